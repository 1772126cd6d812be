"""Where the partitions of an archive are worked on: threads of this process, or the workers of a Dask cluster.

Either calls `process_partition` for each task and hands every outcome to `done`, in the caller's thread. A task may
run twice, and on a worker that dies: that each output is there exactly once is the work of `process_partition`.
"""

from __future__ import annotations

import os
import platform
import secrets
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, ThreadPoolExecutor, wait
from contextlib import contextmanager, nullcontext, suppress
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from granular_id import _core
from granular_id._checks import argument_error
from granular_id._parallel import single_threaded_blas
from granular_id._text import counted
from granular_id.archive.work import Outcome, Task, process_partition
from granular_id.io.errors import need

Done = Callable[[Outcome], None]


def run_tasks(tasks: Sequence[Task], n_jobs: int | None, scheduler: Any, done: Done) -> None:
    """Work in threads of this process, or on the Dask cluster of a scheduler."""
    if scheduler is None:
        run_local(tasks, n_jobs, done)
    else:
        run_dask(tasks, scheduler, done)


def run_local(tasks: Sequence[Task], n_jobs: int | None, done: Done) -> None:
    """Work in threads of this process.

    Parameters
    ----------
    tasks : sequence of Task
        Begun in their order, each when a thread is free.
    n_jobs : int or None
        Threads, as in joblib: None is 1, -1 all cores. BLAS has one thread in each.
    done : callable
        Called in this thread with the `Outcome` of each task, in the order in which they end.

    Raises
    ------
    OSError
        An output cannot be written. No further task is begun; those at work are waited for, as after Ctrl-C.
    """
    from joblib import effective_n_jobs  # slow to import

    n_threads = max(1, min(int(effective_n_jobs(n_jobs)), len(tasks)))
    todo = iter(tasks)
    # One thread is none of the caller's, either: scikit-learn's settings of the caller's decide nothing.
    pool = ThreadPoolExecutor(n_threads, thread_name_prefix="partition")
    with single_threaded_blas():
        try:
            at_work = {pool.submit(process_partition, task) for task in islice(todo, n_threads)}
            while at_work:
                ended, at_work = wait(at_work, return_when=FIRST_COMPLETED)
                at_work |= {pool.submit(process_partition, task) for task in islice(todo, len(ended))}
                for future in ended:
                    done(future.result())
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def run_dask(tasks: Sequence[Task], scheduler: Any, done: Done) -> None:
    """Work on a Dask cluster that runs.

    Tasks and outcomes go through the scheduler, a few KB each; samples and features do not. Client, scheduler and
    workers talk in Dask's own protocol, which carries pickles: whoever reaches their ports can run code as you. No
    pickle is read from archives or outputs. Encryption, timeouts and logging are those of Dask's configuration.

    Parameters
    ----------
    tasks : sequence of Task
    scheduler : str or distributed.Client
        Address of a scheduler (``tcp://host:8786``), or a client that is connected to one: of a ``LocalCluster``,
        ``SLURMCluster`` or ``KubeCluster``. It needs this version of granular_id; its workers that of pyarrow, too,
        and archive and output under the same paths. Workers that come or go meanwhile are used or done without.
    done : callable
        Called in this thread with the `Outcome` of each task, in the order in which they end.

    Raises
    ------
    ConnectionError
        No scheduler answers, or it has gone; what is finished stays.
    ImportError
        distributed is missing.
    OSError
        An output cannot be written; or a worker lacks granular_id, has another version, or does not see the
        archive or the output folder.
    TypeError, ValueError
        No address, or a client that is closed or asynchronous.

    Notes
    -----
    A task whose worker dies runs again on another. One whose workers die again and again (four times, unless Dask is
    configured otherwise) is tried once more when all others are done: alone, so that none fails for its neighbour.
    If it still kills them, its outcome has a `problem`. Ctrl-C cancels what has not begun and closes what was opened.
    """
    distributed = need("distributed", extra="dask", why="to work on a Dask cluster")
    connected = isinstance(scheduler, distributed.Client)
    if connected and scheduler.status != "running":
        raise argument_error(
            ValueError, "scheduler", f"must be a client that is connected, got one that is {scheduler.status}"
        )
    if connected and scheduler.asynchronous:
        raise argument_error(TypeError, "scheduler", "must be a client without asynchronous=True")
    if not tasks:
        return
    with nullcontext(scheduler) if connected else _client(distributed, scheduler) as client:
        _check_workers(client, tasks[0])
        killers = _work_through(distributed, client, tasks, done)
        for task in killers:
            if _work_through(distributed, client, [task], done):
                done(Outcome(task.name, task.n_recordings, problem=f"{_first_place(task)}: {_DIED}"))


_DIED = "the processes that worked on it died, each time (out of memory, or a crash in a library)"


def _first_place(task: Task) -> str:
    file, row_group = task.row_groups[0]
    more = len(task.row_groups) - 1
    return f"{file}, row group {row_group}{f' and {more} more' if more else ''}"


@contextmanager
def _client(distributed: Any, scheduler: Any) -> Iterator[Any]:
    """Connect to an address."""
    try:
        client = distributed.Client(scheduler, set_as_default=False)
    except OSError as error:
        raise ConnectionError(f"scheduler {scheduler}: no Dask scheduler answers there ({error})") from error
    try:
        yield client
    finally:
        client.close()


# What workers are asked and given.


def _versions() -> dict[str, str]:
    """Return the versions that decide the bytes of an output."""
    import pyarrow

    return {"granular_id": _core.__version__, "pyarrow": pyarrow.__version__}


def _unfit(archive: str, seen: str, out: str, versions: Mapping[str, str]) -> str:
    """Say why this process cannot work for the caller, or nothing; `seen` is a file that it must see."""
    for name, version in _versions().items():
        if version != versions[name]:
            return f"has {name} {version}, wanted {versions[name]} as the caller has: install the same version there"
    if not Path(archive).is_dir():
        return f"does not see the archive {archive}: mount it there under the same path"
    if not Path(seen).exists() or not Path(out).is_dir():
        return f"does not see the output folder {out}: mount it there under the same path"
    if not os.access(out, os.W_OK):
        return f"may not write to the output folder {out}"
    return ""


@cache  # of an error nothing is kept: folders may be mounted later
def _check_fit(archive: str, out: str, versions: tuple[tuple[str, str], ...]) -> None:
    problem = _unfit(archive, out, out, dict(versions))
    if problem:
        raise OSError(f"Dask worker {platform.node()}: {problem}")


def _work_on(task: Task, versions: Mapping[str, str]) -> Outcome:
    """Do a task on a worker, which may have come after the others were checked."""
    _check_fit(task.archive, task.out, tuple(versions.items()))
    with single_threaded_blas():
        return process_partition(task)


def _check_workers(client: Any, task: Task) -> None:
    """Refuse workers that cannot do the work, before any begins."""
    if not client.nthreads():
        warnings.warn(
            f"scheduler {client.scheduler.address} has no workers yet: waiting for one", stacklevel=5
        )
        client.wait_for_workers(1)
    seen = Path(task.out, f".{secrets.token_hex(8)}.tmp")
    seen.touch()
    try:
        said = client.run(_unfit, task.archive, str(seen), task.out, _versions(), on_error="return")
    finally:
        seen.unlink(missing_ok=True)
    problems = {
        worker: answer for worker, answer in said.items() if answer and not isinstance(answer, OSError)
    }
    for worker, answer in problems.items():  # what an OSError says is that the worker has gone meanwhile
        lacks = f"cannot load granular_id {_core.__version__} ({answer}): install it there"
        problem = lacks if isinstance(answer, Exception) else answer
        among = f" ({len(problems)} of {counted(len(said), 'worker')})" if len(said) > 1 else ""
        raise OSError(f"Dask worker {worker}{among}: {problem}")


def _work_through(distributed: Any, client: Any, tasks: Sequence[Task], done: Done) -> list[Task]:
    """Have tasks done; return those whose workers died."""
    scheduler = f"scheduler {client.scheduler.address}"  # nothing is known of one that has gone
    # Keys of their own: a result of another call may be of a file that is gone since.
    todo = client.map(_work_on, tasks, key="granular_id", pure=False, batch_size=_BATCH, versions=_versions())
    task_of = dict(zip(todo, tasks, strict=True))
    del todo
    died = []
    try:
        for future in distributed.as_completed(task_of, loop=client.loop):
            task = task_of.pop(future)
            try:
                # Not with_results: where the worker that has a result dies before it is fetched, that never ends.
                outcome = future.result()
            except distributed.KilledWorker:
                died.append(task)
                continue
            except CancelledError as error:
                raise ConnectionError(
                    f"{scheduler} has gone, or its work was cancelled ({error}): what is finished stays; "
                    "call again to go on"
                ) from error
            except Exception as error:
                if isinstance(error, ImportError) or "deserialization" in str(error):
                    raise OSError(
                        f"{scheduler}, or a worker of it, cannot load granular_id {_core.__version__}, or what else "
                        f"the work is made of: install the same there ({error})"
                    ) from error
                raise
            done(outcome)
    finally:
        with suppress(Exception):  # the connection may be lost
            client.cancel(list(task_of))
    return died


_BATCH = 512
"""Tasks in one message to the scheduler: a few MB; Dask warns above 10."""

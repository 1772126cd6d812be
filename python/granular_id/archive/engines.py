"""Where the partitions of an archive are worked on: threads of this process, or the workers of a Dask cluster.

An engine calls `process_partition` for each task and hands every outcome to `done`, in the caller's thread. A task may
run twice, and on a worker that dies: that each output is there exactly once is the work of `process_partition`.
"""

from __future__ import annotations

import logging
import os
import platform
import re
import secrets
import signal
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from itertools import islice
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

from granular_id import _core
from granular_id._checks import argument_error, checked_n_jobs
from granular_id._parallel import single_threaded_blas
from granular_id._text import counted
from granular_id.archive.work import Outcome, Task, process_partition
from granular_id.io.errors import need

Done = Callable[[Outcome], None]


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
    todo = iter(tasks)
    n_threads = _n_workers(n_jobs, len(tasks))
    # One thread is none of the caller's, either: scikit-learn's settings of the caller's decide nothing, in any engine.
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


def run_dask(
    tasks: Sequence[Task],
    scheduler: Any,
    n_jobs: int | None,
    done: Done,
    *,
    dashboard_address: str | None = None,
    tls_ca_file: str | os.PathLike[str] | None = None,
    tls_cert: str | os.PathLike[str] | None = None,
    tls_key: str | os.PathLike[str] | None = None,
) -> None:
    """Work on a Dask cluster: one that is started here and closed at the end, or one that runs.

    Tasks and outcomes go through the scheduler, a few KB each; samples and features do not. Client, scheduler and
    workers talk in Dask's own protocol, which carries pickles: whoever reaches their ports can run code as you. A
    cluster that is started here listens on 127.0.0.1 alone, where other users of this machine still reach it: give
    it the TLS files where you do not trust them. No pickle is read from archives or outputs.

    Parameters
    ----------
    tasks : sequence of Task
    scheduler : str, distributed.Client or None
        Address of a scheduler (``tcp://host:8786``, ``tls://host:8786``), or a client that is connected to one: of a
        ``SLURMCluster`` or ``KubeCluster``. It needs this version of granular_id; its workers that of pyarrow, too,
        and archive and output under the same paths. Workers that come or go meanwhile are used or done without. None
        starts a cluster of processes on this machine; in a script, call it under ``if __name__ == "__main__":`` then.
    n_jobs : int or None
        Processes of the cluster that is started here, as in joblib: None is 1, -1 one a core. Each has one thread.
    done : callable
        Called in this thread with the `Outcome` of each task, in the order in which they end.
    dashboard_address : str, optional
        Where the dashboard of the cluster that is started here listens, if bokeh is installed: 127.0.0.1:8787 by
        default, at another port if that is taken. ``:8787`` is open to all.
    tls_ca_file, tls_cert, tls_key : str or path, optional
        Certificates that Dask encrypts with (PEM), all three. Those in Dask's own configuration are used, too.

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
        Options do not go together, or TLS files do not fit.

    Notes
    -----
    A task whose worker dies runs again on another. One whose workers die again and again (four times, unless Dask is
    configured otherwise) is tried once more when all others are done: alone, so that none fails for its neighbour.
    If it still kills them, its outcome has a `problem`. Ctrl-C cancels what has not begun and closes what was opened.
    """
    distributed = need("distributed", extra="dask", why="to work on a Dask cluster")
    tls = _tls(distributed, tls_ca_file, tls_cert, tls_key)
    own = scheduler is None
    connected = isinstance(scheduler, distributed.Client)
    if not (own or connected or isinstance(scheduler, str)):
        kind = type(scheduler).__name__
        raise argument_error(
            TypeError, "scheduler", f"must be an address or a distributed.Client, got {kind}"
        )
    if connected and scheduler.status != "running":
        raise argument_error(
            ValueError, "scheduler", f"must be a client that is connected, got one that is {scheduler.status}"
        )
    if connected and scheduler.asynchronous:
        raise argument_error(TypeError, "scheduler", "must be a client without asynchronous=True")
    for name, value in {"n_jobs": n_jobs, "dashboard_address": dashboard_address}.items():
        if not own and value is not None:
            wanted = "must be None with a scheduler, whose workers and dashboard are as they are"
            raise argument_error(ValueError, name, f"{wanted}; got {value!r}")
    if dashboard_address is not None and not _HOST_AND_PORT.fullmatch(str(dashboard_address)):
        wanted = "must be HOST:PORT, or :PORT for all that reach this machine"
        raise argument_error(ValueError, "dashboard_address", f"{wanted}; got {dashboard_address!r}")
    if connected and tls is not None:
        raise argument_error(
            ValueError, "tls_ca_file", "must be None with a client, which is connected already"
        )
    n_workers = _n_workers(n_jobs, len(tasks))
    if not tasks:
        return
    with ExitStack() as stack:
        stack.enter_context(_quiet())
        if own:
            scheduler = stack.enter_context(_local_cluster(distributed, n_workers, dashboard_address, tls))
        client = scheduler if connected else stack.enter_context(_client(distributed, scheduler, tls))
        _check_workers(client, tasks[0])
        killers = _work_through(distributed, client, tasks, done)
        for task in killers:
            if _work_through(distributed, client, [task], done):
                done(Outcome(task.name, task.n_recordings, problem=f"{_first_place(task)}: {_DIED}"))


DASK_OPTIONS = ("dashboard_address", "tls_ca_file", "tls_cert", "tls_key")

_DIED = "the processes that worked on it died, each time (out of memory, or a crash in a library)"


def _n_workers(n_jobs: int | None, n_tasks: int) -> int:
    from joblib import effective_n_jobs  # slow to import

    return max(1, min(int(effective_n_jobs(checked_n_jobs(n_jobs))), n_tasks))


def _first_place(task: Task) -> str:
    file, row_group = task.row_groups[0]
    more = len(task.row_groups) - 1
    return f"{file}, row group {row_group}{f' and {more} more' if more else ''}"


def _tls(distributed: Any, ca_file: Any, cert: Any, key: Any) -> Any:
    """Return Dask's settings of encryption, the same files for client, scheduler and workers; None without files."""
    given = {"tls_ca_file": ca_file, "tls_cert": cert, "tls_key": key}
    files = {name: os.fspath(path) for name, path in given.items() if path is not None}
    if not files:
        return None
    missing = next((name for name in given if name not in files), None)
    if missing is not None:
        raise ValueError(f"{missing} is missing: TLS needs {', '.join(given)}")
    for path in files.values():
        Path(path).open("rb").close()  # says the name where it cannot be read; ssl does not
    roles = {f"tls_{role}_{what}": files[f"tls_{what}"] for role in _ROLES for what in ("cert", "key")}
    security = distributed.Security(tls_ca_file=files["tls_ca_file"], require_encryption=True, **roles)
    try:
        security.get_connection_args("client")
    except OSError as error:
        raise ValueError(f"{', '.join(files.values())} do not fit as {', '.join(files)}: {error}") from error
    return security


_HOST_AND_PORT = re.compile(r".*:\d{1,5}")

_ROLES = ("client", "scheduler", "worker")


# Clusters and clients.

_DASHBOARD = "127.0.0.1:8787"

_LEAST_MEMORY = 1 << 30
"""What a worker process may have at least: libraries take 0.3 GB of it before there is any data."""

_ENVIRON = "distributed.nanny.pre-spawn-environ"
_WORKER_ENVIRONMENT = {  # Dask adds one thread for BLAS and arrow, and a threshold above which malloc gives back
    "MALLOC_ARENA_MAX": 2,
    "ARROW_IO_THREADS": 1,
    "DASK_LOGGING__DISTRIBUTED": "critical",
}

_PRELOAD = "import os, sys; sys.stderr = open(os.devnull, 'w')"
"""The terminal is the caller's: what ends a task is raised there. Crashes of libraries write to it all the same."""


def _leave_ctrl_c() -> None:
    """Block Ctrl-C in this thread, in those it starts and in their processes: it is the caller's."""
    if hasattr(signal, "pthread_sigmask"):
        resource_tracker.ensure_running()  # a later start would lift the block
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


@contextmanager
def _local_cluster(
    distributed: Any, n_workers: int, dashboard_address: str | None, tls: Any
) -> Iterator[Any]:
    """Start processes of one thread each on this machine, which listen on 127.0.0.1 alone."""
    import dask.config
    from distributed.system import MEMORY_LIMIT

    settings: dict[str, Any] = {f"{_ENVIRON}.{name}": value for name, value in _WORKER_ENVIRONMENT.items()}
    # Workers keep no data: there is nothing to spill, and one that pauses would never go on.
    settings |= {f"distributed.worker.memory.{what}": False for what in ("target", "spill", "pause")}
    # One task at a time: where its worker dies, no other has to begin again.
    settings |= {"distributed.scheduler.worker-saturation": 1.0}
    # In a thread: Ctrl-C would leave a cluster that has begun to start and cannot be closed.
    with (
        dask.config.set(settings),
        _environment_kept(),
        ThreadPoolExecutor(1, initializer=_leave_ctrl_c) as pool,
    ):
        starting = pool.submit(
            distributed.LocalCluster,
            n_workers=n_workers,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=dashboard_address or _DASHBOARD,
            memory_limit=max(_LEAST_MEMORY, MEMORY_LIMIT // n_workers),
            preload=[_PRELOAD],
            security=tls,
            silence_logs=None,
        )
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", "(?s)Port .* is already in use")
                cluster = starting.result()
            yield cluster
        except RuntimeError as error:
            if starting.exception() is not error:
                raise
            way_out = 'in a script, call this under `if __name__ == "__main__":`'
            raise RuntimeError(
                f"no Dask cluster could be started on this machine ({error}): {way_out}"
            ) from error
        finally:
            if starting.exception() is None:
                starting.result().close()


@contextmanager
def _environment_kept() -> Iterator[None]:
    """Undo what Dask writes into the environment of this process, for its children to inherit."""
    import dask.config

    names = [*dask.config.get(_ENVIRON), "PYTHONHASHSEED"]
    before = {name: os.environ.get(name) for name in names}
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def _client(distributed: Any, scheduler: Any, tls: Any) -> Iterator[Any]:
    """Connect to an address, or to a cluster of this process."""
    if isinstance(scheduler, str):
        _check_address(scheduler, tls or distributed.Security())
    try:
        client = distributed.Client(scheduler, security=tls, set_as_default=False)
    except OSError as error:
        raise ConnectionError(f"scheduler {scheduler}: no Dask scheduler answers there ({error})") from error
    try:
        yield client
    finally:
        client.close()


def _check_address(address: str, security: Any) -> None:
    """Refuse what Dask would refuse half a minute later, or after a minute."""
    import dask.config

    protocol = address.partition("://")[0] if "://" in address else "tcp"
    certified = security.tls_ca_file or dask.config.get("distributed.client.security-loader", None)
    if protocol not in ("tcp", "tls"):
        wanted = "must be an address like tcp://host:8786 or tls://host:8786"
    elif not _HOST_AND_PORT.fullmatch(address.rpartition("/")[2]):
        wanted = "must end in a port, as :8786"
    elif protocol == "tls" and not certified:
        wanted = "needs tls_ca_file, tls_cert and tls_key, or these in Dask's configuration"
    elif protocol == "tcp" and security.require_encryption:
        wanted = "must begin with tls://, for encryption is asked for"
    else:
        return
    raise argument_error(ValueError, "scheduler", f"{wanted}; got {address!r}")


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's loggers from writing into a bar: what ends the work is raised, all else is noise of dying."""
    with ExitStack() as stack:
        for name in ("distributed", "tornado"):
            for handler in logging.getLogger(name).handlers:
                if type(handler) is logging.StreamHandler:  # files are told all
                    stack.callback(handler.setLevel, handler.level)
                    handler.setLevel(logging.CRITICAL + 1)
        yield


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

"""Where partitions are worked on: threads of this process, or the workers of a Dask cluster.

Either calls `make` for each partition and tells `done` its name and what kept it from being computed, or nothing. A
partition may be worked on twice, and on a worker that dies: that its file is there exactly once is the work of `make`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import CancelledError
from contextlib import nullcontext, suppress
from threading import Lock
from typing import Any

from granular_id._parallel import spread
from granular_id.io.files import need

Make = Callable[[Any], str]
Done = Callable[[str, str], None]

_BATCH = 512
"""Partitions in one message to the scheduler: a few MB; Dask warns above 10."""

_DIED = "the processes that worked on it died, each time (out of memory, or a crash in a library)"


def run_in_threads(make: Make, partitions: Mapping[str, Any], n_jobs: int | None, done: Done) -> None:
    """Work in threads of this process. What is raised, or Ctrl-C, begins nothing more; those at work are waited for."""
    from joblib import effective_n_jobs  # slow to import

    one_at_a_time = Lock()

    def work(name: str) -> None:
        problem = make(partitions[name])
        with one_at_a_time:
            done(name, problem)

    spread(work, partitions, int(effective_n_jobs(n_jobs)))


def run_on_cluster(make: Make, partitions: Mapping[str, Any], scheduler: Any, done: Done) -> None:
    """Work on a Dask cluster that runs: an address (``tcp://host:8786``), or a client.

    Partitions and outcomes go through the scheduler, a few hundred bytes each; samples and features do not. A partition
    whose worker dies runs again on another. One whose workers die again and again (four times, unless Dask is
    configured otherwise) is tried once more when all others are done: alone, so that none fails for its neighbour.
    """
    distributed = need("distributed", extra="dask", why="to work on a Dask cluster")
    if not partitions:
        return
    try:
        connected = isinstance(scheduler, distributed.Client)
        opened = nullcontext(scheduler) if connected else distributed.Client(scheduler, set_as_default=False)
    except OSError as error:
        raise ConnectionError(f"scheduler {scheduler}: no Dask scheduler answers there ({error})") from error
    with opened as client:
        _check_versions(client)

        def work(names: Iterable[str]) -> list[str]:
            todo = {name: partitions[name] for name in names}
            return _work_through(distributed, client, make, todo, done)

        for name in work(partitions):
            if work([name]):
                done(name, f"{partitions[name]}: {_DIED}")


def _check_versions(client: Any) -> None:
    """Refuse workers that would make other bytes, before any begins."""
    if not client.nthreads():
        warnings.warn("the scheduler has no workers yet: waiting for one", stacklevel=5)
        client.wait_for_workers(1)
    found = client.get_versions(packages=["granular_id", "pyarrow"])
    for name, wanted in found["client"]["packages"].items():
        for worker, said in found["workers"].items():
            if name in ("granular_id", "pyarrow") and said["packages"][name] != wanted:
                problem = f"has {name} {said['packages'][name]}, wanted {wanted} as the caller has"
                raise OSError(f"Dask worker {worker} {problem}: install it there")


def _work_through(
    distributed: Any, client: Any, make: Make, todo: Mapping[str, Any], done: Done
) -> list[str]:
    """Have partitions done; return those whose workers died."""
    # Keys of their own: a result of another call may be of a file that is gone since.
    futures = client.map(make, [*todo.values()], key="granular_id", pure=False, batch_size=_BATCH)
    names = dict(zip(futures, todo, strict=True))
    del futures
    died = []
    try:
        for future in distributed.as_completed(names, loop=client.loop):
            name = names.pop(future)
            try:
                # Not with_results: where the worker that has a result dies before it is fetched, that never ends.
                problem = future.result()
            except distributed.KilledWorker:
                died.append(name)
            except CancelledError as error:
                gone = f"the scheduler has gone, or its work was cancelled ({error})"
                raise ConnectionError(f"{gone}: what is finished stays; call again to go on") from error
            else:
                done(name, problem)
    finally:
        with suppress(Exception):  # the connection may be lost
            client.cancel(list(names))
    return died

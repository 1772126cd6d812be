"""Where partitions are worked on: threads of this process, or the workers of a Dask cluster.

A partition may be worked on twice, and on a worker that dies: that its file is there exactly once is the work of `make`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from contextlib import nullcontext, suppress
from functools import partial
from typing import Any, NamedTuple

from granular_id.io.files import need

Make = Callable[[Any], str]
Done = Callable[[str, str], None]

_DIED = "the processes that worked on it died, each time (out of memory, or a crash in a library)"


def work_through(
    make: Make, partitions: Mapping[str, Any], done: Done, *, n_jobs: int | None, scheduler: Any
) -> None:
    """Call `make` with each partition, and `done` with its name and what kept it from being made, or nothing.

    Threads as of joblib; or, with a `scheduler`, a Dask cluster that runs: an address (``tcp://host:8786``), or a
    client. Partitions and outcomes go through it, a few hundred bytes each; samples and features do not. What is raised,
    or Ctrl-C, begins nothing more. A partition whose worker dies runs again on another. One whose workers die again and
    again (four times, unless Dask is configured otherwise) is tried once more when all others are done: alone, so that
    none fails for its neighbour.
    """
    if not partitions:
        return
    if scheduler is None:
        from joblib import effective_n_jobs  # slow to import

        with ThreadPoolExecutor(effective_n_jobs(n_jobs)) as pool:
            threads = _Pool(pool.submit, as_completed, lambda _: pool.shutdown(cancel_futures=True))
            _work(threads, make, partitions, done)
        return
    distributed = need("distributed", extra="dask", why="to work on a Dask cluster")
    try:
        connected = isinstance(scheduler, distributed.Client)
        opened = nullcontext(scheduler) if connected else distributed.Client(scheduler, set_as_default=False)
    except OSError as error:
        raise ConnectionError(f"scheduler {scheduler}: no Dask scheduler answers there ({error})") from error
    with opened as client:
        _check_versions(client)
        cluster = _Pool(
            # Not pure: a result of another call may be of a file that is gone since.
            partial(client.submit, pure=False),
            # Not with_results: where the worker that has a result dies before it is fetched, that never ends.
            partial(distributed.as_completed, loop=client.loop),
            client.cancel,
            distributed.KilledWorker,
        )
        for name in _work(cluster, make, partitions, done):
            if _work(cluster, make, {name: partitions[name]}, done):
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


class _Pool(NamedTuple):
    """What threads and a cluster have in common: both have futures."""

    submit: Callable[..., Any]
    completed: Callable[[list[Any]], Iterable[Any]]
    cancel: Callable[[list[Any]], object]
    deaths: type[Exception] | tuple[()] = ()


def _work(pool: _Pool, make: Make, partitions: Mapping[str, Any], done: Done) -> list[str]:
    """Have partitions made; return those whose workers died."""
    futures = {pool.submit(make, one): name for name, one in partitions.items()}
    died = []
    try:
        for future in pool.completed(list(futures)):
            name = futures.pop(future)
            try:
                problem = future.result()
            except pool.deaths:
                died.append(name)
            except CancelledError as error:
                gone = f"the scheduler has gone, or its work was cancelled ({error})"
                raise ConnectionError(f"{gone}: what is finished stays; call again to go on") from error
            else:
                done(name, problem)
    finally:
        with suppress(Exception):  # the connection may be lost
            pool.cancel(list(futures))
    return died

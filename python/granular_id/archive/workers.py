"""Where partitions are worked on: threads of this process, or the workers of a Dask cluster.

A partition may be worked on twice, and on a worker that dies: its file is there exactly once by the work of `make`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from contextlib import nullcontext, suppress
from functools import partial
from typing import Any, NamedTuple

from granular_id import _core
from granular_id._checks import argument_error
from granular_id._core import GranularIdError
from granular_id.io.files import need

Make = Callable[[Any], str]
Done = Callable[[str, str], None]

_BATCH = 512
"""Partitions in one message to the scheduler: a few MB; Dask warns above 10."""

_DIED = "the processes that worked on it died, each time (out of memory, or a crash in a library)"


def check_scheduler(scheduler: Any) -> None:
    """Refuse a text that is no address: a client of such a one would wait for it at the end of the program."""
    if isinstance(scheduler, str):
        need("distributed", extra="dask", why="to work on a Dask cluster")
        from distributed.comm.addressing import get_address_host_port

        try:
            get_address_host_port(scheduler)
        except ValueError as error:
            problem = f"={scheduler!r} is no address such as tcp://host:8786 ({error})"
            raise argument_error(GranularIdError, "scheduler", problem) from error


def work_through(
    make: Make, partitions: Mapping[str, Any], done: Done, *, n_jobs: int | None, scheduler: Any
) -> None:
    """Call `make` with each partition, and `done` with its name and why it could not be made, or nothing."""
    if not partitions:
        return
    if scheduler is None:
        from joblib import effective_n_jobs  # slow to import

        with ThreadPoolExecutor(effective_n_jobs(n_jobs)) as pool:
            threads = _Pool(
                lambda make, items: [pool.submit(make, item) for item in items],
                as_completed,
                lambda _: pool.shutdown(cancel_futures=True),
            )
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
            partial(client.map, pure=False, batch_size=_BATCH),
            # Not with_results: where the worker that has a result dies before it is fetched, that never ends.
            partial(distributed.as_completed, loop=client.loop),
            client.cancel,
            distributed.KilledWorker,
        )
        # Dask tried each of these four times; alone, none fails for its neighbour.
        for name in _work(cluster, make, partitions, done):
            if _work(cluster, make, {name: partitions[name]}, done):
                done(name, f"{partitions[name]}: {_DIED}")


def _check_versions(client: Any) -> None:
    """Refuse workers that would make other bytes, before any begins."""
    if not client.nthreads():
        warnings.warn("the scheduler has no workers yet: waiting for one", stacklevel=5)
        client.wait_for_workers(1)
    for worker, found in client.run(_versions).items():
        if found != _versions():
            problem = f"has {found}, wanted {_versions()} as the caller has: install it there"
            raise OSError(f"Dask worker {worker} {problem}")


def _versions() -> str:
    pyarrow = need("pyarrow", extra="app", why="to work on archives")
    return f"granular_id {_core.__version__} and pyarrow {pyarrow.__version__}"


class _Pool(NamedTuple):
    """What threads and a cluster have in common: both have futures."""

    submit: Callable[[Make, list[Any]], list[Any]]
    completed: Callable[[list[Any]], Iterable[Any]]
    cancel: Callable[[list[Any]], object]
    deaths: type[Exception] | tuple[()] = ()


def _work(pool: _Pool, make: Make, partitions: Mapping[str, Any], done: Done) -> list[str]:
    """Have partitions made; return those whose workers died."""
    futures = dict(zip(pool.submit(make, [*partitions.values()]), partitions, strict=True))
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

"""Work spread over threads that are all gone when it ends, however it ends."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import TypeVar

import threadpoolctl

from granular_id._checks import checked_n_jobs

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_threads(work: Callable[[Item], Result], items: Iterable[Item], n_jobs: int | None) -> list[Result]:
    """`spread` over `n_jobs` threads as in joblib, each with the caller's configuration of scikit-learn."""
    # slow to import, and reading recordings does without
    from joblib import effective_n_jobs
    from sklearn import config_context, get_config

    configuration = get_config()  # scikit-learn keeps one for each thread

    def configured(item: Item) -> Result:
        with config_context(**configuration):
            return work(item)

    return spread(configured, items, effective_n_jobs(checked_n_jobs(n_jobs)))


def spread(work: Callable[[Item], Result], items: Iterable[Item], n_threads: int) -> list[Result]:
    """Do some work for each item; results in the order of the items. One thread is the caller's own.

    When an item fails, or Ctrl-C stops the caller, no further item is begun and those at work are waited for. Of
    several items that fail the first in order is raised.
    joblib's threads are left behind instead: a process that ends meanwhile may be aborted by a thread that comes
    back from compiled code into an interpreter that is no more.
    """
    every = list(items)
    n_threads = min(n_threads, len(every))
    if n_threads <= 1:
        return [work(item) for item in every]
    stopped = threading.Event()

    def unless_stopped(item: Item) -> Result | None:
        if stopped.is_set():
            return None
        try:
            return work(item)
        except BaseException:
            stopped.set()
            raise

    # The caller does nothing but wait: Ctrl-C is raised there, and must not meet it with a lock in its hands.
    pool = ThreadPoolExecutor(n_threads)
    try:
        begun = [pool.submit(unless_stopped, item) for item in every]
        wait(begun)
    finally:
        stopped.set()
        pool.shutdown(wait=True)
    return [done.result() for done in begun]  # type: ignore[misc]  # None only behind an item that raises


_lock = threading.Lock()
_inside = 0
_limits: threadpoolctl.threadpool_limits | None = None


@contextmanager
def single_threaded_blas() -> Iterator[None]:
    """Keep BLAS to one thread inside the block.

    The last bit of a product depends on the number of threads, and an iterative method that rounds differently ends
    elsewhere. The limit belongs to the process, so the first thread that enters sets it and the last that leaves takes
    it back: a limit of its own for each thread would be lifted under those still at work, or stay for ever.
    """
    global _inside, _limits  # noqa: PLW0603 - what they count belongs to the process
    with _lock:
        if _inside == 0:
            _release_openblas()
            _limits = threadpoolctl.threadpool_limits(limits=1, user_api="blas")
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0 and _limits is not None:
                _release_openblas()
                _limits.restore_original_limits()
                _limits = None
                _release_openblas()


def _release_openblas() -> None:
    """Let any thread limit OpenBLAS: from 3.8 on, threadpoolctl listens to the thread that did it first alone."""
    release = getattr(getattr(threadpoolctl, "OpenBLASController", None), "clear_controlling_thread", None)
    if release is not None:
        release(force=True)

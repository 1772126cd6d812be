"""Telling a waiting person how far the work is."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock

__all__ = ["ProgressCallback", "Ticker", "showing"]

ProgressCallback = Callable[[int, int, str], None]
"""Called as ``progress(done, total, what)``: steps finished, steps in all, what the last one was."""


class Ticker:
    """Counts finished steps and passes them on, one call at a time however many threads tick.

    Parameters
    ----------
    total : int
        Steps in all.
    callback : callable or None
        See `ProgressCallback`; None counts in silence.
    """

    def __init__(self, total: int, callback: ProgressCallback | None) -> None:
        self._total = total
        self._callback = callback
        self._done = 0
        self._lock = Lock()

    def tick(self, what: str) -> None:
        """Count one finished step."""
        with self._lock:
            self._done += 1
            if self._callback is not None:
                self._callback(self._done, self._total, what)


@contextmanager
def showing(progress: bool | ProgressCallback) -> Iterator[ProgressCallback | None]:
    """Show progress for the length of a block.

    Parameters
    ----------
    progress : bool or callable
        True draws a bar on standard error when that is a terminal and rich is installed, and is silent
        otherwise; False is silent; a callable is called, see `ProgressCallback`.

    Yields
    ------
    callable or None
        To be called after each step; None when nobody wants to know.
    """
    if callable(progress):
        yield progress
    elif not isinstance(progress, bool):
        raise TypeError(f"progress must be a bool or callable, got {type(progress).__name__}")
    elif progress and sys.stderr.isatty():
        with _bar() as callback:
            yield callback
    else:
        yield None


@contextmanager
def _bar() -> Iterator[ProgressCallback | None]:
    try:
        from rich.console import Console  # noqa: PLC0415 (an extra; the library works without it)
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415
    except ImportError:
        yield None
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)

        def callback(done: int, total: int, what: str) -> None:
            bar.update(task, completed=done, total=total, description=what)

        yield callback

"""Telling a waiting person how far an evaluation is."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock

__all__ = ["ProgressCallback", "Ticker", "ticking"]

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
def ticking(progress: bool | ProgressCallback, total: int) -> Iterator[Ticker]:
    """Show progress for the length of a block.

    Parameters
    ----------
    progress : bool or callable
        True draws a bar on standard error when that is a terminal and rich is installed, and is silent
        otherwise; False is silent; a callable is called, see `ProgressCallback`.
    total : int
        Steps in all.

    Yields
    ------
    Ticker
    """
    if callable(progress):
        yield Ticker(total, progress)
    elif progress and sys.stderr.isatty():
        with _bar(total) as callback:
            yield Ticker(total, callback)
    else:
        yield Ticker(total, None)


@contextmanager
def _bar(total: int) -> Iterator[ProgressCallback | None]:
    try:
        from rich.console import Console  # noqa: PLC0415 (an extra; the library works without it)
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415
    except ImportError:
        yield None
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=total)

        def callback(done: int, total: int, what: str) -> None:
            bar.update(task, completed=done, total=total, description=what)

        yield callback

"""Telling a waiting person how far the work is."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from time import monotonic

from granular_id._checks import argument_error

ProgressCallback = Callable[[int, int, str], None]
"""Called as ``progress(done, total, what)``: steps finished, steps in all, what the last one was."""

_LINE_EVERY_S = 30.0
"""Seconds at least between two lines where no bar can be drawn."""

_SPEED_OVER_S = 3600.0
"""What the time left is judged by: rich looks back 30 s unless told, in which no step may have ended."""


class Ticker:
    """Counts finished steps and passes them on, one call at a time however many threads tick."""

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


def check_progress(progress: bool | ProgressCallback) -> None:
    """Refuse what neither says whether to show progress nor can be called."""
    if not (isinstance(progress, bool) or callable(progress)):
        raise argument_error(
            TypeError, "progress", f"must be a bool or callable, got {type(progress).__name__}"
        )


@contextmanager
def showing(progress: bool | ProgressCallback) -> Iterator[ProgressCallback | None]:
    """Show progress for the length of a block: a bar (rich, on a terminal), lines, nothing, or what a callable does."""
    check_progress(progress)
    if callable(progress):
        yield progress
    elif progress and sys.stderr.isatty():
        with _bar() as callback:
            yield callback
    else:
        yield _lines() if progress else None


def _lines() -> ProgressCallback:
    """Tell in lines how far the work is, and about how long it still takes."""
    start = told = monotonic()

    def callback(done: int, total: int, what: str) -> None:
        nonlocal told
        now = monotonic()
        if now - told < _LINE_EVERY_S or not 0 < done < total:
            return
        told = now
        left = (now - start) / done * (total - done)
        sys.stderr.write(f"{done} of {total}, about {_in_words(left)} left: {what}\n")
        sys.stderr.flush()

    return callback


def _in_words(seconds: float) -> str:
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


@contextmanager
def _bar() -> Iterator[ProgressCallback | None]:
    try:
        from rich.console import Console  # an extra; the library works without it
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
    except ImportError:
        yield _lines()
        return
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    told = Console(stderr=True)
    with Progress(*columns, console=told, transient=True, speed_estimate_period=_SPEED_OVER_S) as bar:
        task = bar.add_task("", total=None)

        def callback(done: int, total: int, what: str) -> None:
            bar.update(task, completed=done, total=total, description=what)

        yield callback

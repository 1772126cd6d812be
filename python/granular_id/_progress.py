"""A line that shows how far the work is."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from time import monotonic

from granular_id._checks import argument_error

ProgressCallback = Callable[[int, int, str], None]
"""Called as ``progress(done, total, what)``: steps finished, steps in all (0: not known), what the last one was."""

_LINE_EVERY_S = 30.0
"""Seconds at least between two lines where no bar can be drawn."""

_SPEED_OVER_S = 3600.0
"""What the time left is judged by: rich looks back 30 s by default, in which no step may have ended."""


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
        with _bar() as step:
            yield step
    else:
        yield _lines() if progress else None


def show_line(progress: bool | ProgressCallback, line: str) -> None:
    """Show a line that stays, above the bar where there is one; nothing where progress is not wanted or a callable."""
    if progress is True:
        print(line, file=sys.stderr, flush=True)


def _lines() -> ProgressCallback:
    """Say in lines how far the work is, and about how long it still takes."""
    start = shown = monotonic()

    def callback(done: int, total: int, what: str) -> None:
        nonlocal shown
        now = monotonic()
        if now - shown >= _LINE_EVERY_S and 0 < done < total:
            shown = now
            left = in_words((now - start) / done * (total - done))
            show_line(True, f"{done} of {total}, about {left} left: {what}")

    return callback


def in_words(seconds: float) -> str:
    """Return a time to wait in a unit that fits."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


@contextmanager
def _bar() -> Iterator[ProgressCallback]:
    try:
        import rich.console  # an extra; the library works without it
        import rich.progress as bars
    except ImportError:
        yield _lines()
        return
    columns = bars.BarColumn(), bars.MofNCompleteColumn(), bars.TimeRemainingColumn()
    with bars.Progress(
        *columns,
        bars.TextColumn("{task.description}"),
        console=rich.console.Console(stderr=True),
        transient=True,
        speed_estimate_period=_SPEED_OVER_S,
    ) as bar:
        task = bar.add_task("", total=None)

        def callback(done: int, total: int, what: str) -> None:
            bar.update(task, completed=done, total=total or None, description=what)

        yield callback

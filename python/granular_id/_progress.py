"""Telling a waiting person how far the work is."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from time import monotonic
from typing import NamedTuple

from granular_id._checks import argument_error

ProgressCallback = Callable[[int, int, str], None]
"""Called as ``progress(done, total, what)``: steps finished, steps in all (0: not known), what the last one was."""

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


class Display(NamedTuple):
    """Where progress is shown."""

    step: ProgressCallback | None
    line: Callable[[str], None]
    """Shows a line that stays, above the bar where there is one; nothing where progress is not wanted or a callable."""


TimeLeft = Callable[[], float | None]
"""Seconds left, or None where that is not known."""


@contextmanager
def showing(progress: bool | ProgressCallback) -> Iterator[ProgressCallback | None]:
    """Show progress for the length of a block: a bar (rich, on a terminal), lines, nothing, or what a callable does."""
    with displaying(progress) as display:
        yield display.step


@contextmanager
def displaying(progress: bool | ProgressCallback, left: TimeLeft | None = None) -> Iterator[Display]:
    """Show progress as `showing` does, and lines beside it; `left` knows more than the mean time of a step."""
    check_progress(progress)
    if callable(progress):
        yield Display(progress, _silent)
    elif progress and sys.stderr.isatty():
        with _bar(left) as display:
            yield display
    else:
        yield Display(_lines(left), _write) if progress else Display(None, _silent)


def _silent(_: str) -> None:
    """Show nothing."""


def _write(line: str) -> None:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


def _lines(left: TimeLeft | None) -> ProgressCallback:
    """Tell in lines how far the work is, and about how long it still takes."""
    start = told = monotonic()

    def callback(done: int, total: int, what: str) -> None:
        nonlocal told
        now = monotonic()
        if now - told < _LINE_EVERY_S or not 0 < done < total:
            return
        told = now
        seconds = (now - start) / done * (total - done) if left is None else left()
        about = "" if seconds is None else f", about {in_words(seconds)} left"
        _write(f"{done} of {total}{about}: {what}")

    return callback


def in_words(seconds: float) -> str:
    """Return a time to wait in a unit that fits."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


@contextmanager
def _bar(left: TimeLeft | None) -> Iterator[Display]:
    try:
        import rich.console  # an extra; the library works without it
        import rich.progress
    except ImportError:
        yield Display(_lines(left), _write)
        return
    remaining = () if left is not None else (rich.progress.TimeRemainingColumn(),)
    what_is_done = rich.progress.BarColumn(), rich.progress.MofNCompleteColumn()
    columns = (*what_is_done, *remaining, rich.progress.TextColumn("{task.description}"))
    told = rich.console.Console(stderr=True)
    with rich.progress.Progress(
        *columns, console=told, transient=True, speed_estimate_period=_SPEED_OVER_S
    ) as bar:
        task = bar.add_task("", total=None)

        def callback(done: int, total: int, what: str) -> None:
            seconds = None if left is None else left()
            about = "" if seconds is None else f"about {in_words(seconds)} left: "
            bar.update(task, completed=done, total=total or None, description=f"{about}{what}")

        def line(text: str) -> None:
            bar.console.print(text, markup=False, highlight=False, soft_wrap=True)

        yield Display(callback, line)

"""Telling accuracies as soon as they are known, and from measured costs how long the rest takes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Lock
from time import monotonic
from typing import Any

from granular_id._progress import ProgressCallback

_LINE_EVERY_S = 30.0
"""Seconds at least between two lines on the time left where no bar can be drawn."""

_MOST_GROWTH = 1.2
"""The time left that was told grows by no more than this factor."""


class Run:
    """One feature space under one protocol, or one control: how many partitions, and how long those done took."""

    def __init__(self, name: str, protocol: str, n_partitions: int) -> None:
        self.name, self.protocol, self.n_partitions = name, protocol, n_partitions
        self.n_done = 0
        self.begun: float | None = None
        self.seconds = 0.0

    def left(self, of_one: float | None) -> float | None:
        """Seconds of the partitions that are not done; `of_one`: of another run of the same space."""
        missing = self.n_partitions - self.n_done
        if self.n_done:
            of_one = self.seconds / self.n_done
        return None if of_one is None and missing else missing * (of_one or 0.0)


class Teller:
    """Passes on finished steps, one call at a time however many threads tick; each run ends with a line of its own."""

    def __init__(
        self, runs: Sequence[Run], step: ProgressCallback | None, line: Callable[[str], None]
    ) -> None:
        self.runs = runs
        self._step, self._line = step, line
        self._total = sum(run.n_partitions + 1 for run in runs)
        self._done = 0
        self._told = float("inf")
        self._lock = Lock()
        self._current: Run | None = None

    def begin(self, run: Run) -> None:
        """Say which run the next steps belong to."""
        self._current = run
        run.begun = monotonic()

    def tick(self, what: str) -> None:
        """Count a finished partition of the run that was begun."""
        with self._lock:
            run = self._current
            if run is not None and run.begun is not None:
                run.n_done += 1
                run.seconds = monotonic() - run.begun
            self._pass_on(what)

    def tell(self, line: str) -> None:
        """Count the end of a run, and show what it found."""
        with self._lock:
            self._line(line)
            self._pass_on(line)

    def _pass_on(self, what: str) -> None:
        self._done += 1
        if self._step is not None:
            self._step(self._done, self._total, what)

    def left(self) -> float | None:
        """Seconds left by what the runs took so far, never more than a fifth above what was told; None: not known."""
        measured = {run.name: run.seconds / run.n_done for run in self.runs if run.n_done}
        cheapest = min(measured.values(), default=None)
        every = [run.left(measured.get(run.name, None if run.protocol else cheapest)) for run in self.runs]
        if any(seconds is None for seconds in every):
            return None
        self._told = min(sum(seconds for seconds in every if seconds is not None), _MOST_GROWTH * self._told)
        return self._told


def in_words(seconds: float) -> str:
    """Return a time to wait in a unit that fits."""
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"


@contextmanager
def telling(progress: bool | ProgressCallback, runs: Sequence[Run]) -> Iterator[Teller]:
    """Show steps for the length of a block: a bar with lines above it on a terminal, lines elsewhere, or a callable."""
    if callable(progress):
        yield Teller(runs, progress, _silent)
    elif not progress:
        yield Teller(runs, None, _silent)
    elif sys.stderr.isatty() and (parts := _rich()) is not None:
        with _bar(runs, *parts) as teller:
            yield teller
    else:
        yield _in_lines(runs)


def _silent(_: str) -> None:
    """Show nothing."""


def _write(line: str) -> None:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


def _in_lines(runs: Sequence[Run]) -> Teller:
    told = monotonic()

    def step(done: int, total: int, what: str) -> None:
        nonlocal told
        if monotonic() - told < _LINE_EVERY_S or done >= total:
            return
        told = monotonic()
        left = teller.left()
        _write(f"{done} of {total}{'' if left is None else f', about {in_words(left)} left'}: {what}")

    teller = Teller(runs, step, _write)
    return teller


def _rich() -> tuple[Any, Any] | None:
    try:
        from rich import console, progress  # an extra; the library works without it
    except ImportError:
        return None
    return console, progress


@contextmanager
def _bar(runs: Sequence[Run], console: Any, progress: Any) -> Iterator[Teller]:
    columns = progress.BarColumn(), progress.MofNCompleteColumn(), progress.TextColumn("{task.description}")
    with progress.Progress(*columns, console=console.Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)

        def step(done: int, total: int, what: str) -> None:
            left = teller.left()
            about = "" if left is None else f"about {in_words(left)} left: "
            bar.update(task, completed=done, total=total, description=f"{about}{what}")

        def line(text: str) -> None:
            bar.console.print(text, markup=False, highlight=False, soft_wrap=True)

        teller = Teller(runs, step, line)
        yield teller

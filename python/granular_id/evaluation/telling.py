"""Telling accuracies as soon as they are known, and from measured costs how long the rest takes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from time import monotonic

from granular_id._progress import ProgressCallback, Ticker, displaying

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


class Teller(Ticker):
    """Passes on finished steps; each run ends with a line of its own, inside `shown`."""

    def __init__(self, runs: Sequence[Run]) -> None:
        super().__init__(sum(run.n_partitions + 1 for run in runs), None)
        self.runs = runs
        self._told = float("inf")
        self._current: Run | None = None

    @contextmanager
    def shown(self, progress: bool | ProgressCallback) -> Iterator[Teller]:
        """Show steps and lines for the length of a block."""
        with displaying(progress, self.left) as (self._callback, self._line):
            yield self

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

    def left(self) -> float | None:
        """Seconds left by what the runs took so far, never more than a fifth above what was told; None: not known."""
        measured = {run.name: run.seconds / run.n_done for run in self.runs if run.n_done}
        cheapest = min(measured.values(), default=None)
        every = [run.left(measured.get(run.name, None if run.protocol else cheapest)) for run in self.runs]
        if any(seconds is None for seconds in every):
            return None
        self._told = min(sum(seconds for seconds in every if seconds is not None), _MOST_GROWTH * self._told)
        return self._told

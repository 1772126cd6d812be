"""Rows as they leave a buffer: cut, joined, and timed by their clocks; what captures and triggers look at."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granular_id._core import Block
from granular_id._text import fixed
from granular_id.live.source import SourceInfo
from granular_id.recording import SampleFlag

__all__ = [
    "BAD",
    "ArrivalClock",
    "GapFiller",
    "HoppingWindows",
    "Rows",
    "measured_rate_hz",
    "start_utc_s",
    "timing_in_words",
    "timing_of",
]

_COLUMNS = ("wrench", "time_s", "host_ns", "flags", "missing_before")

BAD = np.uint8(SampleFlag.SATURATED | SampleFlag.BAD_STATUS)
"""Marks of rows that tell no force; those at either end of a gap hold in between, too."""

_DRIFT = 1e-4
"""No two clocks agree better than this, relative, whatever tolerance is requested."""


@dataclass(frozen=True)
class Rows:
    """Some rows in order: a piece of one block, or several joined."""

    wrench: NDArray[np.float64]
    time_s: NDArray[np.float64]
    host_ns: NDArray[np.int64]
    flags: NDArray[np.uint8]
    missing_before: NDArray[np.int64]

    @classmethod
    def of(cls, block: Block) -> Rows:
        """Take the rows of a block."""
        host_ns, missing = (np.asarray(c).astype(np.int64) for c in (block.host_ns, block.missing_before))
        return cls(block.wrench, block.time_s, host_ns, block.flags, missing)

    @classmethod
    def none(cls) -> Rows:
        """Return no rows."""
        numbers = np.zeros(0, np.int64)
        return cls(np.zeros((0, 6)), np.zeros(0), numbers, np.zeros(0, np.uint8), numbers)

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """Put parts behind one another; those without rows say nothing of the number of axes."""
        parts = [part for part in parts if len(part)] or list(parts[-1:])
        if not parts:
            return cls.none()
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS))

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, rows: slice) -> Rows:
        return Rows(*(getattr(self, name)[rows] for name in _COLUMNS))


class GapFiller:
    """Puts a straight line, flagged, into gaps of at most `max_gap` instants of rows that come piece by piece."""

    def __init__(self, max_gap: int) -> None:
        self._max_gap, self._last = max_gap, Rows.none()

    def begin_anew(self) -> None:
        """Say that the next rows do not join those of before."""
        self._last = Rows.none()

    def fill(self, block: Block) -> Rows:
        """Return the rows of a block, at least one, with those that were missing."""
        rows = Rows.of(block)
        missing = rows.missing_before
        if not len(self._last):
            missing[0] = 0  # before the first row it is nobody's loss
        parts, done = [], 0
        for at in np.flatnonzero((missing > 0) & (missing <= self._max_gap)).tolist():
            left = rows[at - 1 : at] if at else self._last
            parts += [rows[done:at], _between(left, rows[at : at + 1], int(missing[at]))]
            missing[at], done = 0, at
        self._last = rows[-1:]
        return Rows.joined([*parts, rows[done:]])


def _between(left: Rows, right: Rows, n: int) -> Rows:
    share = np.arange(1, n + 1) / (n + 1)
    return Rows(
        left.wrench + share[:, np.newaxis] * (right.wrench - left.wrench),
        left.time_s + share * (right.time_s - left.time_s),
        np.repeat(right.host_ns, n),
        np.repeat((left.flags | right.flags) & BAD | np.uint8(SampleFlag.GAP_FILLED), n),
        np.zeros(n, dtype=np.int64),
    )


class HoppingWindows:
    """Cuts a stream into windows of `n` rows, one every `hop` rows; they begin anew where rows were lost."""

    def __init__(self, n: int, hop: int, max_gap: int = 0) -> None:
        self._n, self._hop, self._skip = n, hop, 0
        self._epoch: int | None = None
        self._gaps, self._rows = GapFiller(max_gap), Rows.none()
        self.n_lost = 0  # how often it began anew because rows were lost
        self.begins_anew = True  # no window is complete since the beginning, or since it began anew

    def restart(self) -> None:
        """Let the next rows begin a window, whatever came before."""
        self._epoch = None

    def feed(self, block: Block) -> Iterator[Rows]:
        """Take the next rows of the stream; yield the windows that they complete, in order."""
        if not len(block):
            return
        if block.epoch != self._epoch or block.missed:
            self.n_lost += bool(block.missed) and self._epoch is not None
            self._begin_anew()
            self._gaps.begin_anew()
        self._epoch = block.epoch
        rows, done = self._gaps.fill(block), 0
        for at in np.flatnonzero(rows.missing_before).tolist():
            yield from self._cut(rows[done:at])
            self.n_lost += 1
            self._begin_anew()
            done = at
        yield from self._cut(rows[done:])

    def _begin_anew(self) -> None:
        self._rows, self._skip, self.begins_anew = Rows.none(), 0, True

    def _cut(self, rows: Rows) -> Iterator[Rows]:
        skipped = min(self._skip, len(rows))
        self._skip -= skipped
        self._rows = Rows.joined([self._rows, rows[skipped:]])
        while len(self._rows) >= self._n:
            window = self._rows[: self._n]
            self._skip = max(0, self._hop - len(self._rows))
            self._rows, self.begins_anew = self._rows[self._hop :], False
            yield window


def measured_rate_hz(rows: Rows, info: SourceInfo) -> float:
    """Return the rate of at least two rows without gaps, by the sensor's own time, or else by when they came in."""
    times = rows.time_s if info.device_clock else 1e-9 * info.speed * (rows.host_ns - rows.host_ns[0])
    period_s = _slope(times - times[0])  # a single late row weighs little
    return 1.0 / period_s if period_s > 0 else float("inf")


def _slope(values: NDArray[np.float64]) -> float:
    step = np.arange(len(values)) - 0.5 * (len(values) - 1)
    return float(step @ values) / float(step @ step)


def start_utc_s(rows: Rows, origin_utc_s: float) -> float:
    """Return the time of day of the first row, s since 1970; `origin_utc_s` is that of the monotonic clock's zero."""
    # Rows come late, never early: the one that came soonest after its device time tells how the clocks stand.
    offset_s = float(np.min(1e-9 * rows.host_ns - rows.time_s))
    return round(origin_utc_s + float(rows.time_s[0]) + offset_s, 6)


def timing_of(rows: Rows, info: SourceInfo) -> dict[str, float]:
    """Return how at least two rows came in, see `Push.timing`."""
    timing = {"rate_hz": measured_rate_hz(rows, info)}
    if info.speed == 1:
        delays_s = 1e-9 * (rows.host_ns - rows.host_ns[0]) - (rows.time_s - rows.time_s[0])
        drift_s = _slope(delays_s) * np.arange(len(rows))
        timing["jitter_s"] = round(float(np.std(delays_s - drift_s)), 6)
        timing["late_s"] = round(float(np.ptp(delays_s)), 6)
    return timing


def timing_in_words(timing: Mapping[str, float] | None) -> list[tuple[str, str]]:
    """Return names and values of `Push.timing` as they are shown; nothing where there is none."""
    known = timing or {}
    return [
        (name, f"{fixed(1e3 * known[key], 1)} ms" if key.endswith("_s") else f"{fixed(known[key], 2)} Hz")
        for name, key in (("rate", "rate_hz"), ("jitter", "jitter_s"), ("late", "late_s"))
        if key in known
    ]


class ArrivalClock:
    """Tells when rows were due by the host's clock: those that come late do not count, those that came soonest do."""

    # The sensor's clock may run by `drift`, relative, faster or slower than `speed` device seconds per second.
    def __init__(self, speed: float, drift: float) -> None:
        self._per_second, self._drift = 1e9 / speed, max(drift, _DRIFT)
        self._first: tuple[float, int] | None = None
        self._offset = float("inf")

    def due_ns(self, rows: Rows) -> NDArray[np.int64]:
        """Return when the next rows were due, shape (n,): not later than they came, and the same in any pieces."""
        if self._first is None:
            self._first = float(rows.time_s[0]), int(rows.host_ns[0])
        device_ns = self._per_second * (rows.time_s - self._first[0])
        # The offset of a clock that is slower grows: what is least of (offset - drift) follows it.
        tilted = (1 + self._drift) * device_ns
        late_ns = rows.host_ns - self._first[1] - tilted
        offset = np.minimum.accumulate(np.concatenate([[self._offset], late_ns]))[1:]
        self._offset = float(offset[-1])
        return self._first[1] + np.rint(tilted + offset).astype(np.int64)

"""Rows as they leave a buffer: cut, joined, and told by their clocks; what captures and triggers look at."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from granular_id._text import fixed
from granular_id.recording import SampleFlag

__all__ = [
    "ArrivalClock",
    "BlockLike",
    "GapFiller",
    "HoppingWindows",
    "Rows",
    "filled",
    "late_s",
    "measured_rate_hz",
    "start_utc_s",
    "timing_in_words",
    "timing_of",
]

_COLUMNS = ("wrench", "time_s", "host_ns", "flags", "missing_before")

_DRIFT = 1e-4
"""No two clocks agree better than this, relative, whatever tolerance is asked for."""


class BlockLike(Protocol):
    """What `WrenchReader.read` returns, as far as a capture needs it; arrays of n rows."""

    @property
    def wrench(self) -> NDArray[np.float64]:
        """Shape (n, C): six axes of a wrench in N and N m, or those of another sensor."""

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Device time."""

    @property
    def host_ns(self) -> NDArray[Any]:
        """When each row came in, by the host's monotonic clock."""

    @property
    def flags(self) -> NDArray[np.uint8]:
        """Bits of `SampleFlag`."""

    @property
    def missing_before(self) -> NDArray[Any]:
        """Instants without a row since the row before."""

    @property
    def epoch(self) -> int:
        """How often device time has begun anew; one value for the whole block."""

    @property
    def missed(self) -> int:
        """Rows overwritten before this block, because it was read too late."""

    def __len__(self) -> int: ...


@dataclass(frozen=True)
class Rows:
    """Some rows in order: a piece of one block, or several joined; the columns are those of `BlockLike`."""

    wrench: NDArray[np.float64]
    time_s: NDArray[np.float64]
    host_ns: NDArray[np.int64]
    flags: NDArray[np.uint8]
    missing_before: NDArray[np.int64]

    @classmethod
    def of(cls, block: BlockLike) -> Rows:
        """Take the rows of a block."""
        host_ns, missing = (np.asarray(c).astype(np.int64) for c in (block.host_ns, block.missing_before))
        return cls(block.wrench, block.time_s, host_ns, block.flags, missing)

    @classmethod
    def none(cls, n_axes: int = 6) -> Rows:
        """Return no rows."""
        numbers = np.zeros(0, np.int64)
        return cls(np.zeros((0, n_axes)), np.zeros(0), numbers, np.zeros(0, np.uint8), numbers)

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


def filled(before: Rows, rows: Rows, max_gap: int) -> Rows:
    """Put a straight line into gaps of at most `max_gap` instants, flagged ``GAP_FILLED``; longer ones stay.

    `before` is the row before the first one, none where that misses nothing. What is saturated or of bad status at
    either end is so in between.
    """
    small = (rows.missing_before > 0) & (rows.missing_before <= max_gap)
    if not small.any():
        return rows
    line, shift = Rows.joined([before, rows]), len(before)
    parts, done = [], 0
    for at in np.flatnonzero(small).tolist():
        left, right = line[at + shift - 1 : at + shift], line[at + shift : at + shift + 1]
        parts += [rows[done:at], _between(left, right, int(rows.missing_before[at]))]
        done = at
    whole = Rows.joined([*parts, rows[done:]])
    return replace(whole, missing_before=np.where(whole.missing_before > max_gap, whole.missing_before, 0))


_PASSED_ON = np.uint8(SampleFlag.SATURATED | SampleFlag.BAD_STATUS)


def _between(left: Rows, right: Rows, n: int) -> Rows:
    share = np.arange(1, n + 1) / (n + 1)
    return Rows(
        left.wrench + share[:, np.newaxis] * (right.wrench - left.wrench),
        left.time_s + share * (right.time_s - left.time_s),
        np.repeat(right.host_ns, n),
        np.repeat((left.flags | right.flags) & _PASSED_ON | np.uint8(SampleFlag.GAP_FILLED), n),
        np.zeros(n, dtype=np.int64),
    )


class GapFiller:
    """Fills small gaps in rows that come piece by piece; what is missing before the first row is nobody's loss."""

    def __init__(self, max_gap: int) -> None:
        self._max_gap = max_gap
        self.begin_anew()

    def begin_anew(self) -> None:
        """Say that the next rows do not join those of before."""
        self._last = Rows.none()

    def fill(self, block: BlockLike) -> Rows:
        """Return the rows of a block, at least one, with those that were missing; see `filled`."""
        rows = Rows.of(block)
        if not len(self._last):
            rows.missing_before[0] = 0
        rows = filled(self._last, rows, self._max_gap)
        self._last = rows[-1:]
        return rows


class HoppingWindows:
    """Cuts a stream into windows of `n` rows, one every `hop` rows, whatever pieces it comes in.

    Gaps of at most `max_gap` instants are filled, flagged; at longer ones, at rows that were overwritten and at a new
    epoch the windows begin anew.
    """

    def __init__(self, n: int, hop: int, max_gap: int = 0) -> None:
        self._n, self._hop = n, hop
        self._epoch: int | None = None
        self._gaps, self._rows = GapFiller(max_gap), Rows.none()
        self._skip = 0
        self.n_lost = 0
        """How often it began anew because rows were lost."""
        self.begins_anew = True
        """Whether no window is complete since the beginning, or since it began anew."""

    def feed(self, block: BlockLike) -> Iterator[Rows]:
        """Take the next rows of the stream; yield the windows that they complete, in order."""
        if not len(block):
            return
        if block.epoch != self._epoch or block.missed:
            self.n_lost += bool(block.missed) and self._epoch is not None
            self._begin_anew()
            self._gaps.begin_anew()
        self._epoch = block.epoch
        rows = self._gaps.fill(block)
        edges = [*np.flatnonzero(rows.missing_before > 0).tolist(), len(rows)]
        yield from self._cut(rows[: edges[0]])
        for begin, end in pairwise(edges):
            self.n_lost += 1
            self._begin_anew()
            yield from self._cut(rows[begin:end])

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


def measured_rate_hz(rows: Rows, *, device_clock: bool) -> float:
    """Return the rate of at least two rows without gaps: the slope of a straight line through their times.

    By the sensor's own time, or by when they came in, where a single late row weighs little.
    """
    times = rows.time_s if device_clock else 1e-9 * (rows.host_ns - rows.host_ns[0])
    step = np.arange(len(rows)) - 0.5 * (len(rows) - 1)
    slope_s = float(step @ (times - times[0])) / float(step @ step)
    return 1.0 / slope_s if slope_s > 0 else float("inf")


def start_utc_s(rows: Rows, origin_utc_s: float) -> float:
    """Return the time of day of the first row, s since 1970; `origin_utc_s` is that of the monotonic clock's zero.

    Rows arrive late, never early: the row that needed least time after its device time tells how the clocks
    stand (the lower envelope of host minus device).
    """
    offset_s = float(np.min(1e-9 * rows.host_ns - rows.time_s))
    return round(origin_utc_s + float(rows.time_s[0]) + offset_s, 6)


def late_s(rows: Rows) -> float:
    """Return how late rows came in at most, against the one that came soonest after its device time."""
    return round(float(np.ptp(_delays_s(rows))), 6)


def timing_of(rows: Rows, rate_hz: float, *, real_time: bool) -> dict[str, float]:
    """Return how at least two rows came in: `rate_hz` as measured; jitter and lateness where device time is real time.

    Jitter is the standard deviation of the delays, without what the clocks drift.
    """
    told = {"rate_hz": rate_hz}
    if real_time:
        delays_s = _delays_s(rows)
        step = np.arange(len(rows)) - 0.5 * (len(rows) - 1)
        left_s = delays_s - delays_s.mean() - step * (float(step @ delays_s) / float(step @ step))
        told |= {"jitter_s": round(float(np.sqrt(np.mean(left_s**2))), 6), "late_s": late_s(rows)}
    return told


def timing_in_words(timing: Mapping[str, float] | None) -> list[tuple[str, str]]:
    """Return names and values of what `timing_of` gives as they are shown; nothing where there is none."""
    known = timing or {}
    return [
        (name, f"{fixed(1e3 * known[key], 1)} ms" if key.endswith("_s") else f"{fixed(known[key], 2)} Hz")
        for name, key in (("rate", "rate_hz"), ("jitter", "jitter_s"), ("late", "late_s"))
        if key in known
    ]


def _delays_s(rows: Rows) -> NDArray[np.float64]:
    delays_s: NDArray[np.float64] = 1e-9 * (rows.host_ns - rows.host_ns[0]) - (rows.time_s - rows.time_s[0])
    return delays_s


class ArrivalClock:
    """Tells when rows were due by the host's clock: rows that come late do not count, only those that came soonest.

    `speed` is device seconds per second; the sensor's clock may run `drift` faster or slower than that, relative.
    """

    def __init__(self, speed: float, drift: float) -> None:
        self._per_second, self._drift = 1e9 / speed, max(drift, _DRIFT)
        self._first: tuple[float, int] | None = None
        self._offset = float("inf")

    def due_ns(self, time_s: NDArray[np.float64], arrived_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return when the next rows were due, shape (n,): not later than they came, and the same in any pieces."""
        if not len(time_s):
            return arrived_ns
        if self._first is None:
            self._first = float(time_s[0]), int(arrived_ns[0])
        device_ns = self._per_second * (time_s - self._first[0])
        host_ns = arrived_ns - self._first[1]
        # The offset of a clock that is slower grows: what is least of (offset - drift) follows it.
        tilted = (1 + self._drift) * device_ns
        offset = np.minimum.accumulate(np.concatenate([[self._offset], host_ns - tilted]))[1:]
        self._offset = float(offset[-1])
        return self._first[1] + np.rint(tilted + offset).astype(np.int64)

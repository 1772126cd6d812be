"""From samples and their time stamps to a ``Recording``: the one place that decides what the clock means."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.columns import TAKEN, factor
from granular_id.io.errors import RecordingFileError
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileSource
from granular_id.recording import (
    STATED_TOLERANCE,
    Recording,
    SampleFlag,
    largest_offset,
    repair_time,
    uniform_rate,
)

Locate = Callable[[int | None], dict[str, Any]]
"""From a sample (None: the file as a whole) to the place that an error names: ``line=``, ``column=``, ``place=``."""

SINCE_1970 = 1e8
"""Stamps above this (1973) are seconds since 1970; below, a clock of the recording's own."""

NOT_SECONDS = 1e11
"""Stamps above this (the year 5138) count milliseconds or less since 1970."""

RATE_TOLERANCE = 0.01
"""Rates and clocks that a file states of the same samples may differ by this part."""

_UNIT_OUT = (
    "pass time_unit= ('s', 'ms', 'us', 'ns', or 'sample' with a rate for an index) if they are no seconds"
)
_WAY_OUT = f"save the one that is true, or {_UNIT_OUT}"

_LONGEST_STEP_S, _SHORTEST_STEP_S = 1.0, 1e-5
"""Forces are sampled faster than once a second, and slower than at 100 kHz."""


def stamped_recording(
    wrench: NDArray[np.float64],
    source: FileSource,
    options: LoadOptions,
    *,
    scales: tuple[float, ...] | None = None,
    stamps: NDArray[np.float64] | None,
    start_time: float | None,
    flags: NDArray[np.uint8] | None = None,
    trigger: int | None = None,
    label: str | None = None,
    session: str | None = None,
    axes: tuple[str, ...],
    meta: Mapping[str, Any] | None,
    locate: Locate,
    clock: str = "time",
    time_unit: str | None,
    file_rate_hz: float | None = None,
) -> tuple[Recording, dict[str, Any]]:
    """Make a recording of samples (T, C) and, where there are any, their stamps (T,).

    `scales` make N and N m of each axis. A start time, trigger or rate of the source comes first. `stamps` are in
    `time_unit`, where the file or its format states it, else in that of the options, or in seconds if that is likely;
    `start_time` is that of the first sample, seconds since 1970, where they do not carry it. `file_rate_hz` is what the
    file states beside the stamps, or instead of them; `clock` is how errors call them. The remarks say what was
    repaired, and where the clock begins if not at 0.
    """
    if source.trigger_index is not None:
        trigger = source.trigger_index
    if scales is not None:
        wrench = wrench * scales
    found = _Stamped(wrench, stamps, flags, trigger, source, options, locate, clock, file_rate_hz)
    if stamps is not None:
        found.to_seconds(time_unit)
        found.order_time()
        found.refuse_unlikely(time_unit)
    rate_hz, time_s, since_1970 = found.clock_of()
    known = (source.start_time, start_time, since_1970)
    try:
        recording = Recording(
            found.wrench,
            rate_hz=rate_hz,
            label=label,
            session=session,
            start_time=next((time for time in known if time is not None), None),
            trigger_index=found.trigger,
            time_s=time_s,
            meta=meta or {},
            flags=found.flags,
            name=source.name,
            axes=axes,
        )
    except (TypeError, ValueError) as error:
        raise RecordingFileError(source.path, str(error)) from error
    return recording, found.remarks


def unlikely_step(step_s: float) -> str | None:
    """Say why a time between samples is most likely not in seconds, and what to do; None where it may be."""
    if _SHORTEST_STEP_S < step_s < _LONGEST_STEP_S:
        return None
    guess = "milliseconds, microseconds, nanoseconds or an index" if step_s > 1e-3 else "minutes or days"
    return f"that would be {1 / step_s:.3g} Hz; most likely it counts {guess}: {_UNIT_OUT}, or save seconds"


@dataclass
class _Stamped:
    """Samples on their way to a recording."""

    wrench: NDArray[np.float64]
    stamps: NDArray[np.float64] | None
    flags: NDArray[np.uint8] | None
    trigger: int | None
    source: FileSource
    options: LoadOptions
    locate: Locate
    clock: str
    file_rate_hz: float | None
    remarks: dict[str, Any] = field(default_factory=dict)

    @property
    def stated_hz(self) -> float | None:
        """The rate that the user states."""
        return self.options.rate_hz if self.source.rate_hz is None else self.source.rate_hz

    def fault(self, problem: str, sample: int | None = None) -> RecordingFileError:
        return RecordingFileError(self.source.path, problem, **self.locate(sample))

    def to_seconds(self, stated: str | None) -> None:
        """Convert stamps from the unit that the file or the user states."""
        assert self.stamps is not None
        asked = self.options.time_unit
        if asked == "sample":
            rate_hz = self.file_rate_hz if self.stated_hz is None else self.stated_hz
            if stated is not None or rate_hz is None:
                came = f"the file says that its stamps are in {stated}" if rate_hz else "no rate is stated"
                raise self.fault(f"time_unit='sample', but {came}")
            self.stamps = self.stamps / rate_hz
            return
        scales = [None if unit is None else factor(unit, "s") for unit in (stated, asked)]
        if stated is not None and scales[0] is None:
            raise self.fault(f"stamps are in {stated!r:.40}; wanted {TAKEN['s']}")
        if None not in scales and scales[0] != scales[1]:
            raise self.fault(f"time_unit={asked!r}, but the file says that its stamps are in {stated}")
        scale = next((scale for scale in scales if scale is not None), 1.0)
        self.stamps = self.stamps if scale == 1 else self.stamps / round(1 / scale)

    def order_time(self) -> None:
        """Make sure that stamps ascend: refuse the first one that does not, or repair them all if asked to."""
        stamps = self.stamps
        assert stamps is not None
        if abs(stamps[0]) > NOT_SECONDS:
            cannot = f"{stamps[0]:.6g} cannot be seconds since 1970 (milliseconds or nanoseconds?)"
            raise self.fault(f"{cannot}; wanted seconds, or time_unit='ms', 'us' or 'ns'", 0)
        wrong = np.flatnonzero(stamps[1:] <= stamps[:-1])
        if not len(wrong):
            return
        first = int(wrong[0])
        if self.options.on_time_error == "raise":
            before, after = float(stamps[first]), float(stamps[first + 1])
            what = f"time runs back from {before!r} to {after!r}"
            if after == before:
                what = f"the stamp {after!r} is repeated"
            repair = "on_time_error='repair' sorts samples and averages those that share a stamp"
            if first and after <= stamps[0]:
                what += (
                    ", where it began: several recordings must be told apart (a file each, or in a table a column "
                    "recording)"
                )
                repair = f"of a single one {repair}"
            raise self.fault(f"{what}; {repair}", first + 1)
        repaired = repair_time(stamps, self.wrench)
        self.remarks.update(moved=repaired.n_moved, merged=repaired.n_merged)
        if self.trigger is not None and self.trigger < len(stamps):
            self.trigger = int(np.searchsorted(repaired.stamps, stamps[self.trigger]))
        marks: NDArray[np.uint8] = repaired.touched.astype(np.uint8) * np.uint8(SampleFlag.TIME_REPAIRED)
        if self.flags is not None:
            marks |= np.bitwise_or.reduceat(self.flags[repaired.order], repaired.first)
        self.wrench, self.stamps, self.flags = repaired.values, repaired.stamps, marks

    def refuse_unlikely(self, time_unit: str | None) -> None:
        """Refuse stamps that are most likely no seconds, where nobody states a unit or a rate."""
        assert self.stamps is not None
        stated = (self.stated_hz, self.file_rate_hz, time_unit, self.options.time_unit)
        if any(one is not None for one in stated) or self.source.irregular or len(self.stamps) < 2:
            return
        with np.errstate(over="ignore"):
            steps = np.diff(self.stamps)
        slow, fast = (
            float(np.median(steps)),
            float(steps.mean()),
        )  # neither pauses nor bursts of messages count
        step = slow if slow >= _LONGEST_STEP_S else fast if fast <= _SHORTEST_STEP_S else None
        if step is not None:
            raise self.fault(f"stamps lie {step:g} apart: {unlikely_step(step)}")

    def clock_of(self) -> tuple[float | None, NDArray[np.float64] | None, float | None]:
        """Return rate_hz, time_s (one of the two is None) and the time of the first sample since 1970."""
        stamps, stated, file_rate_hz = self.stamps, self.stated_hz, self.file_rate_hz
        if stamps is None:
            if self.source.irregular:
                raise self.fault(f"has no {self.clock}, but is called irregular")
            rate_hz = stated if file_rate_hz is None else file_rate_hz  # `completed` refuses another one
            if rate_hz is None:
                way_out = "pass rate_hz=, or a rate_hz column in index.csv"
                raise self.fault(f"has no {self.clock} and no rate is stated; {way_out}")
            return rate_hz, None, None
        first = float(stamps[0])
        time_s = stamps - first
        if not time_s[-1] < np.inf:
            raise self.fault(f"the stamps span {time_s[-1]:g} s", len(stamps) - 1)
        since_1970 = first if first > SINCE_1970 else None
        if since_1970 is None and first:
            self.remarks["first_stamp_s"] = first
        if file_rate_hz is not None:
            self._refuse_other_rate(time_s, file_rate_hz)
        if self.source.irregular:
            return None, time_s, since_1970
        if stated is not None:
            offset = largest_offset(time_s, stated)
            if offset > STATED_TOLERANCE / stated:
                raise self.fault(
                    f"the stated rate of {stated:g} Hz does not fit the stamps (off by up to {offset:.3g} s); "
                    f"leave the rate out to use the stamps, then call .resample(rate_hz), or {_UNIT_OUT}"
                )
            return stated, None, since_1970
        rate = uniform_rate(time_s, resolution_s=float(np.spacing(np.abs(stamps).max())))
        if rate is None and file_rate_hz is not None:
            fits = largest_offset(time_s, file_rate_hz) <= STATED_TOLERANCE / file_rate_hz
            rate = file_rate_hz if fits else None
        return (None, time_s, since_1970) if rate is None else (rate, None, since_1970)

    def _refuse_other_rate(self, time_s: NDArray[np.float64], rate_hz: float) -> None:
        """Refuse a rate of the file's own that its stamps contradict; either may have pauses or jitter."""
        if len(time_s) < 2:
            return
        with np.errstate(over="ignore"):
            steps = np.diff(time_s)
        measured = [1 / float(step) for step in (steps.mean(), np.median(steps))]
        if all(abs(rate - rate_hz) > RATE_TOLERANCE * rate_hz for rate in measured):
            problem = f"states {rate_hz:g} Hz (fs, rate_hz or 1 / dt), but its stamps {measured[0]:.6g} Hz"
            raise self.fault(f"{problem}; {_WAY_OUT}")

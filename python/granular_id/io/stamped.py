"""From samples and their time stamps to a ``Recording``: the one place that decides what the clock means."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileSource
from granular_id.io.units import factor
from granular_id.recording import (
    STATED_TOLERANCE,
    Recording,
    RepairedTime,
    SampleFlag,
    largest_offset,
    repair_time,
    uniform_rate,
)

__all__ = ["NOT_SECONDS", "RATE_TOLERANCE", "SINCE_1970", "Locate", "stamped_recording", "unlikely_step"]

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


@dataclass
class _Samples:
    wrench: NDArray[np.float64]
    flags: NDArray[np.uint8] | None
    stamps: NDArray[np.float64] | None
    trigger: int | None


def stamped_recording(
    wrench: NDArray[np.float64],
    source: FileSource,
    options: LoadOptions,
    *,
    stamps: NDArray[np.float64] | None = None,
    start_time: float | None = None,
    flags: NDArray[np.uint8] | None = None,
    trigger: int | None = None,
    axes: tuple[str, ...] = (),
    meta: Mapping[str, Any] | None = None,
    locate: Locate | None = None,
    clock: str = "time",
    time_unit: str | None = None,
    file_rate_hz: float | None = None,
) -> tuple[Recording, dict[str, Any]]:
    """Make a recording of samples and, where there are any, their stamps."""
    where: Locate = locate or (lambda _: {})
    remarks: dict[str, Any] = {}
    first_trigger = source.trigger_index if source.trigger_index is not None else trigger
    samples = _Samples(wrench, flags, stamps, first_trigger)
    if stamps is not None:
        rate = next((r for r in (source.rate_hz, options.rate_hz, file_rate_hz) if r is not None), None)
        samples.stamps = _in_seconds(stamps, time_unit, rate, source, where, options)
        _order_time(samples, source, where, options, remarks)
        if rate is None and not source.irregular and time_unit is None and options.time_unit is None:
            _refuse_unlikely(samples.stamps, source, where)
    rate_hz, time_s, since_1970 = _clock(samples, source, where, options, remarks, clock, file_rate_hz)
    known = (source.start_time, start_time, since_1970)
    try:
        recording = Recording(
            samples.wrench,
            rate_hz=rate_hz,
            start_time=next((time for time in known if time is not None), None),
            trigger_index=samples.trigger,
            time_s=time_s,
            meta=meta or {},
            flags=samples.flags,
            name=source.name,
            axes=axes,
        )
    except (TypeError, ValueError) as error:
        raise RecordingFileError(source.path, str(error)) from error
    return recording, remarks


def unlikely_step(step_s: float) -> str | None:
    """Say why a time between samples is most likely not in seconds, and what to do; None where it may be."""
    if _SHORTEST_STEP_S < step_s < _LONGEST_STEP_S:
        return None
    guess = "milliseconds, microseconds, nanoseconds or an index" if step_s > 1e-3 else "minutes or days"
    return f"that would be {1 / step_s:.3g} Hz; most likely it counts {guess}: {_UNIT_OUT}, or save seconds"


def _refuse_unlikely(stamps: NDArray[np.float64] | None, source: FileSource, where: Locate) -> None:
    if stamps is None or len(stamps) < 2:
        return
    with np.errstate(over="ignore"):
        steps = np.diff(stamps)
    slow, fast = float(np.median(steps)), float(steps.mean())  # neither pauses nor bursts of messages count
    for step in (slow if slow >= _LONGEST_STEP_S else None, fast if fast <= _SHORTEST_STEP_S else None):
        problem = None if step is None else unlikely_step(step)
        if problem is not None:
            raise RecordingFileError(source.path, f"stamps lie {step:g} apart: {problem}", **where(None))


def _in_seconds(
    stamps: NDArray[np.float64],
    stated: str | None,
    rate_hz: float | None,
    source: FileSource,
    where: Locate,
    options: LoadOptions,
) -> NDArray[np.float64]:
    """Convert stamps from the unit that the file or the user states."""
    asked = options.time_unit
    if asked == "sample":
        if stated is not None or rate_hz is None:
            came = (
                "no rate is stated" if rate_hz is None else f"the file says that its stamps are in {stated}"
            )
            raise RecordingFileError(source.path, f"time_unit='sample', but {came}", **where(None))
        return stamps / rate_hz
    scales = [None if unit is None else factor(unit, "s") for unit in (stated, asked)]
    if stated is not None and scales[0] is None:
        raise RecordingFileError(
            source.path, f"stamps are in {stated!r:.40}; wanted s, ms, us or ns", **where(None)
        )
    if None not in scales and scales[0] != scales[1]:
        problem = f"time_unit={asked!r}, but the file says that its stamps are in {stated}"
        raise RecordingFileError(source.path, problem, **where(None))
    scale = next((scale for scale in scales if scale is not None), 1.0)
    return stamps if scale == 1 else stamps / round(1 / scale)


def _order_time(
    samples: _Samples, source: FileSource, where: Locate, options: LoadOptions, remarks: dict[str, Any]
) -> None:
    """Make sure that stamps ascend: refuse the first one that does not, or repair them all if asked to."""
    stamps = samples.stamps
    assert stamps is not None
    if abs(stamps[0]) > NOT_SECONDS:
        problem = (
            f"{stamps[0]:.6g} cannot be seconds since 1970 (milliseconds or nanoseconds?); wanted seconds, or "
            "time_unit='ms', 'us' or 'ns'"
        )
        raise RecordingFileError(source.path, problem, **where(0))
    wrong = np.flatnonzero(stamps[1:] <= stamps[:-1])
    if not len(wrong):
        return
    first = int(wrong[0])
    before, after = float(stamps[first]), float(stamps[first + 1])
    if options.on_time_error == "raise":
        what = f"time runs back from {before!r} to {after!r}"
        if after == before:
            what = f"the stamp {after!r} is repeated"
        problem = f"{what}; on_time_error='repair' sorts samples and averages those that share a stamp"
        if first and after <= stamps[0]:
            one_each = "a file each, or in a table a column recording"
            problem = (
                f"{what}, where it began: several recordings must be told apart ({one_each}); of a single one "
                "on_time_error='repair' sorts samples and averages those that share a stamp"
            )
        raise RecordingFileError(source.path, problem, **where(first + 1))
    repaired = repair_time(stamps, samples.wrench)
    remarks.update(moved=repaired.n_moved, merged=repaired.n_merged)
    if samples.trigger is not None and samples.trigger < len(stamps):
        samples.trigger = int(np.searchsorted(repaired.stamps, stamps[samples.trigger]))
    samples.flags = _repaired_flags(samples.flags, repaired)
    samples.wrench, samples.stamps = repaired.values, repaired.stamps


def _repaired_flags(flags: NDArray[np.uint8] | None, repaired: RepairedTime) -> NDArray[np.uint8]:
    marks: NDArray[np.uint8] = repaired.touched.astype(np.uint8) * np.uint8(SampleFlag.TIME_REPAIRED)
    if flags is not None:
        marks |= np.bitwise_or.reduceat(flags[repaired.order], repaired.first)
    return marks


def _clock(
    samples: _Samples,
    source: FileSource,
    where: Locate,
    options: LoadOptions,
    remarks: dict[str, Any],
    clock: str,
    file_rate_hz: float | None,
) -> tuple[float | None, NDArray[np.float64] | None, float | None]:
    """Return rate_hz, time_s (one of the two is None) and the time of the first sample since 1970."""
    stated = options.rate_hz if source.rate_hz is None else source.rate_hz
    stamps = samples.stamps
    if stamps is None and source.irregular:
        raise RecordingFileError(source.path, f"has no {clock}, but is called irregular", **where(None))
    if stamps is None:
        stated = stated if file_rate_hz is None else file_rate_hz  # `completed` refuses another one
        if stated is None:
            problem = f"has no {clock} and no rate is stated; pass rate_hz=, or a rate_hz column in index.csv"
            raise RecordingFileError(source.path, problem, **where(None))
        return stated, None, None
    first = float(stamps[0])
    time_s = stamps - first
    if not time_s[-1] < np.inf:
        raise RecordingFileError(source.path, f"the stamps span {time_s[-1]:g} s", **where(len(stamps) - 1))
    since_1970 = first if first > SINCE_1970 else None
    if since_1970 is None and first:
        remarks["first_stamp_s"] = first
    if file_rate_hz is not None:
        _refuse_other_rate(time_s, file_rate_hz, source, where)
    if source.irregular:
        return None, time_s, since_1970
    if stated is not None:
        offset = largest_offset(time_s, stated)
        if offset > STATED_TOLERANCE / stated:
            problem = (
                f"the stated rate of {stated:g} Hz does not fit the stamps (off by up to {offset:.3g} s); "
                f"leave the rate out to use the stamps, then call .resample(rate_hz), or {_UNIT_OUT}"
            )
            raise RecordingFileError(source.path, problem, **where(None))
        return stated, None, since_1970
    rate = uniform_rate(time_s, resolution_s=float(np.spacing(np.abs(stamps).max())))
    if rate is None and file_rate_hz is not None:
        fits = largest_offset(time_s, file_rate_hz) <= STATED_TOLERANCE / file_rate_hz
        rate = file_rate_hz if fits else None
    return (None, time_s, since_1970) if rate is None else (rate, None, since_1970)


def _refuse_other_rate(
    time_s: NDArray[np.float64], rate_hz: float, source: FileSource, where: Locate
) -> None:
    """Refuse a rate of the file's own that its stamps contradict; either may have pauses or jitter."""
    if len(time_s) < 2:
        return
    with np.errstate(over="ignore"):
        steps = np.diff(time_s)
    measured = [1 / float(step) for step in (steps.mean(), np.median(steps))]
    if all(abs(rate - rate_hz) > RATE_TOLERANCE * rate_hz for rate in measured):
        problem = f"states {rate_hz:g} Hz (fs, rate_hz or 1 / dt), but its stamps {measured[0]:.6g} Hz"
        raise RecordingFileError(source.path, f"{problem}; {_WAY_OUT}", **where(None))

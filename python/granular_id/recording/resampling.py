"""Bring recordings to one uniform rate, by a stated method, saying what was made up on the way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, argument_error, checked_choice, finite_number
from granular_id._text import counted, fixed
from granular_id.recording.recording import Recording, SampleFlag
from granular_id.recording.report import NothingLeftError, StepReport

# Time stamps: whether they form a uniform grid, and what to do where they do not.

# Stamps within this part of a step of an even grid count as uniform: finer than clocks jitter.
UNIFORM_TOLERANCE = 0.01

STATED_TOLERANCE = 0.5
"""A rate the user states holds while every stamp is nearer to its own place than to its neighbours'."""


def uniform_rate(time_s: FloatArray, resolution_s: float = 0.0) -> float | None:
    """Find the rate of evenly spaced stamps, each off by `resolution_s` at most: the shortest number that fits all."""
    if len(time_s) < 2:
        return None
    mean = (len(time_s) - 1) / float(time_s[-1])
    if largest_offset(time_s, mean) > 2 * (UNIFORM_TOLERANCE / mean + resolution_s) * (1 + 1e-6):
        return None  # the mean rate fits at least half as well as the best one: no rate will do
    for digits in range(1, 18):
        rate = float(f"{mean:.{digits}g}")
        if largest_offset(time_s, rate) <= UNIFORM_TOLERANCE / rate + resolution_s:
            return rate
    return None


def largest_offset(time_s: FloatArray, rate_hz: float) -> float:
    """Seconds between the stamps and the places an even grid would give them, at worst."""
    return float(np.abs(time_s - np.arange(len(time_s)) / rate_hz).max())


def step_s(recording: Recording, pick: Callable[[FloatArray], Any]) -> float:
    """Return a time between neighbouring samples, seconds: what `pick` makes of all; 0 for a single sample."""
    if recording.n_samples < 2:
        return 0.0
    return 1 / recording.rate_hz if recording.rate_hz is not None else float(pick(np.diff(recording.times())))


class RepairedTime(NamedTuple):
    """Stamps put in order by `repair_time`: M of T."""

    stamps: FloatArray  # strictly increasing
    values: FloatArray  # the samples in that order, those with the same stamp averaged
    touched: NDArray[np.bool_]  # which of them were moved or merged
    order: NDArray[np.intp]  # the sort, shape (T,)
    first: NDArray[np.intp]  # where in that order each begins, for ``ufunc.reduceat``
    n_moved: int  # samples that came later than one with a later stamp
    n_merged: int  # samples merged into another one


def repair_time(stamps: FloatArray, values: FloatArray) -> RepairedTime:
    """Sort samples by their stamps and average those that share one: no other choice prefers neither of two."""
    late = stamps < np.maximum.accumulate(stamps)
    order = np.argsort(stamps, kind="stable")
    late, stamps, values = late[order], stamps[order], values[order]
    first = np.flatnonzero(np.concatenate([[True], stamps[1:] > stamps[:-1]]))
    counts = np.diff(first, append=len(stamps))
    lowest = np.minimum.reduceat(values, first, axis=0)
    equal = lowest == np.maximum.reduceat(values, first, axis=0)
    means = np.add.reduceat(values, first, axis=0) / counts[:, None]
    touched = np.logical_or.reduceat(late, first) | (counts > 1)
    return RepairedTime(
        stamps[first],
        np.where(equal, lowest, means),  # a mean of equal values may differ from them in the last bit
        touched,
        order,
        first,
        n_moved=int(late.sum()),
        n_merged=int((counts - 1).sum()),
    )


Method = Literal["linear", "polyphase"]

MAX_GAP_S = 0.25
"""Default of ``max_gap_s``: at the paper's 0.03 m/s the tool moves 7.5 mm in it, less than half its width."""

# Longest recording that resampling makes (5.5 h at 500 Hz): a mistyped rate must not fill the memory.
MAX_SAMPLES = 10_000_000
_MAX_RATIO = 10_000
_GRID_SLACK = 1e-9


def resample_recordings(
    recordings: Sequence[Recording],
    rate_hz: float,
    method: Method,
    max_gap_s: float | None,
    on_gap: Literal["raise", "skip"],
) -> tuple[list[Recording], StepReport]:
    """Resample each recording; see :meth:`Dataset.resample`, which calls this."""
    rate = finite_number("rate_hz", rate_hz, positive=True)
    checked_choice("method", method, "linear", "polyphase")
    checked_choice("on_gap", on_gap, "raise", "skip")
    if isinstance(max_gap_s, (float, np.floating)) and max_gap_s == np.inf:
        max_gap_s = None
    limit = np.inf if max_gap_s is None else finite_number("max_gap_s", max_gap_s)
    if limit <= 0:
        problem = f"must be positive (or None for no limit), got {limit:g}"
        raise argument_error(ValueError, "max_gap_s", problem)
    results: list[Recording] = []
    skipped: list[dict[str, Any]] = []
    changed: list[dict[str, Any]] = []
    for recording in recordings:
        gap = step_s(recording, np.max)
        if recording.rate_hz is None and gap > limit:
            if on_gap == "raise":
                raise ValueError(_gap_message(recording, recordings, limit))
            skipped.append({"name": recording.name, "skipped": f"gap of {gap:.3g} s"})
        elif recording.rate_hz == rate:
            results.append(recording)
        else:
            result, inserted = _resample_one(recording, rate, method)
            results.append(result)
            changed.append(
                {
                    "name": recording.name,
                    "samples_before": recording.n_samples,
                    "samples_after": result.n_samples,
                    "gap_filled": inserted,
                    "largest_gap_s": gap,
                }
            )
    if not results:
        problem = f"each of {counted(len(recordings))} has gaps beyond max_gap_s={limit:g} s"
        raise NothingLeftError(problem, skipped)
    changed.sort(key=lambda row: -row["largest_gap_s"])
    totals = {
        "recordings_resampled": len(changed),
        "recordings_unchanged": len(results) - len(changed),
        "recordings_skipped": len(skipped),
        "samples_before": sum(row["samples_before"] for row in changed),
        "samples_after": sum(row["samples_after"] for row in changed),
        "gap_filled_samples": sum(row["gap_filled"] for row in changed),
        "recordings_with_filled_gaps": sum(row["gap_filled"] > 0 for row in changed),
        "largest_gap_s": changed[0]["largest_gap_s"] if changed else 0.0,
        "largest_gap_in": changed[0]["name"] if changed else None,
    }
    parameters = {"rate_hz": rate, "method": method, "max_gap_s": max_gap_s, "on_gap": on_gap}
    notes = []
    coarser = sum(r.n_samples > 1 and step_s(r, np.median) * rate < 1 - _GRID_SLACK for r in recordings)
    if method == "linear" and coarser:
        notes.append(
            f"{coarser} recordings were sampled faster than {rate:g} Hz; linear interpolation does not "
            f"filter: content above {rate / 2:g} Hz folds back"
        )
    return results, StepReport("resample", parameters, totals, skipped + changed, notes)


def _gap_message(recording: Recording, recordings: Sequence[Recording], limit: float) -> str:
    """Describe the first gap, and all together: a limit is chosen with this, so the largest is rounded up."""
    first = int(np.argmax(np.diff(recording.times())))
    gaps = [step_s(r, np.max) for r in recordings if r.rate_hz is None]
    beyond = sum(gap > limit for gap in gaps)
    such = "has such a gap" if beyond == 1 else "have such gaps"
    largest = np.ceil(1000 * max(gaps)) / 1000
    return (
        f"recording {recording.name!r} has a gap of {step_s(recording, np.max):.3g} s after sample {first} (at "
        f"{fixed(recording.times()[first], 3)} s), beyond max_gap_s={limit:g}; {beyond} of {len(recordings)} "
        f"recordings {such}, the largest {largest:g} s: raise max_gap_s (None: no limit) to interpolate over "
        "it, or pass on_gap='skip' to leave such recordings out"
    )


def _resample_one(recording: Recording, rate: float, method: Method) -> tuple[Recording, int]:
    """Return the recording at the new rate and how many samples lie inside gaps."""
    n_samples = np.floor(recording.duration_s * rate + _GRID_SLACK) + 1
    if n_samples > MAX_SAMPLES:
        problem = (
            f"={rate:g} gives recording {recording.name!r} ({recording.duration_s:g} s) "
            f"{n_samples:.3g} samples; at most {MAX_SAMPLES} are made"
        )
        raise argument_error(ValueError, "rate_hz", problem)
    times = recording.times()
    grid = np.arange(int(n_samples)) / rate
    if method == "polyphase":
        wrench = _polyphase(recording, rate)[: len(grid)]  # scipy goes on past the last measured sample
    else:
        wrench = np.empty((len(grid), recording.wrench.shape[1]))
        for axis in range(wrench.shape[1]):
            wrench[:, axis] = np.interp(grid, times, recording.wrench[:, axis])
    before = np.clip(np.searchsorted(times, grid, side="right") - 1, 0, None)
    after = np.minimum(np.searchsorted(times, grid, side="left"), len(times) - 1)
    flags = np.zeros(len(grid), np.uint8)
    if recording.flags is not None:
        flags |= recording.flags[before] | recording.flags[after]
    n_inserted = 0
    if recording.rate_hz is None:
        # at least one sample is missing by the recording's own rhythm, and the new grid would show it
        gap = 2 * max(step_s(recording, np.median), 1 / rate)
        inserted = (before != after) & (times[after] - times[before] > gap)
        flags[inserted] |= np.uint8(SampleFlag.GAP_FILLED)
        n_inserted = int(inserted.sum())
    trigger = recording.trigger_index
    result = replace(
        recording,
        wrench=wrench,
        rate_hz=rate,
        time_s=None,
        trigger_index=None if trigger is None else min(round(float(times[trigger]) * rate), len(grid) - 1),
        flags=flags,
    )
    return result, n_inserted


def _polyphase(recording: Recording, rate: float) -> FloatArray:
    if recording.rate_hz is None:
        raise ValueError(
            f"recording {recording.name!r} is irregular: method='polyphase' needs uniform input; use "
            "method='linear'"
        )
    ratio = (Fraction(rate) / Fraction(recording.rate_hz)).limit_denominator(_MAX_RATIO)
    exact = ratio.numerator and abs(float(ratio) * recording.rate_hz / rate - 1) < _GRID_SLACK
    if not exact or ratio.numerator > _MAX_RATIO:
        problem = (
            f"={rate:g} over {recording.rate_hz:g} Hz (recording {recording.name!r}) is not a "
            f"ratio of whole numbers up to {_MAX_RATIO}; use method='linear'"
        )
        raise argument_error(ValueError, "rate_hz", problem)
    if recording.n_samples == 1:
        return recording.wrench  # there is no line through one point to pad along
    from scipy.signal import resample_poly  # heavy to import, and only this method needs it

    # "line": a force with an offset or a drift must not fall to zero at the ends
    result: FloatArray = resample_poly(
        recording.wrench, ratio.numerator, ratio.denominator, axis=0, padtype="line"
    )
    return result

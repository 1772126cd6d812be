"""Bring recordings to one uniform rate, by a stated method, saying what was made up on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from granular_id._checks import FloatArray, checked_number, checked_rate
from granular_id._text import counted, fixed
from granular_id.recording.recording import Recording, SampleFlag
from granular_id.recording.report import StepReport

# Time stamps: whether they form a uniform grid, and what to do where they do not.

UNIFORM_TOLERANCE = 0.01
"""Stamps within this part of a step of an even grid count as uniform: finer than clocks jitter."""

STATED_TOLERANCE = 0.5
"""A rate the user states holds while every stamp is nearer to its own place than to its neighbours'."""


def uniform_rate(time_s: FloatArray, resolution_s: float = 0.0) -> float | None:
    """Find the rate of evenly spaced stamps: the shortest decimal number that fits them all.

    Parameters
    ----------
    time_s : ndarray, shape (T,)
        Strictly increasing stamps, the first one 0.
    resolution_s : float
        What the stamps can be off by rounding (large absolute stamps in float64 are).

    Returns
    -------
    float or None
        The rate in Hz; None for a single stamp and for stamps further than 1 % of a step from an even grid.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording.resampling import uniform_rate
    >>> uniform_rate(np.arange(1600) / 500)
    500.0
    """
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


def largest_gap_s(recording: Recording) -> float:
    """Longest time between two neighbouring samples, seconds (0 for a single sample)."""
    if recording.rate_hz is not None:
        return 1 / recording.rate_hz if recording.n_samples > 1 else 0.0
    steps = np.diff(recording.times())
    return float(steps.max()) if len(steps) else 0.0


def median_step_s(recording: Recording) -> float:
    """Median time between neighbouring samples, seconds (0 for a single sample)."""
    if recording.rate_hz is not None or recording.n_samples < 2:
        return largest_gap_s(recording)
    return float(np.median(np.diff(recording.times())))


@dataclass(frozen=True)
class RepairedTime:
    """Stamps put in order by :func:`repair_time`.

    Attributes
    ----------
    stamps : ndarray, shape (M,)
        Strictly increasing stamps, M <= T.
    values : ndarray, shape (M, C)
        The samples in that order, those with the same stamp averaged.
    touched : ndarray of bool, shape (M,)
        Which samples were moved or merged.
    order : ndarray of int, shape (T,)
        The sort: ``stamps[order]`` ascends.
    first : ndarray of int, shape (M,)
        Where in that order each merged sample begins (for ``ufunc.reduceat`` on other columns).
    n_moved, n_merged : int
        How many samples came later than one with a later stamp, and how many were merged into another one.
    """

    stamps: FloatArray
    values: FloatArray
    touched: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    order: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    first: np.ndarray[tuple[int, ...], np.dtype[np.intp]]
    n_moved: int
    n_merged: int


def repair_time(stamps: FloatArray, values: FloatArray) -> RepairedTime:
    """Sort samples by their stamps and average those that share one.

    The sort is stable. Averaging is the only choice that does not prefer one of two measurements of the same
    instant; repeated messages (equal values) come out unchanged.

    Parameters
    ----------
    stamps : ndarray, shape (T,)
        Finite stamps in the order of recording.
    values : ndarray, shape (T, C)
        The samples.
    """
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
        stamps=stamps[first],
        values=np.where(equal, lowest, means),  # a mean of equal values may differ from them in the last bit
        touched=touched,
        order=order,
        first=first,
        n_moved=int(late.sum()),
        n_merged=int((counts - 1).sum()),
    )


Method = Literal["linear", "polyphase"]

MAX_GAP_S = 0.25
"""Default of ``max_gap_s``: at the paper's 0.03 m/s the tool moves 7.5 mm in it, less than half its width."""

MAX_SAMPLES = 10_000_000
"""Longest recording that resampling makes (5.5 h at 500 Hz): a mistyped rate must not fill the memory."""

_MAX_RATIO = 10_000
_GRID_SLACK = 1e-9


def resample_recordings(
    recordings: Sequence[Recording],
    rate_hz: float,
    *,
    method: Method = "linear",
    max_gap_s: float | None = MAX_GAP_S,
    on_gap: Literal["raise", "skip"] = "raise",
) -> tuple[list[Recording], StepReport]:
    """Resample each recording; see :meth:`Dataset.resample`, which calls this."""
    rate = checked_rate(rate_hz)
    if method not in ("linear", "polyphase"):
        raise ValueError(f"method={method!r}; wanted 'linear' or 'polyphase'")
    if on_gap not in ("raise", "skip"):
        raise ValueError(f"on_gap={on_gap!r}; wanted 'raise' or 'skip'")
    if isinstance(max_gap_s, (float, np.floating)) and max_gap_s == np.inf:
        max_gap_s = None
    limit = np.inf if max_gap_s is None else checked_number(max_gap_s, "max_gap_s")
    if limit <= 0:
        raise ValueError(f"max_gap_s must be positive (or None for no limit), got {limit:g}")
    results: list[Recording] = []
    rows: list[dict[str, Any]] = []
    skipped = 0
    for recording in recordings:
        gap = largest_gap_s(recording)
        if recording.rate_hz is None and gap > limit:
            if on_gap == "raise":
                raise ValueError(_gap_message(recording, recordings, limit))
            rows.append({"name": recording.name, "skipped": f"gap of {gap:.3g} s"})
            skipped += 1
        elif recording.rate_hz == rate:
            results.append(recording)
        else:
            result, inserted = _resample_one(recording, rate, method)
            results.append(result)
            rows.append(
                {
                    "name": recording.name,
                    "samples_before": recording.n_samples,
                    "samples_after": result.n_samples,
                    "gap_filled": inserted,
                    "largest_gap_s": gap,
                }
            )
    rows.sort(key=lambda row: -row.get("largest_gap_s", np.inf))  # skipped ones first, then the widest gaps
    if not results:
        raise ValueError(f"each of {counted(len(recordings))} has gaps beyond max_gap_s={limit:g} s")
    changed = [row for row in rows if "skipped" not in row]
    filled = [row for row in changed if row["gap_filled"]]
    widest: dict[str, Any] = max(changed, key=lambda row: row["largest_gap_s"], default={})
    totals = {
        "recordings_resampled": len(changed),
        "recordings_unchanged": len(recordings) - len(changed) - skipped,
        "recordings_skipped": skipped,
        "samples_before": sum(row["samples_before"] for row in changed),
        "samples_after": sum(row["samples_after"] for row in changed),
        "gap_filled_samples": sum(row["gap_filled"] for row in changed),
        "recordings_with_filled_gaps": len(filled),
        "largest_gap_s": widest.get("largest_gap_s", 0.0),
        "largest_gap_in": widest.get("name"),
    }
    parameters = {"rate_hz": rate, "method": method, "max_gap_s": max_gap_s, "on_gap": on_gap}
    return results, StepReport("resample", parameters, totals, rows, _notes(recordings, rate, method))


def _notes(recordings: Sequence[Recording], rate: float, method: Method) -> list[str]:
    coarser = sum(median_step_s(r) * rate < 1 - _GRID_SLACK for r in recordings if r.n_samples > 1)
    if method == "linear" and coarser:
        return [
            f"{coarser} recordings were sampled faster than {rate:g} Hz; linear interpolation does not "
            f"filter: content above {rate / 2:g} Hz folds back"
        ]
    return []


def _gap_message(recording: Recording, recordings: Sequence[Recording], limit: float) -> str:
    """Describe the first gap, and all together: a limit is chosen with this, so the largest is rounded up."""
    first = int(np.argmax(np.diff(recording.times())))
    gaps = [largest_gap_s(r) for r in recordings if r.rate_hz is None]
    beyond = sum(gap > limit for gap in gaps)
    such = "has such a gap" if beyond == 1 else "have such gaps"
    largest = np.ceil(1000 * max(gaps)) / 1000
    return (
        f"recording {recording.name!r} has a gap of {largest_gap_s(recording):.3g} s after sample {first} (at "
        f"{fixed(recording.times()[first], 3)} s), beyond max_gap_s={limit:g}; {beyond} of {len(recordings)} "
        f"recordings {such}, the largest {largest:g} s: raise max_gap_s (None: no limit) to interpolate over "
        "it, or pass on_gap='skip' to leave such recordings out"
    )


def _resample_one(recording: Recording, rate: float, method: Method) -> tuple[Recording, int]:
    """Return the recording at the new rate and how many samples lie inside gaps."""
    n_samples = np.floor(recording.duration_s * rate + _GRID_SLACK) + 1
    if n_samples > MAX_SAMPLES:
        raise ValueError(
            f"rate_hz={rate:g} gives recording {recording.name!r} ({recording.duration_s:g} s) "
            f"{n_samples:.3g} samples; at most {MAX_SAMPLES} are made"
        )
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
    inserted = _inside_gaps(recording, times, before, after, rate)
    flags[inserted] |= np.uint8(SampleFlag.GAP_FILLED)
    trigger = recording.trigger_index
    result = replace(
        recording,
        wrench=wrench,
        rate_hz=rate,
        time_s=None,
        trigger_index=None if trigger is None else min(round(float(times[trigger]) * rate), len(grid) - 1),
        flags=flags,
    )
    return result, int(inserted.sum())


def _inside_gaps(
    recording: Recording,
    times: FloatArray,
    before: np.ndarray[Any, np.dtype[np.intp]],
    after: np.ndarray[Any, np.dtype[np.intp]],
    rate: float,
) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Tell which new samples lie strictly inside a gap.

    A gap is a step longer than twice the recording's median step and twice the new step: at least one
    sample is missing by the recording's own rhythm, and the new grid would show it.
    """
    if recording.rate_hz is not None:
        return np.zeros(len(before), bool)
    threshold = 2 * max(median_step_s(recording), 1 / rate)
    inside: np.ndarray[Any, np.dtype[np.bool_]] = (before != after) & (
        times[after] - times[before] > threshold
    )
    return inside


def _polyphase(recording: Recording, rate: float) -> FloatArray:
    if recording.rate_hz is None:
        raise ValueError(
            f"recording {recording.name!r} is irregular: method='polyphase' needs uniform input; use "
            "method='linear'"
        )
    ratio = (Fraction(rate) / Fraction(recording.rate_hz)).limit_denominator(_MAX_RATIO)
    exact = ratio.numerator and abs(float(ratio) * recording.rate_hz / rate - 1) < _GRID_SLACK
    if not exact or ratio.numerator > _MAX_RATIO:
        raise ValueError(
            f"rate_hz={rate:g} over {recording.rate_hz:g} Hz (recording {recording.name!r}) is not a "
            f"ratio of whole numbers up to {_MAX_RATIO}; use method='linear'"
        )
    if recording.n_samples == 1:
        return recording.wrench  # there is no line through one point to pad along
    from scipy.signal import resample_poly  # heavy to import, and only this method needs it

    # "line": a force with an offset or a drift must not fall to zero at the ends
    result: FloatArray = resample_poly(
        recording.wrench, ratio.numerator, ratio.denominator, axis=0, padtype="line"
    )
    return result

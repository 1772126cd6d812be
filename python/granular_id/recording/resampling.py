"""Bring recordings to one uniform rate without folding frequencies back, saying what was made up on the way."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from granular_id._checks import FloatArray, WayOutError, argument_error, checked_choice, finite_number
from granular_id._core import GranularIdError
from granular_id._parallel import single_threaded_blas
from granular_id._text import counted, fixed, typed
from granular_id.recording.recording import Recording, SampleFlag
from granular_id.recording.report import StepReport, subject


def step_s(recording: Recording, pick: Callable[[FloatArray], Any]) -> float:
    """Return a time between neighbouring samples, seconds: what `pick` makes of all; 0 for a single sample."""
    if recording.n_samples < 2:
        return 0.0
    return 1 / recording.rate_hz if recording.rate_hz is not None else float(pick(np.diff(recording.times())))


# Longest recording that resampling makes (5.5 h at 500 Hz): a mistyped rate must not fill the memory.
MAX_SAMPLES = 10_000_000
_GRID_SLACK = 1e-9

_Curve = Callable[[Recording, FloatArray], FloatArray]
"""What gives samples of a recording at other times."""


# Systems of a hundred equations: a second thread costs ten times what it saves, and changes the last bit.
@single_threaded_blas()
def resample_recordings(
    recordings: Sequence[Recording],
    rate_hz: float,
    max_gap_s: float | None,
    on_gap: Literal["raise", "skip"],
) -> tuple[list[Recording], StepReport]:
    """Resample each recording; see :meth:`Dataset.resample`, which calls this."""
    rate = finite_number("rate_hz", rate_hz, positive=True)
    checked_choice("on_gap", on_gap, "raise", "skip")
    limit = np.inf if max_gap_s is None else finite_number("max_gap_s", max_gap_s, positive=True)
    results: list[Recording] = []
    skipped: list[dict[str, Any]] = []
    changed: list[dict[str, Any]] = []
    uneven: list[str] = []
    for recording in recordings:
        gap = step_s(recording, np.max)
        if recording.rate_hz is None and gap > limit:
            if on_gap == "raise":
                raise WayOutError(*_gap_message(recording, recordings, limit))
            skipped.append({"name": recording.name, "skipped": f"gap of {gap:.3g} s"})
        elif recording.rate_hz == rate:
            results.append(recording)
        else:
            lower = (
                _FROM * rate * recording.duration_s < recording.n_samples - 1
            )  # it can hold what is taken off
            curve: _Curve = _on_spline if recording.rate_hz is not None else _band_limited
            if recording.rate_hz is None and lower and not _is_even(recording):
                uneven.append(recording.name)
                curve = _on_lines
            result, inserted = _resample_one(recording, rate, curve if lower else None)
            results.append(result)
            changed.append(
                {
                    "name": recording.name,
                    "samples_before": recording.n_samples,
                    "samples_after": result.n_samples,
                    "gap_filled": inserted,
                    "largest_gap_s": gap,
                    "low_pass": lower,
                }
            )
    if not results:
        raise GranularIdError(f"each of {counted(len(recordings))} has gaps beyond max_gap_s={limit:g} s")
    changed.sort(key=lambda row: -row["largest_gap_s"])
    totals = {
        "recordings_resampled": len(changed),
        "recordings_unchanged": len(results) - len(changed),
        "recordings_skipped": len(skipped),
        "recordings_low_passed": sum(row["low_pass"] for row in changed),
        "samples_before": sum(row["samples_before"] for row in changed),
        "samples_after": sum(row["samples_after"] for row in changed),
        "gap_filled_samples": sum(row["gap_filled"] for row in changed),
        "recordings_with_filled_gaps": sum(row["gap_filled"] > 0 for row in changed),
        "largest_gap_s": changed[0]["largest_gap_s"] if changed else 0.0,
        "largest_gap_in": changed[0]["name"] if changed else None,
    }
    notes = []
    if uneven:
        notes.append(
            f"{subject(len(uneven))} too uneven stamps to tell what lies above {rate / 2:g} Hz from what lies below "
            f"(the first is {uneven[0]!r})"
        )
    parameters = {"rate_hz": rate, "max_gap_s": max_gap_s, "on_gap": on_gap}
    return results, StepReport("resample", parameters, totals, skipped + changed, notes)


def _gap_message(recording: Recording, recordings: Sequence[Recording], limit: float) -> tuple[str, ...]:
    """Describe the first gap, and all together: a limit is chosen with this, so the largest is rounded up."""
    first = int(np.argmax(np.diff(recording.times())))
    gaps = [step_s(r, np.max) for r in recordings if r.rate_hz is None]
    beyond = sum(gap > limit for gap in gaps)
    such = "has such a gap" if beyond == 1 else "have such gaps"
    largest = np.ceil(1000 * max(gaps)) / 1000
    return (
        f"recording {recording.name!r} has a gap of {step_s(recording, np.max):.3g} s after sample {first} (at "
        f"{fixed(recording.times()[first], 3)} s), beyond max_gap_s={limit:g}; {beyond} of {len(recordings)} "
        f"recordings {such}, the largest {largest:g} s: call .split(gap_s={limit:g}) before to make a recording of "
        "each stretch ",
        typed(split_gap_s=limit),
        ", raise max_gap_s, None being no limit, to interpolate over it ",
        typed(max_gap_s=float(largest)),
        ", or pass on_gap='skip' to leave such recordings out ",
        typed(on_error="skip"),
    )


def _resample_one(recording: Recording, rate: float, curve: _Curve | None) -> tuple[Recording, int]:
    """Return the recording at the new rate, a lower one by a curve, and how many samples lie inside gaps."""
    n_samples = np.floor(recording.duration_s * rate + _GRID_SLACK) + 1
    if n_samples > MAX_SAMPLES:
        problem = (
            f"={rate:g} gives recording {recording.name!r} ({recording.duration_s:g} s) "
            f"{n_samples:.3g} samples; at most {MAX_SAMPLES} are made"
        )
        raise argument_error(GranularIdError, "rate_hz", problem)
    times = recording.times()
    grid = np.arange(int(n_samples)) / rate
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
        wrench=_low_passed(recording, grid, rate, curve) if curve else _on_lines(recording, grid),
        rate_hz=rate,
        time_s=None,
        trigger_index=None if trigger is None else min(round(float(times[trigger]) * rate), len(grid) - 1),
        flags=flags,
    )
    return result, n_inserted


def _on_lines(recording: Recording, grid: FloatArray) -> FloatArray:
    """Return samples on the straight lines between neighbours."""
    times = recording.times()
    return np.column_stack([np.interp(grid, times, column) for column in recording.wrench.T])


# A lower rate. What lies above half of it would come out as another frequency, so it is taken off before.

# Half the length of the low-pass, in new steps; the middle of its edge, of half the new rate; the shape of its window.
# From this part of half the new rate on it takes 55 dB or more, up to 0.8 of it nothing.
_FROM = 1.05
_HALF_LENGTH, _EDGE, _KAISER = 12, 0.925, 4.5
# Whole numbers up to this one in the ratio of two rates; others go by way of the fine grid.
_MOST_IN_RATIO = 1000
# Steps of the fine grid in a step of the recording, where lines or a spline are drawn.
_FINER = 4
# Samples hold a signal without frequencies above half of their rate where nearly all steps lie between these parts of
# the usual one. Through bursts of samples it would swing to ten times their noise.
_EVEN, _EVEN_STEPS = 0.99, (0.25, 2.0)
_DEGREE = 7  # of the spline


def _is_even(recording: Recording) -> bool:
    """Whether an irregular recording is one of a rate, its stamps but off by part of a step."""
    if recording.n_samples <= _DEGREE:
        return False
    steps = np.diff(recording.times())
    least, most = (part * np.median(steps) for part in _EVEN_STEPS)
    return float(np.mean((steps >= least) & (steps <= most))) >= _EVEN


def _low_passed(recording: Recording, grid: FloatArray, rate: float, curve: _Curve) -> FloatArray:
    """Return samples at a lower rate, through a symmetric low-pass that delays nothing."""
    from scipy.signal import firwin, resample_poly  # heavy to import, and only a lower rate needs it

    up, down, wrench = 1, 1, recording.wrench
    if recording.rate_hz is not None:
        ratio = Fraction(rate / recording.rate_hz).limit_denominator(_MOST_IN_RATIO)
        if abs(float(ratio) * recording.rate_hz / rate - 1) < _GRID_SLACK:
            up, down = ratio.numerator, ratio.denominator
    if down == 1:
        steps = (recording.n_samples - 1) / recording.duration_s / rate
        down = math.ceil(steps if curve is _band_limited else _FINER * steps)
        wrench = curve(recording, np.arange((len(grid) - 1) * down + 1) / (rate * down))
    if len(wrench) == 1:
        return wrench  # there is no line through one point to pad along
    low_pass = firwin(2 * _HALF_LENGTH * down + 1, _EDGE / down, window=("kaiser", _KAISER))
    for phase in range(up):  # a steady force stays what it is between the samples, too
        low_pass[phase::up] /= up * low_pass[phase::up].sum()
    # "line": a force with an offset or a drift must not fall to zero at the ends
    result: FloatArray = resample_poly(wrench, up, down, axis=0, window=low_pass, padtype="line")
    return result[: len(grid)]  # scipy goes on past the last measured sample


def _on_spline(recording: Recording, fine: FloatArray) -> FloatArray:
    """Return samples on a natural spline through those of a uniform recording."""
    from scipy.interpolate import make_interp_spline

    if recording.n_samples <= _DEGREE:
        return _on_lines(recording, fine)
    mean = recording.duration_s / (recording.n_samples - 1)
    still = np.zeros(recording.wrench.shape[1])
    ends = [(order, still) for order in range((_DEGREE + 1) // 2, _DEGREE)]
    spline = make_interp_spline(recording.times() / mean, recording.wrench, k=_DEGREE, bc_type=(ends, ends))
    result: FloatArray = spline(fine / mean)
    return result


# Jittered rows. Steps that are worked on at once, samples beside them that are looked at too, the part of half the rate
# below which frequencies are expected, and the variance of what is no such signal. Where stamps are off by a tenth of a
# step, a tone of 0.49 of the rate is parted by 47 dB from those that stay, by a spline of degree 7 by 27.
_AT_ONCE, _BESIDE = 48, 32
_BAND, _NOISE = 0.99, 1e-4


def _band_limited(recording: Recording, fine: FloatArray) -> FloatArray:
    """Return samples of the signal without frequencies above half of the rate, and inside gaps on straight lines.

    It is the best linear unbiased estimate (ordinary kriging) where all frequencies below are equally strong.
    """
    times, wrench = recording.times(), recording.wrench
    steps = np.diff(times)
    gap = _EVEN_STEPS[1] * np.median(steps)
    begins = np.clip(np.searchsorted(times, fine, side="right") - 1, 0, len(steps) - 1)
    result = np.empty((len(fine), wrench.shape[1]))
    for first in range(0, len(steps), _AT_ONCE):
        points = slice(*np.searchsorted(begins, [first, first + _AT_ONCE]))
        near = slice(max(first - _BESIDE, 0), first + _AT_ONCE + _BESIDE + 1)
        step = np.minimum(steps[near], gap).mean() / _BAND
        stamps, at = times[near] / step, fine[points] / step
        # The last row says that the weights of samples add up to 1: a steady force stays what it is.
        alike = np.ones((len(stamps) + 1, len(stamps) + 1))
        alike[:-1, :-1] = np.sinc(stamps[:, np.newaxis] - stamps) + _NOISE * np.eye(len(stamps))
        alike[-1, -1] = 0.0
        parts = np.linalg.solve(alike, np.vstack([wrench[near], np.zeros(wrench.shape[1])]))
        result[points] = np.sinc(at[:, np.newaxis] - stamps) @ parts[:-1] + parts[-1]
    inside = steps[begins] > gap
    result[inside] = _on_lines(recording, fine[inside])
    return result

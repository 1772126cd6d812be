"""Rates, uneven steps, gaps and lengths: whether the clock of the recordings can be believed."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np

from granular_id._checks import FloatArray
from granular_id._text import counted, verb
from granular_id.recording.checks.report import Finding, found
from granular_id.recording.recording import Recording
from granular_id.recording.resampling import MAX_GAP_S

SLOWEST_RATE_HZ = 1.0
"""Below it the stamps are rather in milliseconds than in seconds."""

RATE_TOLERANCE = 0.02
"""A stated rate and the stamps may differ by this part: more than any clock drifts."""

JITTER_TOLERANCE = 0.5
"""Steps may spread (90 % less 10 % quantile) by this part of their median before it counts as jitter."""

GAP_STEPS = 5.0
"""A gap is longer than this many of the recording's long steps (their 95 % quantile)."""

SPARSE = 0.5
"""A recording is sparse with less than this part of the usual number of samples per second."""


@dataclass(frozen=True)
class Pace:
    """How the samples of one recording follow each other, seconds.

    Attributes
    ----------
    median_s, mean_s : float
        Step between neighbouring samples; 0 for a single sample.
    spread : float
        90 % less 10 % quantile of the steps, relative to their median.
    longest_s : float
        Longest step.
    limit_s : float
        Longest step that does not count as a gap.
    """

    median_s: float
    mean_s: float
    spread: float
    longest_s: float
    limit_s: float


def pace(recording: Recording) -> Pace:
    """Measure the steps of a recording."""
    if recording.n_samples < 2:
        return Pace(0.0, 0.0, 0.0, 0.0, 0.0)
    if recording.rate_hz is not None:
        step = 1 / recording.rate_hz
        return Pace(step, step, 0.0, step, step)
    steps: FloatArray = np.diff(recording.times())
    low, median, high, long = (float(q) for q in np.quantile(steps, (0.1, 0.5, 0.9, 0.95)))
    limit = min(GAP_STEPS * long, max(MAX_GAP_S, GAP_STEPS * median))
    return Pace(median, float(steps.mean()), (high - low) / median, float(steps.max()), limit)


def is_number(value: object) -> TypeGuard[int | float]:
    """Whether an entry of ``meta`` is a number that a float can hold."""
    return (
        isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
    )


def check_timing(recordings: Sequence[Recording], paces: Sequence[Pace]) -> Iterator[Finding]:
    """Judge rates, jitter, gaps and lengths."""
    yield from _rates(recordings, paces)
    yield from _sparse(recordings, paces)
    yield from _gaps(recordings, paces)
    yield from _steps(recordings, paces)
    yield from _lengths(recordings)


def _rates(recordings: Sequence[Recording], paces: Sequence[Pace]) -> Iterator[Finding]:
    slow = [i for i, p in enumerate(paces) if p.median_s * SLOWEST_RATE_HZ > 1]
    if slow:
        message = f"{counted(len(slow))} with less than one sample per second: are the stamps in seconds?"
        yield found("error", "slow", message, recordings, slow)
    rates = sorted({r.rate_hz for r in recordings if r.rate_hz is not None})
    if len(rates) > 1:
        usual = max(rates, key=lambda rate: sum(r.rate_hz == rate for r in recordings))
        other = [i for i, r in enumerate(recordings) if r.rate_hz not in (None, usual)]
        message = (
            f"{len(rates)} different rates, {rates[0]:g} to {rates[-1]:g} Hz; {len(other)} not at {usual:g}"
        )
        yield found("warning", "rates-differ", message, recordings, other, rates_hz=rates)
    stated = {i: r.meta.get("rate_hz") for i, r in enumerate(recordings) if r.time_s is not None}
    broken = {
        i: rate
        for i, rate in stated.items()
        if is_number(rate) and paces[i].mean_s and abs(paces[i].mean_s * rate - 1) > RATE_TOLERANCE
    }
    if broken:
        worst = max(broken, key=lambda i: abs(paces[i].mean_s * broken[i] - 1))
        message = (
            f"{counted(len(broken))} {verb(len(broken), 'does', 'do')} not keep the stated rate: the stamps of "
            f"{recordings[worst].name!r} mean {1 / paces[worst].mean_s:.4g} Hz, its meta says {broken[worst]:g}"
        )
        yield found("warning", "rate-not-kept", message, recordings, broken)


def _sparse(recordings: Sequence[Recording], paces: Sequence[Pace]) -> Iterator[Finding]:
    means = {
        i: 1 / paces[i].mean_s for i, r in enumerate(recordings) if r.time_s is not None and paces[i].mean_s
    }
    usual = float(np.median(list(means.values()))) if means else 0.0
    sparse = [i for i, rate in means.items() if rate < SPARSE * usual]
    if sparse:
        least = min(sparse, key=lambda i: means[i])
        message = (
            f"{counted(len(sparse))} with less than half as many samples per second as usual ({usual:.3g}): "
            f"{recordings[least].name!r} has {means[least]:.2g}"
        )
        yield found("warning", "sparse", message, recordings, sparse, usual_hz=usual, least_hz=means[least])


def _gaps(recordings: Sequence[Recording], paces: Sequence[Pace]) -> Iterator[Finding]:
    holed = [i for i, p in enumerate(paces) if p.longest_s > p.limit_s]
    if holed:
        worst = max(holed, key=lambda i: paces[i].longest_s)
        gap = paces[worst].longest_s
        message = (
            f"{counted(len(holed))} {verb(len(holed), 'has', 'have')} gaps, the longest {gap:.3g} s in "
            f"{recordings[worst].name!r}"
        )
        long = sum(paces[i].longest_s > MAX_GAP_S for i in holed)
        if long:
            message += f"; {long} above {MAX_GAP_S:g} s, which resampling refuses"
        yield found("warning", "gaps", message, recordings, holed, longest_s=gap)


def _steps(recordings: Sequence[Recording], paces: Sequence[Pace]) -> Iterator[Finding]:
    irregular = [i for i, r in enumerate(recordings) if not r.is_uniform and r.n_samples > 1]
    if not irregular:
        return
    jittery = [i for i in irregular if paces[i].spread > JITTER_TOLERANCE]
    if jittery:
        median = float(np.median([paces[i].median_s for i in jittery]))
        mean = float(np.median([paces[i].mean_s for i in jittery]))
        message = (
            f"{counted(len(jittery))} with uneven steps (median {1e3 * median:.3g} ms, mean {1e3 * mean:.3g} ms): "
            f"above {0.5 / mean:.3g} Hz the resampled signal is made up"
        )
        yield found("warning", "jitter", message, recordings, jittery, median_step_s=median, mean_step_s=mean)
    message = f"{counted(len(irregular))} irregularly sampled: resample before extracting features"
    yield found("info", "irregular", message, recordings, irregular)


def _lengths(recordings: Sequence[Recording]) -> Iterator[Finding]:
    lengths = [r.n_samples for r in recordings]
    if len(set(lengths)) > 1:
        seconds = [f"{pick(r.duration_s for r in recordings):.3g}" for pick in (min, max)]
        lasting = f", {seconds[0]} to {seconds[1]} s" if seconds[0] != seconds[1] else ""
        message = f"lengths differ, {min(lengths)} to {max(lengths)} samples{lasting}: align before comparing"
        yield found("info", "lengths-differ", message, shortest=min(lengths), longest=max(lengths))

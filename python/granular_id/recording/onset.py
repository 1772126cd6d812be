"""Onsets: where the motion begins, found from the wrench alone; see :meth:`Dataset.find_onsets`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, argument_error, checked_flag, finite_number
from granular_id._core import GranularIdError
from granular_id.recording.recording import Recording, SampleFlag, irregular_among, places_of
from granular_id.recording.report import StepReport, subject

REST_S = 0.1
"""Default of ``rest_s``: the paper starts "a fraction of a second" before the motion; a tenth is the least of that."""

FALSE_ALARM_RATE = 1e-3
"""Default of ``false_alarm_rate``: one false onset in a thousand recordings, fewer than a data set has."""

ONSET_STEP = "find_onsets"
"""Name of this step in ``Dataset.history``."""

_ORDER = ("not found", "overruled", "found", "recorded")  # as rows of a report: what needs a look comes first


@dataclass(frozen=True)
class Onset:
    """Where the motion of one recording begins; no index, and why there is none."""

    index: int | None
    axes: tuple[str, ...] = ()  # that carry the change, the strongest first
    why: str = ""


def _rest_samples(rest_s: object, rate_hz: float) -> int:
    """Return how many samples the rest holds, or say that they are too few."""
    seconds = finite_number("rest_s", rest_s, positive=True)
    rest = round(min(seconds * rate_hz, 1e15))
    if rest < _WINDOWS_IN_REST:
        problem = (
            f"={seconds:g} holds {rest} samples at {rate_hz:g} Hz; the noise cannot be judged from fewer "
            f"than {_WINDOWS_IN_REST}: rest_s={_WINDOWS_IN_REST / rate_hz:g} or more is wanted"
        )
        raise argument_error(GranularIdError, "rest_s", problem)
    return rest


# Windows that fit into the rest: fewer would not show how windows differ, more would not average the noise.
_WINDOWS_IN_REST = 5
# Windows that a change must last to count: two are compared, and one between them keeps glitches out.
_SPAN = 3


def find_onset(recording: Recording, rest: int, rate: float) -> Onset:
    """Find the onset of a uniform recording with so many samples at rest."""
    wrench, axes = recording.wrench, recording.axes
    window = max(1, rest // _WINDOWS_IN_REST)
    needed = rest + _SPAN * window
    if len(wrench) < needed:
        compared = f"{rest} at rest and {_SPAN * window} to compare"
        why = f"too short: {len(wrench)} samples, {needed} wanted ({compared})"
        return Onset(None, why=why)
    # Powers of two, so that no bit is lost: what the units are makes no difference, and squares cannot overflow
    exponent = np.clip(np.frexp(np.abs(wrench).max(axis=0))[1], -1000, 1023)
    samples = wrench * np.ldexp(1.0, -exponent)
    samples -= samples[0].copy()
    noise = _rest_noise(samples[:rest], np.abs(np.diff(samples, axis=0)), window)
    by_axis, joint = _changes(samples, noise, rest, window, rate)
    passed = np.flatnonzero(joint > 1)
    if not len(passed):
        return Onset(None, why=_why_not(samples, noise, rest, window, recording))
    first = int(passed[0])
    own = by_axis[first : first + _SPAN * window].max(axis=0)
    carrying = tuple(axes[c] for c in np.argsort(-own) if own[c] > 1)
    index = _beginning(samples, by_axis[first] > 1, noise.shared, rest + first, rest, window)
    return Onset(index, carrying)


# Factor on Satterthwaite's degrees of freedom. False alarms come from the lower tail of an estimate, and that is
# thinner than his approximation says where the larger of two estimates is taken and two axes must agree.
_THINNER_TAIL = 2.5
# A sensor is slower than its messages where less than this part of the samples differ from the one before; fewer
# readings than these say nothing.
_MOSTLY_NEW, _READINGS = 0.5, 4


class _RestNoise(NamedTuple):
    level: FloatArray  # mean of the samples of each of C axes
    shared: FloatArray  # (C,): variance of the difference of neighbouring windows, colour shared by all axes
    dof: float  # its degrees of freedom
    own: FloatArray  # (C,): the same from each axis alone; not above `shared`
    own_dof: float
    least_step: FloatArray  # (C,): smallest change, by which a level may seem to differ though it does not
    reading: float  # samples that one reading of the sensor lasts, 1 where each sample is new


def _window_means(samples: FloatArray, window: int) -> FloatArray:
    """Return the means of all windows along the first axis, by running sums: `samples` should be near zero."""
    sums = np.cumsum(samples, axis=0)
    sums[window:] -= sums[:-window].copy()
    return sums[window - 1 :] / window


def _rest_noise(at_rest: FloatArray, steps: FloatArray, window: int) -> _RestNoise:
    """Measure how much neighbouring windows differ at rest; `steps` are those of the whole recording, absolute.

    One axis offers about three such differences, too few: their size over that of single samples is pooled over axes.
    """
    rest = len(at_rest)
    level = at_rest.mean(axis=0)
    centred = at_rest - level
    least_step = np.where(steps > 0, steps, np.inf).min(axis=0)
    least_step[np.isinf(least_step)] = 0.0
    fast = np.square(steps[: rest - 1]).mean(axis=0)
    means = _window_means(centred, window)
    own = np.square(means[window:] - means[:-window]).mean(axis=0)
    live = fast > 0
    colour = float((own[live] / fast[live]).sum()) / max(int(live.sum()), 1)
    size_dof = 2 / 3 * (rest - 1)  # of the mean square of differences between independent samples
    own_dof = size_dof if window == 1 else 0.75 * (rest / window - 1)
    dof = _THINNER_TAIL / (1 / (own_dof * _independent(centred)) + 1 / size_dof)
    # reading is exact to half a count at best, evenly spread: a variance of one count squared over twelve
    own = np.maximum(own, 2 / window * np.square(least_step) / 12)
    return _RestNoise(
        level,
        np.maximum(own, colour * fast),
        dof,
        own,
        own_dof,
        least_step,
        _reading(np.any(steps > 0, axis=1)),
    )


def _reading(changes: NDArray[np.bool_]) -> float:
    """Return how many samples a reading lasts, by where any axis changes: three quarters of them last so long."""
    begins = np.flatnonzero(changes[1:] & ~changes[:-1])  # one sample in between may be interpolated
    if len(begins) <= _READINGS or changes.mean() > _MOSTLY_NEW:
        return 1.0
    return float(np.quantile(np.diff(begins), 0.25))


def _independent(centred: FloatArray) -> float:
    """Count how many independent axes those that are not still are worth: participation ratio of their correlations."""
    size = np.linalg.norm(centred, axis=0)
    scaled = centred[:, size > 0] / size[size > 0]
    total = float(np.square(scaled.T @ scaled).sum())
    return max(scaled.shape[1] ** 2 / total, 1.0) if total else 1.0


# Where windows differ by more than that.


def _changes(
    samples: FloatArray, noise: _RestNoise, rest: int, window: int, rate: float
) -> tuple[FloatArray, FloatArray]:
    """Return the change at each of n samples behind the rest over the smallest that counts, by axis (n, C) and of all.

    Of all axes the second largest counts, or one by its own noise, lest an axis with slower noise ring every alarm.
    """
    n_tests, n_axes = len(samples) - rest - _SPAN * window + 1, samples.shape[1]
    critical = _factor(noise.dof, rate / n_axes, n_tests / window) * np.sqrt(noise.shared)
    alone = _factor(noise.own_dof, rate / n_axes, n_tests / window) * np.sqrt(noise.own)
    unseen = (noise.shared == 0) | (noise.reading > window)
    critical[unseen], alone[unseen] = np.inf, np.inf
    means = _window_means(samples, window)
    apart = (_SPAN - 1) * window
    low, high = (bound(means[apart:], means[:-apart]) for bound in (np.minimum, np.maximum))
    first = rest - _SPAN * window  # where the stretch before the first tested sample begins
    before, after = slice(first, first + n_tests), slice(rest, rest + n_tests)
    # Two windows before and two after must agree: no glitch passes. Their gap never exceeds the difference of the
    # two that meet; two readings of one level may differ by one count.
    gap = np.maximum(low[after] - high[before], low[before] - high[after])
    gap = np.maximum(gap - noise.least_step, 0.0)
    own = gap / alone
    if n_axes == 1:
        return own, own[:, 0]
    by_axis = gap / critical
    return by_axis, np.maximum(own.max(axis=1), np.partition(by_axis, -2, axis=1)[:, -2])


def _factor(dof: float, rate: float, n_tests: float) -> float:
    """Return how many standard errors a change must measure in one of so many tests that share their estimate.

    The smaller of two bounds on the upper point of a studentised maximum: Student's t for a share of the rate
    (Bonferroni), close where the noise is known well; and t for all of it, times what the largest of so many normal
    values reaches, close where few degrees of freedom make the alarms.
    """
    from scipy.special import stdtrit  # slow to import, and only this step needs it

    n = max(n_tests, 1.0)
    for_each, for_all = -stdtrit(dof, rate / n / 2), -stdtrit(dof, rate / 2)
    return float(min(for_each, math.sqrt(2 * math.log(n) + 1) * for_all))


# When a change that was found actually began.

# Courses of a change, powers of the time since it began: a jump, a steady rise, the rise of what accelerates.
_POWERS = (0, 1, 2)
# Longest stretch that is fitted sample by sample; longer ones are averaged down to it.
_MOST_POINTS = 400
# How many rests to look back from where a change was found, and how many typical differences of windows are no move.
_LOOK_BACK = 5
_AT_LEVEL = 6.0
# Half windows fitted after that. Synthetic pushes: with 2 the curve's bend is taken for its beginning (10 ms late),
# with 6 it mostly is (12 ms late), with 3 the middle of all errors is 3 ms.
_AFTER = 3


def _beginning(
    samples: FloatArray, carried: NDArray[np.bool_], noise: FloatArray, at: int, rest: int, window: int
) -> int:
    """Estimate the sample at which the change that was found at one began, by the best of `_POWERS` in least squares.

    The axes that carry it are added up as by a matched filter; for white noise this is maximum likelihood (Hinkley).
    """
    change = samples[at : at + window].mean(axis=0) - samples[at - window : at].mean(axis=0)
    course = samples[:, carried] @ (change[carried] / noise[carried])
    begin = _left_level(course[:at], rest, window) - rest
    length = rest + _AFTER * window // 2
    stride = -(-length // _MOST_POINTS)
    n = length // stride
    begin += length - n * stride
    fitted = course[begin : begin + n * stride].reshape(n, stride).mean(axis=1)
    shapes, starts = _shapes(n, -(-window // stride))
    return begin + int(starts[(shapes @ (fitted - fitted.mean())).argmax()]) * stride


def _left_level(course: FloatArray, rest: int, window: int) -> int:
    """Return the last sample at which the course was at its level of some rests before its end, drift and all."""
    begin = max(0, len(course) - (_LOOK_BACK + 1) * rest)
    means, calm = _window_means(course[begin:], window), _window_means(course[:rest], window)
    usual = np.sqrt(np.square(calm[window:] - calm[:-window]).mean())
    at_level = np.flatnonzero(np.abs(means - course[begin : begin + rest].mean()) <= _AT_LEVEL * usual)
    return begin + max(int(at_level[-1]) + window if len(at_level) else rest, rest)


@lru_cache(maxsize=64)
def _shapes(length: int, window: int) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the centred unit courses of changes, one a row, and the sample at which each begins."""
    time = np.arange(length)
    # a rise is at its old level at k, a jump at k has just left it; each leaves points to be seen by
    starts = np.arange(1, length - max(window // 4, 1))
    since = time - starts[:, np.newaxis]
    shapes = np.concatenate([(since >= 0) * np.maximum(since, 0.0) ** power for power in _POWERS])
    shapes -= shapes.mean(axis=1, keepdims=True)
    return shapes / np.linalg.norm(shapes, axis=1, keepdims=True), np.tile(starts, len(_POWERS))


# A level that strays this many typical differences from that at rest has moved, if ever so slowly.
_STRAYED = 6.0


def _why_not(samples: FloatArray, noise: _RestNoise, rest: int, window: int, recording: Recording) -> str:
    """Say why there is no onset."""
    rate_hz = recording.rate_hz or 0.0
    if noise.reading > window:
        wanted = _WINDOWS_IN_REST * math.ceil(noise.reading) / rate_hz
        return (
            f"the sensor has new values at {rate_hz / noise.reading:.3g} Hz only, samples in between repeat them: "
            f"rest_s={wanted:g} or more is wanted"
        )
    if not noise.shared.any():
        return "no axis ever changes"
    usual = np.sqrt(noise.shared)
    wander = np.abs(_window_means(samples[rest:], window) - noise.level).max(axis=0)
    strayed = (wander - noise.least_step) / np.where(usual > 0, usual, np.inf)
    axis = int(strayed.argmax())
    if strayed[axis] <= _STRAYED:
        return f"no change stands out from the noise of the first {rest / rate_hz:g} s"
    strays = f"{recording.axes[axis]} strays from its level"
    return f"no abrupt change, though {strays}: it starts in motion, drifts, or needs a longer rest"


# Onsets of a whole data set: found, recorded or overruled, each listed in the report.


def find_all_onsets(
    recordings: Sequence[Recording],
    rest_s: float,
    false_alarm_rate: float,
    overrule: Mapping[str, float | None] | None,
    replace_recorded: bool,
) -> tuple[list[Recording], StepReport]:
    """Set the trigger of each recording; see :meth:`Dataset.find_onsets`, which calls this."""
    replace_recorded = checked_flag("replace", replace_recorded)
    rate = finite_number("false_alarm_rate", false_alarm_rate)
    if not 1e-12 <= rate <= 0.5:
        problem = f"must be between 1e-12 and 0.5, got {rate:g}"
        raise argument_error(GranularIdError, "false_alarm_rate", problem)
    seconds = finite_number("rest_s", rest_s, positive=True)
    stated = _stated_indices(recordings, overrule)
    judged = {
        i: r
        for i, r in enumerate(recordings)
        if i not in stated and (replace_recorded or r.trigger_index is None)
    }
    irregular = irregular_among(list(judged.values()))
    if irregular:
        raise GranularIdError(
            f"{irregular}, and windows of a varying number of samples cannot be compared; call "
            ".resample(rate_hz) first, or overrule these"
        )
    results: list[Recording] = []
    rows: list[dict[str, Any]] = []
    filled: list[str] = []
    for i, recording in enumerate(recordings):
        index, row = recording.trigger_index, {"how": "recorded"}
        if i in stated:
            index, row = stated[i], {"how": "overruled"}
        elif i in judged:
            rest = _rest_samples(seconds, recording.rate_hz or 0.0)
            if recording.flags is not None and (recording.flags[:rest] & SampleFlag.GAP_FILLED).any():
                filled.append(recording.name)
            found = find_onset(recording, rest, rate)
            index, row = found.index, {"how": "found", "axes": " ".join(found.axes)}
            if index is None:
                row = {"how": "not found", "why": found.why}
        onset_s = None if index is None else float(recording.times()[index])
        rows.append({"name": recording.name, "onset_s": onset_s, **row})
        unchanged = index == recording.trigger_index
        results.append(recording if unchanged else replace(recording, trigger_index=index))
    rows.sort(key=lambda row: _ORDER.index(row["how"]))
    how = Counter(row["how"] for row in rows)
    times = [row["onset_s"] for row in rows if row["onset_s"] is not None]
    picks: dict[str, Callable[[Any], Any]] = {"earliest": min, "median": np.median, "latest": max}
    totals = {
        "recordings": len(rows),
        **{word.replace(" ", "_"): how[word] for word in ("found", "not found", "overruled", "recorded")},
        **{f"{word}_onset_s": float(pick(times)) for word, pick in picks.items() if times},
    }
    parameters = {
        "rest_s": seconds,
        "false_alarm_rate": rate,
        "overrule": dict(overrule) if overrule else None,
        "replace": replace_recorded,
    }
    notes = []
    if filled:
        notes.append(
            f"{subject(len(filled))} filled gaps in what is taken for rest (the first is {filled[0]!r}): straight "
            "lines hide the noise there, and the false-alarm rate does not hold for them"
        )
    return results, StepReport(ONSET_STEP, parameters, totals, rows, notes)


def _stated_indices(
    recordings: Sequence[Recording], overrule: Mapping[str, float | None] | None
) -> dict[int, int | None]:
    """Turn names and seconds into places and samples, or say what is wrong with them."""
    stated: dict[int, int | None] = {}
    overrule = {} if overrule is None else overrule
    if not isinstance(overrule, Mapping):
        problem = f"must map names of recordings to seconds, as in {{'rice_01': 0.25}}, got {overrule!r:.60}"
        raise argument_error(TypeError, "overrule", problem)
    places = places_of(r.name for r in recordings)
    for name, seconds in overrule.items():
        found = places.get(name, [])
        if len(found) != 1:
            problem = f": {len(found) or 'no'} recordings are called {name!r}; one is wanted"
            raise argument_error(GranularIdError, "overrule", problem)
        stated[found[0]] = None
        if seconds is not None:
            recording = recordings[found[0]]
            time_s = finite_number(f"overrule[{name!r}]", seconds)
            if not 0 <= time_s <= recording.duration_s:
                problem = f"is {time_s:g} s; the recording lasts from 0 to {recording.duration_s:g} s"
                raise argument_error(GranularIdError, "overrule", f"[{name!r}] {problem}")
            stated[found[0]] = int(np.abs(recording.times() - time_s).argmin())
    return stated

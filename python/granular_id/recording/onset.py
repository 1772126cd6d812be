"""``find_onset`` and ``Onset``: where the motion begins, found from the wrench alone; the step for a data set."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._checks import FloatArray, argument_error, checked_flag, finite_number
from granular_id._core import AXES, GranularIdError
from granular_id.recording.recording import (
    Recording,
    SampleFlag,
    irregular_among,
    places_of,
    unit_of,
)
from granular_id.recording.report import StepReport, subject

REST_S = 0.1
"""Default of ``rest_s``: the paper starts "a fraction of a second" before the motion; a tenth is the least of that."""

FALSE_ALARM_RATE = 1e-3
"""Default of ``false_alarm_rate``: one false onset in a thousand recordings, fewer than a data set has."""

ONSET_STEP = "find_onsets"
"""Name of this step in ``Dataset.history``."""

_ORDER = ("not found", "overruled", "found", "kept")  # as rows of a report: what needs a look comes first
# Samples per block that is worked on at once: several arrays of this size stay within a processor's cache.
_BLOCK = 400_000


@dataclass(frozen=True, eq=False)
class Onset:
    """Where the motion of one recording begins, or why that cannot be said.

    Attributes
    ----------
    index : int or None
        Sample at which the change is estimated to have begun; None where none was found.
    time_s : float or None
        The same in seconds from the first sample.
    detected_s : float or None
        Time of the sample with which the change became certain: later than `time_s`, it is when an alarm that watches
        the signal as it comes would have rung.
    axes : tuple of str
        Axes that carry the change, the strongest first.
    strength : float
        Largest change around the onset (the largest anywhere where none was found), over the smallest that counts.
    why : str
        Why there is no onset, in words; empty where there is one.
    """

    index: int | None
    time_s: float | None
    detected_s: float | None
    axes: tuple[str, ...]
    strength: float
    why: str = ""

    def __repr__(self) -> str:
        if self.index is None:
            return f"Onset(None, why={self.why!r})"
        return (
            f"Onset({self.time_s:.6g} s, sample {self.index}, seen at {self.detected_s:.6g} s on "
            f"{' '.join(self.axes)}, {self.strength:.3g} times the threshold)"
        )


def find_onset(
    wrench: ArrayLike,
    rate_hz: float,
    *,
    rest_s: float = REST_S,
    false_alarm_rate: float = FALSE_ALARM_RATE,
    axes: Sequence[str] | None = None,
) -> Onset:
    """Find where the motion begins in one recording, or say why that is not possible.

    The first `rest_s` seconds are taken for rest. A change is found where neighbouring windows, a fifth of that long,
    differ by more than windows at rest do, by a quantile of Student's t; then the sample at which the change began is
    estimated by fitting a jump, a straight or a quadratic rise. Nothing has to be known about the noise: it may be
    autocorrelated, filtered, quantised or drift, as long as it stays what it was at rest. Where a sensor is slower than
    its messages, which then repeat its readings, the rest must hold five of these.

    Parameters
    ----------
    wrench : array_like, shape (T, C)
        Uniformly sampled axes in any units. A scale or an offset of an axis changes nothing.
    rate_hz : float
        Sampling rate, Hz.
    rest_s : float, default 0.1
        Seconds at the start that are known to be at rest; at least 5 samples. The longer, the smaller and the
        slower a change can be found.
    false_alarm_rate : float, default 0.001
        Probability that a recording without any motion gets an onset: per recording, not per sample or axis. It is
        approximate, and lower in most simulated noises.
    axes : sequence of str, optional
        Names of the axes, for messages; default fx fy fz tx ty tz for six, else axis 0, axis 1, ...

    Returns
    -------
    Onset
        ``index`` is None, and ``why`` says so in words, where the recording is too short, nothing changes,
        it starts in motion already or the rest holds too few readings.

    Raises
    ------
    TypeError, ValueError
        Naming the argument: samples that are not finite, a rate or `rest_s` that is not positive or gives fewer
        than 5 samples, a false-alarm rate outside (0, 0.5].

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import find_onset
    >>> force = np.random.default_rng(0).normal(0, 0.02, (1600, 6))       # N, at rest
    >>> find_onset(force, rate_hz=500).why
    'no change stands out from the noise of the first 0.1 s'
    >>> load = 2 * (1 - np.exp(-np.arange(1520) / 15))                    # motion from 0.16 s on
    >>> force[80:, [0, 4]] += np.outer(load, [1, 0.1])                    # N, N m
    >>> onset = find_onset(force, rate_hz=500)
    >>> onset.index, onset.axes
    (79, ('fx', 'ty'))
    """
    n_axes = np.shape(wrench)[1] if np.ndim(wrench) == 2 else len(AXES)
    if axes is None and n_axes != len(AXES):
        axes = [f"axis {i}" for i in range(n_axes)]
    recording = Recording(wrench, rate_hz=rate_hz, axes=axes or ())  # type: ignore[arg-type]
    return onsets_of([recording], rest_s=rest_s, false_alarm_rate=false_alarm_rate)[0]


def _checked_false_alarm_rate(value: object) -> float:
    rate = finite_number("false_alarm_rate", value)
    if not 1e-12 <= rate <= 0.5:
        problem = f"must be between 1e-12 and 0.5, got {rate:g}"
        raise argument_error(GranularIdError, "false_alarm_rate", problem)
    return rate


def rest_samples(rest_s: object, rate_hz: float) -> int:
    """Return how many samples the rest holds, or say that they are too few."""
    seconds = finite_number("rest_s", rest_s, positive=True)
    rest = round(min(seconds * rate_hz, 1e15))
    if rest < WINDOWS_IN_REST:
        problem = (
            f"={seconds:g} holds {rest} samples at {rate_hz:g} Hz; the noise cannot be judged from fewer "
            f"than {WINDOWS_IN_REST}: rest_s={WINDOWS_IN_REST / rate_hz:g} or more is wanted"
        )
        raise argument_error(GranularIdError, "rest_s", problem)
    return rest


def find_onsets_in_block(
    wrenches: Sequence[FloatArray] | FloatArray, rate_hz: float, rest: int, rate: float, axes: tuple[str, ...]
) -> list[Onset]:
    """Find the onsets of checked recordings of one length, rate and set of axes, shape (n, T, C)."""
    at_once = max(1, _BLOCK // wrenches[0].size)
    found: list[Onset] = []
    for begin in range(0, len(wrenches), at_once):
        found += _find(np.array(wrenches[begin : begin + at_once]), rate_hz, rest, rate, axes)
    return found


def _find(block: FloatArray, rate_hz: float, rest: int, rate: float, axes: tuple[str, ...]) -> list[Onset]:
    window = max(1, rest // WINDOWS_IN_REST)
    n_samples = block.shape[1]
    needed = rest + _SPAN * window
    none: dict[str, Any] = {"index": None, "time_s": None, "detected_s": None, "axes": ()}
    if n_samples < needed:
        why = f"too short: {n_samples} samples, {needed} wanted ({rest} at rest and {_SPAN * window} to compare)"
        return [Onset(**none, strength=0.0, why=why)] * len(block)
    # Powers of two, so that no bit is lost: what the units are makes no difference, and squares cannot overflow
    exponent = np.clip(np.frexp(np.maximum(block.max(axis=1), -block.min(axis=1)))[1], -1000, 1023)
    scale = np.ldexp(1.0, exponent)
    block *= np.ldexp(1.0, -exponent)[:, np.newaxis]
    block -= block[:, :1].copy()
    noise = _rest_noise(block, rest, window)
    statistic, joint = _changes(block, noise, rest, window, rate)
    passed = joint > 1
    first = np.where(passed.any(axis=1), passed.argmax(axis=1), -1)
    began = _change_times(block, statistic, first, noise, rest, window)
    onsets = []
    for i, at in enumerate(first.tolist()):
        known = {**none, "strength": float(joint[i].max())}
        if at < 0:
            known["why"] = _why_not(block[i], noise, i, scale[i], rest, window, rate_hz, axes)
        else:
            seen = at + _SPAN * window - 1
            own = statistic[i, at : seen + 1].max(axis=0)
            known = {
                "index": began[i],
                "time_s": began[i] / rate_hz,
                "detected_s": seen / rate_hz,
                "axes": tuple(axes[c] for c in np.argsort(-own) if own[c] > 1),
                "strength": float(joint[i, at : at + rest].max()),
            }
        onsets.append(Onset(**known))
    return onsets


# What an axis does while nothing moves, measured on the few samples before the motion.

WINDOWS_IN_REST = 5
"""Windows that fit into the rest: fewer would not show how windows differ, more would not average the noise."""

# Windows that a change must last to count: two are compared, and one between them keeps glitches out.
_SPAN = 3
# Factor on Satterthwaite's degrees of freedom. False alarms come from the lower tail of an estimate, and that is
# thinner than his approximation says where the larger of two estimates is taken and two axes must agree.
_THINNER_TAIL = 2.5
# A sensor is slower than its messages where less than this part of the samples differ from the one before; fewer
# readings than these say nothing.
_MOSTLY_NEW, _READINGS = 0.5, 4


@dataclass(frozen=True)
class _RestNoise:
    """Noise at rest of n recordings of C axes."""

    level: FloatArray  # (n, C): mean of the samples
    shared: (
        FloatArray  # (n, C): variance of the difference of neighbouring windows, colour shared by all axes
    )
    dof: FloatArray  # (n,): its degrees of freedom
    own: FloatArray  # (n, C): the same from each axis alone; not above `shared`
    own_dof: float
    count: FloatArray  # (n, C): smallest change, by which a level may seem to differ though it does not
    reading: FloatArray  # (n,): samples that one reading of the sensor lasts, 1 where each sample is new


def _windows_of(samples: FloatArray, window: int) -> FloatArray:
    """Return the means of all windows, (n, T - window + 1, C), by running sums: `samples` should be near zero."""
    sums = np.cumsum(samples, axis=1)
    sums[:, window:] -= sums[:, :-window].copy()
    return sums[:, window - 1 :] / window


def _rest_noise(samples: FloatArray, rest: int, window: int) -> _RestNoise:
    """Measure how much neighbouring windows differ in the first `rest` samples of recordings, shape (n, T, C).

    One axis offers about three such differences, too few: how much larger they are than those of single samples is
    pooled over the axes of a sensor. Axes that move together count once (participation ratio of their correlations).
    """
    at_rest = samples[:, :rest]
    level = at_rest.mean(axis=1)
    centred = at_rest - level[:, np.newaxis]
    step = np.abs(np.diff(samples, axis=1))
    count = np.where(step > 0, step, np.inf).min(axis=1)
    count[np.isinf(count)] = 0.0
    fast = np.square(step[:, : rest - 1]).mean(axis=1)
    means = _windows_of(centred, window)
    own = np.square(means[:, window:] - means[:, :-window]).mean(axis=1)
    live = fast > 0
    ratio = np.divide(own, fast, out=np.zeros_like(own), where=live)
    colour = ratio.sum(axis=1) / np.maximum(live.sum(axis=1), 1)
    size_dof = 2 / 3 * (rest - 1)  # of the mean square of differences between independent samples
    own_dof = size_dof if window == 1 else 0.75 * (rest / window - 1)
    dof = _THINNER_TAIL / (1 / (own_dof * _independent(centred)) + 1 / size_dof)
    # reading is exact to half a count at best, evenly spread: a variance of one count squared over twelve
    own = np.maximum(own, 2 / window * np.square(count) / 12)
    shared = np.maximum(own, colour[:, np.newaxis] * fast)
    changes: NDArray[np.bool_] = np.any(step > 0, axis=2)
    reading = np.array([_reading(one) for one in changes])
    return _RestNoise(level, shared, dof, own, own_dof, count, reading)


def _reading(changes: NDArray[np.bool_]) -> float:
    """Return how many samples a reading lasts, by where any axis changes: three quarters of them last so long."""
    begins = np.flatnonzero(changes[1:] & ~changes[:-1])  # one sample in between may be interpolated
    if len(begins) <= _READINGS or changes.mean() > _MOSTLY_NEW:
        return 1.0
    return float(np.quantile(np.diff(begins), 0.25))


def _independent(centred: FloatArray) -> FloatArray:
    """Count how many independent axes those that are not still are worth, shape (n,), at least 1."""
    size = np.sqrt(np.square(centred).sum(axis=1, keepdims=True))
    scaled = np.divide(centred, size, out=np.zeros_like(centred), where=size > 0)
    correlation = np.matmul(scaled.transpose(0, 2, 1), scaled)
    total = np.square(correlation).sum(axis=(1, 2))
    trace = np.trace(correlation, axis1=1, axis2=2)
    independent: FloatArray = np.maximum(np.square(trace) / np.where(total > 0, total, 1.0), 1.0)
    return independent


# Where windows differ by more than that.


def _changes(
    samples: FloatArray, noise: _RestNoise, rest: int, window: int, rate: float
) -> tuple[FloatArray, FloatArray]:
    """Return the change at each sample over the smallest that counts, by axis (n, T, C) and of all (n, T).

    Of all axes the second largest counts, or a single one by its own noise, lest an axis with slower noise than the
    others ring every alarm; 0 where there is no room for the windows.
    """
    n_samples, n_axes = samples.shape[1:]
    n_tests = n_samples - rest - _SPAN * window + 1
    critical = _factor(noise.dof, rate / n_axes, n_tests / window)[:, np.newaxis] * np.sqrt(noise.shared)
    alone = _factor(noise.own_dof, rate / n_axes, n_tests / window) * np.sqrt(noise.own)
    unseen = (noise.shared == 0) | (noise.reading > window)[:, np.newaxis]
    critical[unseen], alone[unseen] = np.inf, np.inf
    means = _windows_of(samples, window)
    apart = (_SPAN - 1) * window
    low, high = (bound(means[:, apart:], means[:, :-apart]) for bound in (np.minimum, np.maximum))
    first = rest - _SPAN * window  # where the stretch before the first tested sample begins
    before, after = slice(first, first + n_tests), slice(rest, rest + n_tests)
    # Two windows before and two after must agree: no glitch passes. Their gap never exceeds the difference of the
    # two that meet; two readings of one level may differ by one count.
    gap = np.maximum(low[:, after] - high[:, before], low[:, before] - high[:, after])
    gap = np.maximum(gap - noise.count[:, np.newaxis], 0.0)
    statistic, joint = np.zeros(samples.shape), np.zeros(samples.shape[:2])
    own = gap / alone[:, np.newaxis]
    statistic[:, after] = own if n_axes == 1 else gap / critical[:, np.newaxis]
    joint[:, after] = own.max(axis=2)
    if n_axes > 1:
        np.maximum(joint, np.partition(statistic, -2, axis=2)[:, :, -2], out=joint)
    return statistic, joint


def _factor(dof: ArrayLike, rate: float, n_tests: float) -> FloatArray:
    """Return how many standard errors a change must measure in one of so many tests that share their estimate.

    The smaller of two bounds on the upper point of a studentised maximum: Student's t for a share of the rate
    (Bonferroni), close where the noise is known well; and t for all of it, times what the largest of so many normal
    values reaches, close where few degrees of freedom make the alarms.
    """
    from scipy.special import stdtrit  # slow to import, and only this step needs it

    n = max(n_tests, 1.0)
    for_each, for_all = -stdtrit(dof, rate / n / 2), -stdtrit(dof, rate / 2)
    factor: FloatArray = np.minimum(for_each, math.sqrt(2 * math.log(n) + 1) * for_all)
    return factor


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


def _change_times(
    samples: FloatArray,
    statistic: FloatArray,
    first: NDArray[np.intp],
    noise: _RestNoise,
    rest: int,
    window: int,
) -> dict[int, int]:
    """Estimate the sample at which each change began, by the place of the recording.

    The axes, added up as by a matched filter, are fitted by a jump, a straight and a quadratic rise: the best by least
    squares is the maximum likelihood estimate for white noise (Hinkley).
    """
    passed = np.flatnonzero(first >= 0)
    first, moving = first[passed], samples[passed]
    before = np.take_along_axis(moving, (first[:, None] + np.arange(-window, 0))[:, :, None], axis=1)
    after = np.take_along_axis(moving, (first[:, None] + np.arange(window))[:, :, None], axis=1)
    carried = statistic[passed, first] > 1
    weights = np.zeros(carried.shape)
    change = after.mean(axis=1) - before.mean(axis=1)
    np.divide(change, noise.shared[passed], out=weights, where=carried)
    length = rest + _AFTER * window // 2
    course = np.einsum("ntc,nc->nt", moving, weights)
    left = np.array([_leaves(*one, rest, window) for one in zip(course, first, strict=True)], dtype=np.intp)
    course = np.take_along_axis(course, (left - rest)[:, np.newaxis] + np.arange(length), axis=1)
    stride = -(-length // _MOST_POINTS)
    kept = length // stride
    course = course[:, length - kept * stride :].reshape(len(course), kept, stride).mean(axis=2)
    shapes, begins = _shapes(kept, -(-window // stride))
    best = begins[((course - course.mean(axis=1, keepdims=True)) @ shapes.T).argmax(axis=1)]
    began = left - rest + (length - kept * stride) + best * stride
    return dict(zip(passed.tolist(), began.tolist(), strict=True))


def _leaves(course: FloatArray, first: int, rest: int, window: int) -> int:
    """Return the last sample before `first` at which the course was at its level of some rests ago, drift and all."""
    begin = max(0, int(first) - (_LOOK_BACK + 1) * rest)
    means = _windows_of(course[np.newaxis, begin:first, np.newaxis], window)[0, :, 0]
    calm = _windows_of(course[np.newaxis, :rest, np.newaxis], window)[0, :, 0]
    usual = np.sqrt(np.square(calm[window:] - calm[:-window]).mean())
    level = course[begin : begin + rest].mean()
    at_level = np.flatnonzero(np.abs(means - level) <= _AT_LEVEL * usual)
    last = int(at_level[-1]) + window if len(at_level) else rest
    return begin + max(last, rest)


@lru_cache(maxsize=64)
def _shapes(length: int, window: int) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the centred unit courses of changes, one a row, and the sample at which each begins."""
    time = np.arange(length)
    # a rise is at its old level at k, a jump at k has just left it; each leaves points to be seen by
    candidates = [
        (k, np.where(time >= k, 1.0, 0.0) if power == 0 else np.maximum(time - k, 0.0) ** power)
        for power in _POWERS
        for k in range(1, length - max(window // 4, 1))
    ]
    shapes = np.array([course - course.mean() for _, course in candidates])
    norms = np.linalg.norm(shapes, axis=1, keepdims=True)
    return shapes / norms, np.array([k for k, _ in candidates], dtype=np.intp)


# A level that strays this many typical differences from that at rest has moved, if ever so slowly.
_STRAYED = 6.0


def _why_not(
    samples: FloatArray,
    noise: _RestNoise,
    i: int,
    scale: FloatArray,
    rest: int,
    window: int,
    rate_hz: float,
    axes: tuple[str, ...],
) -> str:
    """Say why there is no onset in recording `i` of a block, of which `samples` are given."""
    if noise.reading[i] > window:
        wanted = WINDOWS_IN_REST * math.ceil(noise.reading[i]) / rate_hz
        return (
            f"the sensor has new values at {rate_hz / noise.reading[i]:.3g} Hz only, samples in between repeat them: "
            f"rest_s={wanted:g} or more is wanted"
        )
    if not noise.shared[i].any():
        return "no axis ever changes"
    usual = np.sqrt(noise.shared[i])
    means = _windows_of(samples[np.newaxis, rest:], window)[0]
    wander = np.abs(means - noise.level[i]).max(axis=0)
    strayed = (wander - noise.count[i]) / np.where(usual > 0, usual, np.inf)
    axis = int(strayed.argmax())
    if strayed[axis] <= _STRAYED:
        return f"no change stands out from the noise of the first {rest / rate_hz:g} s"
    with np.errstate(over="ignore"):
        distance = wander[axis] * scale[axis]
    strays = f"{axes[axis]} strays by {distance:.2g} {unit_of(axes[axis])}".rstrip()
    return f"no abrupt change, though {strays}: it starts in motion, drifts, or needs a longer rest"


# Onsets of a whole data set: found, kept or overruled, each said in the report.


def find_all_onsets(
    recordings: Sequence[Recording],
    rest_s: float,
    false_alarm_rate: float,
    overrule: Mapping[str, float | None] | None,
    replace_recorded: bool,
) -> tuple[list[Recording], StepReport]:
    """Set the trigger of each recording; see :meth:`Dataset.find_onsets`, which calls this."""
    replace_recorded = checked_flag("replace", replace_recorded)
    stated = _stated_indices(recordings, overrule)
    judged = [
        i
        for i, r in enumerate(recordings)
        if i not in stated and (replace_recorded or r.trigger_index is None)
    ]
    onsets = onsets_of([recordings[i] for i in judged], rest_s=rest_s, false_alarm_rate=false_alarm_rate)
    found = dict(zip(judged, onsets, strict=True))
    results: list[Recording] = []
    rows: list[dict[str, Any]] = []
    for i, recording in enumerate(recordings):
        row: dict[str, Any] = {"how": "kept"}
        index = recording.trigger_index
        if i in stated:
            index, row = stated[i], {"how": "overruled"}
        elif i in found:
            onset = found[i]
            index, row = onset.index, {"how": "not found", "why": onset.why}
            if index is not None:
                strength, axes = round(onset.strength, 2), " ".join(onset.axes)
                row = {"how": "found", "detected_s": onset.detected_s, "strength": strength, "axes": axes}
        onset_s = None if index is None else float(recording.times()[index])
        rows.append({"name": recording.name, "onset_s": onset_s, **row})
        unchanged = index == recording.trigger_index
        results.append(recording if unchanged else replace(recording, trigger_index=index))
    rows.sort(key=lambda row: _ORDER.index(row["how"]))
    how = Counter(row["how"] for row in rows)
    times = [row["onset_s"] for row in rows if row["onset_s"] is not None]
    totals = {
        "recordings": len(rows),
        "stored_triggers_replaced": sum(recordings[i].trigger_index is not None for i in judged),
        **{word.replace(" ", "_"): how[word] for word in ("found", "not found", "overruled", "kept")},
        "earliest_onset_s": min(times, default=None),
        "median_onset_s": float(np.median(times)) if times else None,
        "latest_onset_s": max(times, default=None),
    }
    parameters = {
        "rest_s": float(rest_s),
        "false_alarm_rate": float(false_alarm_rate),
        "overrule": dict(overrule) if overrule else None,
        "replace": replace_recorded,
    }
    return results, StepReport(ONSET_STEP, parameters, totals, rows, _notes(recordings, judged, rest_s))


def onsets_of(recordings: Sequence[Recording], *, rest_s: float, false_alarm_rate: float) -> list[Onset]:
    """Find the onset of each recording, those of equal length and rate together; irregular ones are refused."""
    rate = _checked_false_alarm_rate(false_alarm_rate)
    finite_number("rest_s", rest_s, positive=True)
    irregular = irregular_among(recordings)
    if irregular:
        raise GranularIdError(
            f"{irregular}, and windows of a varying number of samples cannot be compared; call "
            ".resample(rate_hz) first, or overrule these"
        )
    onsets: dict[int, Onset] = {}
    alike = places_of((r.n_samples, r.rate_hz or 0.0, r.axes) for r in recordings)  # all are uniform here
    for (_, rate_hz, axes), places in alike.items():
        wrenches = [recordings[i].wrench for i in places]
        block = find_onsets_in_block(wrenches, rate_hz, rest_samples(rest_s, rate_hz), rate, axes)
        onsets.update(zip(places, block, strict=True))
    return [onsets[i] for i in range(len(recordings))]


def _stated_indices(
    recordings: Sequence[Recording], overrule: Mapping[str, float | None] | None
) -> dict[int, int | None]:
    """Turn names and seconds into places and samples, or say what is wrong with them."""
    if overrule is None:
        return {}
    if not isinstance(overrule, Mapping):
        problem = f"must map names of recordings to seconds, got {type(overrule).__name__}; for example "
        raise argument_error(TypeError, "overrule", problem + "{'rice_01': 0.25}")
    places = places_of(r.name for r in recordings)
    stated: dict[int, int | None] = {}
    for name, seconds in overrule.items():
        if name not in places:
            raise argument_error(GranularIdError, "overrule", f": no recording is called {name!r}")
        if len(places[name]) > 1:
            problem = f": {len(places[name])} recordings are called {name!r}; which is meant?"
            raise argument_error(GranularIdError, "overrule", problem)
        place = places[name][0]
        stated[place] = None
        if seconds is not None:
            recording = recordings[place]
            time_s = finite_number(f"overrule[{name!r}]", seconds)
            if not 0 <= time_s <= recording.duration_s:
                problem = f"is {time_s:g} s; the recording lasts from 0 to {recording.duration_s:g} s"
                raise argument_error(GranularIdError, "overrule", f"[{name!r}] {problem}")
            stated[place] = int(np.abs(recording.times() - time_s).argmin())
    return stated


def _notes(recordings: Sequence[Recording], judged: Sequence[int], rest_s: float) -> list[str]:
    filled = [
        recordings[i].name
        for i in judged
        if (flags := recordings[i].flags) is not None
        and (flags[: rest_samples(rest_s, recordings[i].rate_hz or 0.0)] & SampleFlag.GAP_FILLED).any()
    ]
    if not filled:
        return []
    return [
        f"{subject(len(filled))} filled gaps in what is taken for rest (the first is {filled[0]!r}): straight lines "
        "hide the noise there, and the false-alarm rate does not hold for them"
    ]

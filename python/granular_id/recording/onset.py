"""``find_onset`` and ``Onset``: where the motion begins, found from the wrench alone; the step for a data set."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granular_id._checks import FloatArray, argument_error, as_floats, checked_flag, finite_number
from granular_id.recording.change_detection import SPAN, WINDOWS_IN_REST, Detection, change_times, detect
from granular_id.recording.recording import (
    Recording,
    SampleFlag,
    checked_axes,
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
_WANTED = "a real array of shape (T, C), T >= 1: samples by axes"
# Samples per block that is worked on at once: several arrays of this size stay within a processor's cache.
_BLOCK = 400_000
# A level that strays this many typical differences from that at rest has moved, if ever so slowly.
_STRAYED = 6.0


@dataclass(frozen=True, eq=False)
class Onset:
    """Where the motion of one recording begins, or why that cannot be said.

    Attributes
    ----------
    index : int or None
        Sample at which the change is estimated to have begun; None where none was found.
    time_s : float or None
        The same in seconds from the first sample.
    detected_index, detected_s : int or None, float or None
        The sample with which the change became certain: later than `index`, it is when an alarm that watches
        the signal as it comes would have rung.
    statistic : ndarray, shape (T,)
        How much changes at each sample, over the smallest change that counts: the second largest of the axes
        (or one axis, by what must be asked of it alone); 0 where not judged.
    threshold : float
        What the statistic must exceed: 1.
    axes : tuple of str
        Axes that carry the change, the strongest first.
    strength : float
        Largest statistic around the onset (the largest anywhere where none was found).
    rest_level, rest_sd : ndarray, shape (C,)
        Mean and standard deviation of the axes at rest; of all samples where the recording is too short.
    critical : ndarray, shape (C,)
        Smallest change that counts where another axis changes too, in the unit of the axis; infinite where an
        axis cannot show any.
    rest_samples, window_samples : int
        Samples taken for rest, and samples averaged before they are compared.
    why : str
        Why there is no onset, in words; empty where there is one.
    reading_samples : float
        Samples that one reading of the sensor lasts: 1 where each is new, more where a sensor is slower than its
        messages, which repeat its readings.
    """

    index: int | None
    time_s: float | None
    detected_index: int | None
    detected_s: float | None
    statistic: FloatArray
    threshold: float
    axes: tuple[str, ...]
    strength: float
    rest_level: FloatArray
    rest_sd: FloatArray
    critical: FloatArray
    rest_samples: int
    window_samples: int
    why: str = ""
    reading_samples: float = 1.0

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

    The first `rest_s` seconds are taken for rest. A change is found where two neighbouring windows, a fifth of that
    long, differ by more than windows at rest do; then the sample at which the change began is estimated by
    fitting a jump, a straight or a quadratic rise. Nothing has to be known about the noise: it may be
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
        Probability, at most, that a recording without any motion gets an onset: per recording, not per
        sample or axis.
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
    samples = as_floats(wrench, "wrench", _WANTED)
    if samples.ndim != 2 or 0 in samples.shape:
        raise ValueError(f"wrench has shape {samples.shape}; wanted {_WANTED}")
    if not np.isfinite(samples).all():
        row, column = (int(i) for i in np.argwhere(~np.isfinite(samples))[0])
        raise ValueError(f"wrench[{row}, {column}] is {samples[row, column]}; samples must be finite")
    if axes is None and samples.shape[1] != 6:
        axes = [f"axis {i}" for i in range(samples.shape[1])]
    names = checked_axes(axes, samples.shape)
    rate = finite_number("rate_hz", rate_hz, positive=True)
    alarms = _checked_false_alarm_rate(false_alarm_rate)
    return find_onsets_in_block(samples[np.newaxis], rate, rest_samples(rest_s, rate), alarms, names)[0]


def _checked_false_alarm_rate(value: object) -> float:
    rate = finite_number("false_alarm_rate", value)
    if not 1e-12 <= rate <= 0.5:
        problem = f"must be between 1e-12 and 0.5, got {rate:g}"
        raise argument_error(ValueError, "false_alarm_rate", problem)
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
        raise argument_error(ValueError, "rest_s", problem)
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
    _, n_samples, n_axes = block.shape
    needed = rest + SPAN * window
    none: dict[str, Any] = dict.fromkeys(("index", "time_s", "detected_index", "detected_s"))
    none |= {"axes": (), "threshold": 1.0, "rest_samples": rest, "window_samples": window}
    if n_samples < needed:
        none["why"] = (
            f"too short: {n_samples} samples, {needed} wanted ({rest} at rest and {SPAN * window} to compare)"
        )
        none |= {"statistic": np.zeros(n_samples), "strength": 0.0, "critical": np.full(n_axes, np.inf)}
        return [Onset(**none, rest_level=w.mean(axis=0), rest_sd=w.std(axis=0)) for w in block]
    # Powers of two, so that no bit is lost: what the units are makes no difference, and squares cannot overflow
    exponent = np.clip(np.frexp(np.maximum(block.max(axis=1), -block.min(axis=1)))[1], -1000, 1023)
    scale = np.ldexp(1.0, exponent)
    block *= np.ldexp(1.0, -exponent)[:, np.newaxis]
    origin = block[:, :1].copy()
    block -= origin
    found = detect(block, rest, window, rate)
    began = change_times(block, found, rest, window)
    level, sd = (found.noise.level + origin[:, 0]) * scale, found.noise.sd * scale
    with np.errstate(over="ignore"):  # what no float can hold is infinite
        critical = found.critical * scale
    onsets = []
    for i in range(len(block)):
        statistic, first = found.joint[i].copy(), int(found.first[i])
        if first < 0:
            known = {
                "why": _why_not(found, i, scale[i], rest, rate_hz, axes),
                "strength": float(statistic.max()),
            }
        else:
            seen = first + SPAN * window - 1
            own = found.statistic[i, first : seen + 1].max(axis=0)
            known = {
                "index": began[i],
                "time_s": began[i] / rate_hz,
                "detected_index": seen,
                "detected_s": seen / rate_hz,
                "axes": tuple(axes[c] for c in np.argsort(-own) if own[c] > 1),
                "strength": float(statistic[first : first + rest].max()),
            }
        known |= {"statistic": statistic, "rest_level": level[i], "rest_sd": sd[i], "critical": critical[i]}
        known["reading_samples"] = float(found.noise.held[i])
        onsets.append(Onset(**{**none, **known}))
    return onsets


def _why_not(
    found: Detection, i: int, scale: FloatArray, rest: int, rate_hz: float, axes: tuple[str, ...]
) -> str:
    held = float(found.noise.held[i])
    if held > found.window:
        wanted = WINDOWS_IN_REST * math.ceil(held) / rate_hz
        return (
            f"the sensor has new values at {rate_hz / held:.3g} Hz only, samples in between repeat them: "
            f"{rest / rate_hz:g} s at rest hold {int(rest / held)} of them, rest_s={wanted:g} or more is wanted"
        )
    if np.isinf(found.critical[i]).all():
        return "no axis ever changes"
    usual = np.sqrt(found.noise.shift_variance[i])
    strayed = (found.wander[i] - found.noise.count[i]) / np.where(usual > 0, usual, np.inf)
    axis = int(strayed.argmax())
    if strayed[axis] <= _STRAYED:
        return f"no change stands out from the noise of the first {rest / rate_hz:g} s"
    with np.errstate(over="ignore"):
        distance = found.wander[i, axis] * scale[axis]
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
    return results, StepReport(ONSET_STEP, parameters, totals, rows, _notes(recordings, found))


def onsets_of(recordings: Sequence[Recording], *, rest_s: float, false_alarm_rate: float) -> list[Onset]:
    """Find the onset of each recording, those of equal length and rate together; irregular ones are refused."""
    rate = _checked_false_alarm_rate(false_alarm_rate)
    finite_number("rest_s", rest_s, positive=True)
    irregular = irregular_among(recordings)
    if irregular:
        raise ValueError(
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
            near = get_close_matches(str(name), [key for key in places if key], n=3, cutoff=0.5)
            hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
            raise argument_error(ValueError, "overrule", f": no recording is called {name!r}{hint}")
        if len(places[name]) > 1:
            problem = f": {len(places[name])} recordings are called {name!r}; which is meant?"
            raise argument_error(ValueError, "overrule", problem)
        place = places[name][0]
        stated[place] = None
        if seconds is not None:
            recording = recordings[place]
            time_s = finite_number(f"overrule[{name!r}]", seconds)
            if not 0 <= time_s <= recording.duration_s:
                problem = f"is {time_s:g} s; the recording lasts from 0 to {recording.duration_s:g} s"
                raise argument_error(ValueError, "overrule", f"[{name!r}] {problem}")
            stated[place] = int(np.abs(recording.times() - time_s).argmin())
    return stated


def _notes(recordings: Sequence[Recording], found: Mapping[int, Onset]) -> list[str]:
    filled = [
        recordings[i].name
        for i, onset in found.items()
        if (flags := recordings[i].flags) is not None
        and (flags[: onset.rest_samples] & SampleFlag.GAP_FILLED).any()
    ]
    notes = []
    if filled:
        notes.append(
            f"{subject(len(filled))} "
            f"filled gaps in what is taken for rest (the first is {filled[0]!r}): "
            "straight lines hide the noise there, and the false-alarm rate does not hold for them"
        )
    slow = [i for i, onset in found.items() if onset.reading_samples > onset.window_samples]
    if slow:
        notes.append(
            f"{subject(len(slow))} too few readings at rest, the first is {recordings[slow[0]].name!r}: "
            f"{found[slow[0]].why}"
        )
    return notes

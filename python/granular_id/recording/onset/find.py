"""``find_onset``: from samples to the start of the motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from granular_id._core import AXES
from granular_id.recording._values import FloatArray, as_floats, checked_number, checked_rate
from granular_id.recording.axes import checked_axes, unit_of
from granular_id.recording.onset.change_time import change_times
from granular_id.recording.onset.detection import SPAN, Detection, detect
from granular_id.recording.onset.noise import WINDOWS_IN_REST
from granular_id.recording.onset.result import Onset

__all__ = ["FALSE_ALARM_RATE", "REST_S", "find_onset", "find_onsets_in_block", "rest_samples"]

REST_S = 0.1
"""Default of ``rest_s``: the paper starts "a fraction of a second" before the motion; a tenth is the least of that."""

FALSE_ALARM_RATE = 1e-3
"""Default of ``false_alarm_rate``: one false onset in a thousand recordings, fewer than a data set has."""

_WANTED = "a real array of shape (T, C), T >= 1: samples by axes"
# Samples per block that is worked on at once: several arrays of this size stay within a processor's cache.
_BLOCK = 400_000
# A level that strays this many typical differences from that at rest has moved, if ever so slowly.
_STRAYED = 6.0


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
    autocorrelated, filtered, quantised or drift, as long as it stays what it was at rest.

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
        ``index`` is None, and ``why`` says so in words, where the recording is too short, nothing changes or
        it starts in motion already.

    Raises
    ------
    TypeError, ValueError
        Naming the argument: samples that are not finite, a rate or `rest_s` that is not positive or gives fewer
        than 5 samples, a false-alarm rate outside (0, 0.5].

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording.onset import find_onset
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
    rate = checked_rate(rate_hz)
    checked_false_alarm_rate(false_alarm_rate)
    return find_onsets_in_block(
        samples[np.newaxis], rate, rest_samples(rest_s, rate), float(false_alarm_rate), names
    )[0]


def checked_false_alarm_rate(value: object) -> float:
    """Return a probability that can be promised, or say what is wrong with it."""
    rate = checked_number(value, "false_alarm_rate")
    if not 1e-12 <= rate <= 0.5:
        raise ValueError(f"false_alarm_rate must be between 1e-12 and 0.5, got {rate:g}")
    return rate


def rest_samples(rest_s: object, rate_hz: float) -> int:
    """Return how many samples the rest holds, or say that they are too few."""
    seconds = checked_number(rest_s, "rest_s")
    if seconds <= 0:
        raise ValueError(f"rest_s must be positive, got {seconds:g}")
    rest = round(min(seconds * rate_hz, 1e15))
    if rest < WINDOWS_IN_REST:
        raise ValueError(
            f"rest_s={seconds:g} holds {rest} samples at {rate_hz:g} Hz; the noise cannot be judged from fewer "
            f"than {WINDOWS_IN_REST}: rest_s={WINDOWS_IN_REST / rate_hz:g} or more is wanted"
        )
    return rest


def find_onsets_in_block(
    wrenches: Sequence[FloatArray] | FloatArray, rate_hz: float, rest: int, rate: float, axes: tuple[str, ...]
) -> list[Onset]:
    """Find the onsets of checked recordings of one length, rate and set of axes, shape (n, T, C)."""
    n_samples, n_axes = wrenches[0].shape
    at_once = max(1, _BLOCK // (n_samples * n_axes))
    found: list[Onset] = []
    for begin in range(0, len(wrenches), at_once):
        block = np.array(wrenches[begin : begin + at_once])
        found += _find(block, rate_hz, rest, rate, axes)
    return found


def _find(block: FloatArray, rate_hz: float, rest: int, rate: float, axes: tuple[str, ...]) -> list[Onset]:
    window = max(1, rest // WINDOWS_IN_REST)
    if block.shape[1] < rest + SPAN * window:
        return [_too_short(wrench, rest, window) for wrench in block]
    # Powers of two, so that no bit is lost: what the units are makes no difference, and squares cannot overflow
    exponent = np.clip(np.frexp(np.maximum(block.max(axis=1), -block.min(axis=1)))[1], -1000, 1023)
    scale = np.ldexp(1.0, exponent)
    block *= np.ldexp(1.0, -exponent)[:, np.newaxis]
    origin = block[:, :1].copy()
    block -= origin
    found = detect(block, rest, window, rate)
    passed = np.flatnonzero(found.first >= 0)
    first = found.first[passed]
    moving = block[passed]
    before = np.take_along_axis(moving, (first[:, None] + np.arange(-window, 0))[:, :, None], axis=1)
    after = np.take_along_axis(moving, (first[:, None] + np.arange(window))[:, :, None], axis=1)
    carried = found.statistic[passed, first] > 1
    weights = np.zeros(carried.shape)
    change = after.mean(axis=1) - before.mean(axis=1)
    np.divide(change, found.noise.shift_variance[passed], out=weights, where=carried)
    began = dict(
        zip(passed.tolist(), change_times(moving, weights, first, rest, window).tolist(), strict=True)
    )
    level = (found.noise.level + origin[:, 0]) * scale
    with np.errstate(over="ignore"):  # what no float can hold is infinite
        critical = found.critical * scale
    onsets = []
    for i in range(len(block)):
        statistic = found.joint[i].copy()
        index, seen, carriers, why = began.get(i), None, (), ""
        strongest = statistic
        if index is None:
            why = _why_not(found, i, scale[i], rest / rate_hz, axes)
        else:
            seen = int(found.first[i]) + SPAN * window - 1
            strongest = statistic[found.first[i] : found.first[i] + rest]
            own = found.statistic[i, found.first[i] : seen + 1].max(axis=0)
            carriers = tuple(axes[c] for c in np.argsort(-own) if own[c] > 1)
        onsets.append(
            Onset(
                index=index,
                time_s=None if index is None else index / rate_hz,
                detected_index=seen,
                detected_s=None if seen is None else seen / rate_hz,
                statistic=statistic,
                threshold=1.0,
                axes=carriers,
                strength=float(strongest.max()),
                rest_level=level[i],
                rest_sd=found.noise.sd[i] * scale[i],
                critical=critical[i],
                rest_samples=rest,
                window_samples=window,
                why=why,
            )
        )
    return onsets


def _too_short(wrench: FloatArray, rest: int, window: int) -> Onset:
    n_samples, n_axes = wrench.shape
    needed = rest + SPAN * window
    return Onset(
        index=None,
        time_s=None,
        detected_index=None,
        detected_s=None,
        statistic=np.zeros(n_samples),
        threshold=1.0,
        axes=(),
        strength=0.0,
        rest_level=wrench.mean(axis=0),
        rest_sd=wrench.std(axis=0),
        critical=np.full(n_axes, np.inf),
        rest_samples=rest,
        window_samples=window,
        why=f"too short: {n_samples} samples, {needed} wanted ({rest} at rest and {SPAN * window} to compare)",
    )


def _why_not(found: Detection, i: int, scale: FloatArray, rest_s: float, axes: tuple[str, ...]) -> str:
    if np.isinf(found.critical[i]).all():
        return "no axis ever changes"
    usual = np.sqrt(found.noise.shift_variance[i])
    with np.errstate(over="ignore"):
        wander = found.wander[i] * scale
    strayed = (found.wander[i] - found.noise.count[i]) / np.where(usual > 0, usual, np.inf)
    axis = int(strayed.argmax())
    if strayed[axis] > _STRAYED:
        unit = f" {unit_of(axes[axis])}" if axes[axis] in AXES else ""  # others are in units of the caller's
        distance = f"{wander[axis]:.2g}{unit}"
        return (
            f"no abrupt change, though {axes[axis]} strays by {distance}: it starts in motion, drifts, or needs a "
            "longer rest"
        )
    return f"no change stands out from the noise of the first {rest_s:g} s"

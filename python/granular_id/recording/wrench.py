"""Wrenches in another frame, and the zero that the rest before a motion gives."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from granular_id._checks import (
    FloatArray,
    WayOutError,
    argument_error,
    as_floats,
    checked_text,
    finite_numbers,
    thaw,
)
from granular_id._core import AXES, GranularIdError
from granular_id._text import counted, typed
from granular_id.recording.clock import samples_in
from granular_id.recording.columns import same_unit
from granular_id.recording.recording import KNOWN_UNITS, Recording, irregular_among, unit_of
from granular_id.recording.report import StepReport, first_names, subject
from granular_id.recording.setup import Setup

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    RotationLike: TypeAlias = Rotation | ArrayLike

TARE_S = (0.1, 2.0)
"""A tare without a stated ``lead_s`` takes the rest that is there: no less than the first, no more than the second.

Of ten rests of a Bota Rokubi, zeros from 0.1, 0.25, 0.5, 1, 2 and 4 s differ from the mean of the next second by 0.8,
0.6, 0.5, 0.4, 0.4 and 0.4 standard deviations of a sample: the longer the better, until the zero has wandered as far.
"""

GRAVITY = ("gx", "gy", "gz")
"""Names under which metadata and tables state a direction of gravity, beside ``gravity`` with three numbers."""

_WRENCH = "an array of shape (..., 6): fx fy fz (N) tx ty tz (N m); of recordings call this of their Dataset"
_ROTATION = "a scipy Rotation, a 3 x 3 matrix or a quaternion (x, y, z, w)"
# A matrix typed with eight digits passes, one of three digits would scale forces by a thousandth.
_ORTHONORMAL = 1e-6
_UNIT = 0.01


# Another frame.


def transform(
    wrench: ArrayLike,
    rotation: RotationLike | None = None,
    translation: ArrayLike = (0.0, 0.0, 0.0),
    *,
    flip: Sequence[str] = (),
) -> FloatArray:
    """Give a wrench in another frame: ``F' = R F``, ``T' = R T + p x R F``.

    Conventions are those of ROS (REP 103: metres, right-handed axes, quaternions x y z w): with the transform that
    ``tf`` gives for a lookup of (new frame, old frame), `rotation` and `translation` are taken from it as they are.

    Parameters
    ----------
    wrench : array_like, shape (..., 6)
        fx fy fz in N, tx ty tz in N m about the origin of the old frame. Of recordings :meth:`Dataset.transform` turns
        the samples, and puts the names of the new frame and sign into the metadata.
    rotation : scipy Rotation, array_like of shape (3, 3) or (4,), optional
        Turns components in the old frame into those in the new one; a proper rotation. Default: none.
    translation : array_like, shape (3,)
        Position p of the old origin in the new frame, m. Default: the same origin.
    flip : sequence of str, default none
        Axes whose sign changes before that: single ones of a driver that mirrors them, such as ``("fx", "tx")``; all
        six where the wrench is that of the tool on the robot, and is to be that of the robot on the tool.

    Returns
    -------
    ndarray, shape (..., 6)
        The same bits for each sample, however many come at once.

    Raises
    ------
    TypeError, ValueError
        Another shape; a matrix that scales, shears or reflects; a quaternion that is not of length 1; axes to flip that
        there are not.

    References
    ----------
    .. [1] K. Lynch and F. Park, "Modern Robotics", 2017, section 3.4 (wrenches): F' = [Ad]^T F.

    Examples
    --------
    >>> from granular_id.recording import transform
    >>> transform([0, 0, -3, 0, 0, 0], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.1, 0, 0]).tolist()
    [0.0, 0.0, -3.0, 0.0, 0.30000000000000004, 0.0]
    >>> transform([1, 2, 3, 4, 5, 6], flip=("fx", "tx")).tolist()
    [-1.0, 2.0, 3.0, -4.0, 5.0, 6.0]
    """
    matrix, p = _rotation_matrix(rotation), finite_numbers("translation", translation, 3)
    return _transformed(wrench_array(wrench), matrix, p, _signs(flip))


def _transformed(wrench: FloatArray, matrix: FloatArray, p: FloatArray, signs: FloatArray) -> FloatArray:
    flipped = wrench * signs
    force, torque = _turned(flipped[..., :3], matrix), _turned(flipped[..., 3:], matrix)
    result: FloatArray = np.concatenate([force, torque + np.cross(p, force)], axis=-1)
    result += 0.0  # no -0.0
    return result


def _turned(vectors: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return ``R v`` of each vector, element by element: one sample has the same bits as a million."""
    x, y, z = (vectors[..., k, np.newaxis] * matrix[:, k] for k in range(3))
    result: FloatArray = x + y + z
    return result


def _signs(flip: Sequence[str]) -> FloatArray:
    """Return -1 for each axis of a wrench that is flipped, else 1."""
    if isinstance(flip, str) or not isinstance(flip, Sequence) or any(axis not in AXES for axis in flip):
        problem = f"={flip!r}; wanted a sequence of axes such as ('fx', 'tx'), of {' '.join(AXES)}"
        raise argument_error(GranularIdError, "flip", problem)
    return np.array([-1.0 if axis in flip else 1.0 for axis in AXES])


def _rotation_matrix(rotation: RotationLike | None) -> FloatArray:
    """Return a proper rotation as a 3 x 3 matrix: the one that was given, to the last bit."""
    if rotation is None:
        return np.eye(3)
    from scipy.spatial.transform import Rotation  # slow to import, and most recordings are not turned

    array = as_floats(getattr(rotation, "as_matrix", lambda: rotation)(), "rotation", _ROTATION)
    if array.shape not in ((3, 3), (4,)) or not np.isfinite(array).all():
        problem = f"has shape {array.shape}, or NaN or infinity in it; wanted {_ROTATION}"
        raise argument_error(GranularIdError, "rotation", problem)
    if array.shape == (4,):
        length = float(np.linalg.norm(array))
        if abs(length - 1.0) > _UNIT:
            problem = f"is a quaternion of length {length:.4g}; wanted 1 (x, y, z, w)"
            raise argument_error(GranularIdError, "rotation", problem)
        return np.asarray(Rotation.from_quat(array).as_matrix())
    proper = np.linalg.det(array) > 0  # scipy refuses others in words of its own
    if not proper or np.abs(Rotation.from_matrix(array).as_matrix() - array).max() > _ORTHONORMAL:
        problem = (
            "is no rotation: it scales, shears or mirrors, or has too few digits; give a scipy Rotation or a "
            "quaternion, and axes whose sign is wrong as flip=('fx', 'tx')"
        )
        raise argument_error(GranularIdError, "rotation", problem)
    return array


def wrench_array(wrench: ArrayLike) -> FloatArray:
    """Return samples of six axes as float64."""
    array = as_floats(wrench, "wrench", _WRENCH)
    if array.ndim == 0 or array.shape[-1] != len(KNOWN_UNITS):
        raise argument_error(GranularIdError, "wrench", f"has shape {array.shape}; wanted {_WRENCH}")
    return array


def wrench_samples(recording: Recording) -> FloatArray:
    """Return the samples of a recording that is a wrench: its six axes in order, in N and N m."""
    wanted = tuple(KNOWN_UNITS)
    if recording.axes != wanted:
        way_out = (
            f"call .select(axes={[*wanted]})"
            if set(wanted) <= set(recording.axes)
            else "where six of them are these, give them these names: dataclasses.replace(recording, axes=...)"
        )
        raise GranularIdError(
            f"recording {recording.name!r} has the axes {' '.join(recording.axes)}; wanted {' '.join(wanted)} "
            f"in this order: {way_out}"
        )
    for axis, unit in KNOWN_UNITS.items():
        now = unit_of(axis, recording.meta)
        if not same_unit(now, unit):
            raise GranularIdError(
                f"recording {recording.name!r} has {axis} in {now}; wanted {unit}: convert the samples"
            )
    return recording.wrench


def with_samples(recording: Recording, wrench: FloatArray, **meta: Any) -> Recording:
    """Return the recording with other samples, and metadata put in."""
    wrench.flags.writeable = False
    return replace(recording, wrench=wrench, meta={**thaw(recording.meta), **meta})


def transform_recordings(
    recordings: Sequence[Recording],
    rotation: RotationLike | None,
    translation: ArrayLike,
    frame: str | None,
    flip: Sequence[str],
    sign: str | None,
) -> tuple[list[Recording], StepReport]:
    """Turn the wrench of each recording; see :meth:`Dataset.transform`, which calls this."""
    matrix, p, signs = _rotation_matrix(rotation), finite_numbers("translation", translation, 3), _signs(flip)
    turns = not np.array_equal(matrix, np.eye(3)) or bool(p.any())
    reverses = bool((signs < 0).all())
    if turns and frame is None:
        problem = "is None, and a wrench that is turned or moved is in another frame; wanted its name"
        raise argument_error(GranularIdError, "frame", problem)
    if reverses != (sign is not None):
        problem = (
            "are the words for whose force on whom it is once all six axes are flipped: give both or none"
        )
        raise argument_error(GranularIdError, "sign", problem)
    given = (("frame", frame), ("sign", sign))
    meta = {name: checked_text(words, name, spaced=False) for name, words in given if words is not None}
    for name, changes in (("frame", turns), ("sign", reverses)):
        if changes:
            _refuse_unclear(recordings, name, meta[name])
    results = [
        with_samples(
            _without_gravity(recording) if turns or (signs < 0).any() else recording,
            _transformed(wrench_samples(recording), matrix, p, signs),
            **meta,
        )
        for recording in recordings
    ]
    parameters = {"rotation": matrix.tolist(), "translation_m": p.tolist(), "flip": [*flip] or None}
    return results, StepReport("transform", {**meta, **parameters}, {"recordings": len(results)})


def _without_gravity(recording: Recording) -> Recording:
    """Leave out where gravity points by the metadata: they say it of axes that the recording no longer has."""
    meta = {name: v for name, v in thaw(recording.meta).items() if name not in ("gravity", *GRAVITY)}
    return replace(recording, meta=meta)


def _refuse_unclear(recordings: Sequence[Recording], name: str, new: str) -> None:
    """Refuse to turn or reverse what is so already by its metadata, or is not of one frame or sign."""
    now = Counter(value for recording in recordings if (value := getattr(Setup.of(recording.meta), name)))
    if len(now) > 1:
        names = ", ".join(f"{value!r} ({n})" for value, n in now.most_common())
        raise GranularIdError(f"recordings are of several {name}s: {names}; give those of each {name} apart")
    if new in now:
        problem = f"is {new!r} already, as the metadata of {counted(now[new])} state"
        raise argument_error(GranularIdError, name, f"{problem}; wanted the name of what it is afterwards")


# The zero that the rest before the motion gives.


def rest_zero(lead: FloatArray) -> FloatArray:
    """Return the mean of samples at rest, (n, C) to (C,): summed one after the other, as a stream does."""
    zero: FloatArray = np.add.accumulate(lead, axis=0)[-1] / len(lead)
    return zero


def tare_recordings(
    recordings: Sequence[Recording], lead_s: float | None
) -> tuple[list[Recording], StepReport]:
    """Subtract the mean of the rest before the motion; see :meth:`Dataset.tare`, which calls this."""
    irregular = irregular_among(recordings)
    if irregular:
        raise GranularIdError(f"{irregular}; call .resample(rate_hz) first, nothing is resampled silently")
    without = [r.name for r in recordings if r.trigger_index is None]
    if without:
        raise WayOutError(
            f"{subject(len(without))} no trigger_index: {first_names([*map(repr, without)])}; where the rest ends "
            "is not known: call .find_onsets() ",
            typed(begin_at="onset"),
            ", or leave them out ",
            typed(on_error="skip"),
        )
    least_s, most_s = TARE_S if lead_s is None else (lead_s, lead_s)
    results, rows = [], []
    for recording in recordings:
        rate, rest = (
            recording.rate_hz or 0.0,
            recording.trigger_index or 0,
        )  # each is uniform and has one here
        n = min(samples_in("lead_s", most_s, rate), rest)
        if n < samples_in("lead_s", least_s, rate):
            raise GranularIdError(_too_short(recordings, recording, least_s))
        zero = rest_zero(recording.wrench[rest - n : rest])
        results.append(with_samples(recording, recording.wrench - zero, tare="rest"))
        axes = dict(zip(recording.axes, zero.tolist(), strict=True))
        rows.append({"name": recording.name, "lead_s": n / rate, **axes})
    stated = None if lead_s is None else float(lead_s)
    return results, StepReport("tare", {"lead_s": stated}, {"recordings": len(results)}, rows)


def _too_short(recordings: Sequence[Recording], first: Recording, least_s: float) -> str:
    """Say which recording has too short a rest, and what would fit."""
    rests = [(r.trigger_index or 0) / (r.rate_hz or 1.0) for r in recordings]
    own, shortest = (first.trigger_index or 0) / (first.rate_hz or 1.0), min(rests)
    problem = f"recording {first.name!r} has {own:g} s of rest before its trigger, {least_s:g} s are wanted; "
    if shortest > 0:
        return f"{problem}lead_s={np.floor(1e3 * shortest) / 1e3:g} fits all"
    return f"{problem}leave out those without any rest, or record with a pre-trigger buffer"

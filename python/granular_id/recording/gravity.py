"""Where gravity points: directions, orientations and accelerations as they are given, or as metadata state them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from granular_id._checks import FloatArray, argument_error, as_floats
from granular_id._text import counted
from granular_id.recording.recording import Recording
from granular_id.recording.wrench import POSES, rotation_matrix

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


def directions(name: str, value: ArrayLike) -> FloatArray:
    """Return vectors (..., 3) at length 1."""
    array = as_floats(value, name, "an array of shape (..., 3): directions in the frame of the wrench")
    if array.ndim == 0 or array.shape[-1] != 3:
        raise argument_error(ValueError, name, f"has shape {array.shape}; wanted (..., 3)")
    length = np.sqrt((array * array).sum(axis=-1, keepdims=True))
    if not ((length > 0) & np.isfinite(length)).all():
        raise argument_error(ValueError, name, "holds a direction without length, or one that is not finite")
    result: FloatArray = array / length
    return result


def stated_gravity(
    rests: Sequence[Recording | ArrayLike],
    gravity: ArrayLike | None,
    rotations: Rotation | ArrayLike | None,
    accelerations: Sequence[ArrayLike] | ArrayLike | None,
) -> FloatArray:
    """Return the direction of gravity at each rest, shape (n, 3), from what states it."""
    ways = {"gravity": gravity, "rotations": rotations, "accelerations": accelerations}
    stated = [name for name, value in ways.items() if value is not None]
    if not stated and all(isinstance(rest, Recording) for rest in rests):
        return directions("gravity", np.array([gravity_of(rest) for rest in rests]).reshape(-1, 3))
    if len(stated) != 1:
        came = " and ".join(stated) or "none"
        raise ValueError(f"give exactly one of gravity, rotations and accelerations, got {came}")
    (name,), n = stated, len(rests)
    each: list[FloatArray] = []
    if rotations is not None:
        matrices = getattr(rotations, "as_matrix", None)
        poses = np.asarray(rotations if matrices is None else matrices())
        if poses.ndim == 0 or poses.shape[1:] not in ((4,), (3, 3)):
            problem = (
                f"has shape {poses.shape}; wanted one rotation a rest: (N, 3, 3), (N, 4) or a Rotation of N"
            )
            raise argument_error(ValueError, name, problem)
        each = [-rotation_matrix(pose, f"{name}[{i}]")[2] for i, pose in enumerate(poses)]
    elif accelerations is not None:
        for i, read in enumerate(items(name, accelerations)):
            array = as_floats(read, f"{name}[{i}]", "an array of shape (3,) or (n, 3)")
            each.append(-directions(f"{name}[{i}]", array.reshape(-1, array.shape[-1]).mean(axis=0)))
    else:
        each = list(np.atleast_2d(directions(name, gravity)))  # type: ignore[arg-type]  # it is stated here
    if len(each) != n or any(down.shape != (3,) for down in each):
        raise argument_error(ValueError, name, f"has {len(each)} poses for {counted(n, 'rest')}")
    return np.array(each).reshape(-1, 3)


def gravity_of(rest: Recording | ArrayLike) -> FloatArray:
    """Return where gravity points by the metadata of a recording."""
    if not isinstance(rest, Recording):
        raise argument_error(ValueError, "gravity", "must be given where samples are no Recording, got none")
    down = gravity_in(rest.meta, f"metadata of {rest.name!r}")
    if down is None:
        raise argument_error(
            ValueError,
            "gravity",
            f"must be given, as the metadata of {rest.name!r} have no gravity, gx gy gz or qx qy qz qw",
        )
    return down


def gravity_in(entry: Mapping[str, Any], where: str) -> FloatArray | None:
    """Return where gravity points by a line of a table or metadata, `where`; None where they do not say it."""
    stated = next((names for names in POSES if all(entry.get(name) is not None for name in names)), ())
    came = [entry[name] for name in stated] if stated else entry.get("gravity")
    if came is None:
        return None
    try:
        numbers = np.array([float(value) for value in came])
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if len(numbers) != (len(stated) or 3) or not numbers.any() or not np.isfinite(numbers).all():
        said = ",".join(stated) or "gravity"
        raise ValueError(f"{where}: {said} must be finite numbers, not all 0, got {came!r:.80}")
    if len(numbers) == 3:
        return numbers
    try:
        down: FloatArray = -rotation_matrix(numbers)[2] + 0.0  # no -0.0
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    return down


def items(name: str, value: Any) -> list[Any]:
    """Return the entries of a sequence."""
    try:
        return list(value)
    except TypeError:
        raise argument_error(TypeError, name, f"must be a sequence, got {type(value).__name__}") from None

"""``Payload``: weight and zero that a tool puts on a wrench, identified from rests in several poses, and taken off."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from granular_id._checks import FloatArray, argument_error, as_floats, checked_text, finite_number
from granular_id._files import check_source, json_value, write_json
from granular_id._schema import check_form
from granular_id._text import counted
from granular_id.recording.gravity import directions, gravity_of, items, stated_gravity
from granular_id.recording.recording import Recording
from granular_id.recording.report import StepReport
from granular_id.recording.wrench import (
    crossed,
    rest_zero,
    stated,
    with_samples,
    wrench_array,
    wrench_samples,
)

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

STANDARD_GRAVITY_M_S2 = 9.80665
"""Standard gravity (CGPM 1901). Directions of any length are given: a kilogram is what weighs so many newton."""

FORMAT = "granular-id payload 1"
_FIT = {"n_rests": int, "residual": [float, ...], "condition": float}
_FORM = {
    **{"format": FORMAT, "mass_kg": float, "centre_of_mass_m": [float, ...], "bias?": [float, ...]},
    **{"frame?": (str, None), "fit?": (_FIT, None), "sign?": (str, None)},
}

_WAY_OUT = "turn the tool by 30 degrees or more about two axes; from one orientation only a tare is possible"
# Gravity that lies within a cone of some four degrees around one direction, or as close to one line.
_MOST_CONDITION = 30.0
_FEWEST = 4
_DOUBTFUL_KG, _DOUBTFUL_M, _DOUBTFUL_SHARE = 100.0, 2.0, 0.05


@dataclass(frozen=True)
class PayloadFit:
    """How well a payload fits the rests that it was identified from.

    Attributes
    ----------
    n_rests : int
    residual : tuple of 6 float
        Root mean square of what the payload leaves of the means of the rests, N and N m.
    condition : float
        Condition number of the equations with gravity of length 1: 1.2 to 2 with poses all around, above 30 refused.
    """

    n_rests: int
    residual: tuple[float, ...]
    condition: float

    def __post_init__(self) -> None:
        if len(self.residual) != 6:
            raise argument_error(ValueError, "residual", f"={self.residual!r:.80}; wanted 6 numbers")


@dataclass(frozen=True)
class Payload:
    """What a tool at rest puts on the sensor: ``F = b_F + m g``, ``T = b_T + c x m g``.

    The wrench is the load on the sensor, as drivers have it: it points down with a hanging tool. Where it is that of
    the sensor on the tool, state gravity upwards.

    Parameters
    ----------
    mass_kg : float
        By standard gravity, 9.80665 m/s2.
    centre_of_mass_m : sequence of 3 float
        In the frame of the wrench.
    bias : sequence of 6 float, default zero
        What the sensor reads without any load: N, N m.
    frame : str, optional
        Frame of the wrench; recordings of another one are refused.
    fit : PayloadFit, optional
        How well all this is known, where it was identified.
    sign : str, optional
        Whose force on whom the wrench is, in the words of the metadata; recordings with other words are refused.

    Examples
    --------
    >>> from granular_id.recording import Payload, compensate
    >>> gripper = Payload(mass_kg=0.3, centre_of_mass_m=(0, 0, 0.05))
    >>> gripper.wrench([0, 0, -1]).round(3).tolist()
    [0.0, 0.0, -2.942, 0.0, 0.0, 0.0]
    >>> compensate([1.0, 0.0, -2.941995, 0.0, 0.0, 0.0], gripper, [0, 0, -1]).round(6).tolist()
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """

    mass_kg: float
    centre_of_mass_m: tuple[float, ...]
    bias: tuple[float, ...] = (0.0,) * 6
    frame: str | None = None
    fit: PayloadFit | None = None
    sign: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass_kg", finite_number("mass_kg", self.mass_kg, least=0))
        for name, n in (("centre_of_mass_m", 3), ("bias", 6)):
            values = as_floats(getattr(self, name), name, f"{n} finite numbers")
            if values.shape != (n,) or not np.isfinite(values).all():
                raise argument_error(
                    ValueError, name, f"={getattr(self, name)!r:.80}; wanted {n} finite numbers"
                )
            object.__setattr__(self, name, tuple(values.tolist()))
        for name in _STATED:
            if (words := getattr(self, name)) is not None:
                checked_text(words, name, spaced=False)

    def wrench(self, gravity: ArrayLike) -> FloatArray:
        """Return what the sensor reads at rest: weight of the tool and zero.

        Parameters
        ----------
        gravity : array_like, shape (..., 3)
            Direction of gravity in the frame of the wrench, of any length.

        Returns
        -------
        ndarray, shape (..., 6)
        """
        weight = self.mass_kg * STANDARD_GRAVITY_M_S2 * directions("gravity", gravity)
        torque = crossed(np.asarray(self.centre_of_mass_m), weight)
        result: FloatArray = np.concatenate([weight, torque], axis=-1) + np.asarray(self.bias)
        return result

    @classmethod
    def identify(
        cls,
        rests: Iterable[Recording | ArrayLike],
        *,
        gravity: ArrayLike | None = None,
        rotations: Rotation | ArrayLike | None = None,
        accelerations: Sequence[ArrayLike] | ArrayLike | None = None,
        frame: str | None = None,
    ) -> Payload:
        """Identify a payload from rests in four or more orientations, by least squares on the means of the rests.

        Forces give mass and zero of forces, torques the first moment m c and the zero of torques.

        Parameters
        ----------
        rests : Dataset, or iterable of Recording or array_like of shape (n, 6)
            One rest an orientation, N and N m, nothing touching the tool; half a second or more of each. Means alone,
            of shape (6,), will do.
        gravity : array_like, shape (N, 3), optional
            Direction of gravity in the frame of the wrench at each rest, of any length. At most one of this and the
            next two is given; default: what the metadata of the recordings say, as ``gravity`` (three numbers),
            ``gx`` ``gy`` ``gz``, or ``qx`` ``qy`` ``qz`` ``qw`` (orientation of the sensor, as `rotations`).
        rotations : scipy Rotation of N, array_like of shape (N, 3, 3) or (N, 4), optional
            Orientation of the sensor at each rest: from the frame of the wrench into one whose z points up, such as a
            robot's base (quaternions x y z w).
        accelerations : sequence of N array_like of shape (3,) or (n, 3), optional
            What an accelerometer in the sensor reads at rest, along the axes of the wrench and in any unit: it points
            up. Samples of a rest are averaged.
        frame : str, optional
            Name of the frame of the wrench; default: what the metadata of the recordings say, as of the ``sign``.

        Returns
        -------
        Payload
            With its ``fit``.

        Warns
        -----
        UserWarning
            Residuals that are large beside the tool's weight; a mass or a centre so large that a unit is wrong.

        Raises
        ------
        TypeError, ValueError
            Fewer than four rests, orientations that are too alike ("mass and bias cannot be told apart"), a weight
            below the residuals or a negative one, other numbers of poses than of rests, rests that are compensated or
            tared, or of several frames or signs.

        References
        ----------
        .. [1] D. Kubus, T. Kroeger, F. Wahl, "On-line rigid object recognition and pose estimation based on inertial
           parameters", IROS 2007, eqs. 1 to 4 (here without motion).

        Examples
        --------
        >>> import numpy as np
        >>> from granular_id.recording import Payload
        >>> down = np.array([[0, 0, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        >>> noise = np.random.default_rng(0).normal(0, 0.02, (4, 500, 6)) * [1, 1, 1, 0.05, 0.05, 0.05]
        >>> rests = Payload(0.31, (0, 0.002, 0.05), bias=(4, -2, 7, 0, 0.1, 0)).wrench(down)[:, None] + noise
        >>> payload = Payload.identify(rests, gravity=down)
        >>> round(payload.mass_kg, 3), np.round(payload.centre_of_mass_m, 3).tolist()
        (0.31, [0.0, 0.002, 0.05])
        """
        given = list(rests)
        down = stated_gravity(given, gravity, rotations, accelerations)
        if len(given) < _FEWEST:
            raise argument_error(
                ValueError,
                "rests",
                f"hold {counted(len(given), 'orientation')}, four are wanted: mass and bias cannot be told apart; "
                f"{_WAY_OUT}",
            )
        means = np.array([rest_zero(_rest(rest)) for rest in given])
        if frame is None:
            frame = _common("frame", given)
        payload = _identified(means, down, frame, _common("sign", given))
        for doubt in _doubts(payload):
            warnings.warn(doubt, stacklevel=2)
        return payload

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the payload as JSON, whole or not at all."""
        write_json(path, {"format": FORMAT, **json_value(self)})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Payload:
        """Read what `save` wrote; a file that is none is a ValueError that names it.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> from granular_id.recording import Payload
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "gripper.json"
        >>> Payload(0.3, (0, 0, 0.05)).save(path)
        >>> Payload.load(path) == Payload(0.3, (0, 0, 0.05))
        True
        """
        source = check_source(path)
        try:
            document = json.loads(source.read_text(encoding="utf-8"))
            check_form(document, _FORM, what="the file")
            given = {one.name: document[one.name] for one in fields(cls) if one.name in document}
            if (fit := given.get("fit")) is not None:
                given["fit"] = PayloadFit(fit["n_rests"], tuple(fit["residual"]), fit["condition"])
            return cls(**given)
        except (ValueError, TypeError, RecursionError) as error:
            raise ValueError(f"{os.fspath(path)}: no payload: {error}") from error

    def __str__(self) -> str:
        centre = ", ".join(f"{1000 * c:.1f}" for c in self.centre_of_mass_m)
        if self.fit is None:
            return f"{self.mass_kg:.4g} kg at ({centre}) mm"
        left = _rms(self.fit.residual[:3]), _rms(self.fit.residual[3:])
        return (
            f"mass {self.mass_kg:.4g} kg, centre of mass ({centre}) mm\n"
            f"from {counted(self.fit.n_rests, 'rest')}, condition number {self.fit.condition:.2g}, residual "
            f"{left[0]:.2g} N, {left[1]:.2g} N m"
        )


# What comes in: rests.


def _rest(rest: Recording | ArrayLike) -> FloatArray:
    if isinstance(rest, Recording) and (gone := _taken_off(rest)):
        problem = f"hold {rest.name!r}, which is {gone}, and the weight with it; take rests as the sensor reads them"
        raise argument_error(ValueError, "rests", problem)
    samples = wrench_samples(rest) if isinstance(rest, Recording) else np.atleast_2d(wrench_array(rest))
    if samples.ndim != 2 or not len(samples):
        raise argument_error(ValueError, "rests", f"hold one of shape {samples.shape}; wanted (n, 6)")
    if not np.isfinite(samples).all():
        raise argument_error(ValueError, "rests", "hold NaN or infinity; samples must be finite")
    return samples


def _words(recording: Recording, name: str) -> str | None:
    value = stated(recording, name)
    return value if isinstance(value, str) and value else None


_STATED = ("frame", "sign")
"""What recordings and a payload must agree in, where both state it."""


def _common(name: str, rests: Iterable[Recording | ArrayLike]) -> str | None:
    found = {words for rest in rests if isinstance(rest, Recording) and (words := _words(rest, name))}
    if len(found) > 1:
        raise argument_error(
            ValueError, "rests", f"are of several {name}s: {', '.join(map(repr, sorted(found)))}"
        )
    return next(iter(found), None)


def _taken_off(recording: Recording) -> str:
    """Say what took the weight off already; nothing where nothing did."""
    if stated(recording, "compensated") not in (None, False, "no"):
        return "compensated already, as its metadata say, by its source or an earlier step"
    return (
        "tared from rest, which took weight and zero off already"
        if stated(recording, "tare") == "rest"
        else ""
    )


# Least squares.


def _identified(means: FloatArray, down: FloatArray, frame: str | None, sign: str | None) -> Payload:
    """Solve for mass, first moment and zeros by the means (N, 6) of rests and the directions of gravity (N, 3)."""
    force_design, torque_design = _designs(down)
    condition = _condition(force_design, torque_design)
    if not condition <= _MOST_CONDITION:
        angle = np.degrees(np.arccos(np.clip((down @ down.T).min(), -1.0, 1.0)))
        raise argument_error(
            ValueError,
            "rests",
            f"are too alike in their orientation (gravity turns by {angle:.2g} degrees at most, condition number "
            f"{condition:.2g}): mass and bias cannot be told apart; {_WAY_OUT}",
        )
    (weight, *force_zero), force_left = _solved(force_design, means[:, :3])
    (*moment, bx, by, bz), torque_left = _solved(torque_design, means[:, 3:])
    residual = tuple(np.sqrt((np.hstack([force_left, torque_left]) ** 2).mean(axis=0)).tolist())
    if not weight > _rms(residual[:3]):
        raise _no_weight(weight, _rms(residual[:3]))
    return Payload(
        weight / STANDARD_GRAVITY_M_S2,
        tuple(part / weight for part in moment),
        (*force_zero, bx, by, bz),
        frame,
        PayloadFit(len(means), residual, condition),
        sign,
    )


def _doubts(payload: Payload) -> list[str]:
    """Say what can hardly be: the size of a payload, or its residuals."""
    assert payload.fit is not None
    doubts = []
    far = float(np.abs(payload.centre_of_mass_m).max())
    if payload.mass_kg > _DOUBTFUL_KG or far > _DOUBTFUL_M:
        doubts.append(
            f"a payload of {payload.mass_kg:.3g} kg with its centre {far:.3g} m away: are the rests in N and N m, "
            "and not in mN or N mm?"
        )
    left, weight = _rms(payload.fit.residual[:3]), payload.mass_kg * STANDARD_GRAVITY_M_S2
    if left > _DOUBTFUL_SHARE * weight:
        doubts.append(
            f"forces differ by {left:.2g} N from what the poses of the rests say, for a tool of {weight:.2g} N: "
            "poses are not as stated, something touched the tool, or it is light beside the noise"
        )
    return doubts


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _designs(down: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the equations of forces, (N, 3, 4), and of torques, (N, 3, 6), with gravity of length 1."""
    eye = np.broadcast_to(np.eye(3), (len(down), 3, 3))
    forces = np.concatenate([down[:, :, np.newaxis], eye], axis=2)
    # columns: e_k x g
    moments = np.stack([crossed(np.eye(3)[k], down) for k in range(3)], axis=2)
    return forces, np.concatenate([moments, eye], axis=2)


def _condition(*designs: FloatArray) -> float:
    values = np.concatenate([np.linalg.svd(d.reshape(-1, d.shape[2]), compute_uv=False) for d in designs])
    low, high = float(values.min()), float(values.max())
    return high / low if low > 0 else float("inf")


def _solved(design: FloatArray, means: FloatArray) -> tuple[list[float], FloatArray]:
    """Return the unknowns of three axes by least squares, and what they leave of the means, (N, 3)."""
    rows = design.reshape(-1, design.shape[2])
    found = np.linalg.lstsq(rows, means.reshape(-1), rcond=None)[0]
    return found.tolist(), means - (rows @ found).reshape(-1, 3)


def _no_weight(weight: float, residual: float) -> ValueError:
    mass = weight / STANDARD_GRAVITY_M_S2
    if weight < -residual:
        return ValueError(
            f"rests give a mass of {mass:.3g} kg: the wrench is that of the robot on the tool: reverse the recordings "
            "first, .transform(reverse=True, sign=...); or gravity is stated upwards"
        )
    return ValueError(
        f"rests give a mass of {mass:.2g} kg, whose weight is less than the residual of the forces, {residual:.2g} N: "
        f"mass and bias cannot be told apart; take longer rests, or {_WAY_OUT}"
    )


# Taking it off.


@overload
def compensate(wrench: Recording, payload: Payload, gravity: ArrayLike | None = None) -> Recording: ...
@overload
def compensate(wrench: ArrayLike, payload: Payload, gravity: ArrayLike) -> FloatArray: ...
def compensate(
    wrench: Recording | ArrayLike, payload: Payload, gravity: ArrayLike | None = None
) -> Recording | FloatArray:
    """Take weight and zero of a payload off a wrench.

    Parameters
    ----------
    wrench : array_like, shape (..., 6), or Recording
        fx fy fz in N, tx ty tz in N m, as the sensor reads them.
    payload : Payload
    gravity : array_like, shape (3,) or (..., 3), optional
        Direction of gravity in the frame of the wrench, of any length: one for all samples, or one a sample where the
        sensor turns. Default: what the recording's metadata say, as in :meth:`Payload.identify`. What a moving tool
        adds by its acceleration is not taken off.

    Returns
    -------
    ndarray, shape (..., 6), or Recording
        The recording's metadata say ``compensated`` and the ``payload``.

    Raises
    ------
    TypeError, ValueError
        Other shapes; a recording that is no wrench in N and N m, is compensated already, or of another frame or sign.

    Examples
    --------
    See :class:`Payload`.
    """
    if not isinstance(payload, Payload):
        raise argument_error(TypeError, "payload", f"must be a Payload, got {type(payload).__name__}")
    down = gravity_of(wrench) if gravity is None else gravity
    if not isinstance(wrench, Recording):
        samples = wrench_array(wrench)
        result: FloatArray = samples - _load(payload, down, samples.shape)
        return result
    samples = wrench_samples(wrench)
    if gone := _taken_off(wrench):
        raise ValueError(f"recording {wrench.name!r} is {gone}: compensate once, before the tare")
    for name in _STATED:
        now, known = _words(wrench, name), getattr(payload, name)
        if None not in (now, known) and now != known:
            raise ValueError(
                f"recording {wrench.name!r} is of the {name} {now!r}, the payload of {known!r}; compensate "
                f"recordings before they are turned or reversed, or identify the payload from rests of this {name}"
            )
    compensated = samples - _load(payload, down, samples.shape)
    return with_samples(wrench, compensated, compensated=True, payload=f"{payload.mass_kg:.3g} kg")


def _load(payload: Payload, gravity: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    load = payload.wrench(gravity)
    if load.ndim > 1 and load.shape != shape:
        problem = f"has shape {np.shape(gravity)} for a wrench of shape {shape}; wanted (3,), or one a sample"
        raise argument_error(ValueError, "gravity", problem)
    return load


def compensate_recordings(
    recordings: Sequence[Recording], payload: Payload, gravity: ArrayLike | Sequence[ArrayLike] | None
) -> tuple[list[Recording], StepReport]:
    """Take a payload off each recording; see :meth:`Dataset.compensate`, which calls this."""
    each: list[Any] = [None] * len(recordings) if gravity is None else items("gravity", gravity)
    if gravity is not None and all(np.ndim(part) == 0 for part in each):
        each = [gravity] * len(recordings)
    if len(each) != len(recordings):
        problem = f"has {len(each)} entries for {counted(len(recordings))}; wanted one direction, or one a recording"
        raise argument_error(ValueError, "gravity", problem)
    results = [compensate(r, payload, down) for r, down in zip(recordings, each, strict=True)]
    plain = {name: json_value(getattr(payload, name)) for name in ("mass_kg", "centre_of_mass_m", "bias")}
    return results, StepReport("compensate", plain, {"recordings": len(results)})

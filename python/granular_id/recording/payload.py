"""``Payload``: weight and zero that a tool puts on a wrench, identified from rests in several poses, and taken off."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granular_id._checks import (
    FloatArray,
    argument_error,
    checked_text,
    finite_number,
    finite_numbers,
    items_of,
    whole_number,
)
from granular_id._core import GranularIdError
from granular_id._files import check_source, json_value, write_json
from granular_id._text import counted
from granular_id.recording.recording import Recording
from granular_id.recording.report import StepReport
from granular_id.recording.setup import Setup, values_in
from granular_id.recording.wrench import (
    GRAVITY,
    rest_zero,
    with_samples,
    wrench_array,
    wrench_samples,
)

STANDARD_GRAVITY_M_S2 = 9.80665
"""Standard gravity (CGPM 1901). Directions of any length are given: a kilogram is what weighs so many newton."""

FORMAT = "granular_id.payload/1"
# Gravity beyond it lies within a cone of some four degrees around one direction, or as close to one line.
_FEWEST, _MOST_CONDITION = 4, 30.0
_UNKNOWN = "mass and bias cannot be separated"
_WAY_OUT = "turn the tool by 30 degrees or more about two axes; from one orientation only a tare is possible"
# What recordings and a payload must agree in, where both state it.
_STATED = ("frame", "sign")


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
    frame, sign : str, optional
        Frame of the wrench, and whose force on whom it is, in the words of the metadata; recordings that state others
        are refused.
    n_rests : int, optional
        Rests that it was identified from.
    residual : sequence of 6 float, optional
        Root mean square of what the payload leaves of the means of these rests, N and N m.
    condition : float, optional
        Condition number of the equations with gravity of length 1: 1.2 to 2 with poses all around, above 30 refused.

    Examples
    --------
    >>> from granular_id.recording import Payload
    >>> gripper = Payload(mass_kg=0.3, centre_of_mass_m=(0, 0, 0.05))
    >>> gripper.wrench([0, 0, -1]).round(3).tolist()
    [0.0, 0.0, -2.942, 0.0, 0.0, 0.0]
    >>> gripper.compensate([1.0, 0.0, -2.941995, 0.0, 0.0, 0.0], [0, 0, -1]).round(6).tolist()
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """

    mass_kg: float
    centre_of_mass_m: tuple[float, ...]
    bias: tuple[float, ...] = (0.0,) * 6
    frame: str | None = None
    sign: str | None = None
    n_rests: int | None = None
    residual: tuple[float, ...] | None = None
    condition: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass_kg", finite_number("mass_kg", self.mass_kg, least=0))
        for name, n in (("centre_of_mass_m", 3), ("bias", 6), ("residual", 6)):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, tuple(finite_numbers(name, given, n).tolist()))
        for name in _STATED:
            if (words := getattr(self, name)) is not None:
                checked_text(words, name, spaced=False)
        if self.n_rests is not None:
            whole_number("n_rests", self.n_rests)
        if self.condition is not None:
            finite_number("condition", self.condition, positive=True)

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
        weight = self.mass_kg * STANDARD_GRAVITY_M_S2 * _directions(gravity)
        torque = np.cross(self.centre_of_mass_m, weight)
        result: FloatArray = np.concatenate([weight, torque], axis=-1) + np.asarray(self.bias)
        return result

    @classmethod
    def fit(cls, rests: Iterable[Recording], gravity: ArrayLike | None = None) -> Payload:
        """Identify a payload from rests in four or more orientations, by least squares on the means of the rests.

        Forces give mass and zero of forces, torques the first moment m c and the zero of torques.

        Parameters
        ----------
        rests : Dataset, or iterable of Recording
            One rest an orientation, N and N m, nothing touching the tool; half a second or more of each.
        gravity : array_like, shape (N, 3), optional
            Direction of gravity in the frame of the wrench at each rest, of any length: ``-R[2]`` where R turns the
            sensor's frame into one whose z points up; the negative of what an accelerometer in the sensor reads.
            Default: what the metadata of the recordings say, as ``gravity`` (three numbers) or ``gx``, ``gy``, ``gz``.

        Returns
        -------
        Payload
            With frame and sign of the recordings, residual and condition number.

        Raises
        ------
        TypeError, ValueError
            Fewer than four rests, orientations that are too alike, a weight below the residuals or a negative one,
            another number of directions than of rests, rests that are compensated or tared, or of several frames.

        References
        ----------
        .. [1] D. Kubus, T. Kroeger, F. Wahl, "On-line rigid object recognition and pose estimation based on inertial
           parameters", IROS 2007, eqs. 1 to 4 (here without motion).

        Examples
        --------
        >>> import numpy as np
        >>> from granular_id import Dataset
        >>> from granular_id.recording import Payload
        >>> down = np.array([[0, 0, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        >>> noise = np.random.default_rng(0).normal(0, 0.02, (4, 500, 6)) * [1, 1, 1, 0.05, 0.05, 0.05]
        >>> rests = Payload(0.31, (0, 0.002, 0.05), bias=(4, -2, 7, 0, 0.1, 0)).wrench(down)[:, None] + noise
        >>> payload = Payload.fit(Dataset.from_arrays(rests, rate_hz=500), gravity=down)
        >>> round(payload.mass_kg, 3), np.round(payload.centre_of_mass_m, 3).tolist()
        (0.31, [0.0, 0.002, 0.05])
        """
        given = items_of("rests", rests, Recording)
        if len(given) < _FEWEST:
            problem = f"hold {counted(len(given), 'orientation')}, four are wanted: {_UNKNOWN}; {_WAY_OUT}"
            raise argument_error(GranularIdError, "rests", problem)
        down = _directions(_stated_gravity(given) if gravity is None else gravity)
        if down.shape != (len(given), 3):
            problem = f"has shape {down.shape}; wanted a direction a rest, ({len(given)}, 3)"
            raise argument_error(GranularIdError, "gravity", problem)
        means = np.array([rest_zero(_loaded_samples(rest)) for rest in given])
        known = values_in(Setup.of(rest.meta) for rest in given)
        stated: dict[str, Any] = {}
        for name in _STATED:
            values = known.get(name, [])
            if len(values) > 1:
                problem = f"are of several {name}s: {', '.join(map(repr, values))}"
                raise argument_error(GranularIdError, "rests", problem)
            stated |= {name: values[0]} if values else {}
        return cls(**_least_squares(means, down), n_rests=len(given), **stated)

    def compensate(self, wrench: ArrayLike, gravity: ArrayLike) -> FloatArray:
        """Take weight and zero off a wrench; of recordings :meth:`Dataset.compensate` does.

        Parameters
        ----------
        wrench : array_like, shape (..., 6)
            fx fy fz in N, tx ty tz in N m, as the sensor reads them.
        gravity : array_like, shape (3,) or (..., 3)
            Direction of gravity in the frame of the wrench, of any length: one for all samples, or one a sample where
            the sensor turns. What a moving tool adds by its acceleration is not taken off.

        Returns
        -------
        ndarray, shape (..., 6)
        """
        samples, load = wrench_array(wrench), self.wrench(gravity)
        if load.ndim > 1 and load.shape != samples.shape:
            problem = f"makes loads of shape {load.shape} for a wrench of {samples.shape}; wanted (3,), or one a sample"
            raise argument_error(GranularIdError, "gravity", problem)
        result: FloatArray = samples - load
        return result

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
            if not isinstance(document, dict) or document.pop("format", None) != FORMAT:
                raise GranularIdError(f"its format is not {FORMAT!r}")
            return cls(**document)
        except (ValueError, TypeError, RecursionError) as error:
            raise GranularIdError(f"{os.fspath(path)}: no payload: {error}") from error


def _loaded_samples(recording: Recording) -> FloatArray:
    """Return the samples of a recording, of which no earlier step and not its source took the weight off."""
    setup = Setup.of(recording.meta)
    if setup.compensated not in (None, "no"):
        raise GranularIdError(
            f"recording {recording.name!r} is compensated already, as its metadata say, by its source or an earlier "
            "step: compensate once, and take rests as the sensor reads them"
        )
    if setup.tare == "rest":
        raise GranularIdError(
            f"recording {recording.name!r} is tared from rest, which took weight and zero off: compensate before the "
            "tare, and take rests as the sensor reads them"
        )
    return wrench_samples(recording)


def _least_squares(means: FloatArray, down: FloatArray) -> dict[str, Any]:
    """Solve for mass, first moment and zeros by the means (N, 6) of rests and the directions of gravity (N, 3)."""
    eye = np.tile(np.eye(3), (len(down), 1))
    levers = np.stack([np.cross(axis, down) for axis in np.eye(3)], axis=2)  # of the torque m c x g
    designs = np.hstack([down.reshape(-1, 1), eye]), np.hstack([levers.reshape(-1, 3), eye])
    sizes = np.concatenate([np.linalg.svd(design, compute_uv=False) for design in designs])
    condition = float(sizes.max() / sizes.min()) if sizes.min() > 0 else np.inf
    if not condition <= _MOST_CONDITION:
        problem = f"are too alike in their orientation (condition number {condition:.2g})"
        raise argument_error(GranularIdError, "rests", f"{problem}: {_UNKNOWN}; {_WAY_OUT}")
    solved, residual = [], np.empty(6)
    for part, design in zip((slice(3), slice(3, 6)), designs, strict=True):
        read = means[:, part].ravel()
        solved.append(np.linalg.lstsq(design, read, rcond=None)[0])
        residual[part] = np.sqrt(np.square((read - design @ solved[-1]).reshape(-1, 3)).mean(axis=0))
    weight = float(solved[0][0])
    if not weight > _rms(residual[:3]):
        raise GranularIdError(
            f"rests give a mass of {weight / STANDARD_GRAVITY_M_S2:.3g} kg, whose weight is not above the residual of "
            f"the forces, {_rms(residual[:3]):.2g} N: if it is negative, pass gravity with the other sign (the wrench "
            f"is that of the robot on the tool), else take longer rests, or {_WAY_OUT}"
        )
    return {
        "mass_kg": weight / STANDARD_GRAVITY_M_S2,
        "centre_of_mass_m": solved[1][:3] / weight,
        "bias": np.concatenate([solved[0][1:], solved[1][3:]]),
        "residual": residual,
        "condition": condition,
    }


def _rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _directions(gravity: ArrayLike) -> FloatArray:
    """Return vectors (..., 3) at length 1."""
    array = finite_numbers("gravity", gravity, 3, each=True)
    length = np.sqrt((array * array).sum(axis=-1, keepdims=True))
    if not (length > 0).all():
        raise argument_error(GranularIdError, "gravity", "holds a direction without length")
    result: FloatArray = array / length
    return result


def _stated_gravity(recordings: Sequence[Recording]) -> list[Any]:
    """Return where gravity points by the metadata of each recording."""
    found = []
    for recording in recordings:
        down, apart = recording.meta.get("gravity"), [recording.meta.get(name) for name in GRAVITY]
        if None not in apart:  # as of columns of index.csv, which are texts
            try:
                down = [float(str(value)) for value in apart]
            except ValueError:
                came = f"of {recording.name!r} is {', '.join(map(repr, apart)):.60} by its metadata"
                raise argument_error(GranularIdError, "gravity", f"{came}; wanted three numbers") from None
        if down is None:
            problem = (
                f"must be given, as the metadata of {recording.name!r} have no gravity and no gx, gy, gz"
            )
            raise argument_error(GranularIdError, "gravity", problem)
        found.append(down)
    return found


def compensate_recordings(
    recordings: Sequence[Recording], payload: Payload, gravity: ArrayLike | Sequence[ArrayLike] | None
) -> tuple[list[Recording], StepReport]:
    """Take a payload off each recording; see :meth:`Dataset.compensate`, which calls this."""
    if not isinstance(payload, Payload):
        raise argument_error(TypeError, "payload", f"must be a Payload, got {type(payload).__name__}")
    if gravity is None:
        each: list[Any] = _stated_gravity(recordings)
    else:
        each = [gravity] * len(recordings)
        if isinstance(gravity, Iterable) and any(np.ndim(part) > 0 for part in gravity):
            each = list(gravity)
    if len(each) != len(recordings):
        problem = f"has {len(each)} entries for {counted(len(recordings))}; wanted one direction, or one a recording"
        raise argument_error(GranularIdError, "gravity", problem)
    results = []
    noted = {"compensated": True, "payload": f"{payload.mass_kg:.3g} kg"}
    for recording, down in zip(recordings, each, strict=True):
        samples = _loaded_samples(recording)
        for name in _STATED:
            now, known = getattr(Setup.of(recording.meta), name), getattr(payload, name)
            if now and known and now != known:
                raise GranularIdError(
                    f"recording {recording.name!r} is of the {name} {now!r}, the payload of {known!r}; compensate "
                    f"recordings before they are turned or flipped, or fit the payload to rests of this {name}"
                )
        results.append(with_samples(recording, payload.compensate(samples, down), **noted))
    plain = {name: json_value(getattr(payload, name)) for name in ("mass_kg", "centre_of_mass_m", "bias")}
    return results, StepReport("compensate", plain, {"recordings": len(results)})

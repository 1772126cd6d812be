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
    COSINES,
    crossed,
    rest_zero,
    slow_parts,
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
_FIT: dict[str, Any] = {
    **{"n_rests": int, "mass_interval_kg": [float, ...], "centre_of_mass_margin_m": [float, ...]},
    **{"bias_margin": [float, ...], "residual": [float, ...], "scatter": [float, ...], "condition": float},
}
_FORM = {
    **{"format": FORMAT, "mass_kg": float, "centre_of_mass_m": [float, ...], "bias?": [float, ...]},
    **{"frame?": (str, None), "fit?": (_FIT, None), "sign?": (str, None)},
}

_WAY_OUT = "turn the tool by 30 degrees or more about two axes; from one orientation only a tare is possible"
# Gravity that lies within a cone of some four degrees around one direction, or as close to one line.
_MOST_CONDITION = 30.0
_FEWEST = 4
# No sensor resolves a millionth of its load: the least noise that weights are made of.
_RESOLUTION = 1e-6
_N_FORCE, _N_TORQUE = 4, 6
"""Unknowns: mass and three zeros; three first moments and three zeros."""


@dataclass(frozen=True)
class PayloadFit:
    """How well a payload is known. Intervals are of 95 %.

    Attributes
    ----------
    n_rests : int
    mass_interval_kg : tuple of 2 float
    centre_of_mass_margin_m, bias_margin : tuple of 3 and of 6 float
        Half of the intervals.
    residual : tuple of 6 float
        Root mean square of what the payload leaves of the means of the rests, N and N m.
    scatter : tuple of 2 float
        Standard deviation of forces (N) and torques (N m) from rest to rest that their noise does not explain: poses
        that are not quite as stated, a zero that drifts. It widens the intervals.
    condition : float
        Condition number of the equations with gravity of length 1: 1.2 to 2 with poses all around, above 30 refused.
    """

    n_rests: int
    mass_interval_kg: tuple[float, ...]
    centre_of_mass_margin_m: tuple[float, ...]
    bias_margin: tuple[float, ...]
    residual: tuple[float, ...]
    scatter: tuple[float, ...]
    condition: float

    def __post_init__(self) -> None:
        sizes = {
            "mass_interval_kg": 2,
            "centre_of_mass_margin_m": 3,
            "bias_margin": 6,
            "residual": 6,
            "scatter": 2,
        }
        for name, n in sizes.items():
            if len(getattr(self, name)) != n:
                raise argument_error(ValueError, name, f"={getattr(self, name)!r:.80}; wanted {n} numbers")


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
        """Identify a payload from rests in four or more orientations, by weighted least squares.

        Forces give mass and zero of forces, torques the first moment m c and the zero of torques. Axes are weighted by
        their noise. Intervals hold the noise within each rest, which is coloured (see :func:`rest_mean`), with the
        effective degrees of freedom of Welch and Satterthwaite; where residuals are larger than this noise explains
        (poses that are not quite as stated, a zero that drifts), a scatter from rest to rest is added that explains
        them, and rests and axes are weighted by both.

        Parameters
        ----------
        rests : Dataset, or iterable of Recording or array_like of shape (n, 6)
            One rest an orientation, N and N m, nothing touching the tool; half a second or more of each. Means alone,
            of shape (6,), will do: then the intervals come from the residuals.
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
            One rest does not fit the others, and which; residuals that are large beside the tool's weight; a mass or a
            centre so large that a unit is wrong.

        Raises
        ------
        TypeError, ValueError
            Fewer than four rests, orientations that are too alike ("mass and bias cannot be told apart"), a mass that
            does not stand out of its noise or is negative, other numbers of poses than of rests, rests that are
            compensated or tared, or of several frames or signs.

        References
        ----------
        .. [1] D. Kubus, T. Kroeger, F. Wahl, "On-line rigid object recognition and pose estimation based on inertial
           parameters", IROS 2007, eqs. 1 to 4 (here without motion).
        .. [2] JCGM 100:2008 (GUM), G.4: effective degrees of freedom.
        .. [3] R. Paule and J. Mandel, "Consensus values and weighting factors", Journal of Research of the NBS 87(5),
           1982: scatter beyond the known errors.

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
        >>> low, high = payload.fit.mass_interval_kg
        >>> low < 0.31 < high
        True
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
        samples = [_rest(rest) for rest in given]
        if frame is None:
            frame = _common("frame", given)
        payload = _identified(samples, down, frame, _common("sign", given))
        names = [f"{rest.name!r}" if isinstance(rest, Recording) else f"{i}" for i, rest in enumerate(given)]
        for doubt in _doubts(payload, samples, down, names):
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
                parts: dict[str, Any] = {
                    name: tuple(fit[name]) if isinstance(fit[name], list) else fit[name] for name in _FIT
                }
                given["fit"] = PayloadFit(**parts)
            return cls(**given)
        except (ValueError, TypeError, RecursionError) as error:
            raise ValueError(f"{os.fspath(path)}: no payload: {error}") from error

    def __str__(self) -> str:
        centre = ", ".join(f"{1000 * c:.1f}" for c in self.centre_of_mass_m)
        if self.fit is None:
            return f"{self.mass_kg:.4g} kg at ({centre}) mm"
        margin = (self.fit.mass_interval_kg[1] - self.fit.mass_interval_kg[0]) / 2
        margins = ", ".join(f"{1000 * c:.2g}" for c in self.fit.centre_of_mass_margin_m)
        lines = [
            f"mass {self.mass_kg:.4g} kg +- {margin:.2g}, centre of mass ({centre}) mm +- ({margins}), 95 % intervals",
            f"from {counted(self.fit.n_rests, 'rest')}, condition number {self.fit.condition:.2g}, scatter beyond the "
            f"noise {self.fit.scatter[0]:.2g} N, {self.fit.scatter[1]:.2g} N m",
        ]
        return "\n".join(lines)


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


def _identified(
    samples: Sequence[FloatArray], down: FloatArray, frame: str | None, sign: str | None
) -> Payload:
    n_rests = len(samples)
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
    means = np.array([rest_zero(rest) for rest in samples])
    draws = np.array([slow_parts(rest) for rest in samples])
    variance = _pooled_variance(means, draws, np.array([len(rest) for rest in samples]))
    # in the units of gravity: column 0 of the forces, columns 0 to 2 of the torques
    scale_f = np.array([STANDARD_GRAVITY_M_S2, 1.0, 1.0, 1.0])
    scale_t = np.array([STANDARD_GRAVITY_M_S2] * 3 + [1.0] * 3)
    force = _Block(force_design * scale_f, means[:, :3], variance[:, :3])
    torque = _Block(torque_design * scale_t, means[:, 3:], variance[:, 3:])
    mass, moment = force.found[0], torque.found[:3]
    per_mass = 1.0 / mass if mass else 0.0  # no load at all is refused below
    centre = moment * per_mass

    # How mass, centre and zeros follow from the unknowns of both blocks
    by_force, by_torque = np.zeros((10, _N_FORCE)), np.zeros((10, _N_TORQUE))
    by_force[0, 0] = 1.0
    by_force[1:4, 0] = -centre * per_mass
    by_torque[1:4, :3] = np.eye(3) * per_mass
    by_force[4:7, 1:], by_torque[7:10, 3:] = np.eye(3), np.eye(3)
    margin = _margins(draws, (force, by_force), (torque, by_torque))
    if not mass > margin[0]:
        raise _no_weight(mass, margin[0])
    left = np.hstack([force.left, torque.left])
    fit = PayloadFit(
        n_rests=n_rests,
        mass_interval_kg=(float(mass - margin[0]), float(mass + margin[0])),
        centre_of_mass_margin_m=tuple(margin[1:4].tolist()),
        bias_margin=tuple(margin[4:].tolist()),
        residual=tuple(np.sqrt((left**2).mean(axis=0)).tolist()),
        scatter=(float(np.sqrt(force.scatter)), float(np.sqrt(torque.scatter))),
        condition=condition,
    )
    bias = (*force.found[1:].tolist(), *torque.found[3:].tolist())
    return Payload(float(mass), tuple(centre.tolist()), bias, frame, fit, sign)


_DOUBTFUL_KG, _DOUBTFUL_M, _DOUBTFUL_SHARE = 100.0, 2.0, 0.1
# Residuals, as a share of the weight, that one of six poses makes which is wrong by five degrees; the chance of sound
# rests from which on one is called odd.
_ODD_SHARE, _ODD = 0.02, 1e-3


def _doubts(
    payload: Payload, samples: Sequence[FloatArray], down: FloatArray, names: Sequence[str]
) -> list[str]:
    """Say what can hardly be: the size of a payload, or residuals and the rest that makes them."""
    assert payload.fit is not None
    doubts = []
    far = float(np.abs(payload.centre_of_mass_m).max())
    if payload.mass_kg > _DOUBTFUL_KG or far > _DOUBTFUL_M:
        doubts.append(
            f"a payload of {payload.mass_kg:.3g} kg with its centre {far:.3g} m away: are the rests in N and N m, "
            "and not in mN or N mm?"
        )
    means = np.array([rest_zero(rest) for rest in samples])[:, :3]
    left, n = _left_squared(means, down), len(down)
    without = {
        i: _left_squared(np.delete(means, i, 0), rest)
        for i, rest in ((i, np.delete(down, i, 0)) for i in range(n))
        if _condition(*_designs(rest)) <= _MOST_CONDITION
    }
    scatter, weight = payload.fit.scatter[0], payload.mass_kg * STANDARD_GRAVITY_M_S2
    odd, least = min(without.items(), key=lambda item: item[1], default=(0, left))
    rms = [np.sqrt(part / 3 / size) for part, size in ((least, n - 1), (left, n))]
    if rms[1] > _ODD_SHARE * weight and _is_odd(left, least, n):
        doubts.append(
            f"rest {names[odd]} does not fit the others: without it the payload leaves {rms[0]:.2g} N of the forces, "
            f"with it {rms[1]:.2g} N; its pose is not as stated, or something touched the tool: mend it or leave it out"
        )
    elif scatter > _DOUBTFUL_SHARE * weight:
        doubts.append(
            f"forces differ by {scatter:.2g} N from what the poses of the rests say, for a tool of {weight:.2g} N: "
            "poses are not as stated, or something touched the tool"
        )
    return doubts


def _left_squared(forces: FloatArray, down: FloatArray) -> float:
    """Return the sum of squares that mass and zero leave of the mean forces of rests."""
    design = _designs(down)[0].reshape(-1, _N_FORCE)
    found = np.linalg.lstsq(design, forces.reshape(-1), rcond=None)[0]
    return float(((forces.reshape(-1) - design @ found) ** 2).sum())


def _is_odd(left: float, without: float, n_rests: int) -> bool:
    """Test by the F distribution, over all rests, whether leaving one out takes too much of the residuals away."""
    from scipy.special import fdtrc  # slow to import

    freedom = 3 * (n_rests - 1) - _N_FORCE
    ratio = (left - without) / 3 / (without / freedom) if without > 0 else np.inf
    return bool(n_rests * fdtrc(3, freedom, ratio) < _ODD)


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


def _pooled_variance(means: FloatArray, draws: FloatArray, n_samples: FloatArray) -> FloatArray:
    """Return the variance of each mean by axis, (N, 6), for weights: that of a sample, pooled, over its samples."""
    own = (draws**2).mean(axis=1) * n_samples[:, np.newaxis]
    known = n_samples > COSINES
    pooled = own[known].mean(axis=0) if known.any() else np.zeros(6)
    load = np.abs(means).reshape(-1, 2, 3).max(axis=(0, 2))
    floor = np.repeat(np.where(load > 0, _RESOLUTION * load, 1.0), 3) ** 2
    result: FloatArray = np.maximum(pooled / n_samples[:, np.newaxis], floor)
    return result


class _Block:
    """Weighted least squares of three axes: unknowns, what is left, and how unknowns follow from the means."""

    def __init__(self, design: FloatArray, means: FloatArray, variance: FloatArray) -> None:
        n_rests, _, n_unknown = design.shape
        self._rows, self._means = design.reshape(-1, n_unknown), means.reshape(-1)
        self._variance = variance.reshape(-1)
        self.freedom = len(self._rows) - n_unknown
        self.scatter = self._scatter()  # a variance
        solve = self._solve(self.scatter)
        found: FloatArray = solve @ self._means
        self.found = found
        self.left: FloatArray = (self._means - self._rows @ found).reshape(-1, 3)
        self.by_mean: FloatArray = solve.reshape(n_unknown, n_rests, 3)

    def _solve(self, scatter: float) -> FloatArray:
        sd = np.sqrt(self._variance + scatter)
        solve: FloatArray = np.linalg.pinv(self._rows / sd[:, np.newaxis]) / sd
        return solve

    def _unexplained(self, scatter: float) -> float:
        left = self._means - self._rows @ (self._solve(scatter) @ self._means)
        ratio: float = (left**2 / (self._variance + scatter)).sum() / self.freedom
        return ratio - 1.0

    def _scatter(self) -> float:
        """Return the variance from rest to rest, beside that of the means, that makes the residuals what they are."""
        from scipy.optimize import brentq  # slow to import

        most = float(((self._means - self._rows @ (self._solve(0.0) @ self._means)) ** 2).sum())
        return (
            float(brentq(self._unexplained, 0.0, 2.0 * most, xtol=1e-9 * most))
            if self._unexplained(0.0) > 0
            else 0.0
        )


def _margins(draws: FloatArray, *blocks: tuple[_Block, FloatArray]) -> FloatArray:
    """Return half of the 95 % interval of each figure that follows linearly from the unknowns of the blocks."""
    from scipy.special import stdtrit  # slow to import

    by_mean = np.concatenate([np.einsum("pu,uia->pia", by, block.by_mean) for block, by in blocks], axis=2)
    own = (np.einsum("pia,ija->pij", by_mean, draws) ** 2).mean(axis=2)
    beyond = (
        np.stack([block.scatter * np.einsum("pu,uia->pia", by, block.by_mean) ** 2 for block, by in blocks])
        .sum(axis=(2, 3))
        .T
    )
    freedom = [block.freedom for block, _ in blocks]
    variance = own.sum(axis=1) + beyond.sum(axis=1)
    spread = (own**2).sum(axis=1) / COSINES + (beyond**2 / freedom).sum(axis=1)
    known = variance > 0
    t = stdtrit(np.where(known, variance**2, 1.0) / np.where(known, spread, 1.0), 0.975)
    result: FloatArray = t * np.sqrt(variance)
    return result


def _no_weight(mass: float, margin: float) -> ValueError:
    if mass < -margin:
        return ValueError(
            f"rests give a mass of {mass:.3g} kg: the wrench is that of the robot on the tool: reverse the recordings "
            "first, .transform(reverse=True, sign=...); or gravity is stated upwards"
        )
    return ValueError(
        f"rests give a mass of {mass:.2g} +- {margin:.2g} kg, which does not stand out of the noise: mass and bias "
        f"cannot be told apart; take longer rests, or {_WAY_OUT}"
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

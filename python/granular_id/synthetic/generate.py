"""Whole sets of synthetic recordings: materials, sessions, and how much varies between pushes; rests of a tool."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from itertools import count
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from granular_id._checks import argument_error, finite_number, positive_number, sampling_rate, whole_number
from granular_id._core import GranularIdError
from granular_id._text import fixed
from granular_id.recording import AXES, Dataset, Payload, Recording, SampleFlag
from granular_id.synthetic.drag import FRAME, SIGN, Rig
from granular_id.synthetic.materials import PAPER_MATERIALS, Material, resolve_materials
from granular_id.synthetic.push import (
    IMU_AXES,
    IMU_UNITS,
    STROKE_S,
    Conditions,
    simulate_drive,
    simulate_push,
)
from granular_id.synthetic.sensors import Sensor, random_stream, rest_noise

# Draws beyond this many standard deviations are cut: a bed a centimetre too deep would be seen and redone.
CUT_SD = 2.5


@dataclass(frozen=True)
class Nuisance:
    """Standard deviations of what varies, each split into recording, fill and session.

    A *fill* is one material poured in one session. Each field is ``(per recording, per fill, per session)``. The
    defaults are those of work by hand: much comes with the session, so that held-out sessions are harder than random
    partitions, and materials differ in how well they are known. ``Nuisance().scaled(0.4)`` is an easy set.

    Parameters
    ----------
    depth_m : fill height; together about 3 mm, read off a scale on the container.
    packing_percent : packing fraction; pouring and levelling by hand repeat to one or two per cent.
    overshoot_log, heap_log, back_flow_log : shape of the profile, logarithm of a factor.
    wall_m : starting point of the push.
    lift_ratio, lateral_ratio : direction of the mean force.
    off_axis_m : eccentricity of the mounted tool.
    tilt_deg : tilt of the sensor, each of roll, pitch and yaw.
    gain_log : gain error of the calibration.
    tare_n, tare_n_m : zero-point error of each force and torque axis.
    drift_n_s, drift_n_m_s : drift of each force and torque axis.
    fluctuation_log, sharpness_log : size of the slips and how abrupt they are, logarithm of a factor: moisture,
        wear and dust of the grains.

    Examples
    --------
    >>> from granular_id.synthetic import Nuisance
    >>> Nuisance().scaled(0).tare_n
    (0.0, 0.0, 0.0)
    """

    depth_m: tuple[float, float, float] = (0.0020, 0.0020, 0.0010)
    packing_percent: tuple[float, float, float] = (1.5, 1.5, 0.5)
    overshoot_log: tuple[float, float, float] = (0.30, 0.30, 0.0)
    heap_log: tuple[float, float, float] = (0.25, 0.30, 0.0)
    back_flow_log: tuple[float, float, float] = (0.10, 0.15, 0.0)
    wall_m: tuple[float, float, float] = (0.0008, 0.0005, 0.0005)
    lift_ratio: tuple[float, float, float] = (0.02, 0.05, 0.02)
    lateral_ratio: tuple[float, float, float] = (0.03, 0.06, 0.02)
    off_axis_m: tuple[float, float, float] = (0.0, 0.0, 0.0015)
    tilt_deg: tuple[float, float, float] = (0.3, 0.0, 2.5)
    gain_log: tuple[float, float, float] = (0.0, 0.0, 0.03)
    tare_n: tuple[float, float, float] = (0.06, 0.0, 0.15)
    tare_n_m: tuple[float, float, float] = (0.003, 0.0, 0.0075)
    drift_n_s: tuple[float, float, float] = (0.01, 0.0, 0.02)
    drift_n_m_s: tuple[float, float, float] = (0.0005, 0.0, 0.001)
    fluctuation_log: tuple[float, float, float] = (0.12, 0.20, 0.05)
    sharpness_log: tuple[float, float, float] = (0.12, 0.20, 0.05)

    def __post_init__(self) -> None:
        for field in fields(self):
            levels = getattr(self, field.name)
            if not isinstance(levels, tuple) or len(levels) != 3:
                raise GranularIdError(
                    f"{field.name} must be (per recording, per fill, per session), got {levels!r:.60}"
                )
            for level in levels:
                finite_number(field.name, level, least=0)

    def scaled(self, factor: float) -> Nuisance:
        """Return the same nuisance with every level times `factor`; 0 switches it off."""
        factor = finite_number("factor", factor, least=0)
        return Nuisance(**{f.name: tuple(factor * s for s in getattr(self, f.name)) for f in fields(self)})

    def draw(self, *rngs: np.random.Generator) -> Conditions:
        """Draw the conditions of one push from the generators of recording, fill and session, in this order.

        The same generators give the same draws in units of the levels, whatever the levels are.
        """
        names = [field.name for field in fields(self)]
        draws = np.stack([rng.standard_normal((len(names), 6)) for rng in rngs])
        levels = np.array([getattr(self, name) for name in names])
        total = np.einsum("nk,knj->nj", levels, np.clip(draws, -CUT_SD, CUT_SD))
        drawn = dict(zip(names, total.tolist(), strict=True))
        same = {field.name for field in fields(Conditions)}
        roll_deg, pitch_deg, yaw_deg = drawn["tilt_deg"][:3]
        return Conditions(
            **{name: values[0] for name, values in drawn.items() if name in same - {"lift_ratio"}},
            lift_ratio=Conditions.lift_ratio + drawn["lift_ratio"][0],
            depth_offset_m=drawn["depth_m"][0],
            wall_offset_m=drawn["wall_m"][0],
            off_axis_x_m=drawn["off_axis_m"][0],
            off_axis_y_m=drawn["off_axis_m"][1],
            roll_rad=math.radians(roll_deg),
            pitch_rad=math.radians(pitch_deg),
            yaw_rad=math.radians(yaw_deg),
            tare=(*drawn["tare_n"][:3], *drawn["tare_n_m"][3:]),
            drift_per_s=(*drawn["drift_n_s"][:3], *drawn["drift_n_m_s"][3:]),
        )


# Rest before the motion, s: drawn evenly between these ("a fraction of a second").
LEAD_S = (0.10, 0.25)
# Some 700 pushes take days: the set is recorded in four of them by default.
DEFAULT_SESSIONS = 4
FIRST_SESSION_S = 1_704_099_600.0  # 2024-01-01 09:00 UTC, an arbitrary Monday
SESSION_EVERY_S = 86_400.0
# Every material is pushed once per round. A push with its reset takes about a minute.
PUSH_EVERY_S = 55.0
RESET_S = 10.0
# First element of the key of each random stream.
_RECORDING, _FILL, _SESSION, _BIAS, _ORDER = 1, 2, 3, 4, 5
_CONDITIONS, _PUSH = 0, 1
# Strokes of a drive are numbered as pushes that nobody asks for by so many recordings.
_STROKE = 1_000_000


def synthesize(
    materials: str | Material | Iterable[str | Material] | None = None,
    n_per_class: int = 62,
    sessions: int | None = None,
    *,
    rate_hz: float = 500.0,
    duration_s: float = 3.2,
    seed: int = 0,
    rig: Rig | None = None,
    nuisance: Nuisance | None = None,
    sensor: Sensor | Literal["imu"] | None = None,
) -> Dataset:
    """Make a data set of synthetic recordings from a physical model of the push.

    For demonstrations, tests and the simulated sensor. It is **not** evidence about accuracy on real
    recordings: every recording carries ``meta["synthetic"] = True``.

    Parameters
    ----------
    materials : iterable of str or Material, optional
        Names of the paper's materials, or descriptions of your own. Default: the eleven of `PAPER_MATERIALS`.
    n_per_class : int, default 62
        Recordings per material; the paper's 50 for training and 12 for testing.
    sessions : int, optional
        Days of recording. Mounting, calibration and zero point are drawn per session, the fill of a
        container per session and material. Recording k belongs to session k modulo `sessions`. Default: 4,
        or `n_per_class` if that is fewer; with an IMU each recording is a session of its own.
    rate_hz : float, default 500
        Sampling rate.
    duration_s : float, default 3.2
        Length of each recording; it starts 0.10 to 0.25 s before the motion (`Recording.trigger_index`). One push must
        end before the wall; a recording of an IMU is as long as you like, stroke after stroke of 3.2 s, to and fro.
    seed : int, default 0
        Same seed, same bits (on one platform and numpy version). Recording k of a material does not depend
        on how many recordings or which other materials are made.
    rig : Rig, optional
        Tool, depth, speed, container; default: the paper's.
    nuisance : Nuisance, optional
        What varies between pushes; ``Nuisance().scaled(0)`` switches it off.
    sensor : Sensor or "imu", optional
        Default: a force-torque sensor, ATI Mini45. ``"imu"``: a cheap gyroscope and accelerometer on the holder of the
        tool, axes wx wy wz (rad/s) and ax ay az (m/s2), which feels how tool and arm vibrate.

    Returns
    -------
    Dataset
        ``len(materials) * n_per_class`` recordings, material by material. ``meta`` holds the drawn
        parameters: depth, density, friction angle, gain, zero point, tilt and so on, units in the names.

    Raises
    ------
    ValueError, TypeError
        For unknown materials (the known ones are listed), counts below 1, more sessions than recordings
        per class, values out of range, or a push that would run into the container's wall.

    Examples
    --------
    >>> from granular_id import synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=4, seed=1)
    >>> data.X.shape, sorted(set(data.y.tolist()))
    ((8, 1600, 6), ['fine sugar', 'rice'])
    >>> data[0].meta["synthetic"]
    True
    """
    chosen = resolve_materials(PAPER_MATERIALS if materials is None else materials)
    n_per_class = whole_number("n_per_class", n_per_class)
    if isinstance(sensor, str) and sensor != "imu":
        raise GranularIdError(f"sensor must be a Sensor or 'imu', got {sensor!r:.60}")
    own_sessions = sessions is None and sensor == "imu"
    if sessions is None:
        sessions = 1 if own_sessions else min(DEFAULT_SESSIONS, n_per_class)
    if whole_number("sessions", sessions) > n_per_class:
        raise GranularIdError(f"sessions must not exceed n_per_class = {n_per_class}, got {sessions}")
    seed = whole_number("seed", seed, least=0)
    rig, nuisance = rig or Rig(), nuisance or Nuisance()
    rate_hz = sampling_rate("rate_hz", rate_hz)
    duration_s = positive_number("duration_s", duration_s)
    _check_extremes(rig, nuisance, rate_hz, STROKE_S if sensor == "imu" else duration_s)
    every_s = max(PUSH_EVERY_S, duration_s + RESET_S)

    block = np.empty((len(chosen) * n_per_class, round(duration_s * rate_hz), 6))
    drawn: list[dict[str, Any]] = []
    for slot, material in enumerate(chosen):
        for k in range(n_per_class):
            name = f"{material.name.replace(' ', '_')}_{k:02d}"
            session = _key(name) if own_sessions else k % sessions
            conditions, lead_s, stream = draw_push(material, k, session, seed, nuisance)
            meta = push_meta(material, rig, conditions, lead_s) | {"seed": seed}
            if sensor == "imu":
                numbers = count(k, _STROKE)
                strokes = (draw_push(material, number, session, seed, nuisance) for number in numbers)
                bias = random_stream(seed, _BIAS, session)
                wrench = simulate_drive(material, strokes, rig, rate_hz, block.shape[1], bias)
                meta["units"] = IMU_UNITS
            else:
                wrench = simulate_push(
                    material,
                    rig=rig,
                    rate_hz=rate_hz,
                    duration_s=duration_s,
                    lead_s=lead_s,
                    sensor=sensor or Sensor(),
                    conditions=conditions,
                    seed=stream,
                )
            block[len(drawn)] = wrench
            # Materials come in another order each time, or the clock would name them.
            turns = np.random.default_rng(random_stream(seed, _ORDER, k)).permutation(len(chosen))
            pushes_before = len(chosen) * (k // sessions) + int(turns[slot])
            day_s = FIRST_SESSION_S + SESSION_EVERY_S * (k % sessions)
            drawn.append(
                {
                    "label": material.name,
                    "name": name,
                    "session": name if own_sessions else f"session {k % sessions + 1}",
                    "start_time": day_s + every_s * pushes_before,
                    # A drive has many onsets.
                    "trigger_index": None if sensor == "imu" else math.ceil(lead_s * rate_hz),
                    "meta": meta,
                }
            )
    full_scale = math.inf if sensor == "imu" else np.asarray((sensor or Sensor()).full_scale)
    saturated = np.any(np.abs(block) >= full_scale, axis=2)
    flags = saturated.astype(np.uint8) * np.uint8(SampleFlag.SATURATED)
    block.flags.writeable = False  # recordings share it: no second copy of the samples
    axes = IMU_AXES if sensor == "imu" else AXES
    return Dataset(
        [
            Recording(wrench, rate_hz=rate_hz, flags=own if own.any() else None, axes=axes, **row)
            for wrench, own, row in zip(block, flags, drawn, strict=True)
        ]
    )


def _check_extremes(rig: Rig, nuisance: Nuisance, rate_hz: float, duration_s: float) -> None:
    """Refuse what the most extreme draw could not do, before any time is spent."""
    n_samples = round(duration_s * rate_hz)
    if math.ceil(LEAD_S[1] * rate_hz) >= n_samples:
        raise argument_error(
            GranularIdError,
            "duration_s",
            f"must exceed the {LEAD_S[1]:g} s of rest before the motion by at least one sample, "
            f"got {duration_s:g} at rate_hz = {rate_hz:g}",
        )
    travel_m = float(rig.travel_m(np.array([duration_s - LEAD_S[0]]))[0])
    nearest_m = rig.wall_distance_m - CUT_SD * sum(nuisance.wall_m)
    if travel_m >= nearest_m:
        raise argument_error(
            GranularIdError,
            "duration_s",
            f" = {duration_s:g} moves the tool up to {fixed(travel_m, 3)} m, and the wall may stand at "
            f"{fixed(nearest_m, 3)} m; a shorter recording is wanted, or a slower rig, or one with a more distant wall",
        )
    if rig.depth_m <= CUT_SD * sum(nuisance.depth_m):
        raise GranularIdError(f"depth_m = {rig.depth_m:g} of rig is within the nuisance of the fill height")


def draw_push(
    material: Material, k: int, session: int, seed: int | np.random.SeedSequence, nuisance: Nuisance
) -> tuple[Conditions, float, np.random.SeedSequence]:
    """Draw what push `k` through a material meets in a session: its conditions, its rest in s, its own seed."""
    # The name, not the position in the list: the same recordings whichever materials stand beside.
    key = _key(material.name)
    recording = random_stream(seed, _RECORDING, key, k)
    own = np.random.default_rng(random_stream(recording, _CONDITIONS))
    fill = np.random.default_rng(random_stream(seed, _FILL, key, session))
    of_session = np.random.default_rng(random_stream(seed, _SESSION, session))
    conditions = nuisance.draw(own, fill, of_session)
    return conditions, float(own.uniform(*LEAD_S)), random_stream(recording, _PUSH)


def _key(name: str) -> int:
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=4).digest(), "big")


def push_meta(material: Material, rig: Rig, conditions: Conditions, lead_s: float) -> dict[str, Any]:
    """Describe a simulated push for the metadata of its recording."""
    packed, set_up = conditions.material(material), conditions.rig(rig)
    return {
        "synthetic": True,
        "frame": FRAME,
        "sign": SIGN,
        "lead_s": lead_s,
        "rig": asdict(set_up),
        "material": asdict(packed),
        "conditions": asdict(conditions),
        "gain": math.exp(conditions.gain_log),
    }


def simulate_rests(
    payload: Payload,
    gravity: ArrayLike,
    *,
    duration_s: float = 2.0,
    rate_hz: float = 500.0,
    seed: int = 0,
) -> Dataset:
    """Simulate rests of a tool in several orientations, to identify its payload from.

    Parameters
    ----------
    payload : Payload
        Weight and zero that the sensor reads.
    gravity : array_like, shape (n, 3)
        Direction of gravity in the frame of the sensor at each rest, of any length.
    duration_s : float, default 2
        Of each rest.
    rate_hz : float, default 500
    seed : int, default 0

    Returns
    -------
    Dataset
        One recording a rest, labelled "rest"; its metadata hold its ``gravity``, and frame and sign of the payload
        or those of `synthesize`.

    Examples
    --------
    >>> from granular_id.recording import Payload
    >>> from granular_id.synthetic import simulate_rests
    >>> down = [[0, 0, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> rests = simulate_rests(Payload(0.3, (0, 0, 0.05)), down)
    >>> round(Payload.fit(rests, gravity=down).mass_kg, 1)
    0.3
    """
    directions = np.asarray(gravity, dtype=np.float64)
    if directions.ndim != 2 or directions.shape[1] != 3:
        raise argument_error(GranularIdError, "gravity", f"has shape {directions.shape}; wanted (n, 3)")
    rate = sampling_rate("rate_hz", rate_hz)
    n = round(positive_number("duration_s", duration_s) * rate)
    stated = {"synthetic": True, "frame": payload.frame or FRAME, "sign": payload.sign or SIGN}
    return Dataset(
        [
            Recording(
                load + rest_noise(n, rate, seed=random_stream(seed, i)),
                rate_hz=rate,
                label="rest",
                name=f"rest_{i:02d}",
                meta={**stated, "gravity": direction.tolist()},
            )
            for i, (load, direction) in enumerate(zip(payload.wrench(directions), directions, strict=True))
        ]
    )

"""One push of the tool through one material."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from granular_id._checks import whole_number
from granular_id._text import fixed
from granular_id.synthetic import _checks
from granular_id.synthetic.drag import N_LAYERS, Rig, drag_profile, layers, mean_drag_n
from granular_id.synthetic.fluctuations import (
    contact_breaks,
    heterogeneity,
    relative_fluctuation,
    shear_band_wave,
    stick_slip,
)
from granular_id.synthetic.materials import Material

# From the force on the tool to the numbers of the instrument: arm resonances and an ATI Mini45.

# Bending modes of tool, sensor and arm: natural frequency (Hz) and damping ratio. Light arms with a
# stiff tool ring between 30 and 100 Hz; a bed of grains damps them well.
MODES = ((34.0, 0.20), (40.0, 0.18), (70.0, 0.16), (90.0, 0.15))
# Share of each axis (fx fy fz tx ty tz) that passes through each mode; what is left of 1 goes straight
# through. Bending torques follow their forces, the stiff vertical axis mostly follows directly.
MODE_SHARE = np.array(
    [
        [0.45, 0.10, 0.25, 0.10],
        [0.10, 0.45, 0.10, 0.25],
        [0.05, 0.05, 0.20, 0.20],
        [0.10, 0.45, 0.10, 0.25],
        [0.45, 0.10, 0.25, 0.10],
        [0.05, 0.05, 0.30, 0.40],
    ]
)


def tool_resonance(wrench: NDArray[np.float64], step_s: float) -> NDArray[np.float64]:
    """Pass a wrench through the vibration of tool and arm; steady loads come out unchanged.

    Each mode is ``w^2 / (s^2 + 2 zeta w s + w^2)``, brought to discrete time by the bilinear transform
    with its frequency kept.

    Parameters
    ----------
    wrench : ndarray, shape (6, n)
        Load on the tool, N and N m.
    step_s : float
        Time step, s; below 5 ms, or the highest mode could not be represented.

    Returns
    -------
    ndarray, shape (6, n)
    """
    result: NDArray[np.float64] = (1.0 - MODE_SHARE.sum(axis=1, keepdims=True)) * wrench
    for (frequency_hz, damping), share in zip(MODES, MODE_SHARE.T, strict=True):
        omega = 2.0 * math.pi * frequency_hz
        warp = omega / math.tan(0.5 * omega * step_s)
        gain = np.array([1.0, 2.0, 1.0]) * omega**2
        poles = np.array(
            [
                warp**2 + 2.0 * damping * omega * warp + omega**2,
                2.0 * (omega**2 - warp**2),
                warp**2 - 2.0 * damping * omega * warp + omega**2,
            ]
        )
        result += share[:, np.newaxis] * lfilter(gain, poles, wrench, axis=-1)
    return result


@dataclass(frozen=True)
class Sensor:
    """Noise, resolution and range of a 6-axis force-torque sensor; default: ATI Mini45 (SI-145-5).

    Parameters
    ----------
    noise_rms : tuple of 6 float
        White noise per axis (fx fy fz in N, tx ty tz in N m).
    full_scale : tuple of 6 float
        Calibrated range, N and N m; readings saturate there.
    bits : int, default 16
        Of the converter, over plus and minus the full scale.

    Examples
    --------
    >>> from granular_id.synthetic import Sensor
    >>> (1000 * Sensor().resolution()[:3]).round(2).tolist()          # mN
    [4.43, 4.43, 8.85]
    """

    noise_rms: tuple[float, ...] = (0.020, 0.019, 0.050, 0.53e-3, 0.53e-3, 0.50e-3)
    full_scale: tuple[float, ...] = (145.0, 145.0, 290.0, 5.0, 5.0, 5.0)
    bits: int = 16

    def __post_init__(self) -> None:
        for field, low in (("noise_rms", 0.0), ("full_scale", np.finfo(float).tiny)):
            values = np.asarray(getattr(self, field), dtype=np.float64)
            if values.shape != (6,) or not np.all(np.isfinite(values)) or np.any(values < low):
                wanted = "6 finite numbers, " + ("at least 0" if low == 0 else "positive")
                raise ValueError(f"{field} must hold {wanted}, got {getattr(self, field)!r:.60}")
        if isinstance(self.bits, bool) or not isinstance(self.bits, int) or not 2 <= self.bits <= 32:
            raise ValueError(f"bits must be a whole number from 2 to 32, got {self.bits!r:.60}")

    def resolution(self) -> NDArray[np.float64]:
        """Step of the converter per axis, shape (6,), N and N m."""
        return np.asarray(self.full_scale, dtype=np.float64) / float(2 ** (self.bits - 1))

    def read(self, wrench: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
        """Return what the sensor reports for a true wrench of shape (n, 6)."""
        noisy = wrench + rng.standard_normal(wrench.shape) * np.asarray(self.noise_rms)
        step = self.resolution()
        limit = np.asarray(self.full_scale)
        read: NDArray[np.float64] = np.clip(np.rint(noisy / step) * step, -limit, limit)
        return read


# What differs between two pushes through the same material: fill, packing, mounting, zero point.

# Draws beyond this many standard deviations are cut: a bed a centimetre too deep would be seen and redone.
CUT_SD = 2.5
# Response to one per cent of packing fraction: friction angle (deg) and overshoot (factor, logarithm).
# Dense beds dilate: angle and peak grow together (Gravish 2010).
ANGLE_PER_PERCENT = 0.8
OVERSHOOT_PER_PERCENT = 0.12


@dataclass(frozen=True)
class Conditions:
    """State of bed, mounting and sensor in one push; the default is nominal everywhere.

    Parameters
    ----------
    depth_offset_m : float
        Fill height against the rig's `depth_m`; the tool's length is the limit.
    packing_percent : float
        Packing fraction against the nominal one, per cent: density, friction angle and overshoot follow.
    overshoot_log, heap_log, back_flow_log : float
        Logarithms of factors on these terms of the profile.
    wall_offset_m : float
        Where the push starts: distance to the wall against the rig's.
    lift_ratio : float
        Fz over Fx.
    lateral_ratio : float
        Mean Fy over Fx, from an uneven bed.
    off_axis_x_m, off_axis_y_m : float
        Eccentricity of the tool against the sensor's axis, m.
    roll_rad, pitch_rad, yaw_rad : float
        Tilt of the sensor against the frame of the push.
    gain_log : float
        Logarithm of the sensor's gain error.
    tare : tuple of 6 float
        Zero-point error per axis, N and N m.
    drift_per_s : tuple of 6 float
        Drift per axis, N/s and N m/s.
    """

    depth_offset_m: float = 0.0
    packing_percent: float = 0.0
    overshoot_log: float = 0.0
    heap_log: float = 0.0
    back_flow_log: float = 0.0
    wall_offset_m: float = 0.0
    lift_ratio: float = 0.55
    lateral_ratio: float = 0.0
    off_axis_x_m: float = 0.0
    off_axis_y_m: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    gain_log: float = 0.0
    tare: tuple[float, ...] = (0.0,) * 6
    drift_per_s: tuple[float, ...] = (0.0,) * 6

    def material(self, nominal: Material) -> Material:
        """Return the material in this state of packing."""
        angle = nominal.friction_angle_deg + ANGLE_PER_PERCENT * self.packing_percent
        overshoot_log = self.overshoot_log + OVERSHOOT_PER_PERCENT * self.packing_percent
        return replace(
            nominal,
            bulk_density_kg_m3=nominal.bulk_density_kg_m3 * (1.0 + self.packing_percent / 100.0),
            friction_angle_deg=min(max(angle, 0.0), 60.0),
            overshoot=nominal.overshoot * math.exp(overshoot_log),
            heap=nominal.heap * math.exp(self.heap_log),
            back_flow=nominal.back_flow * math.exp(self.back_flow_log),
        )

    def rig(self, nominal: Rig) -> Rig:
        """Return the rig with this fill height and starting point."""
        return replace(
            nominal,
            depth_m=min(nominal.depth_m + self.depth_offset_m, nominal.tool_length_m),
            wall_distance_m=nominal.wall_distance_m + self.wall_offset_m,
        )

    def rotation(self) -> NDArray[np.float64]:
        """Return the rotation from the frame of the push to the sensor's, shape (3, 3)."""
        cr, sr = math.cos(self.roll_rad), math.sin(self.roll_rad)
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cy, sy = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
        about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        rotation: NDArray[np.float64] = about_z @ about_y @ about_x
        return rotation


@dataclass(frozen=True)
class Nuisance:
    """Standard deviations of what varies, each split into recording, fill and session.

    A *fill* is one material poured in one session. Each field is ``(per recording, per fill, per session)``.

    Parameters
    ----------
    depth_m : fill height; together about 3 mm, read off a scale on the container.
    packing_percent : packing fraction; pouring and levelling by hand repeat to about one per cent.
    overshoot_log, heap_log, back_flow_log : shape of the profile, logarithm of a factor.
    wall_m : starting point of the push.
    lift_ratio, lateral_ratio : direction of the mean force.
    off_axis_m : eccentricity of the mounted tool.
    tilt_deg : tilt of the sensor, each of roll, pitch and yaw.
    gain_log : gain error of the calibration.
    tare_n, tare_n_m : zero-point error of each force and torque axis.
    drift_n_s, drift_n_m_s : drift of each force and torque axis.

    Examples
    --------
    >>> from granular_id.synthetic import Nuisance
    >>> Nuisance().scaled(0).tare_n
    (0.0, 0.0, 0.0)
    """

    depth_m: tuple[float, float, float] = (0.0020, 0.0020, 0.0010)
    packing_percent: tuple[float, float, float] = (1.0, 0.8, 0.5)
    overshoot_log: tuple[float, float, float] = (0.20, 0.12, 0.0)
    heap_log: tuple[float, float, float] = (0.15, 0.10, 0.0)
    back_flow_log: tuple[float, float, float] = (0.06, 0.05, 0.0)
    wall_m: tuple[float, float, float] = (0.0008, 0.0005, 0.0005)
    lift_ratio: tuple[float, float, float] = (0.02, 0.02, 0.01)
    lateral_ratio: tuple[float, float, float] = (0.03, 0.02, 0.01)
    off_axis_m: tuple[float, float, float] = (0.0, 0.0, 0.0005)
    tilt_deg: tuple[float, float, float] = (0.1, 0.0, 0.6)
    gain_log: tuple[float, float, float] = (0.0, 0.0, 0.01)
    tare_n: tuple[float, float, float] = (0.05, 0.0, 0.10)
    tare_n_m: tuple[float, float, float] = (0.002, 0.0, 0.005)
    drift_n_s: tuple[float, float, float] = (0.004, 0.0, 0.004)
    drift_n_m_s: tuple[float, float, float] = (0.0001, 0.0, 0.0001)

    def __post_init__(self) -> None:
        for field in fields(self):
            levels = getattr(self, field.name)
            if not isinstance(levels, tuple) or len(levels) != 3:
                raise ValueError(
                    f"{field.name} must be (per recording, per fill, per session), got {levels!r:.60}"
                )
            for level in levels:
                _checks.non_negative(field.name, level)

    def scaled(self, factor: float) -> Nuisance:
        """Return the same nuisance with every level times `factor`; 0 switches it off."""
        factor = _checks.non_negative("factor", factor)
        return Nuisance(**{f.name: tuple(factor * s for s in getattr(self, f.name)) for f in fields(self)})

    def draw(self, *rngs: np.random.Generator) -> Conditions:
        """Draw the conditions of one push from the generators of recording, fill and session, in this order.

        The same generators give the same draws in units of the levels, whatever the levels are.
        """
        names = [field.name for field in fields(self)]
        draws = np.stack([rng.standard_normal((len(names), 6)) for rng in rngs])
        levels = np.array([getattr(self, name) for name in names])
        total = np.einsum("nk,knj->nj", levels, np.clip(draws, -CUT_SD, CUT_SD))
        drawn = dict(zip(names, total, strict=True))
        tilt = np.radians(drawn["tilt_deg"])
        nominal = Conditions()
        return Conditions(
            depth_offset_m=float(drawn["depth_m"][0]),
            packing_percent=float(drawn["packing_percent"][0]),
            overshoot_log=float(drawn["overshoot_log"][0]),
            heap_log=float(drawn["heap_log"][0]),
            back_flow_log=float(drawn["back_flow_log"][0]),
            wall_offset_m=float(drawn["wall_m"][0]),
            lift_ratio=nominal.lift_ratio + float(drawn["lift_ratio"][0]),
            lateral_ratio=float(drawn["lateral_ratio"][0]),
            off_axis_x_m=float(drawn["off_axis_m"][0]),
            off_axis_y_m=float(drawn["off_axis_m"][1]),
            roll_rad=float(tilt[0]),
            pitch_rad=float(tilt[1]),
            yaw_rad=float(tilt[2]),
            gain_log=float(drawn["gain_log"][0]),
            tare=(*map(float, drawn["tare_n"][:3]), *map(float, drawn["tare_n_m"][3:])),
            drift_per_s=(*map(float, drawn["drift_n_s"][:3]), *map(float, drawn["drift_n_m_s"][3:])),
        )


PARTS = ("texture", "slip", "contacts", "resonance")
"""Parts of the model that `simulate_push` can leave out; what remains is the mean course."""

# The model runs at no less than this, so that slips and the 90 Hz mode are resolved at any output rate.
MIN_MODEL_RATE_HZ = 1000.0
# Slow heterogeneity of the drag, relative: a floor for any hand-filled bed, plus a part that grows with
# the grains' own fluctuation (coarse beds are less even).
HETEROGENEITY = 0.02
HETEROGENEITY_OF_FLUCTUATION = 0.30
# Its correlation length, tool diameters: the tool averages over its own width.
CORRELATION_DIAMETERS = 1.0
# Its size on Fz and Fy, which have courses of their own besides following Fx.
VERTICAL_SHARE, LATERAL_SHARE = 0.6, 0.8
# Effective friction of grains on the polished tool, times the share of the flanks that slide: the twist
# Tz that a sideways load brings with it, over half the diameter.
WALL_FRICTION = 0.3


def random_stream(seed: int | np.random.SeedSequence, *key: int) -> np.random.SeedSequence:
    """Return the seed of one independent stream; depends on `seed` and `key` only, never on call order.

    Raises
    ------
    TypeError, ValueError
        When the seed is neither a whole number >= 0 nor a `numpy.random.SeedSequence`.
    """
    if isinstance(seed, np.random.SeedSequence):
        return np.random.SeedSequence(entropy=seed.entropy, spawn_key=(*seed.spawn_key, *key))
    return np.random.SeedSequence(entropy=whole_number("seed", seed, least=0), spawn_key=key)


def simulate_push(
    material: Material,
    *,
    rig: Rig | None = None,
    rate_hz: float = 500.0,
    duration_s: float = 3.2,
    lead_s: float = 0.15,
    parts: Collection[str] = PARTS,
    sensor: Sensor | None = None,
    conditions: Conditions | None = None,
    seed: int | np.random.SeedSequence = 0,
) -> NDArray[np.float64]:
    """Simulate the wrench of one push; the physics behind `synthesize`, with every knob in reach.

    Parameters
    ----------
    material : Material
    rig : Rig, optional
        Tool, depth, speed; default: the paper's.
    rate_hz : float, default 500
        Output rate. The model runs at a multiple of it, at least 1000 Hz; samples are picked from there
        without a filter, as a polled sensor would.
    duration_s : float, default 3.2
        Length of the recording. The push must end before the wall.
    lead_s : float, default 0.15
        Rest before the motion.
    parts : collection of str, default all of `PARTS`
        Which of texture (slow heterogeneity, shear bands), slip, contacts and resonance to include.
    sensor : Sensor, optional
        Default None: the true wrench, free of noise and quantisation.
    conditions : Conditions, optional
        Fill, packing, tilt, zero point; default: nominal.
    seed : int or numpy.random.SeedSequence, default 0
        Each part draws from a stream of its own, so that leaving one out does not change the others.

    Returns
    -------
    ndarray, shape (round(duration_s * rate_hz), 6)
        fx fy fz in N, tx ty tz in N m, in the frame of `Rig`.

    Raises
    ------
    ValueError
        For values out of range, an unknown part, or a push that would run into the wall.

    Examples
    --------
    >>> from granular_id.synthetic import PAPER_MATERIALS, Rig, simulate_push
    >>> peas = PAPER_MATERIALS[0]
    >>> slow = simulate_push(peas, parts=(), duration_s=1.15)
    >>> fast = simulate_push(peas, parts=(), rig=Rig(speed_m_s=0.06), duration_s=0.65)
    >>> slow.shape
    (575, 6)
    >>> bool(abs(slow[-1, 0] - fast[-1, 0]) < 0.05)     # N, at the same place
    True
    """
    conditions = conditions or Conditions()
    rate_hz = _checks.rate("rate_hz", rate_hz)
    duration_s = _checks.positive("duration_s", duration_s)
    lead_s = _checks.non_negative("lead_s", lead_s)
    unknown = sorted(set(parts) - set(PARTS))
    if unknown:
        raise ValueError(f"parts has no part {unknown[0]!r}; known: {', '.join(PARTS)}")
    n_samples = round(duration_s * rate_hz)
    if n_samples < 2:
        raise ValueError(
            f"duration_s = {duration_s:g} holds {n_samples} samples at rate_hz = {rate_hz:g}, needs 2"
        )
    material = conditions.material(material)
    rig = conditions.rig(rig or Rig())

    per_sample = math.ceil(MIN_MODEL_RATE_HZ / rate_hz)
    step_s = 1.0 / (rate_hz * per_sample)
    steps = np.arange((n_samples - 1) * per_sample + 1, dtype=np.float64)
    time_s = steps * step_s - lead_s
    travel_m = rig.travel_m(time_s)
    if travel_m[-1] >= rig.wall_distance_m:
        raise ValueError(
            # No argument's name for the length: a robot is told it by whoever commands the push.
            f"a push of {duration_s:g} s at speed_m_s = {rig.speed_m_s:g} moves the tool {fixed(travel_m[-1], 3)} m, "
            f"into the wall at wall_distance_m = {fixed(rig.wall_distance_m, 3)}; a shorter push or a lower speed_m_s "
            "is wanted"
        )
    load = _wrench_on_tool(material, rig, conditions, travel_m, step_s=step_s, parts=parts, seed=seed)
    if "resonance" in parts:
        load = tool_resonance(load, step_s)
    wrench = _mounted(load[:, ::per_sample], conditions, 1.0 / rate_hz)
    return wrench if sensor is None else sensor.read(wrench, np.random.default_rng(random_stream(seed, 3)))


def _wrench_on_tool(
    material: Material,
    rig: Rig,
    conditions: Conditions,
    travel_m: NDArray[np.float64],
    *,
    step_s: float,
    parts: Collection[str],
    seed: int | np.random.SeedSequence,
) -> NDArray[np.float64]:
    """Load in the frame of the push about the sensor's origin, shape (6, n)."""
    drag, measured = drag_profile(material, travel_m, rig)
    course = np.zeros((3, travel_m.size))
    if "texture" in parts:
        course = _texture(material, rig, travel_m, np.random.default_rng(random_stream(seed, 0)))
    grains = np.zeros((3, N_LAYERS, travel_m.size))
    if "slip" in parts:
        grains += stick_slip(material, rig, travel_m, np.random.default_rng(random_stream(seed, 1)))
    if "contacts" in parts:
        rng = np.random.default_rng(random_stream(seed, 2))
        grains += contact_breaks(material, rig, travel_m, step_s, rng)

    # Layer by layer, in units of the layer's share of the mean drag. Everything random rides on the load
    # that the grains bear; the back-flow offset shifts the zero only.
    along = measured + drag * (course[0] + grains[0])
    sideways = conditions.lateral_ratio * along + drag * (course[1] + grains[1])
    vertical = conditions.lift_ratio * along + drag * (course[2] + grains[2])
    shares, lever_m = layers(material, rig)
    mean_n = mean_drag_n(material, rig) * shares
    fx, fy, fz = (mean_n @ part for part in (along, sideways, vertical))
    tx = -(mean_n * lever_m) @ sideways + conditions.off_axis_y_m * fz
    ty = (mean_n * lever_m) @ along - conditions.off_axis_x_m * fz
    tz = conditions.off_axis_x_m * fy - conditions.off_axis_y_m * fx
    tz = tz + WALL_FRICTION * 0.5 * rig.tool_diameter_m * fy
    return np.stack([fx, fy, fz, tx, ty, tz])


def _texture(
    material: Material, rig: Rig, travel_m: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Slow relative course on x, y, z, shape (3, n)."""
    travel = travel_m / rig.tool_diameter_m
    size = HETEROGENEITY + HETEROGENEITY_OF_FLUCTUATION * relative_fluctuation(material, rig)
    along, sideways, vertical = size * heterogeneity(travel, CORRELATION_DIAMETERS, rng, 3)
    along = along + material.shear_band_wave * shear_band_wave(travel, rng)
    return np.stack([along, LATERAL_SHARE * sideways, VERTICAL_SHARE * vertical])


def _mounted(load: NDArray[np.float64], conditions: Conditions, step_s: float) -> NDArray[np.float64]:
    """Load (6, n) as a tilted sensor with gain and zero-point errors would feel it, shape (n, 6)."""
    rotation = conditions.rotation()
    felt = np.concatenate([rotation @ load[:3], rotation @ load[3:]]).T * math.exp(conditions.gain_log)
    time_s = np.arange(felt.shape[0])[:, np.newaxis] * step_s
    zero_point = np.asarray(conditions.tare) + time_s * np.asarray(conditions.drift_per_s)
    wrench: NDArray[np.float64] = felt + zero_point
    return wrench

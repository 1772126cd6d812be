"""One push of the tool through one material, as the sensor reads it."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from granular_id._checks import (
    FloatArray,
    argument_error,
    finite_number,
    positive_number,
    sampling_rate,
    whole_number,
)
from granular_id._text import fixed
from granular_id.synthetic.drag import (
    N_LAYERS,
    Rig,
    contact_breaks,
    drag_profile,
    heterogeneity,
    layers,
    mean_drag_n,
    relative_fluctuation,
    shear_band_wave,
    stick_slip,
)
from granular_id.synthetic.materials import Material

PARTS = ("texture", "slip", "contacts", "resonance")
"""Parts of the model that `simulate_push` can leave out; what remains is the mean course."""

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
    fluctuation_log, sharpness_log : float
        Logarithms of factors on the size of the slips and on how abrupt they are.
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
    fluctuation_log: float = 0.0
    sharpness_log: float = 0.0

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
            fluctuation=nominal.fluctuation * math.exp(self.fluctuation_log),
            sharpness=nominal.sharpness * math.exp(self.sharpness_log),
        )

    def rig(self, nominal: Rig) -> Rig:
        """Return the rig with this fill height and starting point."""
        return replace(
            nominal,
            depth_m=min(nominal.depth_m + self.depth_offset_m, nominal.tool_length_m),
            wall_distance_m=nominal.wall_distance_m + self.wall_offset_m,
        )

    def rotation(self) -> FloatArray:
        """Return the rotation from the frame of the push to the sensor's, shape (3, 3)."""
        cr, sr = math.cos(self.roll_rad), math.sin(self.roll_rad)
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cy, sy = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
        about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        rotation: FloatArray = about_z @ about_y @ about_x
        return rotation


# What the numbers of the instrument are made of: resonances of the arm, and an ATI Mini45.

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


def tool_resonance(wrench: FloatArray, step_s: float) -> FloatArray:
    """Pass a wrench (6, n) through the vibration of tool and arm; steady loads come out unchanged.

    Each mode is ``w^2 / (s^2 + 2 zeta w s + w^2)``, brought to discrete time by the bilinear transform with its
    frequency kept: steps below 5 ms, or the highest mode could not be represented.
    """
    result: FloatArray = (1.0 - MODE_SHARE.sum(axis=1, keepdims=True)) * wrench
    for mode, share in zip(MODES, MODE_SHARE.T, strict=True):
        omega, _, poles = mode_filter(*mode, step_s)
        gain = np.array([1.0, 2.0, 1.0]) * omega**2
        result += share[:, np.newaxis] * lfilter(gain, poles, wrench, axis=-1)
    return result


def mode_filter(frequency_hz: float, damping: float, step_s: float) -> tuple[float, float, list[float]]:
    """Return the angular frequency of a mode, that of the bilinear transform, and the denominator of its filter."""
    omega = 2.0 * math.pi * frequency_hz
    warp = omega / math.tan(0.5 * omega * step_s)
    poles = [
        warp**2 + 2.0 * damping * omega * warp + omega**2,
        2.0 * (omega**2 - warp**2),
        warp**2 - 2.0 * damping * omega * warp + omega**2,
    ]
    return omega, warp, poles


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

    def resolution(self) -> FloatArray:
        """Step of the converter per axis, shape (6,), N and N m."""
        return np.asarray(self.full_scale, dtype=np.float64) / float(2 ** (self.bits - 1))

    def read(self, wrench: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return what the sensor reports for a true wrench of shape (n, 6)."""
        noisy = wrench + rng.standard_normal(wrench.shape) * np.asarray(self.noise_rms)
        step = self.resolution()
        limit = np.asarray(self.full_scale)
        read: FloatArray = np.clip(np.rint(noisy / step) * step, -limit, limit)
        return read


# The push itself.

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
    """Return the seed of one independent stream; depends on `seed` and `key` only, never on call order."""
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
) -> FloatArray:
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
    rate_hz = sampling_rate("rate_hz", rate_hz)
    duration_s = positive_number("duration_s", duration_s)
    lead_s = finite_number("lead_s", lead_s, least=0)
    unknown = sorted(set(parts) - set(PARTS))
    if unknown:
        raise ValueError(f"parts has no part {unknown[0]!r}; known: {', '.join(PARTS)}")
    n_samples = round(duration_s * rate_hz)
    if n_samples < 2:
        raise argument_error(
            ValueError,
            "duration_s",
            f" = {duration_s:g} holds {n_samples} samples at rate_hz = {rate_hz:g}, needs 2",
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
            # No argument's name for the length: of a simulated robot, whoever commands the push sets it.
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
    travel_m: FloatArray,
    *,
    step_s: float,
    parts: Collection[str],
    seed: int | np.random.SeedSequence,
) -> FloatArray:
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


def _texture(material: Material, rig: Rig, travel_m: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Slow relative course on x, y, z, shape (3, n)."""
    travel = travel_m / rig.tool_diameter_m
    size = HETEROGENEITY + HETEROGENEITY_OF_FLUCTUATION * relative_fluctuation(material, rig)
    along, sideways, vertical = size * heterogeneity(travel, CORRELATION_DIAMETERS, rng, 3)
    along = along + material.shear_band_wave * shear_band_wave(travel, rng)
    return np.stack([along, LATERAL_SHARE * sideways, VERTICAL_SHARE * vertical])


def _mounted(load: FloatArray, conditions: Conditions, step_s: float) -> FloatArray:
    """Load (6, n) as a tilted sensor with gain and zero-point errors would feel it, shape (n, 6)."""
    rotation = conditions.rotation()
    felt = np.concatenate([rotation @ load[:3], rotation @ load[3:]]).T * math.exp(conditions.gain_log)
    time_s = np.arange(felt.shape[0])[:, np.newaxis] * step_s
    zero_point = np.asarray(conditions.tare) + time_s * np.asarray(conditions.drift_per_s)
    wrench: FloatArray = felt + zero_point
    return wrench

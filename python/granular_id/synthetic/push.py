"""One push of the tool through one material as the sensor reads it, and many of them as an IMU feels them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from granular_id._checks import FloatArray, argument_error, finite_number, positive_number, sampling_rate
from granular_id._core import GranularIdError
from granular_id._text import fixed
from granular_id.synthetic.drag import (
    GRAVITY_M_S2,
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
from granular_id.synthetic.sensors import Sensor, random_stream, vibration

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
        raise GranularIdError(f"parts has no part {unknown[0]!r}; known: {', '.join(PARTS)}")
    n_samples = round(duration_s * rate_hz)
    if n_samples < 2:
        raise argument_error(
            GranularIdError,
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
        raise GranularIdError(
            # No argument's name for the length: of a simulated robot, whoever commands the push sets it.
            f"a push of {duration_s:g} s at speed_m_s = {rig.speed_m_s:g} moves the tool {fixed(travel_m[-1], 3)} m, "
            f"into the wall at wall_distance_m = {fixed(rig.wall_distance_m, 3)}; a shorter push or a lower speed_m_s "
            "is wanted"
        )
    load = _wrench_on_tool(material, rig, conditions, travel_m, step_s=step_s, parts=parts, seed=seed)
    if "resonance" in parts:
        load = vibration(load, step_s)
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


# Many pushes to and fro, as a gyroscope and an accelerometer on the holder of the tool feel them.

IMU_AXES = ("wx", "wy", "wz", "ax", "ay", "az")
IMU_UNITS = dict(zip(IMU_AXES, ("rad/s",) * 3 + ("m/s2",) * 3, strict=True))
# One stroke from wall to wall, the rest before it included, and how long it takes to relieve the tool at its end.
STROKE_S = 3.2
RELIEF_S = 0.1
# Holder, sensor and tool: a kilogram and a half, of the size of a hand.
MASS_KG = 1.5
INERTIA_KG_M2 = 0.006
# A cheap sensor (InvenSense MPU-6050: 0.005 deg/s and 400 ug per root Hz) at some 50 Hz, and a bias that each session
# has anew.
NOISE = np.array([0.001] * 3 + [0.03] * 3)
BIAS = np.array([0.01] * 3 + [0.15] * 3)

Stroke = tuple[Conditions, float, np.random.SeedSequence]
"""What a stroke meets: its conditions, its rest in s, its seed."""


def simulate_drive(
    material: Material,
    strokes: Iterator[Stroke],
    rig: Rig,
    rate_hz: float,
    n_samples: int,
    bias: np.random.SeedSequence,
) -> FloatArray:
    """Simulate what an IMU on the tool holder reads while the tool strokes to and fro, shape (n_samples, 6).

    Each stroke is a push of `simulate_push`, every other one backwards. The arm holds against steady loads; what it
    lets through is the vibration of its modes, over mass and inertia. `bias` seeds the sensor's zero point.
    """
    per_sample = math.ceil(MIN_MODEL_RATE_HZ / rate_hz)
    step_s = 1.0 / (rate_hz * per_sample)
    n_steps = n_samples * per_sample
    n_strokes = math.ceil(n_steps / round(STROKE_S / step_s))
    met, loads = list(islice(strokes, n_strokes)), list[FloatArray]()
    for number, (conditions, lead_s, seed) in enumerate(met):
        load = simulate_push(
            material,
            rig=rig,
            rate_hz=1.0 / step_s,
            duration_s=STROKE_S,
            lead_s=lead_s,
            parts=[part for part in PARTS if part != "resonance"],
            conditions=replace(conditions, tare=(0.0,) * 6, drift_per_s=(0.0,) * 6),
            seed=seed,
        )
        relief = np.linspace(1.0, 0.0, round(RELIEF_S / step_s))
        load[-len(relief) :] *= relief[:, np.newaxis]
        if number % 2:
            load[:, [0, 1, 3, 4]] *= -1.0  # the tool has turned about its axis
        loads.append(load)
    load = np.concatenate(loads)[:n_steps]
    rates = vibration(load[:, 3:].T, step_s, order=1, axes=slice(3, 6)) / INERTIA_KG_M2
    accelerations = vibration(load[:, :3].T, step_s, order=2, axes=slice(3)) / MASS_KG
    # z points down: at rest an accelerometer reads what holds it up.
    accelerations += (met[0][0].rotation() @ np.array([0.0, 0.0, -GRAVITY_M_S2]))[:, np.newaxis]
    # The sensor's own filter: the mean since its last reading.
    read: FloatArray = np.vstack([rates, accelerations]).T.reshape(n_samples, per_sample, 6).mean(axis=1)
    read += BIAS * np.random.default_rng(bias).standard_normal(6)
    read += NOISE * np.random.default_rng(random_stream(met[0][2], 3)).standard_normal(read.shape)
    return read

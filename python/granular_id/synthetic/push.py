"""One push of the tool through one material."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import argument_error, finite_number, positive_number, sampling_rate, whole_number
from granular_id._text import fixed
from granular_id.synthetic.drag import N_LAYERS, Rig, drag_profile, layers, mean_drag_n
from granular_id.synthetic.fluctuations import (
    contact_breaks,
    heterogeneity,
    relative_fluctuation,
    shear_band_wave,
    stick_slip,
)
from granular_id.synthetic.materials import Material
from granular_id.synthetic.nuisance import Conditions
from granular_id.synthetic.sensor import Sensor, tool_resonance

FloatArray = NDArray[np.float64]

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

"""The forces of the bed on the tool: mean drag, its course along the push, and what rides on it.

Drag grows as D H^2 and does not depend on speed: R. Albert et al., "Slow drag in a granular medium", Phys. Rev.
Lett. 82, 205 (1999), up to a Froude number of about 1: S. Kumar et al., arXiv 1712.09057 (2017). Resistive stress
is proportional to depth: S. Agarwal, D. I. Goldman, K. Kamrin, PNAS 120, e2214017120 (2023). Dense packings overshoot
and oscillate as shear bands form and are overrun: N. Gravish, P. B. Umbanhowar, D. I. Goldman, "Force and flow
transition in plowed granular media", Phys. Rev. Lett. 105, 128301 (2010). Stick-slip: I. Albert et al., Phys. Rev.
Lett. 84, 5122 (2000) and Phys. Rev. E 64, 031307 (2001); B. Kahng et al., Phys. Rev. E 64, 051303 (2001). Contact
forces are exponentially distributed: S. N. Coppersmith et al., Phys. Rev. E 53, 4673 (1996).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from scipy.signal import lfilter

from granular_id._checks import FloatArray, finite_number, positive_number
from granular_id._core import GranularIdError
from granular_id.synthetic.materials import Material

GRAVITY_M_S2 = 9.81
# Broms' factor 3 for a pile in sand under lateral load: a wedge of three tool widths is mobilised. With
# the pressure's integral over depth, H^2/2, it gives the 1.5 of the formula.
WEDGE_WIDTHS = 3.0
# Three mobilised widths times the factor 2 of Rankine's passive cohesion term, 2 c sqrt(Kp).
COHESION_FACTOR = 6.0
# Depth layers that slip independently. Force chains end within a few tool widths of each other: 76 mm of
# a 17 mm tool is about four.
N_LAYERS = 4
# Load-bearing contacts: 60 % of the grains that fit on the front half of the submerged cylinder's surface.
CONTACT_FRACTION = 0.6
# Travel over which the heap and the back-flow build up, tool diameters: a surcharge forms over the first
# few tool widths, the hole behind the tool closes within about one.
HEAP_DIAMETERS = 2.0
BACK_FLOW_DIAMETERS = 1.0
# Reach of the end wall's influence, tool diameters (Rankine's passive wedge is about 2 widths long).
WALL_REACH_DIAMETERS = 1.3


# The frame of `Rig`, and whose force on whom.
FRAME = "x along the push, z along the tool (down), y completes; origin at the sensor"
SIGN = "load of the tool on the material: fx positive while pushing"


@dataclass(frozen=True)
class Rig:
    """A vertical cylinder, almost submerged, pushed sideways through a container.

    The defaults are the paper's: a cylinder 17 mm wide and 80 mm long at 0.03 m/s.

    Frame: x along the push, z along the tool away from the sensor flange (down), y completes the
    right-handed set; origin at the sensor. Sign: what the tool exerts on the material, so that Fx is
    positive while pushing.

    Parameters
    ----------
    tool_diameter_m : float, default 0.017
        D.
    tool_length_m : float, default 0.080
        Length of the cylinder.
    depth_m : float, default 0.076
        H, submerged length; at most `tool_length_m`.
    speed_m_s : float, default 0.03
        Speed of the push.
    acceleration_m_s2 : float, default 1.0
        The robot's ramp to that speed: 30 ms at the default, short against every feature of the drag.
    wall_distance_m : float, default 0.100
        From the start of the push to the container's end wall. The push must end before it.
    sensor_to_tool_m : float, default 0.040
        From the sensor's reference plane to the top of the cylinder: mounting plate and holder.
    """

    tool_diameter_m: float = 0.017
    tool_length_m: float = 0.080
    depth_m: float = 0.076
    speed_m_s: float = 0.03
    acceleration_m_s2: float = 1.0
    wall_distance_m: float = 0.100
    sensor_to_tool_m: float = 0.040

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name == "sensor_to_tool_m":
                finite_number(field.name, self.sensor_to_tool_m, least=0)
            else:
                positive_number(field.name, getattr(self, field.name))
        if self.depth_m > self.tool_length_m:
            raise GranularIdError(
                f"depth_m must not exceed tool_length_m = {self.tool_length_m:g}, got {self.depth_m:g}"
            )

    def travel_m(self, time_s: FloatArray) -> FloatArray:
        """Distance moved at times counted from the start of the motion (0 before it), m."""
        ramp_s = self.speed_m_s / self.acceleration_m_s2
        moving = np.maximum(time_s, 0.0)
        ramped = np.minimum(moving, ramp_s)
        return 0.5 * self.acceleration_m_s2 * ramped**2 + self.speed_m_s * (moving - ramped)

    def surface_to_sensor_m(self) -> float:
        """Height of the sensor's origin above the surface of the bed, m."""
        return self.sensor_to_tool_m + self.tool_length_m - self.depth_m


def _friction_and_cohesion_n(material: Material, rig: Rig) -> tuple[float, float]:
    passive = math.tan(math.radians(45.0 + material.friction_angle_deg / 2.0)) ** 2
    # The tool cannot pass between grains: half a grain on either side moves with it (Albert 1999).
    width_m = rig.tool_diameter_m + material.grain_diameter_m
    weight_n_m3 = material.bulk_density_kg_m3 * GRAVITY_M_S2
    friction_n = 0.5 * WEDGE_WIDTHS * passive * weight_n_m3 * width_m * rig.depth_m**2
    cohesion_n = COHESION_FACTOR * material.cohesion_pa * math.sqrt(passive) * width_m * rig.depth_m
    return friction_n, cohesion_n


def mean_drag_n(material: Material, rig: Rig) -> float:
    """Steady drag, N: ``1.5 Kp rho g De H^2 + 6 c sqrt(Kp) De H``, ``Kp = tan^2(45 deg + phi/2)``, ``De = D + d``."""
    return sum(_friction_and_cohesion_n(material, rig))


def contact_count(material: Material, rig: Rig) -> float:
    """Load-bearing contacts on the tool, ``0.6 (pi/2) D H / d^2``, at least 1."""
    front_m2 = 0.5 * math.pi * rig.tool_diameter_m * rig.depth_m
    return max(1.0, CONTACT_FRACTION * front_m2 / material.grain_diameter_m**2)


def layers(material: Material, rig: Rig) -> tuple[FloatArray, FloatArray]:
    """Share of the mean drag and lever arm (m, to the sensor's origin) of each depth layer."""
    # Frictional pressure grows with depth, cohesion does not: shares between a triangle and a rectangle.
    friction_n, cohesion_n = _friction_and_cohesion_n(material, rig)
    edges = np.linspace(0.0, 1.0, N_LAYERS + 1)
    top, bottom = edges[:-1], edges[1:]
    force_n = friction_n * (bottom**2 - top**2) + cohesion_n * (bottom - top)
    moment = friction_n * (bottom**3 - top**3) * (2.0 / 3.0) + cohesion_n * (bottom**2 - top**2) * 0.5
    centre_m = rig.depth_m * moment / force_n
    return force_n / force_n.sum(), rig.surface_to_sensor_m() + centre_m


def drag_profile(material: Material, travel_m: FloatArray, rig: Rig) -> tuple[FloatArray, FloatArray]:
    """Course of the drag in units of the mean drag: as the grains bear it, and as a sensor zeroed in the bed reads it.

    Mobilisation ``1 - exp(-X/xm)``, overshoot of a dense packing ``A (X/xo) exp(1 - X/xo)``, heap, and the rise
    ``a exp(-(Xw - X)/1.3)`` towards the wall; the reading has the negative offset of the back-flow too.
    """
    x = travel_m / rig.tool_diameter_m
    wall_at = rig.wall_distance_m / rig.tool_diameter_m
    mobilised = 1.0 - np.exp(-x / material.mobilisation_diameters)
    early = x / material.overshoot_at_diameters
    peak = material.overshoot * early * np.exp(1.0 - early)
    heap = material.heap * (1.0 - np.exp(-x / HEAP_DIAMETERS))
    wall = material.wall * np.exp(-(wall_at - x) / WALL_REACH_DIAMETERS)
    drag = mobilised * (1.0 + peak + heap + wall)
    back_flow = material.back_flow * (1.0 - np.exp(-x / BACK_FLOW_DIAMETERS))
    return drag, drag - back_flow


# What rides on the mean drag: the noise of breaking contacts.
# Distance over which a broken contact's load is taken up again, grain diameters: the gap to the next
# grain, a tenth of a diameter in a dense bed.
RECOVERY_GRAINS = 0.1
# Lean of single contacts sideways and vertically (tangent): about 30 degrees.
CONTACT_LATERAL, CONTACT_VERTICAL = 0.6, 0.5
# Sign of the lean of the four groups of contacts (left or right, rising or falling).
_SIDE = np.array([1.0, 1.0, -1.0, -1.0])
_SLOPE = np.array([1.0, -1.0, 1.0, -1.0])


def contact_breaks(
    material: Material, rig: Rig, travel_m: FloatArray, step_s: float, rng: np.random.Generator
) -> FloatArray:
    """Draw the noise of breaking contacts, (3, N_LAYERS, n), in units of the layer's own mean drag.

    Shot noise: at rate ``Nc v / d`` a contact drops a force that is exponentially distributed about its share of the
    drag, times the material's sharpness, and recovers over a tenth of a grain. The number in a step is Poisson, and a
    sum of exponentials is a gamma variable: flour costs no more than peas.
    """
    per_layer = contact_count(material, rig) / N_LAYERS
    moved_m = np.diff(travel_m, prepend=travel_m[:1])
    expected = per_layer * moved_m / (material.grain_diameter_m * _SIDE.size)
    broken = rng.poisson(expected, (_SIDE.size, N_LAYERS, travel_m.size))
    dropped = rng.standard_gamma(broken.astype(np.float64))
    along = -(dropped.sum(axis=0) - _SIDE.size * expected)
    sideways = -CONTACT_LATERAL * np.tensordot(_SIDE, dropped, axes=1)
    vertical = -CONTACT_VERTICAL * np.tensordot(_SLOPE, dropped, axes=1)

    recovery_s = RECOVERY_GRAINS * material.grain_diameter_m / rig.speed_m_s
    decay = math.exp(-step_s / recovery_s)
    # Mean of the decaying force over one step: contacts that recover within it weigh less.
    seen = recovery_s / step_s * (1.0 - decay)
    jumps = np.stack([along, sideways, vertical])
    noise: FloatArray = lfilter([seen], [1.0, -decay], jumps, axis=-1) * (material.sharpness / per_layer)
    return noise


# Stick-slip: force chains in front of the tool load up, let go, and load up again.
# Mean slip length, grain diameters: a chain fails when the tool has pushed it by most of one grain
# (Albert 2001). Long grains must turn before they let go: the exponent of the aspect ratio.
SLIP_GRAINS = 0.8
ASPECT_EXPONENT = 0.3
# Shape of the gamma distribution of slip lengths: coefficient of variation 0.35, irregular but periodic.
SLIP_LENGTH_SHAPE = 8.0
# Force of a layer just before and just after a slip, relative to its strongest, mean and spread: about
# two thirds of a chain's load is released (Kahng 2001 finds slips large against the mean at few contacts).
BEFORE_MEAN, BEFORE_SD = 1.0, 0.12
AFTER_MEAN, AFTER_SD = 0.35, 0.10
# Duration of a slip for grains of sharpness 1, s: the time a loaded grain and its neighbours take to fall
# into the next gap, some milliseconds for grains of 1 to 10 mm. It does not depend on the tool's speed.
SLIP_DURATION_S = 0.009
# Size sideways and vertically against along the push: chains lean by some 20 to 30 degrees.
LATERAL, VERTICAL = 0.45, 0.40


def slip_length_m(material: Material) -> float:
    """Mean distance between two slips of one layer, ``0.8 d AR^0.3``, m."""
    return SLIP_GRAINS * material.grain_diameter_m * math.pow(material.aspect_ratio, ASPECT_EXPONENT)


def relative_fluctuation(material: Material, rig: Rig) -> float:
    """Return the stick-slip's standard deviation over the drag, ``kappa / sqrt(Nc)``: proportional to d."""
    return material.fluctuation / math.sqrt(contact_count(material, rig))


def stick_slip(material: Material, rig: Rig, travel_m: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw the stick-slip of every depth layer, (3, N_LAYERS, n), in units of the layer's own mean drag.

    A sawtooth per layer: load rises linearly over a random slip length, then drops within some milliseconds. Slips
    follow the distance moved, so their rate is proportional to speed and their size independent of it.
    """
    length_m = slip_length_m(material)
    end_m = float(travel_m[-1])
    # Enough slips to pass the end in practically every draw; np.interp holds the last value otherwise.
    n_slips = math.ceil(1.25 * end_m / length_m) + 24
    lengths = rng.gamma(SLIP_LENGTH_SHAPE, length_m / SLIP_LENGTH_SHAPE, (N_LAYERS, n_slips))
    # Begin a few slips before the start, so that layers are out of step from the first sample on.
    slip_at = np.cumsum(lengths, axis=1) - length_m * rng.uniform(2.0, 6.0, (N_LAYERS, 1))
    before = np.maximum(rng.normal(BEFORE_MEAN, BEFORE_SD, (N_LAYERS, n_slips)), 0.0)
    after = np.maximum(rng.normal(AFTER_MEAN, AFTER_SD, (N_LAYERS, n_slips)), 0.0)
    lean = rng.standard_normal((2, N_LAYERS, n_slips + 1))

    slip_over_m = rig.speed_m_s * SLIP_DURATION_S / material.sharpness
    # Fine or soft grains slip for longer than they stick: half and half is then the sawtooth's limit.
    landed_at = slip_at + np.minimum(slip_over_m, 0.5 * np.append(lengths[:, 1:], lengths[:, :1], axis=1))

    # Moments of a sawtooth that rises evenly from `after` to `before`.
    mean = 0.5 * (AFTER_MEAN + BEFORE_MEAN)
    square = (AFTER_MEAN**2 + AFTER_SD**2 + AFTER_MEAN * BEFORE_MEAN + BEFORE_MEAN**2 + BEFORE_SD**2) / 3.0
    shares, _ = layers(material, rig)
    size = relative_fluctuation(material, rig) / math.sqrt(float(np.sum(shares**2)))

    result = np.empty((3, N_LAYERS, travel_m.size))
    for layer in range(N_LAYERS):
        knots = np.stack([slip_at[layer], landed_at[layer]], axis=1).ravel()
        load = np.stack([before[layer], after[layer]], axis=1)
        result[0, layer] = (np.interp(travel_m, knots, load.ravel()) - mean) / math.sqrt(square - mean**2)
        for axis, scale in ((1, LATERAL), (2, VERTICAL)):
            # A chain keeps its lean while it loads; the next chain leans elsewhere.
            leaning = lean[axis - 1, layer]
            leant = load * np.stack([leaning[:-1], leaning[1:]], axis=1)
            result[axis, layer] = scale * np.interp(travel_m, knots, leant.ravel()) / math.sqrt(square)
    return size * result


# Slow structure along the push: heterogeneity of the bed and waves of shear bands.
# Harmonics of a random Fourier sum: enough for a Gaussian value at every place (central limit).
N_HARMONICS = 24
# Wavelength of successive shear bands, tool diameters. Bands start at the tool's foot and surface some
# way ahead; the next one forms when the tool has reached the old one (Gravish et al. 2010).
SHEAR_BAND_DIAMETERS = 0.85
# The first band forms as the tool starts, so that waves begin nearly in step; spread of their phase.
START_PHASE_RAD = 0.6
# Then the wavelength wanders: standard deviation of the phase at a correlation length of WANDER_DIAMETERS.
PHASE_WANDER_RAD = 0.9
WANDER_DIAMETERS = 2.5
# Slow loading, quick collapse: skew of the wave (0 = sine).
WAVE_SKEW = 0.5
# Grid for the slow fields, tool diameters; they change over about one diameter.
GRID_DIAMETERS = 0.05


def heterogeneity(
    travel_diameters: FloatArray, correlation_diameters: float, rng: np.random.Generator, n: int
) -> FloatArray:
    """Draw smooth Gaussian fields (n, t) of zero mean and unit variance: of position, not of time."""
    wave_number = rng.standard_normal((n, N_HARMONICS)) / correlation_diameters
    phase = rng.uniform(0.0, 2.0 * math.pi, (n, N_HARMONICS))
    end = float(travel_diameters[-1])
    grid = np.linspace(0.0, end, max(2, math.ceil(end / GRID_DIAMETERS) + 1))
    angle = wave_number[:, :, np.newaxis] * grid + phase[:, :, np.newaxis]
    field = math.sqrt(2.0 / N_HARMONICS) * np.cos(angle).sum(axis=1)
    return np.stack([np.interp(travel_diameters, grid, row) for row in field])


def shear_band_wave(travel_diameters: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw the periodic force of successive shear bands: unit amplitude, wandering wavelength."""
    start = rng.normal(0.0, START_PHASE_RAD)
    field = heterogeneity(travel_diameters, WANDER_DIAMETERS, rng, 1)[0]
    wander = PHASE_WANDER_RAD * (field - field[0])
    phase = 2.0 * math.pi * travel_diameters / SHEAR_BAND_DIAMETERS + start + wander
    wave: FloatArray = np.sin(phase - WAVE_SKEW * np.sin(phase))
    return wave

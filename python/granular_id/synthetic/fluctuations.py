"""What rides on the mean drag: breaking contacts, stick-slip, and slow structure along the push."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from granular_id.synthetic.drag import N_LAYERS, Rig, contact_count, layers
from granular_id.synthetic.materials import Material

FloatArray = NDArray[np.float64]

# Distance over which a broken contact's load is taken up again, grain diameters: the gap to the next
# grain, a tenth of a diameter in a dense bed.
RECOVERY_GRAINS = 0.1
# Lean of single contacts sideways and vertically (tangent): about 30 degrees.
CONTACT_LATERAL, CONTACT_VERTICAL = 0.6, 0.5
# Sign of the lean of the four groups of contacts (left or right, rising or falling).
_SIDE = np.array([1.0, 1.0, -1.0, -1.0])
_SLOPE = np.array([1.0, -1.0, 1.0, -1.0])


def contact_break_rate_hz(material: Material, rig: Rig | None = None) -> float:
    """Contacts broken per second on the whole tool, ``Nc v / d``: each lasts about one grain of travel."""
    rig = rig or Rig()
    return contact_count(material, rig) * rig.speed_m_s / material.grain_diameter_m


def contact_breaks(
    material: Material, rig: Rig, travel_m: FloatArray, step_s: float, rng: np.random.Generator
) -> FloatArray:
    """Draw the contact-break noise of every depth layer on the three force axes.

    Shot noise: at rate ``Nc v / d`` a contact drops a force that is exponentially distributed about its
    share ``F / Nc`` of the drag, times the material's sharpness, and recovers over a tenth of a grain.
    The number in a step is Poisson, and a sum of exponentials is a gamma variable, so flour with tens of
    millions of breaks a second costs no more than peas with a hundred.

    Parameters
    ----------
    material : Material
    rig : Rig
    travel_m : ndarray, shape (n,)
        Distance moved, m, at steps of `step_s`.
    step_s : float
        Time step, s.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (3, N_LAYERS, n)
        Fluctuation along x, y, z in units of the layer's own mean drag.

    Notes
    -----
    Exponential distribution of contact forces: S. N. Coppersmith et al., "Model for force fluctuations in
    bead packs", Phys. Rev. E 53, 4673 (1996).
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


def relative_fluctuation(material: Material, rig: Rig | None = None) -> float:
    """Return the stick-slip's standard deviation over the drag, ``kappa / sqrt(Nc)``: proportional to d."""
    return material.fluctuation / math.sqrt(contact_count(material, rig))


def stick_slip(material: Material, rig: Rig, travel_m: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw the stick-slip of every depth layer on the three force axes.

    A sawtooth per layer: load rises linearly over a random slip length, then drops within some
    milliseconds. Slips follow the distance moved, so their rate is proportional to speed and the size
    independent of it.

    Parameters
    ----------
    material : Material
    rig : Rig
    travel_m : ndarray, shape (n,)
        Distance moved, m.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (3, N_LAYERS, n)
        Fluctuation along x, y, z in units of the layer's own mean drag. Summed over the layers by their
        share of the drag, x has the standard deviation `relative_fluctuation`.

    Notes
    -----
    I. Albert et al., "Jamming and fluctuations in granular drag", Phys. Rev. Lett. 84, 5122 (2000) and
    "Stick-slip fluctuations in granular drag", Phys. Rev. E 64, 031307 (2001); B. Kahng, I. Albert,
    P. Schiffer, A.-L. Barabasi, "Modeling relaxation and jamming in granular media", Phys. Rev. E 64,
    051303 (2001).
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
    """Draw ``n`` smooth Gaussian fields of zero mean and unit variance along the push.

    Parameters
    ----------
    travel_diameters : ndarray, shape (t,)
        Distance moved in tool diameters, not decreasing.
    correlation_diameters : float
        Length over which the field forgets itself (Gaussian covariance).
    rng : numpy.random.Generator
    n : int

    Returns
    -------
    ndarray, shape (n, t)
        Fields of position, not of time: pushing faster plays them faster.
    """
    wave_number = rng.standard_normal((n, N_HARMONICS)) / correlation_diameters
    phase = rng.uniform(0.0, 2.0 * math.pi, (n, N_HARMONICS))
    end = float(travel_diameters[-1])
    grid = np.linspace(0.0, end, max(2, math.ceil(end / GRID_DIAMETERS) + 1))
    angle = wave_number[:, :, np.newaxis] * grid + phase[:, :, np.newaxis]
    field = math.sqrt(2.0 / N_HARMONICS) * np.cos(angle).sum(axis=1)
    return np.stack([np.interp(travel_diameters, grid, row) for row in field])


def shear_band_wave(travel_diameters: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Draw the periodic force of successive shear bands: unit amplitude, wandering wavelength.

    Notes
    -----
    N. Gravish, P. B. Umbanhowar, D. I. Goldman, Phys. Rev. Lett. 105, 128301 (2010): above a critical
    packing the drag on a plough oscillates as shear bands form and are overrun.
    """
    start = rng.normal(0.0, START_PHASE_RAD)
    field = heterogeneity(travel_diameters, WANDER_DIAMETERS, rng, 1)[0]
    wander = PHASE_WANDER_RAD * (field - field[0])
    phase = 2.0 * math.pi * travel_diameters / SHEAR_BAND_DIAMETERS + start + wander
    wave: FloatArray = np.sin(phase - WAVE_SKEW * np.sin(phase))
    return wave

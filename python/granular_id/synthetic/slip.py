"""Stick-slip: force chains in front of the tool load up, let go, and load up again."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from granular_id.synthetic.drag import N_LAYERS, contact_count, layers
from granular_id.synthetic.materials import Material
from granular_id.synthetic.rig import Rig

__all__ = ["relative_fluctuation", "slip_length_m", "stick_slip"]

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


def stick_slip(
    material: Material, rig: Rig, travel_m: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
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

"""Noise of single contacts that break in front of the tool."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from granular_id.synthetic.drag import N_LAYERS, contact_count
from granular_id.synthetic.materials import Material
from granular_id.synthetic.rig import Rig

__all__ = ["contact_break_rate_hz", "contact_breaks"]

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
    material: Material, rig: Rig, travel_m: NDArray[np.float64], step_s: float, rng: np.random.Generator
) -> NDArray[np.float64]:
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
    noise: NDArray[np.float64] = lfilter([seen], [1.0, -decay], jumps, axis=-1)
    return noise * (material.sharpness / per_layer)

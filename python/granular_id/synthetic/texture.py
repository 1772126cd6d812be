"""Slow structure along the push: heterogeneity of the bed and waves of shear bands."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["heterogeneity", "shear_band_wave"]

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
    travel_diameters: NDArray[np.float64], correlation_diameters: float, rng: np.random.Generator, n: int
) -> NDArray[np.float64]:
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


def shear_band_wave(travel_diameters: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
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
    wave: NDArray[np.float64] = np.sin(phase - WAVE_SKEW * np.sin(phase))
    return wave

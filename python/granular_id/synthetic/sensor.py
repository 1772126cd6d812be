"""From the force on the tool to the numbers of the instrument: arm resonances and an ATI Mini45."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

FloatArray = NDArray[np.float64]

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
    result: FloatArray = (1.0 - MODE_SHARE.sum(axis=1, keepdims=True)) * wrench
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

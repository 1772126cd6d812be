"""The instrument: how tool and arm vibrate, and what a force-torque sensor adds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from granular_id._checks import FloatArray, sampling_rate, whole_number
from granular_id._core import GranularIdError


def random_stream(seed: int | np.random.SeedSequence, *key: int) -> np.random.SeedSequence:
    """Return the seed of one independent stream; depends on `seed` and `key` only, never on call order."""
    if isinstance(seed, np.random.SeedSequence):
        return np.random.SeedSequence(entropy=seed.entropy, spawn_key=(*seed.spawn_key, *key))
    return np.random.SeedSequence(entropy=whole_number("seed", seed, least=0), spawn_key=key)


# Vibration of tool and arm.

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


def vibration(load: FloatArray, step_s: float, *, order: int = 0, axes: slice = slice(6)) -> FloatArray:
    """Pass some axes of a wrench (c, n) through the modes of tool and arm.

    The transfer function of a mode is ``w^2 / (s^2 + 2 zeta w s + w^2)``, of which steady loads come out unchanged; for
    velocities (order 1) and accelerations (order 2) of a unit mass it is ``s^order`` over the same. It is brought to
    discrete time by the bilinear transform with its frequency preserved: steps below 5 ms, or the highest mode could
    not be represented.
    """
    shares = MODE_SHARE[axes]
    moved: FloatArray = (
        (1.0 - shares.sum(axis=1, keepdims=True)) * load if order == 0 else np.zeros_like(load)
    )
    for (frequency_hz, damping), share in zip(MODES, shares.T, strict=True):
        omega = 2.0 * math.pi * frequency_hz
        warp = omega / math.tan(0.5 * omega * step_s)
        zeros = [
            np.array([1.0, 2.0, 1.0]) * omega**2,
            np.array([1.0, 0.0, -1.0]) * warp,
            np.array([1.0, -2.0, 1.0]) * warp**2,
        ][order]
        poles = [
            warp**2 + 2.0 * damping * omega * warp + omega**2,
            2.0 * (omega**2 - warp**2),
            warp**2 - 2.0 * damping * omega * warp + omega**2,
        ]
        moved += share[:, np.newaxis] * lfilter(zeros, poles, load, axis=-1)
    return moved


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
                raise GranularIdError(f"{field} must hold {wanted}, got {getattr(self, field)!r:.60}")
        if isinstance(self.bits, bool) or not isinstance(self.bits, int) or not 2 <= self.bits <= 32:
            raise GranularIdError(f"bits must be a whole number from 2 to 32, got {self.bits!r:.60}")

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


# A sensor at rest.

# Ten rests of a Bota Rokubi on the carriage of a rover's test bed (robomechanics/3d-terramechanics): standard deviation
# of a reading, N and N m, root mean square of the ten.
NOISE_SD = np.array([0.080, 0.168, 0.052, 3.4e-3, 1.8e-3, 0.50e-3])
# Bending torques follow their forces: their sign, and the correlation with it.
COUPLED = {3: (1, 0.94), 4: (0, -0.94)}
# New values a second: messages in between repeat the last one, all axes together.
READING_HZ = 12.28
# Below this the spectrum rises as 1 / f^2: the zero wanders; not beyond periods of this length.
WANDER_HZ = 0.15
LONGEST_S = 20.0


def rest_noise(n_samples: int, rate_hz: float, *, seed: int | np.random.SeedSequence = 0) -> FloatArray:
    """Draw what a sensor at rest reads around its zero, (n_samples, 6): readings that are held, a zero that wanders.

    Samples are no independent values: the mean of 1 s is three times as uncertain as ``sd / sqrt(n)`` says at 100 Hz.
    """
    n = whole_number("n_samples", n_samples)
    rate = sampling_rate("rate_hz", rate_hz)
    rng = np.random.default_rng(random_stream(seed, 4))
    reading = np.floor(rng.random() + np.arange(n) * (READING_HZ / rate)).astype(np.intp)
    n_readings = int(reading[-1]) + 1
    # Twice, as what is drawn by frequencies repeats itself.
    n_drawn = max(2 * n_readings, round(2 * LONGEST_S * READING_HZ))
    frequency = np.fft.rfftfreq(n_drawn, 1.0 / READING_HZ)
    gain: FloatArray = np.sqrt(1.0 + (WANDER_HZ / np.maximum(frequency, 1.0 / LONGEST_S)) ** 2)
    gain[0] = 0.0
    gain *= np.sqrt(n_drawn / (gain**2).sum() / 2.0)
    white = np.fft.rfft(rng.standard_normal((n_drawn, 6)), axis=0)
    readings: FloatArray = np.fft.irfft(white * gain[:, np.newaxis], n_drawn, axis=0)[:n_readings]
    for torque, (force, share) in COUPLED.items():
        readings[:, torque] = share * readings[:, force] + np.sqrt(1.0 - share**2) * readings[:, torque]
    noise: FloatArray = (readings * NOISE_SD)[reading]
    return noise

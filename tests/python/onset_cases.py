"""Signals with a known onset, shared by the tests of onset detection."""

import numpy as np

RATE_HZ, START = 500.0, 90
# Noise of an ATI Mini45, N and N m.
NOISE = np.array([0.020, 0.019, 0.050, 0.53e-3, 0.53e-3, 0.50e-3])


def noise(seed=0, n_samples=1600):
    return np.random.default_rng(seed).normal(0, NOISE, (n_samples, 6))


def push(seed=0, start=START, n_samples=1600, course="ramp", rate_hz=RATE_HZ):
    """Noise, and from `start` on a load on fx, fz and (by a lever of 0.1 m) ty."""
    time_s = np.maximum(np.arange(n_samples) - start, 0) / rate_hz
    shape = {
        "jump": (np.arange(n_samples) >= start) * 1.0,
        "ramp": np.minimum(time_s / 0.1, 1.0),
        "bend": np.minimum((time_s / 0.1) ** 2, 1.0),
    }[course]
    return noise(seed, n_samples) + shape[:, None] * np.array([3.0, 0, 1.5, 0, 0.3, 0])

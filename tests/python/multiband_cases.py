"""Recordings of two materials that differ in one planted way."""

import numpy as np
from scipy.signal import butter, sosfilt

from granular_id.recording import Dataset, Recording

RATE_HZ = 500.0
ALL = ("coupling", "quantiles", "envelope", "spectrum", "level")


def band_noise(random, low_hz, high_hz, shape):
    """Noise of one band, of RMS 1."""
    sos = butter(4, [low_hz, high_hz], "bandpass", fs=RATE_HZ, output="sos")
    noise = sosfilt(sos, random.normal(size=shape), axis=1)
    return noise / np.sqrt(np.mean(noise**2))


def two_materials(n_each=12, n_samples=512, n_axes=6):
    """The same noise for both; `y` says oat, rice, oat, rice ..."""
    random = np.random.default_rng(0)
    y = np.tile(["oat", "rice"], n_each)
    return random.normal(scale=0.1, size=(2 * n_each, n_samples, n_axes)), y, random


def as_wrench(X):
    """The same as recordings of a wrench, whose axes have names."""
    return Dataset([Recording(one, RATE_HZ) for one in X])


def louder():
    """More energy on fz in 15-31 Hz in rice."""
    X, y, random = two_materials()
    X[y == "rice", :, 2] += 0.2 * band_noise(random, 16, 30, (12, 512))
    return X, y

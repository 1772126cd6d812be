"""Recordings of materials that differ in level and roughness, to be explained."""

import numpy as np

LABELS = ("oat", "peas", "rice")


def recordings(labels=LABELS, n_each=12, n_samples=400, seed=0):
    """Noise around offsets and vibrations that depend on the material."""
    random = np.random.default_rng(seed)
    y = np.repeat(np.array(labels), n_each)
    X = random.normal(scale=0.1, size=(len(y), n_samples, 6))
    for k, label in enumerate(labels):
        X[y == label] *= 1 + 0.5 * k
        X[y == label, :, k] += 0.3
    return X, y

"""Classes that overlap, and a coding of one's own."""

import numpy as np

MATRIX = np.array([[1, 1, 0], [-1, 0, 1], [0, -1, 1], [1, -1, -1]])
"""A coding of four classes."""


def blobs(n_classes=4, per_class=25, n_features=8, distance=1.0, seed=0):
    """Rows of as many classes in random order; another seed draws other rows of the same classes."""
    rng = np.random.default_rng(seed)
    y = rng.permutation(np.repeat(np.arange(n_classes), per_class))
    centres = distance * np.random.default_rng(99).standard_normal((n_classes, n_features))
    return rng.standard_normal((len(y), n_features)) + centres[y], y

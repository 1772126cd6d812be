"""Scores in the order of addition that a model file promises, written out in plain numpy."""

from __future__ import annotations

import numpy as np

from granular_id.features import extract_features


def scores(model, wrench):
    """Return scores (n, L) of recordings (n, T, C); one multiplication and one addition at a time."""
    coef, spec = model.coef, model.spec
    n, n_samples, n_axes = wrench.shape
    raw = np.zeros((n, len(coef)))
    if spec.raw:
        for t in range(n_samples):
            for axis in range(n_axes):
                raw += coef[:, axis * n_samples + t] * wrench[:, t, axis, None]
    hist = np.zeros_like(raw)
    if spec.hfmh:
        n_hist = n_axes * spec.n_bins
        counts = extract_features(wrench, spec=spec)[:, -n_hist:]
        weights = coef[:, -n_hist:]
        for j in range(n_hist):
            seen = counts[:, j] != 0.0
            hist[seen] += weights[:, j] * counts[seen, j, None]
    return (model.intercept + raw) + hist


def bits(values):
    return np.ascontiguousarray(values, dtype=np.float64).view(np.uint64)

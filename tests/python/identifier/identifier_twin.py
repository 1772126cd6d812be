"""Provisional answers of a model in plain numpy, from its definition: what the streaming identification must give."""

import numpy as np

import granular_id as gid


def provisional_scores(core, wrench, n_seen):
    """Scores (L,) after some samples: unseen raw samples at their mean, counts scaled up to the whole length."""
    spec, n = core.spec, core.n_samples
    blocks = []
    if spec.raw:
        raw = (
            np.zeros((core.n_axes, n))
            if core.raw_mean is None
            else core.raw_mean.reshape(core.n_axes, n).copy()
        )
        raw[:, :n_seen] = wrench[:n_seen].T
        blocks.append(raw.ravel())
    if spec.hfmh:
        keywords = {**spec.__getnewargs_ex__()[1], "raw": False}
        counts = gid.extract_features(wrench[:n_seen], **keywords)
        blocks.append(counts if spec.density else counts * n / n_seen)
    return core.intercept + core.coef @ np.concatenate(blocks)


def hinge_losses(core, scores):
    """Mean hinge loss (K,) of the classes, loss-weighted."""
    codes = core.coding_matrix.astype(float)
    losses = np.maximum(0.0, 1.0 - codes * scores) / 2.0 * np.abs(codes)
    return losses.sum(axis=1) / np.abs(codes).sum(axis=1)

"""Answers over a recording, made without a model."""

import numpy as np

from granular_id.identifier import Timeline


def timeline(losses, classes, **fields):
    """One answer a second, each about two seconds."""
    n = len(losses)
    usual = {
        "name": "drive",
        "classes": tuple(classes),
        "times_s": 2.0 + np.arange(n),
        "losses": np.asarray(losses),
        "probabilities": None,
        "candidates": ((),) * n,
        "unknown": None,
        "flagged": np.zeros(n, bool),
        "trained_on": None,
        "window_s": 2.0,
        "hop_s": 1.0,
        "duration_s": 1.0 + n,
    }
    return Timeline(**{**usual, **fields})

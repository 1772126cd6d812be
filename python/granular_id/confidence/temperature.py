"""Probabilities from class values: a softmax with one temperature."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_LOG_RANGE = 12.0  # temperatures from e^-12 to e^12 of the spread of the values
_LEAST = 1e-300  # a probability of 0 for what happened would make the loss infinite


def softmax(values: npt.ArrayLike, temperature: float) -> FloatArray:
    """Probabilities (..., K) of class values (..., K), larger for what is likelier."""
    scaled = np.asarray(values, dtype=np.float64) / temperature
    shares = np.exp(scaled - scaled.max(axis=-1, keepdims=True))
    found: FloatArray = shares / shares.sum(axis=-1, keepdims=True)
    return found


def fit_temperature(
    values: FloatArray, truth: npt.NDArray[np.intp], sessions: npt.NDArray[np.intp] | None = None
) -> float:
    """Return the temperature that makes held-out class values (n, K) the likeliest, each session weighing alike.

    Sessions (n,) are numbers from 0 on.

    One recording in n + 2 counts as of another material, as in Platt's scaling: n right answers do not make the next
    one certain.

    Sources: Guo, Pleiss, Sun, Weinberger, "On calibration of modern neural networks" (ICML 2017), section 4.2; Platt,
    "Probabilistic outputs for support vector machines" (1999), section 2.2.
    """
    from scipy.optimize import minimize_scalar  # slow to import, and a model that is read does without

    weights = np.full(len(truth), 1 / len(truth))
    if sessions is not None:
        n_of = np.bincount(sessions)
        weights = 1 / (np.count_nonzero(n_of) * n_of[sessions])
    known = np.isfinite(values)
    spread = float(values[known].std()) or 1.0
    others = known.copy()
    others[np.arange(len(truth)), truth] = False
    wanted = others / ((len(truth) + 2) * np.maximum(others.sum(axis=1, keepdims=True), 1))
    wanted[np.arange(len(truth)), truth] = 1 - wanted.sum(axis=1)

    def loss(log_temperature: float) -> float:
        shares = softmax(values, spread * math.exp(log_temperature))
        return -float(weights @ (wanted * np.log(np.maximum(shares, _LEAST))).sum(axis=1))

    found = minimize_scalar(loss, bounds=(-_LOG_RANGE, _LOG_RANGE), method="bounded")
    return spread * math.exp(float(found.x))

"""From the score of a learner to a probability: Platt's sigmoid.

Sources: Platt (1999), "Probabilistic outputs for support vector machines" (sigmoid, softened targets); Lin, Lin, Weng
(2007), "A note on Platt's probabilistic outputs for support vector machines", Machine Learning 68:267-276 (Newton's
method with a line search, forms that do not overflow).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import expit

__all__ = ["fit_sigmoid", "sigmoid"]

FloatArray = npt.NDArray[np.float64]

_MAX_STEPS = 100
_GRADIENT_TOLERANCE = 1e-9  # relative to the sum of weights
_RIDGE = 1e-12
_SMALLEST_STEP = 1e-10
_ENOUGH_DESCENT = 1e-4


def sigmoid(scores: FloatArray, slope: FloatArray, offset: FloatArray) -> FloatArray:
    """Probability 1 / (1 + exp(slope * score + offset)) of the code +1; shapes that broadcast."""
    probability: FloatArray = expit(-(slope * scores + offset))
    return probability


def fit_sigmoid(scores: FloatArray, targets: FloatArray, weights: FloatArray | None) -> tuple[float, float]:
    """Fit the sigmoid of one learner by maximum likelihood.

    Parameters
    ----------
    scores : ndarray, shape (n,)
        Of rows that the learner was not trained on.
    targets : ndarray, shape (n,)
        +1.0 or -1.0, both present. They are softened to (N+ + 1) / (N+ + 2) and 1 / (N- + 2), as in Platt's paper,
        so that scores that separate the sides do not give certainty.
    weights : ndarray, shape (n,), or None
        Positive; a whole number equals as many repetitions.

    Returns
    -------
    slope, offset : float
        Of `sigmoid`; the slope is negative where a higher score speaks for +1.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.ecoc.sigmoid import fit_sigmoid, sigmoid
    >>> slope, offset = fit_sigmoid(np.array([-1.0, -0.5, 0.5, 1.0]), np.array([-1.0, -1.0, 1.0, 1.0]), None)
    >>> sigmoid(np.array([-1.0, 0.0, 1.0]), slope, offset).round(3)
    array([0.206, 0.5  , 0.794])
    """
    counts = np.ones(len(scores)) if weights is None else weights
    positive = targets > 0
    n_positive, n_negative = float(counts[positive].sum()), float(counts[~positive].sum())
    wanted = np.where(positive, (n_positive + 1.0) / (n_positive + 2.0), 1.0 / (n_negative + 2.0))
    unit = float(np.abs(scores).max()) or 1.0  # scores of any size, one ridge and one tolerance
    features = np.stack((scores / unit, np.ones(len(scores))))
    point = np.array([0.0, np.log((n_negative + 1.0) / (n_positive + 1.0))])
    cost = _cost(point @ features, wanted, counts)
    for _ in range(_MAX_STEPS):
        probability = expit(-(point @ features))
        gradient = features @ (counts * (wanted - probability))
        if np.abs(gradient).max() <= _GRADIENT_TOLERANCE * counts.sum():
            break
        hessian = (features * (counts * probability * (1.0 - probability))) @ features.T + _RIDGE * np.eye(2)
        direction = -np.linalg.solve(hessian, gradient)
        slope_along = float(gradient @ direction)
        step = 1.0
        while step >= _SMALLEST_STEP:
            moved = point + step * direction
            moved_cost = _cost(moved @ features, wanted, counts)
            if moved_cost < cost + _ENOUGH_DESCENT * step * slope_along:
                point, cost = moved, moved_cost
                break
            step /= 2.0
        else:
            break  # no lower cost in floating point: this is the minimum
    return float(point[0]) / unit, float(point[1])


def _cost(exponent: FloatArray, wanted: FloatArray, counts: FloatArray) -> float:
    """Negative log-likelihood; `wanted` is the target for 1 / (1 + exp(exponent))."""
    losses = wanted * np.logaddexp(0.0, exponent) + (1.0 - wanted) * np.logaddexp(0.0, -exponent)
    return float(counts @ losses)

"""Weights of a linear classifier behind scaling, whitening or components, turned into weights for plain features."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.decomposition import PCA
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted

from granular_id.rica import RICA
from granular_id.spaces.base import real_steps
from granular_id.spaces.components import PrincipalComponents
from granular_id.spaces.scaling import BlockScaler
from granular_id.spaces.whitening import WithinClassWhitening

__all__ = ["LINEAR_STEPS", "folded_back", "folded_weights", "is_linear_step"]

FloatArray = npt.NDArray[np.float64]

LINEAR_STEPS = (PrincipalComponents, RICA, PCA, StandardScaler, BlockScaler, WithinClassWhitening)
"""Steps of the form ``L (x - mean)``: what stands behind them can be folded back."""


def folded_weights(pipeline: Pipeline) -> tuple[FloatArray, FloatArray]:
    """Weights and intercepts of a fitted pipeline's linear learners, on the features before any linear step.

    Parameters
    ----------
    pipeline : Pipeline
        Fitted. Whatever comes first gives the features, for instance `MultiBand`; then any of `LINEAR_STEPS`; last
        a classifier with ``coef_`` (L, D') and ``intercept_`` (L,).

    Returns
    -------
    coef : ndarray, shape (L, D)
    intercept : ndarray, shape (L,)
        A score is ``coef @ features + intercept``.

    Raises
    ------
    TypeError
        No pipeline, or no linear classifier at its end.
    NotFittedError

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.pipeline import make_pipeline
    >>> from granular_id import BlockScaler, ECOCClassifier, RawSignal
    >>> X = np.random.default_rng(0).normal(size=(20, 30, 6))
    >>> model = make_pipeline(RawSignal(), BlockScaler(), ECOCClassifier()).fit(X, np.arange(20) % 2)
    >>> coef, intercept = folded_weights(model)
    >>> scores = RawSignal().fit_transform(X) @ coef.T + intercept
    >>> np.allclose(scores, model[-1].binary_scores(model[:-1].transform(X)))
    True
    """
    steps = real_steps(pipeline) if isinstance(pipeline, Pipeline) else []
    if not steps:
        raise TypeError(f"pipeline must be a Pipeline with steps in it, got {type(pipeline).__name__}")
    classifier = steps.pop()
    check_is_fitted(classifier)
    if getattr(classifier, "coef_", None) is None or getattr(classifier, "intercept_", None) is None:
        raise TypeError(f"pipeline must end in a linear classifier, {classifier} has no coef_ and intercept_")
    after: list[Any] = []
    while steps and is_linear_step(steps[-1]):
        after.insert(0, steps.pop())
    return folded_back(after, classifier.coef_, classifier.intercept_)


def folded_back(
    steps: Sequence[Any], weights: npt.ArrayLike, intercept: npt.ArrayLike = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Turn weights of the output of linear steps into weights of their input.

    Parameters
    ----------
    steps : sequence of fitted `LINEAR_STEPS`
        In the order in which they transform.
    weights : array-like, shape (L, D') or (D',)
    intercept : array-like, shape (L,) or ()

    Returns
    -------
    weights : ndarray, shape (L, D) or (D,)
    intercept : ndarray, shape (L,) or ()
    """
    folded, constant = np.asarray(weights, dtype=np.float64), np.asarray(intercept, dtype=np.float64)
    for step in reversed(steps):
        folded = _back(step, folded)
        mean = getattr(step, "mean_", None)
        if mean is not None and getattr(step, "with_mean", True):
            constant = constant - folded @ mean
    return folded, constant


def is_linear_step(step: Any) -> bool:
    """Whether a step can be folded back."""
    return isinstance(step, LINEAR_STEPS)


def _back(step: Any, weights: FloatArray) -> FloatArray:
    if isinstance(step, WithinClassWhitening):  # symmetric: (A x) w = x (A w)
        rows: FloatArray = step.transform(np.atleast_2d(weights))
        return rows.reshape(weights.shape)
    if isinstance(step, BlockScaler):
        scaled: FloatArray = weights * step.factor_
        return scaled
    if isinstance(step, StandardScaler):
        return weights if step.scale_ is None else weights / step.scale_
    if isinstance(step, PCA) and step.whiten:
        # As PCA.transform does it: a component without variance is not blown up.
        scale = np.sqrt(step.explained_variance_)
        smallest = np.finfo(scale.dtype).eps
        weights = weights / np.where(scale < smallest, smallest, scale)
    passed: FloatArray = weights @ step.components_
    if isinstance(step, RICA) and step.scale_ is not None:
        passed = passed / step.scale_
    return passed

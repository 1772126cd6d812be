"""Where a linear model looks: the size of its weights over time, axis and bin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone

from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.thinning import rounded, thinned
from granular_id.gram import linear_gram
from granular_id.spaces import feature_blocks

__all__ = ["WeightBlock", "weight_blocks"]

Floats = NDArray[np.float64]

# Learners whose weight vectors are held at once: K = 200 classes have 19,900 of them, a gigabyte and more.
_LEARNERS_AT_ONCE = 64


@dataclass(frozen=True, eq=False)
class WeightBlock:
    """Weights of one block of features, for instance all samples or all bins.

    Parameters
    ----------
    name : str
        ``"raw"``, ``"hfmh"``, ...
    kind : str
        ``"time"``, ``"magnitude"`` or ``"frequency"``: what `coordinates` mean.
    axes : tuple of str
        Which of fx fy fz tx ty tz, in the order of the rows below.
    unit : str
        Unit of `coordinates`.
    coordinates : (m,) float array
        Seconds, bin centres or hertz.
    weights : (n_axes, m) float array
        Mean of the size of the weight over the binary learners, in one over the unit of the feature.
    influence : (n_axes, m) float array
        Mean over the learners of the size of the weight times the standard deviation of the feature, each
        learner's values divided by their sum over all features. Weights for newtons and for counts cannot be
        compared; their influence can.
    shares : (n_axes,) float array
        Sum of the influence over each axis. All blocks together sum to 1.
    """

    name: str
    kind: str
    axes: tuple[str, ...]
    unit: str
    coordinates: Floats
    weights: Floats
    influence: Floats
    shares: Floats

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and text."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()
        } | {"axes": list(self.axes)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> WeightBlock:
        """Make a block from what `to_dict` gave."""
        arrays = ("coordinates", "weights", "influence", "shares")
        plain = dict(values) | {"axes": tuple(values["axes"])}
        return cls(**plain | {name: np.array(values[name], dtype=np.float64) for name in arrays})


def weight_blocks(
    X: Floats, y: NDArray[Any], fitted: Any, classifier: BaseEstimator | None = None
) -> tuple[WeightBlock, ...]:
    """Fit one linear model on all recordings and measure its weights.

    A picture of the model, not a measure of its quality: nothing is held out.

    Parameters
    ----------
    X : (n, T, C) float array
        Recordings, N and N m.
    y : (n,) array
        Labels.
    fitted : transformer
        Feature space, fitted on these recordings.
    classifier : estimator, optional
        An `ECOCClassifier` lends its coding and C. Default, and for any other or one that needs more than
        scalar products: ``ECOCClassifier()``. Not changed.

    Returns
    -------
    tuple of WeightBlock
        At most `granular_id.evaluation.thinning.POINTS` coordinates each.

    Raises
    ------
    TypeError
        The features have no link to instants, bins or frequencies, as principal components have none.

    Examples
    --------
    >>> from granular_id import RawSignal
    >>> X = np.zeros((4, 3, 6))
    >>> X[2:, 1, 0] = 1.0  # the classes differ in Fx, in the second of three samples
    >>> (raw,) = weight_blocks(X, np.array(["a", "a", "b", "b"]), RawSignal().fit(X))
    >>> raw.axes[raw.shares.argmax()], raw.influence[0].tolist()
    ('fx', [0.0, 1.0, 0.0])
    """
    blocks = feature_blocks(fitted)
    features = np.asarray(fitted.transform(X), dtype=np.float64)
    usable = isinstance(classifier, ECOCClassifier) and classifier.supports_gram
    model = clone(classifier) if usable else ECOCClassifier()
    model.fit_gram(linear_gram(features, center=features.mean(axis=0)), y)
    size, influence = _sizes(model.dual_coef_, features)
    return tuple(_block(block, size[block.columns], influence[block.columns]) for block in blocks)


def _sizes(dual: Floats, features: Floats) -> tuple[Floats, Floats]:
    """Mean over learners of the size of each weight, and of its share in the learner's decision."""
    spread = features.std(axis=0)
    size, influence = np.zeros(features.shape[1]), np.zeros(features.shape[1])
    for start in range(0, len(dual), _LEARNERS_AT_ONCE):
        weights = np.abs(dual[start : start + _LEARNERS_AT_ONCE] @ features)
        size += weights.sum(axis=0)
        weights *= spread
        total = weights.sum(axis=1, keepdims=True)
        influence += np.divide(weights, total, out=np.zeros_like(weights), where=total > 0).sum(axis=0)
    return size / len(dual), influence / len(dual)


def _block(block: Any, size: Floats, influence: Floats) -> WeightBlock:
    shape = (len(block.axes), len(block.coordinates))
    return WeightBlock(
        name=block.name,
        kind=block.kind,
        axes=tuple(block.axes),
        unit=block.unit,
        coordinates=rounded(thinned(np.asarray(block.coordinates, dtype=np.float64))),
        weights=rounded(thinned(size.reshape(shape))),
        influence=rounded(thinned(influence.reshape(shape))),
        shares=rounded(influence.reshape(shape).sum(axis=1)),
    )

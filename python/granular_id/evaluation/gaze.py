"""Where a linear model looks: the size of its weights over time, axis, bin and band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler

from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.band_gaze import band_weights
from granular_id.evaluation.thinning import rounded, thinned
from granular_id.gram import linear_gram
from granular_id.spaces import BlockScaler, WithinClassWhitening, feature_blocks
from granular_id.spaces.band_columns import band_columns
from granular_id.spaces.base import real_steps
from granular_id.spaces.folding import folded_back

__all__ = ["WeightBlock", "can_look", "weight_blocks"]

Floats = NDArray[np.float64]

# Learners whose weight vectors are held at once: K = 200 classes have 19,900 of them, a gigabyte and more.
_LEARNERS_AT_ONCE = 64
# What keeps each column in its place, so that a picture of the columns is one of the recording.
_SCALING = (BlockScaler, WithinClassWhitening, StandardScaler)


@dataclass(frozen=True, eq=False)
class WeightBlock:
    """Weights of one block of features, for instance all samples or all bins.

    Parameters
    ----------
    name : str
        ``"raw"``, ``"hfmh"``, ...
    kind : str
        ``"time"``, ``"magnitude"``, ``"frequency"`` or ``"band"``: what `coordinates` mean.
    axes : tuple of str
        Which of fx fy fz tx ty tz, in the order of the rows below.
    unit : str
        Unit of `coordinates`.
    coordinates : (m,) float array
        Seconds, bin centres or hertz. Of a band its geometric middle, and 0 for the whole signal; octaves reach
        half an octave down and up from there.
    weights : (n_axes, m) float array
        Mean of the size of the weight over the binary learners, in one over the unit of the feature; of a band also
        over the features that the block has of it.
    influence : (n_axes, m) float array
        Mean over the learners of the size of the weight times the standard deviation of the feature, each
        learner's values divided by their sum over all features. Weights for newtons and for counts cannot be
        compared; their influence can. Of a band the sum over the features of the block, those of two axes half
        for each.
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
    """Measure the weights of one linear model of all recordings.

    A picture of the model, not a measure of its quality: nothing is held out.

    Parameters
    ----------
    X : (n, T, C) float array
        Recordings, N and N m.
    y : (n,) array
        Labels.
    fitted : transformer
        Feature space, fitted on these recordings; a pipeline may scale or whiten its columns. Those of a multi-band
        space are scaled with `BlockScaler` where nothing else does.
    classifier : estimator, optional
        One that was fitted on these features, with their weights in `coef_` (L, D), is looked at itself. One that
        was not is not changed: an `ECOCClassifier` lends its coding and C. Default, and for any other or one that
        needs more than scalar products: ``ECOCClassifier()``.

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
    space, scaling = _parted(fitted)
    bands = band_columns(space)
    blocks = feature_blocks(space) if bands is None else ()
    plain = np.asarray(space.transform(X), dtype=np.float64)
    is_fitted = hasattr(classifier, "coef_")
    if bands is not None and not scaling and not is_fitted:
        # The blocks of the multi-band space have no common unit: no linear model is trained on them as they are.
        scaling = [BlockScaler([bands.of(block=block).size for block in bands.blocks]).fit(plain)]
    features = plain
    for step in scaling:
        features = step.transform(features)
    weights = classifier.coef_ if is_fitted else _dual_coef(features, y, classifier)  # type: ignore[union-attr]
    size, influence = _sizes(weights, None if is_fitted else features, scaling, plain.std(axis=0))
    if bands is None:
        return tuple(_block(block, size[block.columns], influence[block.columns]) for block in blocks)
    return tuple(
        _rounded(name, kind, bands.axes, "s" if kind == "time" else "Hz", *arrays)
        for name, kind, *arrays in band_weights(bands, size, influence)
    )


def can_look(fitted: Any) -> bool:
    """Whether the features of a fitted space can be followed back to the recording, as `weight_blocks` must."""
    space, _ = _parted(fitted)
    try:
        return band_columns(space) is not None or bool(feature_blocks(space))
    except TypeError:
        return False


def _parted(fitted: Any) -> tuple[Any, list[Any]]:
    """Split a feature space into what gives columns with a meaning, and what scales them."""
    steps = real_steps(fitted) if isinstance(fitted, Pipeline) else [fitted]
    scaling: list[Any] = []
    while len(steps) > 1 and isinstance(steps[-1], _SCALING):
        scaling.insert(0, steps.pop())
    if not scaling:
        return fitted, []
    return Pipeline([(f"step{number}", step) for number, step in enumerate(steps)]), scaling


def _dual_coef(features: Floats, y: NDArray[Any], classifier: Any) -> Floats:
    """Weight of each row in each learner of a linear model of features."""
    usable = isinstance(classifier, ECOCClassifier) and classifier.supports_gram
    model = clone(classifier) if usable else ECOCClassifier()
    dual: Floats = model.fit_gram(linear_gram(features, center=features.mean(axis=0)), y).dual_coef_
    return dual


def _sizes(
    learners: Floats, rows: Floats | None, scaling: list[Any], spread: Floats
) -> tuple[Floats, Floats]:
    """Mean over learners of the size of each weight, and of its share in the learner's decision.

    `learners` hold weights of scaled features or, where `rows` of them are given, of rows.
    """
    size, influence = np.zeros(len(spread)), np.zeros(len(spread))
    for start in range(0, len(learners), _LEARNERS_AT_ONCE):
        some = learners[start : start + _LEARNERS_AT_ONCE]
        folded, _ = folded_back(scaling, some if rows is None else some @ rows)
        weights = np.abs(folded)
        size += weights.sum(axis=0)
        weights *= spread
        total = weights.sum(axis=1, keepdims=True)
        influence += np.divide(weights, total, out=np.zeros_like(weights), where=total > 0).sum(axis=0)
    return size / len(learners), influence / len(learners)


def _block(block: Any, size: Floats, influence: Floats) -> WeightBlock:
    shape = (len(block.axes), len(block.coordinates))
    coordinates = np.asarray(block.coordinates, dtype=np.float64)
    size, influence = size.reshape(shape), influence.reshape(shape)
    return _rounded(block.name, block.kind, block.axes, block.unit, coordinates, size, influence)


def _rounded(
    name: str, kind: str, axes: Sequence[str], unit: str, coordinates: Floats, size: Floats, influence: Floats
) -> WeightBlock:
    return WeightBlock(
        name=name,
        kind=kind,
        axes=tuple(axes),
        unit=unit,
        coordinates=rounded(thinned(coordinates)),
        weights=rounded(thinned(size)),
        influence=rounded(thinned(influence)),
        shares=rounded(influence.sum(axis=1)),
    )

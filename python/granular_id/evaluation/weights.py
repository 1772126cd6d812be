"""Feature importance: the weights of one linear model, over time, bins, frequencies or bands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler

from granular_id._estimators import real_steps
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.features import by_columns, features_of
from granular_id.gram import linear_gram
from granular_id.spaces import (
    BandColumns,
    BlockScaler,
    WithinClassWhitening,
    band_columns,
    feature_blocks,
    folded_back,
)

Floats = NDArray[np.float64]

POINTS = 200
"""Most points a curve keeps: a panel is a few hundred pixels wide."""

DIGITS = 5
"""Significant digits kept, more than a figure shows: a result of 20 classes stays below a few megabytes."""

_LEARNERS_AT_ONCE = 64  # K = 200 classes have 19,900 of them, whose weights together take a gigabyte and more
_SCALING = (BlockScaler, WithinClassWhitening, StandardScaler)  # steps that keep each column in its place


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
        Axes, in the order of the rows below.
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


def is_traceable(fitted: Any) -> bool:
    """Whether the features of a fitted space belong to instants, bins, frequencies or bands."""
    space, _ = _without_scaling(fitted)
    try:
        return band_columns(space) is not None or bool(feature_blocks(space))
    except TypeError:
        return False


def weight_blocks(X: Floats, y: NDArray[Any], fitted: Any, classifier: Any = None) -> tuple[WeightBlock, ...]:
    """Measure the weights of one linear model of all recordings (n, T, C).

    A picture of the model, not a measure of its quality: nothing is held out. `fitted` is a feature space for which
    `is_traceable` holds, fitted on these recordings. A `classifier` that was trained on its features and has their
    weights in `coef_` (L, D) is the model; any other lends its coding and C where it is an `ECOCClassifier` that
    works on scalar products, and is replaced by ``ECOCClassifier()`` where not.
    """
    space, scaling = _without_scaling(fitted)
    bands = band_columns(space)
    blocks = feature_blocks(space) if bands is None else ()
    plain = features_of(type(space).__name__, space, X)
    is_trained = hasattr(classifier, "coef_")
    if bands is not None and not scaling and not is_trained:
        # The blocks of the multi-band space have no common unit: no linear model is trained on them as they are.
        scaling = [BlockScaler([bands.of(block=block).size for block in bands.blocks]).fit(plain)]
    if is_trained:
        learners, rows = classifier.coef_, None
    else:
        rows = plain
        for step in scaling:
            rows = step.transform(rows)
        model = clone(classifier) if isinstance(classifier, ECOCClassifier) else ECOCClassifier()
        learners = model.fit_gram(linear_gram(rows, center=rows.mean(axis=0)), y).dual_coef_
    size, influence = _mean_sizes(learners, rows, scaling, by_columns(np.std, plain))
    if bands is not None:
        return tuple(_over_bands(bands, size, influence))
    return tuple(_along(block, size, influence) for block in blocks)


def _without_scaling(fitted: Any) -> tuple[Any, list[Any]]:
    """Split a feature space into what gives columns with a meaning, and the steps that scale them."""
    steps = real_steps(fitted) if isinstance(fitted, Pipeline) else [fitted]
    scaling: list[Any] = []
    while len(steps) > 1 and isinstance(steps[-1], _SCALING):
        scaling.insert(0, steps.pop())
    if not scaling:
        return fitted, []
    return Pipeline([(f"step{number}", step) for number, step in enumerate(steps)]), scaling


def _mean_sizes(
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


def _along(block: Any, size: Floats, influence: Floats) -> WeightBlock:
    """Gather a `FeatureBlock`, whose columns follow one coordinate of each axis."""
    shape = (len(block.axes), len(block.coordinates))
    size, influence = size[block.columns].reshape(shape), influence[block.columns].reshape(shape)
    return _block(block.name, block.kind, block.axes, block.unit, block.coordinates, size, influence)


def _over_bands(columns: BandColumns, size: Floats, influence: Floats) -> Iterator[WeightBlock]:
    """Gather the blocks of a multi-band space: over bands, but spectrum and level over frequencies and instants.

    The whole signal comes first, at 0 Hz, then the bands from the lowest. A band too short for a block has zeros.
    """
    along = {block.name: block for block in columns.read_along()}
    order = [0, *range(len(columns.bands) - 1, 0, -1)]
    middles = [np.sqrt(columns.bands[k].low_hz * columns.bands[k].high_hz) for k in order[1:]]
    by_axis = [columns.over_axes(values) for values in (size, np.ones(len(size)), influence)]
    for name in columns.blocks:
        if name in along:
            yield _along(along[name], size, influence)
            continue
        cells = [columns.of(block=name, band=band) for band in order]
        sizes, counts, shares = (
            np.stack([values[cell].sum(axis=0) for cell in cells], axis=1) for values in by_axis
        )
        weights = np.divide(sizes, counts, out=np.zeros_like(sizes), where=counts > 0)
        yield _block(name, "band", columns.axes, "Hz", np.array([0.0, *middles]), weights, shares)


def _block(
    name: str, kind: str, axes: Sequence[str], unit: str, coordinates: Floats, size: Floats, influence: Floats
) -> WeightBlock:
    return WeightBlock(
        name=name,
        kind=kind,
        axes=tuple(axes),
        unit=unit,
        coordinates=rounded(downsampled(np.asarray(coordinates, dtype=np.float64))),
        weights=rounded(downsampled(size)),
        influence=rounded(downsampled(influence)),
        shares=rounded(influence.sum(axis=1)),
    )


def window_starts(n: int, most: int = POINTS) -> NDArray[np.intp]:
    """First index of each of at most `most` adjoining windows over `n` points, as equal as can be."""
    return np.arange(min(n, most)) * n // min(n, most)


def downsampled(values: Floats, most: int = POINTS) -> Floats:
    """Mean over each of at most `most` windows along the last axis; shorter input is returned as it is."""
    n = values.shape[-1]
    starts = window_starts(n, most)
    means: Floats = np.add.reduceat(values, starts, axis=-1) / np.diff(starts, append=n)
    return means


def rounded(values: Floats, digits: int = DIGITS) -> Floats:
    """Round to significant digits."""
    return np.array([float(f"{value:.{digits}g}") for value in values.ravel().tolist()]).reshape(values.shape)

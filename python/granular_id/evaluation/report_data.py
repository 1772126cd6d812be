"""What a report draws beside accuracies: forces, residuals, histograms, and the weights of a linear model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler

from granular_id._core import AXES
from granular_id._estimators import describe_estimator, real_steps
from granular_id._parallel import single_threaded_blas
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.features import plan_for, seeded
from granular_id.gram import linear_gram
from granular_id.recording import Dataset
from granular_id.spaces import (
    HFMH,
    BandColumns,
    BlockScaler,
    Chosen,
    FeatureSpace,
    WithinClassWhitening,
    band_columns,
    block_sizes,
    feature_blocks,
    folded_back,
    tell_blocks,
)
from granular_id.splits import groups_of

Floats = NDArray[np.float64]

POINTS = 200
"""Most points a curve keeps: a panel is a few hundred pixels wide."""

DIGITS = 5
"""Significant digits kept, more than a figure shows: a result of 20 classes stays below a few megabytes."""

_WINDOWS = 40  # of the residual: 80 ms in the paper's 3.2 s, in which the tool moves a seventh of its width
_LEARNERS_AT_ONCE = 64  # K = 200 classes have 19,900 of them, whose weights together take a gigabyte and more
_SCALING = (BlockScaler, WithinClassWhitening, StandardScaler)  # steps that keep each column in its place


@dataclass(frozen=True, eq=False)
class HighPass:
    """What is left above the cut-off, per material and axis.

    Parameters
    ----------
    settings : mapping
        Class and parameters of the `HFMH` that was used.
    time_s : (W,) float array
        Middle of each time window, seconds from the first sample.
    residual : (K, C, W) float array
        Root mean square of the high-passed signal over a window and over the recordings, N and N m.
    bin_range : (C, 2) float array
        Lower edge of the first bin and upper edge of the last, N and N m.
    hfmh : (K, C, n_bins) float array
        Mean histogram over the recordings: counts, or densities where the settings say so.
    """

    settings: Mapping[str, Any]
    time_s: Floats
    residual: Floats
    bin_range: Floats
    hfmh: Floats

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> HighPass:
        """Make one from what `Portrait.to_dict` gave."""
        return cls(**_with_arrays(values, "time_s", "residual", "bin_range", "hfmh"))


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

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> WeightBlock:
        """Make one from what `Portrait.to_dict` gave."""
        found = _with_arrays(values, "coordinates", "weights", "influence", "shares")
        return cls(**found | {"axes": tuple(values["axes"])})


@dataclass(frozen=True, eq=False)
class Portrait:
    """How the recordings look, material by material, and what a linear model weighs.

    Numbers are rounded to five digits, and curves downsampled to at most
    `granular_id.evaluation.report_data.POINTS` points, each the mean over a window.

    Parameters
    ----------
    labels : tuple of K str
        Materials, in the order of the first axis of the arrays.
    counts : tuple of K int
        Recordings of each.
    n_synthetic : int
        How many recordings were simulated.
    axes : tuple of C str
        Axes, in the order of the second.
    rate_hz : float
        Sampling rate of the recordings.
    n_samples : int
        Samples of each recording.
    time_s : (P,) float array
        Seconds from the first sample.
    mean, sd : (K, C, P) float arrays
        Mean and standard deviation (divisor n) over the recordings of a material, N and N m.
    high_pass : HighPass or None
        None where the sampling rate is too low for the cut-off.
    looked_at : str or None
        Feature space of the model; None where the features of none belong to a time, axis and bin.
    weights : tuple of WeightBlock
        Of one linear model, fitted on all recordings in that space; nothing was held out.
    looked_with : str
        What that model chose, where it is of a classifier that chooses.
    """

    labels: tuple[str, ...]
    counts: tuple[int, ...]
    n_synthetic: int
    axes: tuple[str, ...]
    rate_hz: float
    n_samples: int
    time_s: Floats
    mean: Floats
    sd: Floats
    high_pass: HighPass | None
    looked_at: str | None
    weights: tuple[WeightBlock, ...]
    looked_with: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and text, ready for ``json.dumps``."""
        return {field.name: _plain(getattr(self, field.name)) for field in fields(self)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Portrait:
        """Make one from what `to_dict` gave; ``from_dict(p.to_dict())`` holds the same numbers as ``p``."""
        high_pass = values["high_pass"]
        return cls(
            **_with_arrays(values, "time_s", "mean", "sd")
            | {name: tuple(values[name]) for name in ("labels", "counts", "axes")}
            | {
                "high_pass": None if high_pass is None else HighPass.from_dict(high_pass),
                "weights": tuple(map(WeightBlock.from_dict, values["weights"])),
            }
        )


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [_plain(one) for one in value] if isinstance(value, tuple) else value


def _with_arrays(values: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {**values, **{name: np.array(values[name], dtype=np.float64) for name in names}}


def not_drawn(data: Dataset) -> list[str]:
    """Return one line on why a report does not draw the recordings; none where it does."""
    if data.axes == AXES:
        return []
    return [
        f"recordings and weights are not drawn: that is for the axes {' '.join(AXES)}, these have {' '.join(data.axes)}"
    ]


def portrait_of_result(
    data: Dataset,
    spaces: Sequence[FeatureSpace],
    accuracies: Mapping[str, float],
    classifier: BaseEstimator,
    seed: int,
    has_weights: Mapping[str, bool],
) -> Portrait | None:
    """Gather the report data of an evaluation: weights in the most accurate space whose features are not mixed."""
    if not_drawn(data):
        return None
    best_first = sorted(spaces, key=lambda space: -accuracies[space.name])
    unmixed = {
        space.name: space.transformer
        for space in best_first
        if (plan := plan_for(space.transformer)) is None or not plan.after
    }
    model = clone(classifier)
    if isinstance(model, ECOCClassifier):
        # All recordings together may overlap where the training rows of no partition did.
        model.set_params(hard_margin=False)
    own = {
        space.name: seeded(space.classifier, seed) if has_weights[space.name] else None
        for space in spaces
        if space.classifier is not None
    }
    return portrait(data, unmixed, classifier=model, own=own)


def portrait(
    data: Dataset,
    spaces: Mapping[str, BaseEstimator],
    *,
    classifier: BaseEstimator | None = None,
    own: Mapping[str, BaseEstimator | None] | None = None,
) -> Portrait:
    """Gather what a report draws from recordings of equal length and rate.

    The first of `spaces` whose features belong to instants, bins, frequencies or bands gives the weights: those of
    `classifier` (see `weight_blocks`) or, where `own` has one for the space, of that, trained here; None there means
    that it has no weights. The first space that holds an `HFMH` says how to high-pass, else the paper's settings do.
    """
    X, y, rate_hz = data.X, data.y, data.rate_hz
    labels = np.unique(y)
    groups = [np.flatnonzero(y == label) for label in labels]
    mean, sd = (
        rounded(downsampled(np.stack([statistic(X[rows], axis=0).T for rows in groups])))
        for statistic in (np.mean, np.std)
    )
    looked_at, weights, looked_with = _weights(data, spaces, classifier, own or {})
    return Portrait(
        labels=tuple(labels.tolist()),
        counts=tuple(map(len, groups)),
        n_synthetic=sum(recording.is_synthetic for recording in data),
        axes=AXES,
        rate_hz=float(rate_hz),
        n_samples=X.shape[1],
        time_s=rounded(downsampled(np.arange(X.shape[1]) / rate_hz)),
        mean=mean,
        sd=sd,
        high_pass=_high_pass(X, groups, _histogram_of(spaces, rate_hz)),
        looked_at=looked_at,
        weights=weights,
        looked_with=looked_with,
    )


def _histogram_of(spaces: Mapping[str, BaseEstimator], rate_hz: float) -> HFMH | None:
    """Return the first histogram in use, else the paper's; None where the rate is too low for that."""
    for space in spaces.values():
        for part in (space, *space.get_params().values()):
            if isinstance(part, HFMH):
                # RawHFMH is one too and has more parameters; only its counts are wanted here.
                return HFMH(**{name: getattr(part, name) for name in HFMH().get_params()})
    papers = HFMH(rate_hz=rate_hz)
    return papers if papers.cutoff_hz < rate_hz / 2 else None


def _high_pass(X: Floats, groups: list[NDArray[np.intp]], histogram: HFMH | None) -> HighPass | None:
    if histogram is None:
        return None
    fitted = clone(histogram).fit(X)
    counts = fitted.transform(X).reshape(len(X), X.shape[2], -1)
    starts = window_starts(X.shape[1], _WINDOWS)
    sizes = np.diff(starts, append=X.shape[1])
    residual = np.empty((len(groups), X.shape[2], len(starts)))
    for axis in range(X.shape[2]):  # one at a time: a copy of one axis, not of all
        power = np.add.reduceat(histogram.high_passed(X[:, :, axis]) ** 2, starts, axis=1) / sizes
        for k, rows in enumerate(groups):
            residual[k, axis] = np.sqrt(power[rows].mean(axis=0))
    return HighPass(
        settings=describe_estimator(histogram),
        time_s=rounded((starts + (sizes - 1) / 2) / histogram.rate_hz),
        residual=rounded(residual),
        bin_range=np.array(fitted.bin_range_, dtype=np.float64),
        hfmh=rounded(np.stack([counts[rows].mean(axis=0) for rows in groups])),
    )


def _weights(
    data: Dataset,
    spaces: Mapping[str, BaseEstimator],
    classifier: BaseEstimator | None,
    own: Mapping[str, BaseEstimator | None],
) -> tuple[str | None, tuple[WeightBlock, ...], str]:
    """Return the space, the weights, and what a classifier of the space's own chose."""
    X, y = data.X, data.y
    for name, space in spaces.items():
        if name in own and own[name] is None:
            continue
        fitted = clone(space).fit(X, y)
        if not is_traceable(fitted):
            continue
        if name not in own:
            return name, weight_blocks(X, y, fitted, classifier), ""
        trained = clone(own[name])
        tell_blocks(trained, block_sizes(fitted))
        groups = groups_of(data).fit_arguments(trained, np.arange(len(data)))
        with single_threaded_blas():  # as the partitions do: bits must not depend on the number of threads
            trained.fit(fitted.transform(X), y, **groups)
        chosen = Chosen.of(trained)
        return name, weight_blocks(X, y, fitted, trained), "" if chosen is None else chosen.words
    return None, (), ""


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
    plain = np.asarray(space.transform(X), dtype=np.float64)
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
        usable = isinstance(classifier, ECOCClassifier) and classifier.supports_gram
        model = clone(classifier) if usable else ECOCClassifier()
        learners = model.fit_gram(linear_gram(rows, center=rows.mean(axis=0)), y).dual_coef_
    size, influence = _mean_sizes(learners, rows, scaling, plain.std(axis=0))
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

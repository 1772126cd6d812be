"""What a report draws that predictions alone do not tell: forces, residuals, histograms, weights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
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
from granular_id.gram import linear_gram
from granular_id.recording import Dataset
from granular_id.spaces import (
    HFMH,
    BandColumns,
    BlockScaler,
    Chosen,
    WithinClassWhitening,
    band_columns,
    block_sizes,
    feature_blocks,
    folded_back,
    tell_blocks,
)
from granular_id.splits import origins_of

Floats = NDArray[np.float64]

_WINDOWS = 40
"""Windows of the residual: 80 ms in the paper's 3.2 s, in which the tool moves a seventh of its width."""


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

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers and text."""
        arrays = {name: getattr(self, name).tolist() for name in ("time_s", "residual", "bin_range", "hfmh")}
        return {"settings": dict(self.settings), **arrays}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> HighPass:
        """Make one from what `to_dict` gave."""
        arrays = {name: _floats(values[name]) for name in ("time_s", "residual", "bin_range", "hfmh")}
        return cls(settings=dict(values["settings"]), **arrays)


@dataclass(frozen=True, eq=False)
class Portrait:
    """How the recordings look, material by material, and where a linear model looks.

    Numbers are rounded to five digits, and curves thinned to at most
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
        Feature space whose model was looked at; None where none of them keeps a link to time, axis and bin.
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
        return {
            "labels": list(self.labels),
            "counts": list(self.counts),
            "n_synthetic": self.n_synthetic,
            "axes": list(self.axes),
            "rate_hz": self.rate_hz,
            "n_samples": self.n_samples,
            "time_s": self.time_s.tolist(),
            "mean": self.mean.tolist(),
            "sd": self.sd.tolist(),
            "high_pass": None if self.high_pass is None else self.high_pass.to_dict(),
            "looked_at": self.looked_at,
            "weights": [block.to_dict() for block in self.weights],
            "looked_with": self.looked_with,
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Portrait:
        """Make one from what `to_dict` gave; ``from_dict(p.to_dict())`` holds the same numbers as ``p``."""
        high_pass = values["high_pass"]
        return cls(
            labels=tuple(values["labels"]),
            counts=tuple(values["counts"]),
            n_synthetic=int(values["n_synthetic"]),
            axes=tuple(values["axes"]),
            rate_hz=float(values["rate_hz"]),
            n_samples=int(values["n_samples"]),
            **{name: _floats(values[name]) for name in ("time_s", "mean", "sd")},
            high_pass=None if high_pass is None else HighPass.from_dict(high_pass),
            looked_at=values["looked_at"],
            weights=tuple(WeightBlock.from_dict(block) for block in values["weights"]),
            looked_with=str(values.get("looked_with", "")),
        )


def portrait(
    data: Dataset,
    spaces: Mapping[str, BaseEstimator],
    *,
    classifier: BaseEstimator | None = None,
    own: Mapping[str, BaseEstimator | None] | None = None,
) -> Portrait:
    """Gather what a report draws beside accuracies.

    Parameters
    ----------
    data : Dataset
        Recordings of equal length and rate, with labels.
    spaces : mapping of str to estimator
        Feature spaces, the one to look at first. The first whose features belong to instants, bins, frequencies or
        bands gives the weights; the first that holds an `HFMH` says how to high-pass and count, else the
        paper's settings do.
    classifier : estimator, optional
        See `granular_id.evaluation.report_data.weight_blocks`.
    own : mapping of str to estimator or None, optional
        Classifiers of those spaces that bring one. That of the space looked at is trained; None where it would have
        no weights in `coef_`, and so nothing to look at.

    Returns
    -------
    Portrait

    Raises
    ------
    ValueError
        Recordings of unequal length or rate, or without labels.

    Examples
    --------
    >>> from granular_id import RawHFMH, synthesize
    >>> seen = portrait(synthesize(["rice", "fine sugar"], n_per_class=3), {"raw+hfmh": RawHFMH()})
    >>> seen.labels, seen.mean.shape, seen.high_pass.hfmh.shape, seen.looked_at
    (('fine sugar', 'rice'), (2, 6, 200), (2, 6, 100), 'raw+hfmh')
    """
    X, y, rate_hz = data.X, data.y, data.rate_hz
    labels = np.unique(y)
    groups = [np.flatnonzero(y == label) for label in labels]
    looked_at, weights, looked_with = _weights(data, spaces, classifier, own or {})
    return Portrait(
        labels=tuple(labels.tolist()),
        counts=tuple(map(len, groups)),
        n_synthetic=sum(recording.is_synthetic for recording in data),
        axes=AXES,
        rate_hz=float(rate_hz),
        n_samples=X.shape[1],
        time_s=rounded(thinned(np.arange(X.shape[1]) / rate_hz)),
        mean=_per_material(X, groups, np.mean),
        sd=_per_material(X, groups, np.std),
        high_pass=_high_pass(X, groups, _histogram_of(spaces, rate_hz)),
        looked_at=looked_at,
        weights=weights,
        looked_with=looked_with,
    )


def _weights(
    data: Dataset,
    spaces: Mapping[str, BaseEstimator],
    classifier: BaseEstimator | None,
    own: Mapping[str, BaseEstimator | None],
) -> tuple[str | None, tuple[WeightBlock, ...], str]:
    X, y = data.X, data.y
    for name, space in spaces.items():
        if name in own and own[name] is None:
            continue
        fitted = clone(space).fit(X, y)
        if not can_look(fitted):  # its features have no link to the recording: look at the next
            continue
        if name not in own:
            return name, weight_blocks(X, y, fitted, classifier), ""
        trained = clone(own[name])
        tell_blocks(trained, block_sizes(fitted))
        with single_threaded_blas():  # as the partitions do: bits must not depend on the number of threads
            trained.fit(
                fitted.transform(X), y, **origins_of(data).fit_arguments(trained, np.arange(len(data)))
            )
        chosen = Chosen.of(trained)
        return name, weight_blocks(X, y, fitted, trained), "" if chosen is None else chosen.words
    return None, (), ""


def _per_material(X: Floats, groups: list[NDArray[np.intp]], statistic: Any) -> Floats:
    over_recordings = np.stack([statistic(X[rows], axis=0).T for rows in groups])
    return rounded(thinned(over_recordings))


def _histogram_of(spaces: Mapping[str, BaseEstimator], rate_hz: float) -> HFMH | None:
    """Return the first histogram in use, else the paper's; None where the rate is too low for that."""
    for space in spaces.values():
        for part in _parts(space):
            if isinstance(part, HFMH):
                # RawHFMH is one too and has more parameters; only its counts are wanted here.
                return HFMH(**{name: getattr(part, name) for name in HFMH().get_params()})
    papers = HFMH(rate_hz=rate_hz)
    return papers if papers.cutoff_hz < rate_hz / 2 else None


def _parts(estimator: Any) -> Iterator[Any]:
    yield estimator
    if hasattr(estimator, "get_params"):
        yield from estimator.get_params(deep=True).values()


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


def _floats(values: Any) -> Floats:
    return np.array(values, dtype=np.float64)


def not_drawn(data: Dataset) -> list[str]:
    """Return one line on why a report does not draw the recordings; none where it does."""
    if data.axes == AXES:
        return []
    return [
        f"recordings and weights are not drawn: that is for the axes {' '.join(AXES)}, these have {' '.join(data.axes)}"
    ]


# Where a linear model looks: the size of its weights over time, axis, bin and band.

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
        At most `granular_id.evaluation.report_data.POINTS` coordinates each.

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


# Where a linear model looks in the multi-band space: influence of each band and axis, block by block.

BandWeights = tuple[str, str, Floats, Floats, Floats]
"""Name, kind, coordinates (m,), size (C, m) and influence (C, m) of a block."""


def band_weights(columns: BandColumns, size: Floats, influence: Floats) -> list[BandWeights]:
    """Gather what single features weigh: bands for most blocks, frequencies and instants for spectrum and level.

    Parameters
    ----------
    columns : BandColumns
    size, influence : (D,) float arrays
        Of each feature, see `granular_id.evaluation.report_data.WeightBlock`.

    Returns
    -------
    list of BandWeights
        Bands from the lowest to the highest, at their geometric middle in hertz, after the whole signal at 0.
        Influence is the sum over the features of a cell, with those of two axes half for each; size is their
        mean. Both are 0 where a band is too short for the block.
    """
    spread, sizes = columns.over_axes(influence), columns.over_axes(size)
    counts = columns.over_axes(np.ones(len(size)))
    along = {block.name: block for block in columns.read_along()}
    order = [0, *range(len(columns.bands) - 1, 0, -1)]
    middles = np.array(
        [0.0, *(np.sqrt(columns.bands[k].low_hz * columns.bands[k].high_hz) for k in order[1:])]
    )
    found: list[BandWeights] = []
    for name in columns.blocks:
        if name in along:
            block = along[name]
            shape = (len(block.axes), len(block.coordinates))
            own = (size[block.columns].reshape(shape), influence[block.columns].reshape(shape))
            found.append((name, block.kind, block.coordinates, *own))
            continue
        cells = [columns.of(block=name, band=band) for band in order]
        sums = [
            np.stack([values[cell].sum(axis=0) for cell in cells], axis=1)
            for values in (sizes, counts, spread)
        ]
        weights = np.divide(sums[0], sums[1], out=np.zeros_like(sums[0]), where=sums[1] > 0)
        found.append((name, "band", middles, weights, sums[2]))
    return found


# Fewer points and fewer digits: what is drawn need not be longer than a figure is wide.

POINTS = 200
"""Most points a curve keeps: a panel is a few hundred pixels wide."""

DIGITS = 5
"""Significant digits kept, more than a figure shows: a result of 20 classes stays below a few megabytes."""


def window_starts(n: int, most: int = POINTS) -> NDArray[np.intp]:
    """First index of each of at most `most` adjoining windows over `n` points, as equal as can be.

    Examples
    --------
    >>> window_starts(7, 3).tolist()
    [0, 2, 4]
    """
    return np.arange(min(n, most)) * n // min(n, most)


def thinned(values: NDArray[np.float64], most: int = POINTS) -> NDArray[np.float64]:
    """Mean over each of at most `most` windows along the last axis; shorter input is returned as it is.

    Examples
    --------
    >>> thinned(np.array([1.0, 3.0, 5.0, 7.0]), most=2).tolist()
    [2.0, 6.0]
    """
    n = values.shape[-1]
    starts = window_starts(n, most)
    sums = np.add.reduceat(values, starts, axis=-1)
    means: NDArray[np.float64] = sums / np.diff(starts, append=n)
    return means


def rounded(values: NDArray[np.float64], digits: int = DIGITS) -> NDArray[np.float64]:
    """Round to significant digits.

    Examples
    --------
    >>> rounded(np.array([1.23456789, 0.000987654321, 0.0])).tolist()
    [1.2346, 0.00098765, 0.0]
    """
    return np.array([float(f"{value:.{digits}g}") for value in values.ravel().tolist()]).reshape(values.shape)

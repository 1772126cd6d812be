"""What a report draws beside accuracies: forces, what is left above the cut-off, histograms, weights."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline

from granular_id._estimators import describe_estimator, real_steps
from granular_id._memory import spans
from granular_id._parallel import single_threaded_blas
from granular_id.evaluation.features import by_columns, features_of, plan_for, seeded
from granular_id.evaluation.weights import (
    WeightBlock,
    downsampled,
    is_traceable,
    rounded,
    weight_blocks,
    window_starts,
)
from granular_id.recording import AXES, Dataset, common_units
from granular_id.spaces import (
    HFMH,
    Chosen,
    FeatureSpace,
    RecordingTransformer,
    block_sizes,
    tell_blocks,
)
from granular_id.splits import groups_of

Floats = NDArray[np.float64]

MOST_AXES = 6
"""Most axes that figures show: of more, those in which the materials differ most."""

_WINDOWS = 40  # of the residual: 80 ms in the paper's 3.2 s, in which the tool moves a seventh of its width


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
        Root mean square of the high-passed signal over a window and over the recordings, in the unit of the axis.
    bin_range : (C, 2) float array
        Lower edge of the first bin and upper edge of the last, in the unit of the axis.
    hfmh : (K, C, n_bins) float array
        Mean histogram over the recordings: counts, or densities where the settings say so.
    """

    settings: Mapping[str, Any]
    time_s: Floats
    residual: Floats
    bin_range: Floats
    hfmh: Floats


@dataclass(frozen=True, eq=False)
class ReportData:
    """How the recordings look, material by material, and what a linear model weighs.

    Numbers are rounded to five digits, and curves downsampled to at most
    `granular_id.evaluation.weights.POINTS` points, each the mean over a window.

    Parameters
    ----------
    labels : tuple of K str
        Materials, in the order of the first axis of the arrays.
    counts : tuple of K int
        Recordings of each.
    n_synthetic : int
        How many recordings were simulated.
    axes : tuple of C str
        Axes, in the order of the second: of recordings of more than six, the six in which the materials differ most,
        by `most_different`.
    rate_hz : float
        Sampling rate of the recordings.
    n_samples : int
        Samples of each recording.
    time_s : (P,) float array
        Seconds from the first sample.
    mean, sd : (K, C, P) float arrays
        Mean and standard deviation (divisor n) over the recordings of a material, in the unit of the axis.
    high_pass : HighPass
        The signal above the cut-off.
    looked_at : str or None
        Feature space of the model; None where the features of none belong to a time, axis and bin.
    weights : tuple of WeightBlock
        Of one linear model, fitted on all recordings in that space; nothing was held out.
    looked_with : str
        What that model chose, where it is of a classifier that chooses.
    units : tuple of C str
        Unit of each axis, "" where not known.
    n_axes : int
        Axes of the recordings, those left out included.
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
    high_pass: HighPass
    looked_at: str | None
    weights: tuple[WeightBlock, ...]
    looked_with: str
    units: tuple[str, ...]
    n_axes: int


def most_different(mean: Floats, sd: Floats) -> list[int]:
    """Rank axes by how much materials differ in them, most first.

    `mean` and `sd` are (K, C, P), over the recordings of each material. What counts is the spread of the means of the
    materials, over the spread of recordings within a material, both as root mean squares over time.
    """
    apart = np.sqrt(mean.var(axis=0).mean(axis=-1))
    within = np.sqrt((sd**2).mean(axis=(0, 2)))
    score = np.divide(apart, within, out=np.where(apart > 0, np.inf, 0.0), where=within > 0)
    ranked: list[int] = np.argsort(-score, kind="stable").tolist()
    return ranked


def report_data_of(
    data: Dataset,
    spaces: Sequence[FeatureSpace],
    accuracies: Mapping[str, float],
    classifier: BaseEstimator,
    seed: int,
    has_weights: Mapping[str, bool],
) -> ReportData:
    """Gather the report data of an evaluation: weights in the most accurate space whose features are not mixed."""
    best_first = sorted(spaces, key=lambda space: -accuracies[space.name])
    unmixed = {
        space.name: space.transformer
        for space in best_first
        if (plan := plan_for(space.transformer)) is None or not plan.after
    }
    own = {
        space.name: seeded(space.classifier, seed) if has_weights[space.name] else None
        for space in spaces
        if space.classifier is not None
    }
    return gather_report_data(data, unmixed, classifier=clone(classifier), own=own)


def gather_report_data(
    data: Dataset,
    spaces: Mapping[str, BaseEstimator],
    *,
    classifier: BaseEstimator | None = None,
    own: Mapping[str, BaseEstimator | None] | None = None,
) -> ReportData:
    """Gather what a report draws from recordings of equal length and rate.

    The first of `spaces` whose features belong to instants, bins, frequencies or bands gives the weights: those of
    `classifier` (see `weight_blocks`) or, where `own` has one for the space, of that, trained here; None there means
    that it has no weights. The first space that holds an `HFMH` says how to high-pass; else the paper's settings do,
    with a cut-off of at most a quarter of the rate and, for axes other than a wrench's, bins over what each axis has.
    """
    X, y, rate_hz = data.X, data.y, data.rate_hz
    labels = np.unique(y)
    groups = [np.flatnonzero(y == label) for label in labels]
    mean, sd = (
        rounded(downsampled(np.stack([by_columns(statistic, X, rows).T for rows in groups])))
        for statistic in (np.mean, np.std)
    )
    shown = sorted(most_different(mean, sd)[:MOST_AXES])
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="cutoff_hz")  # the evaluation said so
        looked_at, weights, looked_with = _weights(data, spaces, classifier, own or {})
        high_pass = _high_pass(X, groups, _histogram_of(spaces, data), shown)
    return ReportData(
        labels=tuple(labels.tolist()),
        counts=tuple(map(len, groups)),
        n_synthetic=sum(recording.is_synthetic for recording in data),
        axes=tuple(data.axes[axis] for axis in shown),
        rate_hz=float(rate_hz),
        n_samples=X.shape[1],
        time_s=rounded(downsampled(np.arange(X.shape[1]) / rate_hz)),
        mean=mean[:, shown],
        sd=sd[:, shown],
        high_pass=high_pass,
        looked_at=looked_at,
        weights=weights,
        looked_with=looked_with,
        units=tuple(common_units(data)[axis] for axis in shown),
        n_axes=len(data.axes),
    )


def _histogram_of(spaces: Mapping[str, BaseEstimator], data: Dataset) -> HFMH:
    """Return the first histogram in use, else the paper's, fitted to what the rate carries and the axes hold."""
    for space in spaces.values():
        for part in (space, *space.get_params().values()):
            if isinstance(part, HFMH):
                # RawHFMH is one too and has more parameters; only its counts are wanted here.
                return HFMH(**{name: getattr(part, name) for name in HFMH().get_params()})
    rate_hz, papers = data.rate_hz, HFMH()
    return HFMH(
        rate_hz=rate_hz,
        cutoff_hz=min(papers.cutoff_hz, rate_hz / 4),
        bin_range=papers.bin_range if data.axes == AXES else "auto",
    )


def _high_pass(X: Floats, groups: list[NDArray[np.intp]], histogram: HFMH, shown: list[int]) -> HighPass:
    fitted = clone(histogram).fit(X)
    counts = fitted.transform(X).reshape(len(X), X.shape[2], -1)[:, shown]
    starts = window_starts(X.shape[1], _WINDOWS)
    sizes = np.diff(starts, append=X.shape[1])
    residual = np.empty((len(groups), len(shown), len(starts)))
    for place, axis in enumerate(shown):  # one at a time: a copy of one axis of some recordings, not of all
        power = np.concatenate(
            [
                np.add.reduceat(fitted.high_passed(X[span, :, axis]) ** 2, starts, axis=1) / sizes
                for span in spans(len(X), X[:1].nbytes)
            ]
        )
        for k, rows in enumerate(groups):
            residual[k, place] = np.sqrt(power[rows].mean(axis=0))
    return HighPass(
        settings=describe_estimator(histogram),
        time_s=rounded((starts + (sizes - 1) / 2) / fitted.spec_.rate_hz),
        residual=rounded(residual),
        bin_range=np.array(fitted.bin_range_[shown], dtype=np.float64),
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
        first = real_steps(space)[0] if isinstance(space, Pipeline) else space
        fitted = clone(space).fit(data if isinstance(first, RecordingTransformer) else X, y)  # axes by name
        if not is_traceable(fitted):
            continue
        if name not in own:
            return name, weight_blocks(X, y, fitted, classifier), ""
        trained = clone(own[name])
        tell_blocks(trained, block_sizes(fitted))
        groups = groups_of(data).fit_arguments(trained, np.arange(len(data)))
        with single_threaded_blas():  # as the partitions do: bits must not depend on the number of threads
            trained.fit(features_of(name, fitted, X), y, **groups)
        chosen = Chosen.of(trained)
        return name, weight_blocks(X, y, fitted, trained), "" if chosen is None else chosen.words
    return None, (), ""

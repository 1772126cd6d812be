"""What a report draws beside accuracies: forces and histograms of each material."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone

from granular_id.recording import AXES, Dataset, common_units
from granular_id.spaces import HFMH

Floats = NDArray[np.float64]

MOST_AXES = 6
"""Most axes that figures show: of more, those in which the materials differ most."""

POINTS = 200
"""Most points of a curve: a panel is a few hundred pixels wide."""


@dataclass(frozen=True, eq=False)
class Histograms:
    """Mean histogram of the high-passed signal (HFMH), per material and axis.

    Parameters
    ----------
    cutoff_hz : float
        Of the high-pass.
    bin_range : (C, 2) float array
        Lower edge of the first bin and upper edge of the last, in the unit of the axis.
    counts : (K, C, n_bins) float array
        Mean over the recordings of a material.
    """

    cutoff_hz: float
    bin_range: Floats
    counts: Floats


@dataclass(frozen=True, eq=False)
class ReportData:
    """How the recordings look, material by material; curves are means over at most `POINTS` windows.

    Parameters
    ----------
    labels : tuple of K str
        Materials, in the order of the first axis of the arrays.
    n_synthetic : int
        How many recordings were simulated.
    axes : tuple of C str
        Axes, in the order of the second: of recordings of more than six, the six in which the materials differ most,
        by `most_different`.
    time_s : (P,) float array
        Seconds from the first sample.
    mean, sd : (K, C, P) float arrays
        Mean and standard deviation (divisor n) over the recordings of a material, in the unit of the axis.
    hfmh : Histograms
        What is left above the cut-off.
    units : tuple of C str
        Unit of each axis, "" where not known.
    """

    labels: tuple[str, ...]
    n_synthetic: int
    axes: tuple[str, ...]
    time_s: Floats
    mean: Floats
    sd: Floats
    hfmh: Histograms
    units: tuple[str, ...]


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


def window_starts(n: int, most: int = POINTS) -> NDArray[np.intp]:
    """First index of each of at most `most` adjoining windows over `n` points, as equal as can be."""
    return np.arange(min(n, most)) * n // min(n, most)


def _downsampled(values: Floats) -> Floats:
    """Mean over each of at most `POINTS` windows along the last axis; shorter input is returned as it is."""
    n = values.shape[-1]
    starts = window_starts(n)
    means: Floats = np.add.reduceat(values, starts, axis=-1) / np.diff(starts, append=n)
    return means


def report_data_of(data: Dataset, transformers: Sequence[BaseEstimator]) -> ReportData:
    """Gather what a report draws from recordings of equal length and rate.

    The first of the `transformers` that holds an `HFMH` says how to high-pass; else the paper's settings do, with a
    cut-off of at most a quarter of the rate and, for axes other than a wrench's, bins over what each axis has.
    """
    X, y = data.X, data.y
    labels = np.unique(y)
    groups = [np.flatnonzero(y == label) for label in labels]
    mean, sd = (
        _downsampled(np.stack([statistic(X[rows], axis=0).T for rows in groups]))
        for statistic in (np.mean, np.std)
    )
    shown = sorted(most_different(mean, sd)[:MOST_AXES])
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="cutoff_hz")  # the evaluation has warned
        hfmh = _histograms(X, groups, _histogram_of(transformers, data), shown)
    return ReportData(
        labels=tuple(labels.tolist()),
        n_synthetic=sum(recording.is_synthetic for recording in data),
        axes=tuple(data.axes[axis] for axis in shown),
        time_s=_downsampled(np.arange(X.shape[1]) / data.rate_hz),
        mean=mean[:, shown],
        sd=sd[:, shown],
        hfmh=hfmh,
        units=tuple(common_units(data)[axis] for axis in shown),
    )


def _histogram_of(transformers: Sequence[BaseEstimator], data: Dataset) -> HFMH:
    """Return the first histogram in use, else the paper's, fitted to what the rate carries and the axes hold."""
    for transformer in transformers:
        for part in (transformer, *transformer.get_params().values()):
            if isinstance(part, HFMH):
                # RawHFMH is one too and has more parameters; only its counts are wanted here.
                return HFMH(**{name: getattr(part, name) for name in HFMH().get_params()})
    rate_hz, papers = data.rate_hz, HFMH()
    return HFMH(
        rate_hz=rate_hz,
        cutoff_hz=min(papers.cutoff_hz, rate_hz / 4),
        bin_range=papers.bin_range if data.axes == AXES else "auto",
    )


def _histograms(X: Floats, groups: list[NDArray[np.intp]], histogram: HFMH, shown: list[int]) -> Histograms:
    fitted = clone(histogram).fit(X)
    counts = fitted.transform(X).reshape(len(X), X.shape[2], -1)[:, shown]
    return Histograms(
        cutoff_hz=float(fitted.spec_.cutoff_hz),
        bin_range=np.array(fitted.bin_range_[shown], dtype=np.float64),
        counts=np.stack([counts[rows].mean(axis=0) for rows in groups]),
    )

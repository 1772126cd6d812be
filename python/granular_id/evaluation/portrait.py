"""What a report draws that predictions alone do not tell: forces, residuals, histograms, weights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone

from granular_id._blas import single_threaded_blas
from granular_id._core import AXES
from granular_id.evaluation.chosen import Chosen
from granular_id.evaluation.describe import describe_estimator
from granular_id.evaluation.gaze import WeightBlock, can_look, weight_blocks
from granular_id.evaluation.origins import origins_of
from granular_id.evaluation.thinning import rounded, thinned, window_starts
from granular_id.recording import Dataset
from granular_id.spaces import HFMH, block_sizes, tell_blocks

__all__ = ["HighPass", "Portrait", "portrait"]

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
    `granular_id.evaluation.thinning.POINTS` points, each the mean over a window.

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
        See `granular_id.evaluation.gaze.weight_blocks`.
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

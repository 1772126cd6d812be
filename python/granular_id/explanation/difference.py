"""`explain`: which instants, axes, bins and bands decide between two materials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.utils.validation import column_or_1d

from granular_id._columns import wrench_of
from granular_id.explanation.bands import BandExplanation
from granular_id.explanation.naming import named
from granular_id.explanation.pairs import pair_factors
from granular_id.explanation.result import ExplainedBlock, Explanation
from granular_id.explanation.steps import chain_of

__all__ = ["explain"]

FloatArray = npt.NDArray[np.float64]


def explain(
    model: Any,
    first: Any,
    second: Any,
    X: npt.ArrayLike,
    y: npt.ArrayLike | None = None,
    *,
    axes: Sequence[str] | None = None,
) -> Explanation:
    """Say which instants, axes and bins decide between two materials.

    A linear learner's score is a sum over features, so the difference between its mean scores for recordings of
    two materials is a sum too: of the weight of each feature times the difference of its means. Nothing is
    estimated and nothing left over.

    Parameters
    ----------
    model : Pipeline
        Fitted: a feature space that knows what its columns stand for (`RawSignal`, `HFMH`, `RawHFMH`,
        `RawHistogram`, `DFT`, `RangeNormalizer`, unions of them, `MultiBand`), filters such as `Tare` in front if
        wanted; then any of `BlockScaler`, `WithinClassWhitening`, `PrincipalComponents`, `RICA`, scikit-learn's
        ``PCA`` and ``StandardScaler``; last an `ECOCClassifier` with linear learners or a `BestClassifier`.
    first, second : label
        The two materials, among ``model.classes_``.
    X : array-like, shape (n, T, C)
        Recordings, N and N m; those of other materials are left out. Those the model was not trained on say
        what decides; those it was trained on, what it has learned.
    y : array-like, shape (n,), optional
        Material of each recording. Without it they count for what the model names them.
    axes : sequence of C str, optional
        Names of the axes, as in `Dataset.axes`. Default: fx, fy, fz, tx, ty, tz for six, numbers for others.

    Returns
    -------
    Explanation
        ``print`` it for the main points in words; `granular_id.plotting.plot_explanation` draws it. Of the
        multi-band space a `BandExplanation`: shares of blocks, bands, axes and couplings.

    Raises
    ------
    TypeError
        A model that is no such pipeline, or whose learners are not linear.
    ValueError
        An unknown label, twice the same, no recording of one of the two, `X` of another shape than in fit, or
        names of another number of axes.
    NotFittedError
        A model that is not fitted.

    Notes
    -----
    The score is that of the learner trained on the two materials, positive for `first`. A coding other than
    one-vs-one may have none: `granular_id.explanation.pairs.pair_factors` says which sum takes its place.

    The bins of a histogram hold a fixed number of samples in all: what one gains another loses. Contributions of
    single bins are to be read with their neighbours.

    Examples
    --------
    Two materials that differ in nothing but fz, in the second half:

    >>> import numpy as np
    >>> from sklearn.pipeline import make_pipeline
    >>> from granular_id import ECOCClassifier, RawSignal
    >>> from granular_id.explanation import explain
    >>> X = np.random.default_rng(0).normal(scale=0.01, size=(20, 100, 6))
    >>> y = np.repeat(["oat", "rice"], 10)
    >>> X[y == "oat", 50:, 2] += 1.0
    >>> model = make_pipeline(RawSignal(rate_hz=500), ECOCClassifier()).fit(X, y)
    >>> oat_or_rice = explain(model, "oat", "rice", X, y)
    >>> max(oat_or_rice.by_axis(), key=oat_or_rice.by_axis().get)
    'fz'
    >>> region = oat_or_rice.regions(1)[0]
    >>> region.axis, 0.1 <= region.low < region.high <= 0.2
    ('fz', True)
    """
    chain = chain_of(model)
    classes = chain.classifier.classes_
    pair = (_row_of("first", first, classes), _row_of("second", second, classes))
    if pair[0] == pair[1]:
        raise ValueError(f"first and second must be two materials, got {first!r} twice")
    if isinstance(X, (list, tuple)):
        X, _ = wrench_of(X, "X", getattr(model[0], "axes_in_", None))
    recordings = _recordings(X)
    if axes is not None:
        chain = named(chain, axes, recordings.shape[2] if recordings.ndim == 3 else 1)
    labels = _labels(model, recordings, y)
    rows = [_rows_of(classes[row], labels, given=y is not None) for row in pair]
    decoding = getattr(chain.classifier, "decoding", "loss_weighted")
    factors = pair_factors(chain.classifier.coding_matrix_, *pair, decoding=decoding)

    means, scores = [], []
    for members in rows:
        columns, scored = chain.columns_and_scores(recordings[members], factors)
        means.append(columns.mean(axis=0))
        scores.append(float(scored.mean()))
    weights = chain.weights_of(factors)
    contributions = weights * (means[0] - means[1])
    told: dict[str, Any] = {
        "first": classes.tolist()[pair[0]],
        "second": classes.tolist()[pair[1]],
        "scores": (scores[0], scores[1]),
        "counts": (len(rows[0]), len(rows[1])),
        "factors": factors,
        "blocks": tuple(ExplainedBlock.of(block, weights, contributions) for block in chain.blocks),
    }
    if chain.bands is None:
        return Explanation(**told)
    return BandExplanation(
        **told, columns=chain.bands, means=np.stack(means), weights=weights, contributions=contributions
    )


def _recordings(X: npt.ArrayLike) -> npt.NDArray[Any]:
    try:
        recordings = np.asarray(X)
    except ValueError as reason:
        raise ValueError(f"X must be recordings of one shape, an array (n, T, C): {reason}") from None
    if recordings.ndim not in (2, 3):
        raise ValueError(
            f"X must be recordings, an array (n, T, C), got {type(X).__name__} of shape {recordings.shape}; "
            "of a Dataset pass its X and y"
        )
    return recordings


def _row_of(argument: str, label: Any, classes: npt.NDArray[Any]) -> int:
    known: list[Any] = classes.tolist()
    if isinstance(label, np.ndarray) or label not in known:
        raise ValueError(f"{argument} must be one of {', '.join(map(repr, known))}, got {label!r}")
    return known.index(label)


def _labels(model: Any, recordings: npt.NDArray[Any], y: npt.ArrayLike | None) -> npt.NDArray[Any]:
    if y is None:
        return np.asarray(model.predict(recordings))
    labels: npt.NDArray[Any] = column_or_1d(y)
    if len(labels) != len(recordings):
        raise ValueError(
            f"y must have one label per recording of X, got {len(labels)} for X of shape {recordings.shape}"
        )
    return labels


def _rows_of(label: Any, labels: npt.NDArray[Any], *, given: bool) -> npt.NDArray[np.intp]:
    rows = np.flatnonzero(labels == label)
    if rows.size == 0:
        missing = "y has no" if given else "model names no recording of X"
        raise ValueError(
            f"{missing} {str(label)!r}: without recordings of both materials there is no difference"
        )
    return rows

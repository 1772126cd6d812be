"""`explain`: which blocks, bands, axes and times decide between two materials."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import clone
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import check_is_fitted, column_or_1d

from granular_id._core import GranularIdError
from granular_id._estimators import real_steps
from granular_id.ecoc import ECOCClassifier
from granular_id.explanation.columns import columns_of
from granular_id.explanation.result import Explanation
from granular_id.recording import Dataset, common_units, refuse_tables, unit_of
from granular_id.spaces import (
    LINEAR_STEPS,
    BestClassifier,
    RecordingFilter,
    choice_of,
    fit_pipeline,
    folded_back,
    limit_components,
)
from granular_id.splits import Fold, groups_of, hold_out

FloatArray = npt.NDArray[np.float64]


def explain(
    model: Any,
    first: Any,
    second: Any,
    X: Dataset | npt.ArrayLike,
    y: npt.ArrayLike | None = None,
    *,
    axes: Sequence[str] | None = None,
) -> Explanation:
    """Add up what blocks, bands, axes and times of the features contribute to distinguishing two materials.

    A linear learner's score is a sum over features, so the difference between its mean scores for recordings of
    two materials is a sum too: of the weight of each feature times the difference of its means. Nothing is
    estimated and nothing left over.

    Parameters
    ----------
    model : Pipeline
        Fitted: a feature space that knows what its columns stand for (`RawSignal`, `HFMH`, `RawHFMH`,
        `RawHistogram`, `DFT`, `RangeNormalizer`, unions of them, `MultiBand`), filters such as `Tare` in front if
        wanted; then any of `BlockScaler`, `WithinClassWhitening`, `RICA`, scikit-learn's ``PCA`` and
        ``StandardScaler``; last an `ECOCClassifier` with linear learners or a `BestClassifier`.
    first, second : label
        The two materials, among ``model.classes_``.
    X : Dataset, or array-like of shape (n, T, C)
        Recordings; those of other materials are left out. Those the model was not trained on say what decides; those
        it was trained on, what it has learned.
    y : array-like, shape (n,), optional
        Material of each recording. Without it that of the `Dataset`; of arrays, what the model names them.
    axes : sequence of C str, optional
        Names of the axes. Default: those that the model was fitted on or, where these had none, those of the
        `Dataset`; else axis0, axis1, ...

    Returns
    -------
    Explanation
        ``print`` it for its tables; `granular_id.plotting.plot_explanation` draws it.

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
    one-vs-one may have none. Then the score is the difference between the decision values of the two materials under
    the linear loss (1 - m s) / 2, the only loss that keeps it a sum over learners.

    The bins of a histogram hold a fixed number of samples in all: what one gains another loses. Contributions of
    single bins are to be read with their neighbours.

    Examples
    --------
    Two materials that differ in nothing but fz, in the second half:

    >>> import numpy as np
    >>> from sklearn.pipeline import make_pipeline
    >>> from granular_id import ECOCClassifier, RawSignal
    >>> from granular_id import explain
    >>> X = np.random.default_rng(0).normal(scale=0.01, size=(20, 100, 6))
    >>> y = np.repeat(["oat", "rice"], 10)
    >>> X[y == "oat", 50:, 2] += 1.0
    >>> model = make_pipeline(RawSignal(rate_hz=500), ECOCClassifier()).fit(X, y)
    >>> oat_or_rice = explain(model, "oat", "rice", X, y, axes=["fx", "fy", "fz", "tx", "ty", "tz"])
    >>> by_axis, by_time = oat_or_rice.sums("axis"), oat_or_rice.sums("time")
    >>> max(by_axis, key=by_axis.get)
    'fz'
    >>> list(by_time)[0], sum(list(by_time.values())[4:]) > 0.9 * oat_or_rice.difference
    ('0.000-0.025 s', True)
    """
    space, after, classifier = _parts(model)
    classes = classifier.classes_
    pair = (_place_of("first", first, classes), _place_of("second", second, classes))
    if pair[0] == pair[1]:
        raise GranularIdError(f"first and second must be two materials, got {first!r} twice")
    known = getattr(model[0], "axes_in_", None)
    recordings = X if isinstance(X, Dataset) else _recordings(X)
    units = None if axes is None else [unit_of(axis) for axis in axes]
    if isinstance(X, Dataset):
        if y is None and all(recording.label is not None for recording in X):
            y = X.y
        if known is None and axes is None:
            axes, units = X.axes, common_units(X)
    columns = columns_of(space, axes, units)
    labels = _labels(model, recordings, y)
    rows = [_rows_of(classes[place], labels, given=y is not None) for place in pair]
    factors = pair_factors(classifier.coding_matrix_, *pair)

    of_features, offset = factors @ classifier.coef_, factors @ classifier.intercept_
    means, scores = [], []
    for members in rows:
        own = features = space.transform(recordings[members])
        for step in after:  # not as arrays: a step fitted on a data frame wants its names again
            features = step.transform(features)
        means.append(np.asarray(own, dtype=np.float64).mean(axis=0))
        scores.append(float((np.asarray(features, dtype=np.float64) @ of_features + offset).mean()))
    weights, _ = folded_back(after, of_features)
    return Explanation(
        first=classes.tolist()[pair[0]],
        second=classes.tolist()[pair[1]],
        scores=(scores[0], scores[1]),
        counts=(len(rows[0]), len(rows[1])),
        factors=factors,
        columns=columns,
        weights=weights,
        contributions=weights * (means[0] - means[1]),
    )


def explain_held_out(
    data: Dataset, pipeline: Pipeline, first: str, second: str
) -> tuple[Explanation, str, dict[str, Any]]:
    """Train on some recordings, explain those held out of two materials; say what was trained, and the split."""
    y, folds = data.y, hold_out(data)
    for label in (first, second):
        if label in folds.untested:
            raise GranularIdError(f"{label!r} is not held out: {folds.untested[label]}")

    def best(*labels: str) -> Fold:
        return max(folds, key=lambda fold: min((y[fold.test] == label).sum() for label in labels))

    held = [best(first, second)]
    if not np.isin((first, second), y[held[0].test]).all():  # no fold has both
        held = [best(first), best(second)]
    train = reduce(np.intersect1d, [fold.train for fold in held])
    tested = np.concatenate([fold.test for fold in held])
    tested = tested[np.isin(y[tested], (first, second))]
    pipeline = clone(pipeline)
    fewer = limit_components(pipeline, len(train))
    model = fit_pipeline(pipeline, data[train], y[train], groups_of(data).take(train))
    chosen = choice_of(model)
    how = "" if chosen is None else f"; {chosen.words}"
    how += f"; {fewer}" if fewer else ""
    split = {
        "folds": folds.name,
        "held_out": " and ".join(fold.held_out for fold in held),
        "train": [data.names[row] for row in train.tolist()],
        "explained": [data.names[row] for row in tested.tolist()],
    }
    explanation = explain(model, first, second, data[tested])
    return explanation, f"trained on {len(train)} of {len(y)} recordings{how}", split


def _recordings(X: npt.ArrayLike) -> npt.NDArray[Any]:
    if isinstance(X, (list, tuple)):
        refuse_tables(X, "X")
    try:
        recordings = np.asarray(X)
    except ValueError as reason:
        raise GranularIdError(f"X must be recordings of one shape, an array (n, T, C): {reason}") from None
    if recordings.ndim not in (2, 3):
        raise GranularIdError(
            f"X must be recordings, a Dataset or an array (n, T, C), got {type(X).__name__} of shape "
            f"{recordings.shape}"
        )
    return recordings


def _place_of(argument: str, label: Any, classes: npt.NDArray[Any]) -> int:
    known: list[Any] = classes.tolist()
    if isinstance(label, np.ndarray) or label not in known:
        raise GranularIdError(f"{argument} must be one of {', '.join(map(repr, known))}, got {label!r}")
    return known.index(label)


def _labels(model: Any, recordings: Dataset | npt.NDArray[Any], y: npt.ArrayLike | None) -> npt.NDArray[Any]:
    if y is None:
        return np.asarray(model.predict(recordings))
    labels: npt.NDArray[Any] = column_or_1d(y)
    if len(labels) != len(recordings):
        raise GranularIdError(
            f"y must have one label per recording of X, got {len(labels)} for X of {len(recordings)} recordings"
        )
    return labels


def _rows_of(label: Any, labels: npt.NDArray[Any], *, given: bool) -> npt.NDArray[np.intp]:
    rows = np.flatnonzero(labels == label)
    if rows.size == 0:
        missing = "y has no" if given else "model names no recording of X"
        raise GranularIdError(
            f"{missing} {str(label)!r}: without recordings of both materials there is no difference"
        )
    return rows


def _parts(model: Any) -> tuple[Pipeline, tuple[Any, ...], ECOCClassifier | BestClassifier]:
    """Take a fitted model apart: its feature space, the linear steps after it, and its classifier."""
    if not isinstance(model, Pipeline):
        raise TypeError(
            "model must be a Pipeline of a feature space and an ECOCClassifier, "
            f"for instance make_pipeline(RawHFMH(), ECOCClassifier()), got {type(model).__name__}"
        )
    steps = real_steps(model)
    classifier = steps.pop() if steps else None
    if not isinstance(classifier, (ECOCClassifier, BestClassifier)):
        raise TypeError(
            f"model must end in an ECOCClassifier or a BestClassifier, got {type(classifier).__name__}"
        )
    check_is_fitted(classifier, "classes_")
    n_before = 0
    while n_before < len(steps) and isinstance(steps[n_before], RecordingFilter):
        n_before += 1
    space, after = steps[: n_before + 1], steps[n_before + 1 :]
    for step in after:
        if not isinstance(step, LINEAR_STEPS):
            known = ", ".join(kind.__name__ for kind in LINEAR_STEPS)
            raise TypeError(
                f"model may have {known} between feature space and classifier, "
                f"got {type(step).__name__}, which cannot be followed back to instants and bins"
            )
    named = [(f"step{number}", step) for number, step in enumerate(space)]
    return Pipeline(named or [("none", "passthrough")]), tuple(after), classifier


def pair_factors(coding_matrix: npt.NDArray[np.int8], first: int, second: int) -> npt.NDArray[np.float64]:
    """Factors of the learners' scores whose sum speaks for one class against another."""
    # Learners trained on these two classes alone speak for them: with one-vs-one there is exactly one. Without any, the
    # difference of the decision values under the linear loss: half the difference of the codes, each divided by the
    # number of learners that saw the class.
    codes = coding_matrix.astype(np.float64)
    known = np.abs(codes)
    alone = (known.sum(axis=0) == 2) & (codes[first] * codes[second] == -1)
    if alone.any():
        only: npt.NDArray[np.float64] = np.where(alone, codes[first], 0.0) / alone.sum()
        return only + 0.0  # no negative zeros
    divisors = known.sum(axis=1)
    factors: npt.NDArray[np.float64] = 0.5 * (
        codes[first] / divisors[first] - codes[second] / divisors[second]
    )
    return factors

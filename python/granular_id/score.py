"""Held-out recordings, scored by models that did not train on them: the one loop of this package.

A model with more features than recordings is sure of every recording that it trained on. Whatever is stated of a model,
its accuracy, its confidence, its rules, is read from `Held`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.metrics import confusion_matrix
from sklearn.pipeline import Pipeline

from granular_id._core import GranularIdError
from granular_id._estimators import convergence_warnings, learns, named_errors, seeded_clone
from granular_id._parallel import in_threads, single_threaded_blas
from granular_id.recording import Dataset
from granular_id.spaces import fit_on_features
from granular_id.splits import Folds, groups_of
from granular_id.statistics import cluster_interval

Floats = NDArray[np.float64]
Codes = NDArray[np.intp]

Observe = Callable[[Pipeline, Floats, Codes, Floats, Codes], Any]
"""Called for each fold with the fitted pipeline, features and rows that trained, features and rows that are tested."""


@dataclass(frozen=True, eq=False)
class Held:
    """What models say of recordings that did not train them: one row for each held-out recording of each fold.

    Attributes
    ----------
    classes : tuple of str
        The K materials, sorted.
    rows : (m,) int array
        Place of each recording in the data set.
    fold : (m,) int array
        Number of the fold that held it out.
    truth, predicted : (m,) int arrays
        Its material and the answer, as places in `classes`.
    values : (m, K) float array
        Class values, the largest wins; ``-inf`` for a material that did not train. Where a classifier has none, 1 for
        the answer and 0 for the others.
    sessions : (m,) object array
        The session of each; None where it is not known.
    clusters : (m,) object array
        What is drawn anew in an interval: the session of each, or its value of the condition that was held out.
    folds : Folds
        How they were held out.
    observed : tuple
        What `observe` of `fit_and_score` returned, one entry for each fold.
    n_features : int
        Length of a feature vector.
    seconds : mapping of str to float
        Time spent on features, training and answers, added up over threads.
    notes : tuple of str
        What did not converge.
    """

    classes: tuple[str, ...]
    rows: Codes
    fold: Codes
    truth: Codes
    predicted: Codes
    values: Floats
    sessions: NDArray[np.object_]
    clusters: NDArray[np.object_]
    folds: Folds
    observed: tuple[Any, ...] = ()
    n_features: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def right(self) -> NDArray[np.bool_]:
        """Whether each answer is right."""
        found: NDArray[np.bool_] = self.predicted == self.truth
        return found

    @property
    def places(self) -> Codes:
        """Number (m,) of the cluster of each row, or of its fold where no sessions or conditions were held out."""
        if not self.folds.sessions_apart:
            return self.fold
        names = np.array([str(cluster) for cluster in self.clusters])
        found: Codes = np.unique(names, return_inverse=True)[1].astype(np.intp)
        return found

    @property
    def confusion(self) -> NDArray[np.int64]:
        """Counts (K, K): row true, column named material."""
        counts: NDArray[np.int64] = confusion_matrix(
            self.truth, self.predicted, labels=range(len(self.classes))
        )
        return counts

    @property
    def recall(self) -> Floats:
        """Share of each material that is named right, (K,); NaN for one that was not tested."""
        confusion = self.confusion
        with np.errstate(invalid="ignore"):
            shares: Floats = np.diag(confusion) / confusion.sum(axis=1)
        return shares

    @property
    def accuracy(self) -> float:
        """Balanced accuracy: the mean of `recall` over the tested materials."""
        return float(np.nanmean(self.recall))

    @property
    def chance(self) -> float:
        """Balanced accuracy of guessing: one over the number of tested materials."""
        return 1 / np.unique(self.truth).size

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of `accuracy` over new sessions, or values of the condition; NaN where fewer than three."""
        if not self.folds.sessions_apart:
            return math.nan, math.nan
        return cluster_interval(self.right, self.truth, self.places)

    def fold_accuracies(self, n_together: int = 1) -> Floats:
        """Balanced accuracy of each fold, or of as many after each other as belong together."""
        part = self.fold // n_together
        return np.array([self.take(part == k).accuracy for k in range(len(self.folds) // n_together)])

    def take(self, some: NDArray[Any]) -> Held:
        """Return some of the rows."""
        names = ("rows", "fold", "truth", "predicted", "values", "sessions", "clusters")
        return replace(self, **{name: getattr(self, name)[some] for name in names})


def fit_and_score(
    pipeline: Pipeline,
    data: Dataset,
    folds: Folds,
    *,
    X: Floats | None = None,
    seed: int = 0,
    n_jobs: int | None = None,
    tick: Callable[[str], None] | None = None,
    observe: Observe | None = None,
    name: str = "pipeline",
) -> Held:
    """Fit a clone of a pipeline on the training rows of each fold, and score the recordings that it holds out.

    Features that learn nothing from data are extracted once for all recordings.

    Parameters
    ----------
    pipeline : Pipeline
        Feature space and classifier, not fitted.
    data : Dataset
        Recordings of equal length and rate with a label each.
    folds : Folds
        From `granular_id.splits.hold_out`.
    X : (n, ...) float array, optional
        What stands for the samples of each recording; default ``data.X``.
    seed : int
        Of every ``random_state`` that the pipeline leaves open.
    n_jobs : int, optional
        Threads over folds, as in joblib. The numbers do not depend on it.
    tick : callable, optional
        Called with the name and the fold after each.
    observe : callable, optional
        Called as ``observe(fitted, X_train, train_rows, X_test, test_rows)`` for each fold, with the fitted pipeline
        and features.
    name : str
        Of the feature space, for errors and progress.

    Returns
    -------
    Held
    """
    samples = data.X if X is None else X
    classes, truth = np.unique(data.y, return_inverse=True)
    groups, seconds = groups_of(data, folds.by), {"features": 0.0, "training": 0.0, "answers": 0.0}
    # Not every classifier takes texts; ours names the classes in its messages.
    by_name = type(pipeline[-1]).__module__.startswith("granular_id.")
    with named_errors(name), single_threaded_blas(), convergence_warnings(name) as notes:
        begun = time.perf_counter()
        shared = (
            None if learns(pipeline[0]) else seeded_clone(pipeline[0], SeedSequence(seed, spawn_key=(3,)))
        )
        features = samples if shared is None else _features(shared, samples, name)
        seconds["features"] += time.perf_counter() - begun

        def score(k: int) -> tuple[Codes, Floats, Any, int]:
            train, test, held_out = folds.folds[k]
            y: Any = classes[truth[train]] if by_name else truth[train]
            fitted = seeded_clone(pipeline, SeedSequence(seed, spawn_key=(1, k)))
            begun = time.perf_counter()
            own, new = features[train], features[test]
            if shared is None:
                own = _checked(name, fitted[0].fit(own, y).transform(own), train)
                new = _checked(name, fitted[0].transform(new), test)
            else:
                fitted.steps[0] = (fitted.steps[0][0], shared)
            extracted = time.perf_counter()
            fit_on_features(fitted, own, y, groups.take(train))
            trained = time.perf_counter()
            rest = fitted[1:]
            predicted = rest.predict(new)
            known = np.searchsorted(classes, rest.classes_) if by_name else rest.classes_
            codes = (np.searchsorted(classes, predicted) if by_name else predicted).astype(np.intp)
            values = _class_values(rest, new, codes, known.astype(np.intp), len(classes))
            seconds["features"] += extracted - begun
            seconds["training"] += trained - extracted
            seconds["answers"] += time.perf_counter() - trained
            seen = None if observe is None else observe(fitted, own, train, new, test)
            if tick is not None:
                tick(f"{name}: {held_out}")
            return codes, values, seen, own.shape[1]

        # Threads, not processes: features are shared, and libsvm works outside the interpreter lock.
        scored = in_threads(score, range(len(folds)), n_jobs)
    rows = np.concatenate([fold.test for fold in folds])
    fold = np.repeat(np.arange(len(folds)), [fold.test.size for fold in folds])
    return Held(
        classes=tuple(classes.tolist()),
        rows=rows,
        fold=fold,
        truth=truth[rows].astype(np.intp),
        predicted=np.concatenate([codes for codes, _, _, _ in scored]),
        values=np.concatenate([values for _, values, _, _ in scored]),
        sessions=groups.sessions[rows],
        clusters=(groups.sessions if groups.conditions is None else groups.conditions)[rows],
        folds=folds,
        observed=() if observe is None else tuple(seen for _, _, seen, _ in scored),
        n_features=scored[0][3],
        seconds=seconds,
        notes=tuple(notes),
    )


def _class_values(fitted: Pipeline, X: Floats, codes: Codes, known: Codes, n_classes: int) -> Floats:
    """Class values (m, K) in the order of all classes; of a classifier without any, 1 for the answer."""
    values = np.full((len(X), n_classes), -np.inf)
    of_pairs = getattr(fitted[-1], "decision_function_shape", "") == "ovo"
    if of_pairs or not hasattr(fitted, "decision_function"):
        values[:, known] = 0.0
        values[np.arange(len(X)), codes] = 1.0
        return values
    found = np.asarray(fitted.decision_function(X), dtype=np.float64)
    values[:, known] = np.column_stack((-found, found)) if found.ndim == 1 else found
    return values


def _features(space: Any, samples: Floats, name: str) -> Floats:
    """Fit a feature space that learns nothing, and return what it makes of all recordings."""
    return _checked(name, space.fit(samples).transform(samples), np.arange(len(samples)))


def _checked(name: str, values: Any, rows: Codes) -> Floats:
    """Return finite features (n, D) of some recordings."""
    features = np.asarray(values, dtype=np.float64)
    if features.ndim != 2:
        raise GranularIdError(f"feature space {name!r} must give an array (n, D), got shape {features.shape}")
    if not np.isfinite(features).all():
        row, column = np.argwhere(~np.isfinite(features))[0].tolist()
        raise GranularIdError(
            f"feature space {name!r} must give finite features, got {features[row, column]} in column {column} "
            f"of recording {rows[row]}"
        )
    return features


def space_pipeline(transformer: Any, classifier: Any) -> Pipeline:
    """Return a feature space and a classifier as one pipeline, not fitted."""
    return Pipeline([("features", clone(transformer)), ("classifier", clone(classifier))])

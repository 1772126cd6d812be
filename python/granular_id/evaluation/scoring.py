"""One feature space and one classifier, trained and tested on every partition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from granular_id._estimators import convergence_warnings, named_errors
from granular_id._parallel import in_threads, single_threaded_blas
from granular_id._progress import Ticker
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.features import STAGES, GramBank, SpaceFeatures, seeded, timed
from granular_id.partitions import CONDITION, Partition
from granular_id.spaces import BestClassifier, Chosen, FeatureSpace, adapted_classifier, tell_blocks
from granular_id.splits import Groups

Codes = NDArray[np.intp]
Floats = NDArray[np.float64]

_LEAST = 3  # recordings of each material where all are declared
_ABOUT_EQUAL = 2  # the most recordings of a material against the least of another


@dataclass(frozen=True, eq=False)
class Task:
    """One space and one classifier, to be asked about every partition."""

    space: FeatureSpace
    classifier: BaseEstimator
    bank: GramBank
    """Of the recordings; tasks on the same recordings share it."""
    groups: Groups | None = None
    """Sessions and order, for a classifier that asks for them."""
    kind: str = "space"
    """Or "control", which may be called like a space."""

    @property
    def by_gram(self) -> bool:
        """Whether the classifier takes scalar products in place of features."""
        return hasattr(self.classifier, "fit_gram")


@dataclass(frozen=True, eq=False)
class Answer:
    """What one partition answered."""

    predicted: Codes
    n_features: int
    seconds: Mapping[str, float]
    """By stage, of this partition alone."""
    shared_seconds: Mapping[str, float]
    """By stage, of what all partitions share."""
    chosen: Chosen | None
    adapted: Codes | None
    """What it names after it was adapted to the tested recordings, declared to hold all materials."""


def answers_of(
    task: Task,
    partitions: Sequence[Partition],
    *,
    labels: NDArray[np.str_],
    truth: Codes,
    seed: int,
    n_jobs: int | None,
    ticker: Ticker,
) -> tuple[list[Answer], list[str]]:
    """Answer one task for every partition; return also lines on what did not converge."""
    space = task.space
    name, kind = (
        (space.name, "feature space") if task.kind == "space" else (f"control {space.name}", task.kind)
    )
    with named_errors(space.name, kind):
        features = SpaceFeatures(space.name, space.transformer, task.bank, seed, by_gram=task.by_gram)

    def compute(partition: Partition) -> Answer:
        with named_errors(space.name, kind):
            answer = _answer(task, features, partition, labels, truth, seed)
        ticker.tick(f"{name}: {partition.description}")
        return answer

    # Threads, not processes: scalar products are shared, and libsvm works outside the interpreter lock. The
    # matrices of a pair of classes are small: more threads for each took twice the time of one.
    with single_threaded_blas(), convergence_warnings(name) as not_converged:
        answers = in_threads(compute, partitions, n_jobs)
    return answers, not_converged


def _answer(
    task: Task,
    features: SpaceFeatures,
    partition: Partition,
    labels: NDArray[np.str_],
    truth: Codes,
    seed: int,
) -> Answer:
    """Train on one part of a partition and name the recordings of the other."""
    # Our own classifier names classes in its messages; of others not all take text.
    takes_text = isinstance(task.classifier, ECOCClassifier)
    targets = labels[truth[partition.train]] if takes_text else truth[partition.train]
    classifier: Any = seeded(task.classifier, seed, partition)
    adapted: Codes | None = None
    seconds = dict.fromkeys(STAGES, 0.0)
    if task.by_gram:
        train, cross, n_features = features.products(partition, targets, seconds)
        with timed(seconds, "training"):
            classifier.fit_gram(train, targets)
        with timed(seconds, "prediction"):
            predicted = classifier.predict_gram(cross)
    else:
        with timed(seconds, "features"):
            train, test, sizes = features.rows(partition, targets)
        n_features = train.shape[1]
        with timed(seconds, "training"):
            tell_blocks(classifier, sizes)
            known = {} if task.groups is None else task.groups.fit_arguments(classifier, partition.train)
            classifier.fit(train, targets, **known)
        with timed(seconds, "prediction"):
            predicted = classifier.predict(test)
        if partition.protocol == CONDITION and task.kind == "space":
            adapted = _adapted(classifier, train, truth[partition.train], test, truth[partition.test])
    codes = np.searchsorted(labels, predicted) if takes_text else predicted
    return Answer(
        predicted=np.asarray(codes, dtype=np.intp),
        n_features=n_features,
        seconds=seconds,
        shared_seconds=features.shared_seconds,
        chosen=Chosen.of(classifier),
        adapted=adapted,
    )


def _adapted(classifier: Any, X: Floats, y: Codes, X_new: Floats, truth: Codes) -> Codes | None:
    """Name rows of a held-out condition after adapting to them, if they hold all classes about equally."""
    counts = np.bincount(truth, minlength=int(y.max()) + 1)[np.unique(y)]
    if (
        not isinstance(classifier, BestClassifier)
        or counts.min() < _LEAST
        or counts.max() > _ABOUT_EQUAL * counts.min()
    ):
        return None
    named: Codes = adapted_classifier(classifier, X, y, X_new).predict(X_new).astype(np.intp)
    return named

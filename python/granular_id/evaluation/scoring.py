"""One feature space and one classifier, trained and tested on every partition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from granular_id._estimators import convergence_warnings, named_errors
from granular_id._parallel import in_threads, single_threaded_blas
from granular_id._progress import Ticker
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.checkpoint import Answer, Checkpoint
from granular_id.evaluation.features import STAGES, GramBank, SpaceFeatures, seeded, timed
from granular_id.gram import spread
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
    shuffled: bool = False
    """Whether the labels of the training rows are shuffled first."""
    most_rows: int | None = None
    """Of more training rows so many are taken, in proportion of each class."""
    kind: str = "space"
    """Or "control", which may be called like a space."""

    @property
    def key(self) -> str:
        """What no other task of an evaluation is called; checkpoints know it."""
        return f"{self.kind} {self.space.name}"

    @property
    def by_gram(self) -> bool:
        """Whether the classifier takes scalar products in place of features."""
        return hasattr(self.classifier, "fit_gram")


class CostGrid(BaseEstimator):  # type: ignore[misc]
    """`ECOCClassifier` at each of several relative costs, ascending; predictions are (n, n_costs).

    A relative cost is C times the mean squared distance of the training rows from their mean.
    """

    supports_gram = True

    def __init__(self, relative_costs: Sequence[float]) -> None:
        self.relative_costs = relative_costs

    def fit_gram(self, gram: Floats, y: NDArray[Any]) -> CostGrid:
        """Train once for each cost."""
        unit = 1.0 / nonzero_spread(gram)
        self.fitted_: list[ECOCClassifier] = []
        for cost in self.relative_costs:
            # Where no multiplier reached its bound a larger one changes nothing.
            hard = self.fitted_ and self.fitted_[-1].alpha_at_bound_ == 0
            self.fitted_.append(self.fitted_[-1] if hard else ECOCClassifier(C=cost * unit).fit_gram(gram, y))
        return self

    def predict_gram(self, cross: Floats) -> NDArray[Any]:
        """Name the rows once for each cost."""
        return np.stack([fitted.predict_gram(cross) for fitted in self.fitted_], axis=1)


def nonzero_spread(gram: Floats) -> float:
    """Return the `spread` of rows, which are the recordings in a feature space; a ValueError where it is zero."""
    found = spread(gram)
    if not found:
        raise ValueError(
            "all recordings have the same features, so nothing can be told apart; leave it out of spaces"
        )
    return found


def answers_of(
    task: Task,
    *,
    partitions: Mapping[str, Sequence[Partition]],
    labels: NDArray[np.str_],
    truth: Codes,
    seed: int,
    n_jobs: int | None,
    ticker: Ticker,
    checkpoint: Checkpoint | None,
) -> tuple[dict[str, list[Answer]], list[str]]:
    """Answer one task for every partition, by protocol; return also lines on what did not converge.

    What the checkpoint has is not computed again.
    """
    space = task.space
    every = list(chain.from_iterable(partitions.values()))
    name, kind = (space.name, "feature space") if task.kind == "space" else (task.key, task.kind)
    known = [None if checkpoint is None else checkpoint.load(task.key, each) for each in every]
    missing = [each for each, answer in zip(every, known, strict=True) if answer is None]
    if missing:
        with named_errors(space.name, kind):
            features = SpaceFeatures(space.name, space.transformer, task.bank, seed, by_gram=task.by_gram)
    for _ in range(len(every) - len(missing)):
        ticker.tick(f"{name}: from the checkpoint")

    def compute(partition: Partition) -> Answer:
        with named_errors(space.name, kind):
            answer = _answer(task, features, partition, labels, truth, seed)
        if checkpoint is not None:
            checkpoint.save(task.key, partition, answer)
        ticker.tick(f"{name}: {partition.description}")
        return answer

    # Threads, not processes: scalar products are shared, and libsvm works outside the interpreter lock. The
    # matrices of a pair of classes are small: more threads for each took twice the time of one.
    with single_threaded_blas(), convergence_warnings(name) as not_converged:
        computed = iter(in_threads(compute, missing, n_jobs))
    answers = iter([next(computed) if answer is None else answer for answer in known])
    return {protocol: [next(answers) for _ in drawn] for protocol, drawn in partitions.items()}, not_converged


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
    takes_text = isinstance(task.classifier, ECOCClassifier | CostGrid)
    if task.most_rows is not None and partition.train.size > task.most_rows:
        by_class = partition.train[np.argsort(truth[partition.train], kind="stable")]
        taken = np.linspace(0, by_class.size - 1, task.most_rows).round().astype(np.intp)
        partition = replace(partition, train=np.sort(by_class[taken]))
    targets = labels[truth[partition.train]] if takes_text else truth[partition.train]
    if task.shuffled:
        words = np.random.SeedSequence(seed, spawn_key=(4, partition.index))
        targets = np.random.default_rng(words).permutation(targets)
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
        has_weights=task.by_gram or hasattr(classifier, "coef_"),
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

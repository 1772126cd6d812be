"""Features, training and prediction of one feature space over all partitions."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from threading import Lock
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone

from granular_id._progress import Ticker
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.partitions import Partition
from granular_id.evaluation.plan import Space
from granular_id.gram import linear_gram

__all__ = ["SpaceRun", "run_space"]

Codes = NDArray[np.intp]
Floats = NDArray[np.float64]
Labels = NDArray[np.str_]


@dataclass(frozen=True)
class SpaceRun:
    """Predictions of one space, one array per partition, and what they took."""

    predicted: list[Codes]
    n_features: int
    seconds: dict[str, float]


class StageClock:
    """Seconds per stage, added up over partitions and threads."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(("features", "gram", "training", "prediction"), 0.0)
        self._lock = Lock()

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Add the time of a block to a stage."""
        start = time.perf_counter()
        yield
        spent = time.perf_counter() - start
        with self._lock:
            self.seconds[stage] += spent


def run_space(
    space: Space,
    X: Floats,
    y: Labels,
    partitions: Sequence[Partition],
    classifier: BaseEstimator,
    *,
    seed: int,
    n_jobs: int | None,
    ticker: Ticker,
) -> SpaceRun:
    """Predict the tested rows of every partition in one feature space.

    Three ways lead to the same labels. Features that learn nothing are computed once for all recordings; with
    `ECOCClassifier` one Gram matrix of all rows follows, of which a partition needs a slice. Another
    classifier gets slices of the features. Features that learn are fitted on the training rows of each
    partition.

    Parameters
    ----------
    space : Space
    X : (n, T, C) float array
        Recordings of equal length, N and N m.
    y : (n,) str array
        Labels.
    partitions : sequence of Partition
        Of all protocols.
    classifier : estimator
        Not changed; each partition fits a clone.
    seed : int
        Sets every ``random_state`` that is None, by partition.
    n_jobs : int or None
        Threads, as in joblib; the numbers do not depend on it.
    ticker : Ticker
        Told about the features and about each partition.

    Returns
    -------
    SpaceRun
    """
    work = _Work(space, y, classifier, seed)
    answer = work.prepare(X)
    ticker.tick(f"{space.name}: ready")

    def run(partition: Partition) -> Codes:
        predicted = answer(partition)
        ticker.tick(f"{space.name}: {partition.protocol}, {partition.description}")
        return predicted

    # Threads, not processes: the Gram is shared and libsvm works outside the interpreter lock.
    predicted = Parallel(n_jobs=n_jobs, require="sharedmem")(delayed(run)(p) for p in partitions)
    return SpaceRun(predicted=predicted, n_features=work.n_features, seconds=work.clock.seconds)


class _Work:
    """One space and one classifier: how a partition is answered."""

    def __init__(self, space: Space, y: Labels, classifier: BaseEstimator, seed: int) -> None:
        self.clock = StageClock()
        self.n_features = 0
        self._space = space
        self._classifier = classifier
        self._seed = seed
        self._labels, codes = np.unique(y, return_inverse=True)
        # Our own classifier names classes in its messages; of others not all take text.
        self._named = isinstance(classifier, ECOCClassifier)
        self._targets = y if self._named else codes

    def prepare(self, X: Floats) -> Callable[[Partition], Codes]:
        """Compute what all partitions share; return the function that answers one."""
        if self._space.learns:
            return partial(self._learning, X)
        with self.clock("features"):
            transformer = clone(self._space.transformer).fit(X)
        features = self._transform(transformer, X)
        if type(self._classifier) is not ECOCClassifier or self._classifier.standardize:
            return partial(self._from_features, features)
        with self.clock("gram"):
            # The origin changes rounding only; the mean of all rows keeps large offsets from spoiling it.
            gram = linear_gram(features, center=features.mean(axis=0))
        return partial(self._from_gram, gram)

    def _from_gram(self, gram: Floats, partition: Partition) -> Codes:
        train, test = partition.train, partition.test
        fitted = _seeded(self._classifier, self._seed, partition)
        with self.clock("training"):
            fitted.fit_gram(gram[np.ix_(train, train)], self._targets[train])
        with self.clock("prediction"):
            return self._codes(fitted.predict_gram(gram[np.ix_(test, train)]))

    def _from_features(self, features: Floats, partition: Partition) -> Codes:
        return self._fit_predict(features[partition.train], features[partition.test], partition)

    def _learning(self, X: Floats, partition: Partition) -> Codes:
        transformer = _seeded(self._space.transformer, self._seed, partition)
        with self.clock("features"):
            transformer.fit(X[partition.train], self._targets[partition.train])
        train = self._transform(transformer, X[partition.train])
        test = self._transform(transformer, X[partition.test])
        return self._fit_predict(train, test, partition)

    def _fit_predict(self, train: Floats, test: Floats, partition: Partition) -> Codes:
        fitted = _seeded(self._classifier, self._seed, partition)
        with self.clock("training"):
            fitted.fit(train, self._targets[partition.train])
        with self.clock("prediction"):
            return self._codes(fitted.predict(test))

    def _codes(self, predicted: Any) -> Codes:
        codes = np.searchsorted(self._labels, predicted) if self._named else predicted
        return np.asarray(codes, dtype=np.intp)

    def _transform(self, transformer: Any, X: Floats) -> Floats:
        with self.clock("features"):
            features = np.asarray(transformer.transform(X), dtype=np.float64)
        if features.ndim != 2:
            raise ValueError(
                f"feature space {self._space.name!r} must give an array (n, D), got shape {features.shape}"
            )
        self.n_features = features.shape[1]
        return features


def _seeded(estimator: Any, seed: int, partition: Partition) -> Any:
    """Clone, and give every open ``random_state`` a seed of its own partition: same seed, same numbers."""
    fresh = clone(estimator)
    names = sorted(
        name
        for name, value in fresh.get_params(deep=True).items()
        if value is None and (name == "random_state" or name.endswith("__random_state"))
    )
    if names:
        words = np.random.SeedSequence(seed, spawn_key=(1, partition.index)).generate_state(len(names))
        fresh.set_params(**{name: int(word) for name, word in zip(names, words, strict=True)})
    return fresh

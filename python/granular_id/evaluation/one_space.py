"""Features, training and prediction of one feature space over all partitions."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._blas import single_threaded_blas
from granular_id._progress import Ticker
from granular_id._seeds import seeded_clone
from granular_id._threads import in_threads
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.chosen import Chosen
from granular_id.evaluation.complaints import heard_complaints, named_errors
from granular_id.evaluation.gram_engine import features_of, plan_for
from granular_id.evaluation.partition import Partition
from granular_id.evaluation.task import STAGES, Answer, Answers, SpaceRun, Task
from granular_id.gram import linear_gram
from granular_id.spaces import GramPlan, block_sizes, tell_blocks

__all__ = ["run_space"]

Floats = NDArray[np.float64]


def run_space(
    task: Task,
    y: NDArray[np.str_],
    partitions: Sequence[Partition],
    *,
    seed: int,
    n_jobs: int | None,
    ticker: Ticker,
    answers: Answers | None = None,
) -> SpaceRun:
    """Predict the tested rows of every partition in one feature space.

    Three ways lead to the same labels. Where scalar products of blocks are all that is needed (`plan_for`, and a
    classifier that ``supports_gram``), a partition is a slice; principal components come from the slice too, and
    any classifier may follow them. Otherwise, features that learn nothing are computed once for all recordings,
    and features that learn are fitted on the training rows of each partition.

    Parameters
    ----------
    task : Task
    y : (n,) str array
        Labels.
    partitions : sequence of Partition
        Of all protocols.
    seed : int
        Sets every ``random_state`` that is None, by partition.
    n_jobs : int or None
        Threads, as in joblib; the numbers do not depend on it.
    ticker : Ticker
        Told when the shared work is done, and about each partition.
    answers : Answers, optional
        Asked before a partition is computed, and given what was computed.

    Returns
    -------
    SpaceRun

    Raises
    ------
    ValueError
        From transformer or classifier, with the name of the space.
    """
    name = task.space.name if task.kind == "space" else task.key
    kind = "feature space" if task.kind == "space" else task.kind
    found = [None if answers is None else answers.load(task.key, partition) for partition in partitions]
    missing = [partition for partition, answer in zip(partitions, found, strict=True) if answer is None]
    computed: Iterator[Answer] = iter(())
    complaints: list[str] = []
    if missing:
        with named_errors(task.space.name, kind):
            work = _Work(task, y, seed)
    ticker.tick(f"{name}: ready")
    for _ in range(len(partitions) - len(missing)):
        ticker.tick(f"{name}: from the checkpoint")
    if missing:

        def run(partition: Partition) -> Answer:
            with named_errors(task.space.name, kind):
                answer = work.answer(partition)
            if answers is not None:
                answers.save(task.key, partition, answer)
            ticker.tick(f"{name}: {partition.protocol}, {partition.description}")
            return answer

        # Threads, not processes: scalar products are shared, and libsvm works outside the interpreter lock. The
        # matrices of a pair of classes are small: more threads for each took twice the time of one.
        with single_threaded_blas(), heard_complaints(name) as complaints:
            computed = iter(in_threads(run, missing, n_jobs))
    every = [next(computed) if answer is None else answer for answer in found]
    seconds = Counter(dict.fromkeys(STAGES, 0.0))
    for spent in (every[-1].shared_seconds, *(answer.seconds for answer in every)):
        seconds.update(spent)
    return SpaceRun(
        predicted=[answer.predicted for answer in every],
        chosen=[answer.chosen for answer in every],
        n_features=every[-1].n_features,
        seconds={stage: float(seconds[stage]) for stage in STAGES},
        complaints=tuple(complaints),
        has_weights=every[-1].has_weights,
    )


class _Clock:
    """Seconds per stage of one partition."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(STAGES, 0.0)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Add the time of a block to a stage."""
        start = time.perf_counter()
        yield
        self.seconds[stage] += time.perf_counter() - start


class _Work:
    """What the partitions of a task share, and how one is answered."""

    def __init__(self, task: Task, y: NDArray[np.str_], seed: int) -> None:
        self._task = task
        self._seed = seed
        self._labels, codes = np.unique(y, return_inverse=True)
        # Our own classifier names classes in its messages; of others not all take text.
        self._named = isinstance(task.classifier, ECOCClassifier)
        self._targets = y if self._named else codes
        # What is the same for all partitions draws from a seed that is.
        self._transformer = _seeded(task.space.transformer, seed)
        self._by_gram = bool(getattr(task.classifier, "supports_gram", False))
        self._features: Floats | None = None
        shared = _Clock()
        plan = plan_for(self._transformer, task.space.name)
        self._plan = plan if plan is not None and (self._by_gram or plan.after) else None
        if self._plan is not None:
            shared.seconds.update(task.bank.prepare(self._plan))
        elif not task.space.learns:
            with shared("features"):
                self._features = self._transformed(self._transformer.fit(task.bank.X), task.bank.X)
        self._shared_seconds = shared.seconds

    def answer(self, partition: Partition) -> Answer:
        """Train on one part of a partition and name the recordings of the other."""
        clock = _Clock()
        targets = self._targets[partition.train]
        if self._task.shuffled:
            words = np.random.SeedSequence(self._seed, spawn_key=(4, partition.index))
            targets = np.random.default_rng(words).permutation(targets)
        fitted = _seeded(self._task.classifier, self._seed, partition)
        if self._plan is not None and not self._plan.after:
            n_features = self._task.bank.n_features(self._plan)
            with clock("gram"):
                train, test = self._task.bank.sliced(self._plan, partition.train, partition.test)
            predicted = self._named_by_gram(fitted, train, test, targets, clock)
        else:
            with clock("features"):
                train, test, sizes = self._rows(partition, targets)
            n_features = train.shape[1]
            if self._by_gram:
                with clock("gram"):
                    center = train.mean(axis=0)
                    train, test = linear_gram(train, center=center), linear_gram(test, train, center=center)
                predicted = self._named_by_gram(fitted, train, test, targets, clock)
            else:
                with clock("training"):
                    self._fit(fitted, train, targets, sizes, partition)
                with clock("prediction"):
                    predicted = fitted.predict(test)
        codes = np.searchsorted(self._labels, predicted) if self._named else predicted
        return Answer(
            predicted=np.asarray(codes, dtype=np.intp),
            n_features=n_features,
            seconds=clock.seconds,
            shared_seconds=self._shared_seconds,
            chosen=Chosen.of(fitted),
            has_weights=self._by_gram or hasattr(fitted, "coef_"),
        )

    def _fit(
        self, classifier: Any, train: Floats, targets: Any, sizes: dict[str, int] | None, partition: Partition
    ) -> None:
        """Train; a classifier that asks is told which columns are a block, and where the rows come from."""
        tell_blocks(classifier, sizes)
        known: dict[str, Any] = {}
        if self._task.origins is not None and not self._task.shuffled:  # shuffled labels come from nowhere
            known = self._task.origins.fit_arguments(classifier, partition.train)
        classifier.fit(train, targets, **known)

    def _named_by_gram(self, fitted: Any, train: Floats, test: Floats, targets: Any, clock: _Clock) -> Any:
        with clock("training"):
            fitted.fit_gram(train, targets)
        with clock("prediction"):
            return fitted.predict_gram(test)

    def _rows(self, partition: Partition, targets: Any) -> tuple[Floats, Floats, dict[str, int] | None]:
        """Features of the training and of the tested rows, and how many columns each block of them has."""
        if self._features is not None:
            sizes = block_sizes(self._transformer)
            return self._features[partition.train], self._features[partition.test], sizes
        seeded = _seeded(self._task.space.transformer, self._seed, partition)
        X = self._task.bank.X
        if self._plan is None:
            seeded.fit(X[partition.train], targets)
            train, test = (self._transformed(seeded, X[rows]) for rows in (partition.train, partition.test))
            return train, test, block_sizes(seeded)
        train, test = self._task.bank.components(self._plan, partition.train, partition.test)
        plan: GramPlan | None = plan_for(seeded)
        for step in () if plan is None else plan.after[1:]:
            step.fit(train, targets)
            train, test = step.transform(train), step.transform(test)
        return train, test, None

    def _transformed(self, fitted: Any, X: Floats) -> Floats:
        return features_of(self._task.space.name, fitted, X)


def _seeded(estimator: Any, seed: int, partition: Partition | None = None) -> Any:
    """Clone, and give every open ``random_state`` a number, another in each partition."""
    key = (3,) if partition is None else (1, partition.index)
    return seeded_clone(estimator, np.random.SeedSequence(seed, spawn_key=key))

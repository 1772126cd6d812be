"""Features, training and prediction of one feature space over all partitions."""

from __future__ import annotations

import secrets
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from granular_id._estimators import heard_complaints, named_errors, seeded_clone
from granular_id._parallel import in_threads, single_threaded_blas
from granular_id._progress import Ticker
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.gram import GramBank, features_of, plan_for
from granular_id.gram import linear_gram
from granular_id.spaces import (
    Chosen,
    FeatureSpace,
    GramPlan,
    block_sizes,
    feature_spaces,
    learns,
    tell_blocks,
)
from granular_id.splits import Origins, Partition

# From the arguments of `evaluate` to a checked plan: which spaces, which seed.


@dataclass(frozen=True)
class Space:
    """A feature space to evaluate: a name and a transformer of (n, T, C) recordings to (n, D) features.

    `classifier` is its own, where it does not take that of the evaluation.
    """

    name: str
    transformer: BaseEstimator
    paper_accuracy: float | None
    learns: bool
    classifier: BaseEstimator | None = None


def plan_seed(random_state: int | None) -> int:
    """Return the seed: the given one, or for None a fresh one that the result will record."""
    if random_state is None:
        return secrets.randbits(32)
    if isinstance(random_state, bool) or not isinstance(random_state, Integral):
        raise TypeError(
            f"random_state must be a whole number or None, got {type(random_state).__name__} {random_state!r}"
        )
    if random_state < 0:
        raise ValueError(f"random_state must not be negative, got {random_state}")
    return int(random_state)


def plan_spaces(
    spaces: str | Sequence[str] | Mapping[str, BaseEstimator | FeatureSpace], rate_hz: float
) -> list[Space]:
    """Turn the `spaces` argument of `evaluate` into a list.

    Parameters
    ----------
    spaces : str, sequence of str or mapping
        ``"all"``: every space but the controls, those of the paper in its order (best accuracy first), then ours.
        ``"paper"``: the paper's alone. Names: those, in the order given. A mapping of name to transformer or
        `FeatureSpace`: those.
    rate_hz : float
        Sampling rate of the recordings, which the named spaces need for their filter and given ones must have.

    Returns
    -------
    list of Space
        A transformer without a boolean attribute ``learns`` counts as learning, the safe side: it is then
        fitted on the training rows of each partition.

    Raises
    ------
    TypeError, ValueError
        Neither of the above; an unknown name; none at all; twice the same; a transformer (or a step of a
        pipeline) whose `rate_hz` is not that of the recordings.
    """
    if isinstance(spaces, Mapping):
        plan = [_own(name, transformer) for name, transformer in spaces.items()]
        for space in plan:
            _refuse_other_rate(space, rate_hz)
    else:
        known = feature_spaces(rate_hz=rate_hz)
        plan = [_known(known[name]) for name in _names(spaces, known)]
    if not plan:
        raise ValueError("spaces must name at least one feature space, got none")
    return plan


def in_paper_order(known: Mapping[str, FeatureSpace]) -> list[str]:
    """Names of feature spaces without the controls: the paper's, best accuracy first, then those it does not have."""
    names = [name for name, space in known.items() if not space.control]
    return sorted(names, key=lambda name: -(known[name].paper_accuracy or 0.0))


def _names(spaces: str | Sequence[str], known: Mapping[str, FeatureSpace]) -> list[str]:
    if spaces == "all":
        return in_paper_order(known)
    if spaces == "paper":
        return [name for name in in_paper_order(known) if known[name].paper_accuracy is not None]
    names = [spaces] if isinstance(spaces, str) else list(spaces)
    for name in names:
        if name not in known:
            choices = ", ".join(map(repr, ("all", "paper", *known)))
            raise ValueError(f"spaces must be among {choices}, got {name!r}")
    if len(set(names)) < len(names):
        raise ValueError(f"spaces must name each feature space once, got {names!r}")
    return names


def _known(space: FeatureSpace) -> Space:
    return Space(space.name, space.transformer, space.paper_accuracy, space.learns, space.classifier)


def _own(name: Any, transformer: Any) -> Space:
    if not isinstance(name, str) or not name:
        raise TypeError(f"spaces: a name must be non-empty text, got {name!r}")
    if isinstance(transformer, FeatureSpace):
        return _known(replace(transformer, name=name))
    if not (hasattr(transformer, "fit") and hasattr(transformer, "transform")):
        raise TypeError(
            f"spaces[{name!r}] must have fit and transform like a scikit-learn transformer, "
            f"got {type(transformer).__name__}"
        )
    return Space(name, transformer, None, learns(transformer))


def _refuse_other_rate(space: Space, rate_hz: float) -> None:
    """Refuse a filter designed for another rate: its cut-off would silently lie elsewhere."""
    get_params = getattr(space.transformer, "get_params", None)
    parameters = {} if get_params is None else get_params(deep=True)
    for key, value in parameters.items():
        if key.rpartition("__")[2] != "rate_hz" or value is None or value == rate_hz:
            continue
        owner = parameters[key.removesuffix("__rate_hz")] if "__" in key else space.transformer
        kind = type(owner).__name__
        raise ValueError(
            f"spaces[{space.name!r}]: {kind} has rate_hz={value:g}, the recordings have {rate_hz:g} Hz: "
            f"pass {kind}(rate_hz={rate_hz:g})"
        )


# What is asked about every partition, and what a partition answers.

Codes = NDArray[np.intp]

STAGES = ("features", "gram", "training", "prediction")


@dataclass(frozen=True, eq=False)
class Task:
    """One space and one classifier, to be asked about every partition.

    Parameters
    ----------
    space : Space
    classifier : estimator
        Not changed; each partition fits a clone.
    bank : GramBank
        Of the recordings; shared by the tasks on the same recordings.
    origins : Origins, optional
        Told to a classifier that asks for sessions or an order; None: it learns nothing about them.
    shuffled : bool
        Whether the labels of the training rows are shuffled first, see `granular_id.evaluation.controls`.
    kind : {"space", "control"}
        A control may be called like a space.
    """

    space: Space
    classifier: BaseEstimator
    bank: GramBank
    origins: Origins | None = None
    shuffled: bool = False
    kind: str = "space"

    @property
    def key(self) -> str:
        """What no other task of an evaluation is called."""
        return f"{self.kind} {self.space.name}"


@dataclass(frozen=True, eq=False)
class Answer:
    """What one partition said.

    Parameters
    ----------
    predicted : (n_test,) int array
        Class numbers.
    n_features : int
        Length of a feature vector.
    seconds : mapping of str to float
        Of this partition alone.
    shared_seconds : mapping of str to float
        Of what all partitions of the space share.
    chosen : Chosen or None
        What a classifier that chooses took.
    has_weights : bool
        Whether the classifier, trained on features, says in `coef_` how it weighs them: such can be drawn.
    """

    predicted: Codes
    n_features: int
    seconds: dict[str, float]
    shared_seconds: dict[str, float]
    chosen: Chosen | None = None
    has_weights: bool = False


class Answers(Protocol):
    """Where answers are kept as they come, see `granular_id.evaluation.checkpoint`."""

    def load(self, task: str, partition: Partition) -> Answer | None:
        """Return the answer of an earlier run, or None."""

    def save(self, task: str, partition: Partition, answer: Answer) -> None:
        """Keep an answer."""


@dataclass(frozen=True, eq=False)
class SpaceRun:
    """Predictions and choices of one space, one per partition, what they took, and what did not converge.

    `has_weights` as in `Answer`, of the last.
    """

    predicted: list[Codes]
    chosen: list[Chosen | None]
    n_features: int
    seconds: dict[str, float]
    complaints: tuple[str, ...] = ()
    has_weights: bool = False


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

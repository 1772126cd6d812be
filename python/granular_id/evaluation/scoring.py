"""Feature spaces over partitions: which ones, with which seeds, and their features or scalar products."""

from __future__ import annotations

import secrets
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from granular_id._estimators import seeded_clone
from granular_id._progress import ProgressCallback
from granular_id.evaluation.gram import GramBank, features_of, plan_for
from granular_id.gram import linear_gram
from granular_id.partitions import Partition
from granular_id.recording import Dataset
from granular_id.spaces import Chosen, FeatureSpace, block_sizes, feature_spaces, learns
from granular_id.splits import Groups

# From the arguments of `evaluate` and `select` to feature spaces and a seed.


def check_arguments(data: Dataset, progress: bool | ProgressCallback) -> None:
    """Refuse what is no data set, and what cannot show progress, before any work."""
    if not isinstance(data, Dataset):
        raise TypeError(f"data must be a granular_id.Dataset, got {type(data).__name__}")
    if not (isinstance(progress, bool) or callable(progress)):
        raise TypeError(f"progress must be True, False or callable, got {type(progress).__name__}")


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
) -> list[FeatureSpace]:
    """Turn the `spaces` argument of `evaluate` into a list, for recordings of this rate."""
    if isinstance(spaces, Mapping):
        plan = [_own_space(name, transformer, rate_hz) for name, transformer in spaces.items()]
    else:
        known = feature_spaces(rate_hz=rate_hz)
        plan = [known[name] for name in _names(spaces, known)]
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


def _own_space(name: Any, given: Any, rate_hz: float) -> FeatureSpace:
    if not isinstance(name, str) or not name:
        raise TypeError(f"spaces: a name must be non-empty text, got {name!r}")
    if isinstance(given, FeatureSpace):
        space = replace(given, name=name)
    elif hasattr(given, "fit") and hasattr(given, "transform"):
        space = FeatureSpace(name, given, None)
    else:
        raise TypeError(
            f"spaces[{name!r}] must have fit and transform like a scikit-learn transformer, "
            f"got {type(given).__name__}"
        )
    _refuse_other_rate(space, rate_hz)
    return space


def _refuse_other_rate(space: FeatureSpace, rate_hz: float) -> None:
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


# What is asked of a space, and what one partition answers.

Floats = NDArray[np.float64]
Codes = NDArray[np.intp]

STAGES = ("features", "gram", "training", "prediction")


@dataclass(frozen=True, eq=False)
class Task:
    """One space and one classifier, to be asked about every partition."""

    space: FeatureSpace
    classifier: BaseEstimator
    bank: GramBank
    """Of the recordings; tasks on the same recordings share it."""
    origins: Groups | None = None
    """Sessions and order, for a classifier that asks for them."""
    shuffled: bool = False
    """Whether the labels of the training rows are shuffled first."""
    kind: str = "space"
    """Or "control", which may be called like a space."""

    @property
    def key(self) -> str:
        """What no other task of an evaluation is called; checkpoints know it."""
        return f"{self.kind} {self.space.name}"

    @property
    def by_gram(self) -> bool:
        """Whether the classifier takes scalar products in place of features."""
        return bool(getattr(self.classifier, "supports_gram", False))


@dataclass(frozen=True, eq=False)
class Answer:
    """What one partition answered; kept in checkpoints."""

    predicted: Codes
    n_features: int
    seconds: dict[str, float]
    """By stage, of this partition alone."""
    shared_seconds: dict[str, float]
    """By stage, of what all partitions share."""
    chosen: Chosen | None = None
    has_weights: bool = False
    """Whether the classifier, trained on features, has weights in `coef_`: such can be drawn."""


def seeded(estimator: Any, seed: int, partition: Partition | None = None) -> Any:
    """Clone, and give every open ``random_state`` a number: one for what partitions share, else one for each."""
    key = (3,) if partition is None else (1, partition.index)
    return seeded_clone(estimator, np.random.SeedSequence(seed, spawn_key=key))


@contextmanager
def timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Add the time of a block to a stage."""
    start = time.perf_counter()
    yield
    seconds[stage] = seconds.get(stage, 0.0) + (time.perf_counter() - start)


class SpaceFeatures:
    """One feature space: features of the rows of any partition, or their scalar products.

    Three ways lead to the same labels. Where scalar products of blocks are all that is needed, a partition is a slice
    of the bank; principal components come from the slice too. Otherwise features that learn nothing are computed once
    for all recordings, and features that learn are fitted on the training rows of each partition.
    """

    def __init__(self, name: str, transformer: Any, bank: GramBank, seed: int, *, by_gram: bool) -> None:
        self._name = name
        self._transformer = transformer
        self._bank = bank
        self._seed = seed
        self._shared = seeded(transformer, seed)
        plan = plan_for(self._shared, name)
        self._plan = plan if plan is not None and (by_gram or plan.after) else None
        self._features: Floats | None = None
        self.shared_seconds = dict.fromkeys(STAGES, 0.0)
        if self._plan is not None:
            self.shared_seconds.update(bank.prepare(self._plan))
        elif not learns(self._shared):
            with timed(self.shared_seconds, "features"):
                self._features = features_of(name, self._shared.fit(bank.X), bank.X)

    def products(
        self, partition: Partition, y: NDArray[Any], seconds: dict[str, float]
    ) -> tuple[Floats, Floats, int]:
        """Products of training rows, those of tested rows with them, and the length of a feature vector."""
        if self._plan is not None and not self._plan.after:  # a slice of the bank
            with timed(seconds, "gram"):
                train, cross = self._bank.sliced(self._plan, partition.train, partition.test)
            return train, cross, self._bank.n_features(self._plan)
        with timed(seconds, "features"):
            train, test, _ = self.rows(partition, y)
        with timed(seconds, "gram"):
            center = train.mean(axis=0)
            return linear_gram(train, center=center), linear_gram(test, train, center=center), train.shape[1]

    def rows(self, partition: Partition, y: NDArray[Any]) -> tuple[Floats, Floats, dict[str, int] | None]:
        """Features of training and of tested rows, and the number of columns of each block where it is known.

        What learns is fitted on the training rows and their labels `y`.
        """
        if self._features is not None:  # computed once for all recordings
            sizes = block_sizes(self._shared)
            return self._features[partition.train], self._features[partition.test], sizes
        transformer = seeded(self._transformer, self._seed, partition)
        if self._plan is None:  # learned from these rows
            X = self._bank.X
            transformer.fit(X[partition.train], y)
            train, test = (
                features_of(self._name, transformer, X[rows]) for rows in (partition.train, partition.test)
            )
            return train, test, block_sizes(transformer)
        train, test = self._bank.components(self._plan, partition.train, partition.test)
        plan: Any = plan_for(transformer)  # the same blocks and steps, with the seeds of this partition
        for step in plan.after[1:]:
            step.fit(train, y)
            train, test = step.transform(train), step.transform(test)
        return train, test, None

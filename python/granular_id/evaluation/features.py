"""Feature spaces on partitions: features, or their scalar products from blocks computed once for all recordings.

A linear classifier needs the scalar products of features alone. Those of a union are the weighted sum of those of its
blocks, those of a partition are a slice: with 682 recordings of 10,200 features a partition costs a copy of 2 MB
instead of 6 thousand million multiplications.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise, takewhile
from threading import Lock
from typing import Any

import numpy as np
from joblib import effective_n_jobs
from numpy.typing import NDArray
from sklearn.base import clone

from granular_id._checks import all_finite
from granular_id._estimators import seeded_clone
from granular_id._memory import check_room, copied, empty, is_large, large_bytes, spans, taken
from granular_id.gram import linear_gram
from granular_id.partitions import Partition
from granular_id.spaces import (
    GramPlan,
    RecordingFilter,
    block_key,
    block_sizes,
    gram_plan,
    learns,
    row_norms,
    steps_of,
    unit_weight,
    works_one_by_one,
)

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


STAGES = ("features", "gram", "training", "prediction")


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


def plan_for(transformer: Any, name: str | None = None) -> GramPlan | None:
    """Say which blocks a space consists of; None where it must be fitted on the training rows of each partition.

    What learns nothing and does not come apart is one block. Messages call a single block by the name of the space.
    """
    plan = gram_plan(transformer)
    if plan is None:
        return None if learns(transformer) else GramPlan(((name or "features", transformer),), None, ())
    if name is not None and len(plan.blocks) == 1:
        return replace(plan, blocks=((name, plan.blocks[0][1]),))
    return plan


def features_of(name: str, transformer: Any, X: Floats, rows: Rows | None = None) -> Floats:
    """Return the features (n, D) of a fitted transformer, or name the space that gives something else.

    Of all recordings, or of those at `rows`. Where these are large they are worked on piece by piece, and so are not
    copied; the features of a piece have the same bits. What is not of this package may look at all of them at once.
    """
    n = len(X) if rows is None else len(rows)
    steps = steps_of(transformer)
    at_first = list(takewhile(works_one_by_one, steps))
    while at_first and len(at_first) < len(steps) and isinstance(at_first[-1], RecordingFilter):
        at_first.pop()  # what it makes are no features yet
    if not is_large(n * X[:1].nbytes) or not at_first:
        some = X if rows is None else taken(X, rows, f"recordings of the space {name!r}")
        return _checked(name, transformer.transform(some), 0)
    features: Any = None
    for span in spans(n, X[:1].nbytes):
        piece: Any = X[span] if rows is None else X[rows[span]]
        for step in at_first:
            piece = step.transform(piece)
        piece = _checked(name, piece, span.start)
        if features is None:
            features = empty((n, piece.shape[1]), f"features of the space {name!r}")
        features[span] = piece
    for step in steps[len(at_first) :]:
        features = step.transform(features)
    return _checked(name, features, 0) if len(at_first) < len(steps) else features


def _checked(name: str, values: Any, first: int) -> Floats:
    """Return finite features (n, D) of the recordings from `first` on."""
    features = np.asarray(values, dtype=np.float64)
    if features.ndim != 2:
        raise ValueError(f"feature space {name!r} must give an array (n, D), got shape {features.shape}")
    if not all_finite(features):
        row, column = (int(i) for i in np.argwhere(~np.isfinite(features))[0])
        raise ValueError(
            f"feature space {name!r} must give finite features, got {features[row, column]} in column {column} "
            f"of recording {first + row}"
        )
    return features


def check_disk(X: Floats, transformers: Iterable[Any], n_jobs: int | None) -> None:
    """Refuse to begin where temporary files have no room for the features of recordings (n, T, C).

    These are about as large as the recordings, once for each thread; and 8 n^2 bytes for each block are kept.
    """
    gram, of_features = 8 * len(X) ** 2, X.nbytes * effective_n_jobs(n_jobs)
    plans = [plan for plan in map(plan_for, transformers) if plan is not None]
    n_blocks = len({_key(block) for plan in plans for _, block in plan.blocks})
    need = of_features * is_large(X.nbytes) + n_blocks * gram * is_large(gram)
    check_room(need, "the features of all recordings")


def by_columns(statistic: Callable[..., Floats], values: Floats, rows: Rows) -> Floats:
    """Take a statistic over some rows of an array (n, ...), for a few columns at a time where large.

    Numpy adds row to row: the bits do not depend on how many columns there are, from two on.
    """
    flat = values.reshape(len(values), -1)
    n_columns = flat.shape[1]
    n_parts = 1
    if is_large(8 * len(rows) * n_columns):
        n_parts = min(max(1, n_columns // 2), math.ceil(32 * len(rows) * n_columns / large_bytes()))
    edges = [n_columns * part // n_parts for part in range(n_parts + 1)]
    parts = (flat[rows, low:high] for low, high in pairwise(edges))
    return np.concatenate([statistic(part, axis=0) for part in parts]).reshape(values.shape[1:])


@dataclass(frozen=True, eq=False)
class _Block:
    """Products about the mean of all rows, norms about zero, and the seconds they took by stage."""

    transformer: Any  # keeps the object alive whose identity may be the key
    gram: Floats
    norms: Floats
    n_features: int
    seconds: dict[str, float]


class GramBank:
    """Scalar products of the recordings (n, T, C) of one data set, in any feature space that has a plan.

    It keeps 8 n^2 bytes for each different block, 3.7 MB for 682 recordings, and no features. Several threads may use
    it. Products are about the mean of all rows, which changes rounding only: a classifier with an intercept, and
    principal components, give the same for any origin.
    """

    def __init__(self, X: Floats) -> None:
        self.X = X
        self._blocks: dict[Hashable, _Block] = {}
        self._components: dict[Hashable, tuple[Floats, Floats]] = {}
        self._lock = Lock()

    def prepare(self, plan: GramPlan) -> dict[str, float]:
        """Compute the blocks of a plan; return the seconds they took by stage, as if no other plan shared them."""
        blocks = self._blocks_of(plan)
        return {stage: sum(block.seconds[stage] for block in blocks) for stage in ("features", "gram")}

    def n_features(self, plan: GramPlan) -> int:
        """Length of a feature vector before the steps that come ``after`` the blocks."""
        return sum(block.n_features for block in self._blocks_of(plan))

    def sliced(self, plan: GramPlan, train: Rows, test: Rows) -> tuple[Floats, Floats]:
        """Products (n_train, n_train) of training rows, and (n_test, n_train) of tested rows with them.

        Weights "unit" are learned from the training rows. Steps ``after`` the blocks are not taken.
        """
        blocks = self._blocks_of(plan)
        weights = [1.0] * len(blocks)
        if plan.block_weights == "unit":
            weights = [unit_weight(block.norms[train]) for block in blocks]
        elif isinstance(plan.block_weights, tuple):
            weights = list(plan.block_weights)
        train_gram, cross_gram = np.zeros((train.size, train.size)), np.zeros((test.size, train.size))
        for weight, block in zip(weights, blocks, strict=True):
            for rows, gram in ((train, train_gram), (test, cross_gram)):
                for span in spans(rows.size, 8 * train.size):  # a copy of some rows at a time, not of all
                    gram[span] += weight**2 * block.gram[np.ix_(rows[span], train)]
        return train_gram, cross_gram

    def components(self, plan: GramPlan, train: Rows, test: Rows) -> tuple[Floats, Floats]:
        """Scores of training and of tested rows on the principal components of the training rows, read-only.

        The first step ``after`` the blocks is `PrincipalComponents`. Spaces that go on from the same components share
        them.
        """
        first = plan.after[0]
        blocks = tuple(_key(transformer) for _, transformer in plan.blocks)
        key = (blocks, plan.block_weights, _key(first), train.tobytes(), test.tobytes())
        known = self._components.get(key)
        if known is None:
            train_gram, cross_gram = self.sliced(plan, train, test)
            fitted = clone(first).fit_gram(train_gram)
            known = fitted.transform_gram(train_gram), fitted.transform_gram(cross_gram)
            for scores in known:
                scores.setflags(write=False)
            self._components[key] = known
        return known

    def _blocks_of(self, plan: GramPlan) -> list[_Block]:
        return [self._block(name, transformer) for name, transformer in plan.blocks]

    def _block(self, name: str, transformer: Any) -> _Block:
        key = _key(transformer)
        with self._lock:
            if key not in self._blocks:
                start = time.perf_counter()
                # What learns nothing takes no more than the shape: one recording shows it, and is not copied.
                as_one = is_large(self.X.nbytes) and all(map(works_one_by_one, steps_of(transformer)))
                fitted = clone(transformer).fit(self.X[:1] if as_one else self.X)
                features = features_of(name, fitted, self.X)
                ready = time.perf_counter()
                gram = linear_gram(features, center=features.mean(axis=0))
                if is_large(
                    gram.nbytes
                ):  # made in memory, where it is added to again and again; kept on disk
                    gram = copied(gram, f"products of {name!r}")
                norms = row_norms(features)
                seconds = {"features": ready - start, "gram": time.perf_counter() - ready}
                self._blocks[key] = _Block(transformer, gram, norms, features.shape[1], seconds)
            return self._blocks[key]


def _key(transformer: Any) -> Hashable:
    """Equal for transformers that give equal features; what cannot be compared is equal to itself only."""
    try:
        key = block_key(transformer)
        hash(key)
    except TypeError:
        return id(transformer)
    return key


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
            what = f"features of the space {self._name!r}"
            train, test = (taken(self._features, rows, what) for rows in (partition.train, partition.test))
            return train, test, sizes
        transformer = seeded(self._transformer, self._seed, partition)
        if self._plan is None:  # learned from these rows
            X = self._bank.X
            transformer.fit(taken(X, partition.train, f"recordings of the space {self._name!r}"), y)
            train, test = (
                features_of(self._name, transformer, X, rows) for rows in (partition.train, partition.test)
            )
            return train, test, block_sizes(transformer)
        train, test = self._bank.components(self._plan, partition.train, partition.test)
        plan: Any = plan_for(transformer)  # the same blocks and steps, with the seeds of this partition
        for step in plan.after[1:]:
            step.fit(train, y)
            train, test = step.transform(train), step.transform(test)
        return train, test, None

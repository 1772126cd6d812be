"""Scalar products of feature spaces: each elementary block once, each space and partition by slices and sums.

A linear classifier needs of its features their scalar products alone. Those of a union of blocks are the
weighted sum of those of the blocks, those of a partition are a slice: with 682 recordings of 10,200 features a
partition costs a copy of 2 MB instead of 6 thousand million multiplications. Principal components come from the
same slices. What does not decompose so (`plan_for` gives None) takes the general way, on features.

An evaluation and a selection over the same recordings share one `GramBank`: ask `plan_for` for a plan of each
transformer, then the bank for `GramBank.sliced` products of training and test rows, or for
`GramBank.components` where principal components follow.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Hashable
from dataclasses import dataclass, replace
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from granular_id.gram import linear_gram
from granular_id.spaces import GramPlan, block_key, gram_plan, learns, row_norms, unit_weight

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


def plan_for(transformer: Any, name: str | None = None) -> GramPlan | None:
    """Say how the scalar products of a feature space follow from blocks, or None where they do not.

    Parameters
    ----------
    transformer : estimator
        Turns recordings (n, T, C) into features (n, D).
    name : str, optional
        What messages call a space that is one block as a whole; default: its class.

    Returns
    -------
    GramPlan or None
        As `granular_id.spaces.gram_plan`, and one block for anything else that learns nothing. None: something
        is learned from features themselves, and the space must be fitted on the training rows of each partition.

    Examples
    --------
    >>> from granular_id.spaces import BlockUnion, HFMH, RawSignal
    >>> union = BlockUnion([("raw", RawSignal()), ("hfmh", HFMH())], block_weights="unit")
    >>> [name for name, _ in plan_for(union).blocks]
    ['raw', 'hfmh']
    >>> plan_for(HFMH(bin_range="auto")) is None
    True
    """
    plan = gram_plan(transformer)
    if plan is None:
        return None if learns(transformer) else GramPlan(((name or "features", transformer),), None, ())
    if name is not None and len(plan.blocks) == 1:
        return replace(plan, blocks=((name, plan.blocks[0][1]),))
    return plan


def features_of(name: str, transformer: Any, X: Floats) -> Floats:
    """Return the features (n, D) of a fitted transformer, or name the space that gives something else."""
    features = np.asarray(transformer.transform(X), dtype=np.float64)
    if features.ndim != 2:
        raise ValueError(f"feature space {name!r} must give an array (n, D), got shape {features.shape}")
    if not np.isfinite(features).all():
        row, column = (int(i) for i in np.argwhere(~np.isfinite(features))[0])
        raise ValueError(
            f"feature space {name!r} must give finite features, got {features[row, column]} in column {column} "
            f"of recording {row}"
        )
    return features


@dataclass(frozen=True, eq=False)
class _Block:
    """What is kept of one block: products about the mean of all rows, norms about zero, and what they took."""

    transformer: Any  # keeps the object alive whose identity may be the key
    gram: Floats
    norms: Floats
    n_features: int
    seconds: dict[str, float]


class GramBank:
    """Scalar products of the recordings of one data set, in any feature space that has a plan.

    Parameters
    ----------
    X : (n, T, C) float array
        All recordings, N and N m. Not copied, not changed.

    Notes
    -----
    Keeps 8 n^2 bytes for each different block, 3.7 MB for 682 recordings; features are not kept. May be used
    by several threads. Products are about the mean of all rows, which changes rounding only: a classifier with
    an intercept, and principal components, give the same for any origin.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.spaces import RawSignal
    >>> X = np.random.default_rng(0).normal(size=(6, 20, 6))
    >>> bank = GramBank(X)
    >>> train, cross = bank.sliced(plan_for(RawSignal()), np.arange(4), np.arange(4, 6))
    >>> train.shape, cross.shape
    ((4, 4), (2, 4))
    """

    def __init__(self, X: Floats) -> None:
        self.X = X
        self._blocks: dict[Hashable, _Block] = {}
        self._components: dict[Hashable, tuple[Floats, Floats]] = {}
        self._lock = Lock()

    def prepare(self, plan: GramPlan) -> dict[str, float]:
        """Compute what is not there yet; return the seconds that the blocks of a plan took, by stage.

        A block that several plans share is counted for each of them: that is what each would take alone.
        """
        blocks = self._blocks_of(plan)
        return {stage: sum(block.seconds[stage] for block in blocks) for stage in ("features", "gram")}

    def n_features(self, plan: GramPlan) -> int:
        """Length of a feature vector before the steps that come ``after``."""
        return sum(block.n_features for block in self._blocks_of(plan))

    def sliced(self, plan: GramPlan, train: Rows, test: Rows) -> tuple[Floats, Floats]:
        """Scalar products of training rows with each other, and of test rows with training rows.

        Parameters
        ----------
        plan : GramPlan
            From `plan_for`. Its steps ``after`` the blocks are not taken here.
        train, test : (n_train,) and (n_test,) int arrays
            Rows of `X`. Weights "unit" are learned from the training rows.

        Returns
        -------
        train_gram : (n_train, n_train) float array
        cross_gram : (n_test, n_train) float array
        """
        blocks = self._blocks_of(plan)
        weights = [1.0] * len(blocks)
        if plan.block_weights == "unit":
            weights = [unit_weight(block.norms[train]) for block in blocks]
        elif isinstance(plan.block_weights, tuple):
            weights = list(plan.block_weights)
        within, across = np.ix_(train, train), np.ix_(test, train)
        train_gram, cross_gram = np.zeros((train.size, train.size)), np.zeros((test.size, train.size))
        for weight, block in zip(weights, blocks, strict=True):
            train_gram += weight**2 * block.gram[within]
            cross_gram += weight**2 * block.gram[across]
        return train_gram, cross_gram

    def components(self, plan: GramPlan, train: Rows, test: Rows) -> tuple[Floats, Floats]:
        """Scores of training and test rows on the principal components of the training rows.

        Kept, so that spaces which go on from the same components share them.

        Parameters
        ----------
        plan : GramPlan
            From `plan_for`, with `PrincipalComponents` as the first step ``after`` the blocks.
        train, test : int arrays
            Rows of `X`.

        Returns
        -------
        (n_train, p) and (n_test, p) float arrays
            Read-only.
        """
        first = plan.after[0]
        rows = hashlib.blake2b(train.tobytes() + b"|" + test.tobytes()).digest()
        blocks = tuple(_key(transformer) for _, transformer in plan.blocks)
        key = (blocks, plan.block_weights, _key(first), rows)
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
                self._blocks[key] = self._computed(name, transformer)
            return self._blocks[key]

    def _computed(self, name: str, transformer: Any) -> _Block:
        start = time.perf_counter()
        features = features_of(name, clone(transformer).fit(self.X), self.X)
        ready = time.perf_counter()
        gram = linear_gram(features, center=features.mean(axis=0))
        norms = row_norms(features)
        end = time.perf_counter()
        return _Block(
            transformer, gram, norms, features.shape[1], {"features": ready - start, "gram": end - ready}
        )


def _key(transformer: Any) -> Hashable:
    """Equal for transformers that give equal features; a stranger is equal to itself only."""
    try:
        key = block_key(transformer)
        hash(key)
    except TypeError:
        return id(transformer)
    return key

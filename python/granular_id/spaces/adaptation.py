"""Linear classifiers brought to another set-up: what recordings of it say about offsets and scales of features.

All of it takes and gives weights and intercepts, so that a model stays one matrix. What is known of the training are
mean and spread of each column and the mean scores of each class (`SourceStatistics`): a shift of the features by d is a
shift of the scores by ``coef @ d``, so shifts are found and applied where they are smallest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from granular_id._core import GranularIdError
from granular_id.spaces.scaling import block_factors, block_slices, column_moments

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
Losses = Callable[[FloatArray], FloatArray]

LEAST_ROWS = 3
"""Fewest labelled recordings, or recordings a material in the mean: fewer give less than chance does."""

# Measured on real recordings under other loads, speeds, sensors and people, on synthetic rigs and on halves of
# sessions; docs/guide/setups.md has the outcome.
_ROUNDS, _RECENTRED, _EVEN_STEPS = 2, 2, 30
_WIDTH = 0.15  # of a membership, in medians of the margin
_MOST_ROWS = 5
_LEAST_SCALE, _MOST_SCALE = 0.2, 5.0
_PRIOR_ROWS = 1.0
_RIDGE, _RIDGE_UNSURE = 0.1, 1.0
_LEAST_SHARE = 1e-12
_COLUMNS_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class Learners:
    """Linear binary learners on D columns, L of them for K classes, and how their scores become losses (n, K)."""

    coef: FloatArray  # (L, D)
    intercept: FloatArray  # (L,)
    coding: npt.NDArray[np.int8]  # (K, L)
    losses: Losses

    def scores(self, X: FloatArray) -> FloatArray:
        """Score rows (n, D): (n, L)."""
        scored: FloatArray = X @ self.coef.T + self.intercept
        return scored

    def answers(self, X: FloatArray) -> IntArray:
        """Name the class (n,) of each row."""
        codes: IntArray = self.losses(self.scores(X)).argmin(axis=1)
        return codes

    def shifted(self, offset: FloatArray) -> Learners:
        """Take an offset (L,) from all scores."""
        return replace(self, intercept=self.intercept - offset)


@dataclass(frozen=True, eq=False)
class SourceStatistics:
    """What is stored of the training rows; `mean` is None where it has no meaning any more."""

    mean: FloatArray | None  # (D,) mean of the class means of each column
    sd: FloatArray  # (D,) of all rows
    scores: FloatArray  # (K, L) mean scores of the rows of each class

    @classmethod
    def of(cls, X: FloatArray, codes: IntArray, learners: Learners) -> SourceStatistics:
        """Summarise training rows (n, D) of classes `codes` (n,), of which each has one."""
        means = np.array([X[codes == k].mean(axis=0) for k in range(len(learners.coding))])
        sd = np.empty(X.shape[1])
        for start in range(0, sd.size, _COLUMNS_AT_ONCE):  # X may be too large for memory
            columns = slice(start, start + _COLUMNS_AT_ONCE)
            sd[columns] = column_moments(X[:, columns])[1]
        return cls(means.mean(axis=0), sd, learners.scores(means))


def adapted_to_all(
    learners: Learners, source: SourceStatistics, X: FloatArray, blocks: Mapping[str, int] | None
) -> tuple[Learners, SourceStatistics]:
    """Bring learners to the set-up of rows (n, D) that hold all classes about equally, without labels.

    Without `blocks` self-training only recentres. Returns the statistics as the new learners see them, too.
    Equal shares: Asano et al., "Self-labelling via simultaneous clustering and representation learning" (ICLR 2020).
    """
    least = LEAST_ROWS * len(learners.coding)
    if len(X) < least:
        raise GranularIdError(
            f"all_materials=True needs {LEAST_ROWS} recordings a material in the mean, {least} for "
            f"{len(learners.coding)} materials, got {len(X)}: record more, or give labels (--labelled)"
        )
    learners, source = standardised(learners, source, X)
    return self_trained(learners, source, X, blocks), source


def standardised(
    learners: Learners, source: SourceStatistics, X: FloatArray
) -> tuple[Learners, SourceStatistics]:
    """Give each column of rows (n, D), of all classes about equally, the mean and the spread of the training.

    Returns the statistics as the new learners see them, too.
    """
    if source.mean is None:
        raise GranularIdError(
            "all_materials=True starts from the columns of the training, and this model has been adapted since: "
            "adapt the model that it was made from"
        )
    mean, sd = column_moments(X)
    scale = np.ones_like(sd)
    np.divide(source.sd, sd, out=scale, where=sd > 0)
    scale = np.clip(scale, _LEAST_SCALE, _MOST_SCALE)
    constant = learners.coef @ (source.mean - scale * mean)
    moved = replace(learners, coef=learners.coef * scale, intercept=learners.intercept + constant)
    return moved, SourceStatistics(mean, source.sd / scale, source.scores)


def self_trained(
    learners: Learners, source: SourceStatistics, X: FloatArray, blocks: Mapping[str, int] | None
) -> Learners:
    """Correct scores by rows (n, D) as `adapted_by_labels` does, by memberships that the scores give in their place.

    Classes that are named too often are named less. Regression follows that by one step only: what it learns does not
    go away.
    """
    for _ in range(_ROUNDS):
        for _ in range(_RECENTRED):
            scores = learners.scores(X)
            members = _memberships(learners.losses(scores), _EVEN_STEPS)
            learners = learners.shifted(_own_offsets(scores, members, source, learners.coding))
        if blocks is not None:
            members = _memberships(learners.losses(learners.scores(X)), 1)
            learners = _regressed(learners, source, X, members, blocks, _RIDGE_UNSURE)
    return learners


def adapted_by_labels(
    learners: Learners,
    source: SourceStatistics,
    X: FloatArray,
    codes: IntArray,
    blocks: Mapping[str, int] | None,
) -> Learners:
    """Correct scores by rows (n, D) whose classes `codes` (n,) are known.

    Each learner is recentred on its own classes; what is left between scores and the mean scores of the training is
    learned by ridge regression on the columns, standardised and with blocks of equal weight; not without blocks.
    """
    members = np.eye(len(learners.coding))[codes]
    learners = learners.shifted(_own_offsets(learners.scores(X), members, source, learners.coding))
    return learners if blocks is None else _regressed(learners, source, X, members, blocks, _RIDGE)


def _regressed(
    learners: Learners,
    source: SourceStatistics,
    X: FloatArray,
    members: FloatArray,
    blocks: Mapping[str, int],
    ridge_share: float,
) -> Learners:
    """Take from scores what of their difference to the mean scores of the training the columns explain."""
    residuals = learners.scores(X) - members @ source.scores
    factors = block_factors(source.sd, block_slices(blocks, source.sd.size))
    factors *= learners.coef.any(axis=0)  # a block that was left out stays out
    mean = X.mean(axis=0)
    rows = (X - mean) * factors
    ridge = ridge_share * float((rows * rows).sum()) / len(rows)
    if not ridge > 0:
        return learners
    if len(rows) > rows.shape[1]:
        moments = rows.T @ rows + ridge * np.eye(rows.shape[1])
        correction = np.linalg.solve(moments, rows.T @ residuals).T * factors
    else:
        gram = rows @ rows.T + ridge * np.eye(len(rows))
        correction = np.linalg.solve(gram, residuals).T @ (rows * factors)
    return replace(
        learners, coef=learners.coef - correction, intercept=learners.intercept + correction @ mean
    )


def _memberships(losses: FloatArray, even_steps: int) -> FloatArray:
    """Share (n, K) that each class has in each row; steps of Sinkhorn & Knopp make the shares of all classes equal."""
    least = np.partition(losses, 1, axis=1)
    width = max(_WIDTH * float(np.median(least[:, 1] - least[:, 0])), _LEAST_SHARE)
    members: FloatArray = np.exp((losses.min(axis=1, keepdims=True) - losses) / width)
    members /= members.sum(axis=1, keepdims=True)
    for _ in range(even_steps):
        members /= np.maximum(members.sum(axis=0), _LEAST_SHARE)
        members /= members.sum(axis=1, keepdims=True)
    return members


def _own_offsets(
    scores: FloatArray, members: FloatArray, source: SourceStatistics, coding: npt.NDArray[np.int8]
) -> FloatArray:
    """Offset (L,) of each learner: that of the classes on its two sides, drawn to the common one if rows are few."""
    counts = members.sum(axis=0)
    known = counts > 0
    offsets = np.zeros_like(source.scores)
    offsets[known] = (members[:, known] / counts[known]).T @ scores - source.scores[known]
    weights = np.minimum(counts, _MOST_ROWS)
    common = weights @ offsets / weights.sum()
    own = np.array(common, dtype=np.float64)
    for learner, column in enumerate(coding.T):
        sides = [np.flatnonzero((column == sign) & known) for sign in (1, -1)]
        if all(side.size for side in sides):
            least = float(counts[np.concatenate(sides)].min())
            midpoint = float(np.mean([offsets[side, learner].mean() for side in sides]))
            own[learner] += (midpoint - own[learner]) * least / (least + _PRIOR_ROWS)
    return own

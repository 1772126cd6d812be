"""Linear classifiers brought to another set-up: what recordings of it say about offsets and scales of features.

All of it takes and gives weights and intercepts, so that a model stays one matrix. What is known of the training are
mean and spread of each column and the mean scores of each class (`SourceStatistics`): a shift of the features by d is a
shift of the scores by ``coef @ d``, so shifts are found and applied where they are smallest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt
from sklearn.utils.validation import check_is_fitted, validate_data

from granular_id._checks import checked_flag
from granular_id._estimators import origin_of
from granular_id._parallel import single_threaded_blas
from granular_id.recording import Dataset
from granular_id.spaces.scaling import BlockSizes, block_slices, column_moments, own_blocks

if TYPE_CHECKING:
    from typing_extensions import Self

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
Label = TypeVar("Label")
Losses = Callable[[FloatArray], FloatArray]

_LEAST_ROWS = 3
"""Labelled recordings, or recordings a material in the mean, of which less is said than chance says."""

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
    """What is kept of the training rows; `mean` is None where it has no meaning any more."""

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


def check_way(labels: object, all_materials: bool, allow_missing: bool) -> None:
    """Refuse neither and both of the two ways to adapt; missing materials may be allowed where labels are given."""
    if (labels is not None) == checked_flag("all_materials", all_materials):
        raise ValueError(
            f"adapting needs one of two ways, got {'both' if all_materials else 'neither'}: give the labels of a few "
            "recordings of each material, or pass all_materials=True, which declares that the recordings hold all "
            "materials about equally"
        )
    if checked_flag("allow_missing", allow_missing) and all_materials:
        raise ValueError(
            "leave out allow_missing=True: all_materials=True declares that no material is missing"
        )


def adapted_to_all(
    learners: Learners, source: SourceStatistics, X: FloatArray, blocks: Mapping[str, int] | None
) -> tuple[Learners, SourceStatistics]:
    """Bring learners to the set-up of rows (n, D) that hold all classes about equally, without labels.

    Without `blocks` self-training only recentres. Returns the statistics as the new learners see them, too.
    """
    least = _LEAST_ROWS * len(learners.coding)
    if len(X) < least:
        raise ValueError(
            f"all_materials=True needs {_LEAST_ROWS} recordings a material in the mean, {least} for "
            f"{len(learners.coding)} materials, got {len(X)}: record more, or give labels"
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
        raise ValueError(
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
    factors = _factors(source.sd, blocks) * learners.coef.any(axis=0)  # a block that was left out stays out
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


def _factors(sd: FloatArray, blocks: Mapping[str, int]) -> FloatArray:
    """Factor (D,) of each column that gives it unit spread, and blocks equal weight; 0 of a constant one."""
    varying = sd > 0
    factors = np.zeros_like(sd)
    np.divide(1.0, sd, out=factors, where=varying)
    start = 0
    for size in blocks.values():
        columns = slice(start, start + size)
        n_varying = int(np.count_nonzero(varying[columns]))
        factors[columns] /= np.sqrt(max(n_varying, 1) * len(blocks))
        start += size
    return factors


class AdaptableClassifier:
    """A fitted classifier of linear learners (`coef_`, `intercept_`, `coding_matrix_`) that can be adapted."""

    blocks: BlockSizes
    classes_: npt.NDArray[Any]
    coding_matrix_: npt.NDArray[np.int8]
    coef_: FloatArray
    intercept_: FloatArray
    n_features_in_: int
    source_: SourceStatistics

    def _values(self, scores: FloatArray) -> FloatArray:
        raise NotImplementedError

    def adapt(
        self,
        X: npt.ArrayLike,
        y: npt.ArrayLike,
        X_new: npt.ArrayLike,
        y_new: npt.ArrayLike | None = None,
        *,
        all_materials: bool = False,
        allow_missing: bool = False,
    ) -> Self:
        """Return a classifier for another set-up, learned from recordings of it: with labels, or of all classes.

        Parameters
        ----------
        X : array-like, shape (n, D)
            Plain features of the training rows, as given to `fit`.
        y : array-like, shape (n,)
            Their labels.
        X_new : array-like, shape (m, D)
            Features of recordings of the new set-up.
        y_new : array-like, shape (m,), optional
            Their labels, each of `classes_`: a few of each class. Either these or `all_materials`.
        all_materials : bool, default False
            Declare that `X_new` holds all classes about equally: each column gets mean and spread of the training, and
            self-training follows. Loses where it is not so: with half of the classes 2 to 18 points.
        allow_missing : bool, default False
            With labels, go on without some of the classes. What is learned of the others does not carry over to them.

        Returns
        -------
        Self
            A new classifier with other `coef_` and `intercept_`, and no `held_out_scores_`; this one stays. The new one
            keeps what is known of the training rows (`source_`), and goes by that when it is adapted again.

        Raises
        ------
        TypeError, ValueError
            Neither labels nor `all_materials`, or both; a `Dataset` in place of features, another number of columns,
            NaN or infinity; labels that were not in training, fewer than three labelled rows, classes that are missing:
            the message names them; with `all_materials` fewer than three rows a class, in the mean, or a classifier
            that was adapted before.

        Notes
        -----
        With labels each learner is recentred on its own classes, with few rows more on all of them; the difference that
        is left to the mean scores of the training is learned by kernel ridge regression on standardised columns, with a
        ridge of 0.1 of the mean squared norm of the rows. It is linear, too.

        With `all_materials` two rounds of self-training do the same with memberships in place of labels:
        exp(-loss / w), w = 0.15 of the median margin, over their sum. 30 steps of Sinkhorn and Knopp make the shares of
        all classes equal for recentring, one step for the regression, whose ridge is the mean squared norm of the rows.

        References
        ----------
        Equal shares: Asano et al., "Self-labelling via simultaneous clustering and representation learning" (ICLR
        2020).

        Examples
        --------
        >>> from sklearn.datasets import load_iris
        >>> from granular_id import BestClassifier
        >>> X, y = load_iris(return_X_y=True)
        >>> clf = BestClassifier().fit(X[::2], y[::2])
        >>> moved = X[1::2] + [0.5, 0.0, 1.0, 0.5]
        >>> new = clf.adapt(X[::2], y[::2], moved, all_materials=True)
        >>> bool((clf.predict(moved) == y[1::2]).mean() < 0.7 < 0.9 < (new.predict(moved) == y[1::2]).mean())
        True
        """
        check_way(y_new, all_materials, allow_missing)
        with single_threaded_blas():
            learners, source, blocks = self._known(X, y)
            rows = self._rows(X_new, "X_new")
            if y_new is None:
                made, known = adapted_to_all(learners, source, rows, blocks)
            else:
                codes, _ = codes_and_missing(
                    np.asarray(y_new), self.classes_, len(rows), "y_new", allow_missing
                )
                made, known = adapted_by_labels(learners, source, rows, codes, blocks), source
        return self._with(made, known)

    def _known(self, X: Any, y: Any) -> tuple[Learners, SourceStatistics, dict[str, int]]:
        check_is_fitted(self)
        rows = self._rows(X, "X")
        slices = block_slices(own_blocks(self.blocks, origin_of(X)), self.n_features_in_)
        codes = codes_of(np.asarray(y), self.classes_, len(rows), "y")
        missing = missing_of(codes, self.classes_.tolist())
        if missing:
            raise ValueError(f"y must hold every class of the training, {missing[0]!r} is missing")
        learners = Learners(
            self.coef_, self.intercept_, self.coding_matrix_, lambda scores: -self._values(scores)
        )
        sizes = {name: columns.stop - columns.start for name, columns in slices.items()}
        source = getattr(self, "source_", None)
        return learners, SourceStatistics.of(rows, codes, learners) if source is None else source, sizes

    def _rows(self, X: Any, name: str) -> FloatArray:
        if isinstance(X, Dataset):
            raise TypeError(
                f"{name} must be features, got a Dataset: pass those of a feature space, as in "
                "MultiBand().fit_transform(data), or adapt an Identifier, which takes recordings"
            )
        rows: FloatArray = validate_data(self, X, dtype=np.float64, reset=False)
        return rows

    def _with(self, learners: Learners, source: SourceStatistics) -> Self:
        made = deepcopy(self)
        made.coef_, made.intercept_ = learners.coef, learners.intercept
        made.source_ = replace(
            source, mean=None
        )  # another time the columns are no longer those of the training
        if hasattr(made, "held_out_scores_"):  # of the learners as they were
            del made.held_out_scores_
        return made


def codes_of(labels: npt.NDArray[Any], classes: npt.NDArray[Any], n: int, name: str) -> IntArray:
    """Return the place of each of n labels among the classes; refuse others."""
    if labels.shape != (n,):
        raise ValueError(f"{name} must hold a label for each of {n} rows, got shape {labels.shape}")
    codes = {label: code for code, label in enumerate(classes.tolist())}
    unknown = next((label for label in labels.tolist() if label not in codes), None)
    if unknown is not None:
        raise ValueError(f"{name} must hold labels of the training, got {unknown!r}")
    return np.array([codes[label] for label in labels.tolist()], dtype=np.intp)


def missing_of(codes: IntArray, labels: Sequence[Label]) -> list[Label]:
    """Return the classes that no row has."""
    there = set(codes.tolist())
    return [label for code, label in enumerate(labels) if code not in there]


def codes_and_missing(
    labels: npt.NDArray[Any], classes: npt.NDArray[Any], n: int, name: str, allow_missing: bool
) -> tuple[IntArray, list[str]]:
    """Return the classes of n rows to adapt by, and those without a row; refuse too few rows, and missing classes."""
    codes = codes_of(labels, classes, n, name)
    if n < _LEAST_ROWS:
        raise ValueError(
            f"adapting by labels needs at least {_LEAST_ROWS} recordings, got {n}: the offset of one cannot be told "
            "from its material; record more, of more materials"
        )
    missing = [str(label) for label in missing_of(codes, classes.tolist())]
    if missing and not allow_missing:
        raise ValueError(
            f"adapting by labels needs recordings of every material, {', '.join(missing)} "
            f"{'is' if len(missing) == 1 else 'are'} missing: what the others show does not carry over; record them, "
            "or pass allow_missing=True"
        )
    return codes, missing

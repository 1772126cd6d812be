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

from granular_id._checks import checked_flag, whole_number
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

LEAST_ROWS = 3
"""Recordings, and with `all_materials` recordings a material in the mean, of which less is said than chance says."""

# Measured on real recordings under other loads, speeds, sensors and people, on synthetic rigs and on halves of
# sessions, with all, half, three of the materials and unequal shares; docs/guide/setups.md has the outcome.
_STEPS, _KEPT, _MOST_ROWS = 4, 0.7, 5
_STILL_ROWS, _STILL_ROWS_A_CLASS = 20.0, 1.0  # added to those that ask for a shift, so that few move little
_WIDTH = 0.15  # of a membership, in medians of the margin
_RECENTRED, _EVEN_STEPS = 2, 30
_LEAST_SCALE, _MOST_SCALE = 0.2, 5.0
_LEAST_SLOPE, _SHARE_FOR_SLOPE = 0.8, 0.25  # less takes a session of one material for one of all
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
        return _answers(self.losses(self.scores(X)))[0]

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


def checked_rounds(rounds: int | None, all_materials: bool) -> int:
    """Return the rounds of self-training: those that are asked for, or the default of the method."""
    default = 2 if checked_flag("all_materials", all_materials) else 0
    return default if rounds is None else whole_number("rounds", rounds, least=0)


def adapted(
    learners: Learners,
    source: SourceStatistics,
    X: FloatArray,
    *,
    all_materials: bool,
    rounds: int,
    blocks: Mapping[str, int] | None = None,
    caution: float = 0.0,
) -> tuple[Learners, SourceStatistics]:
    """Bring learners to the set-up of rows (n, D) without labels, as `AdaptableClassifier.adapt` says it.

    Without `blocks` self-training only recentres.
    """
    refuse_few(len(X), "adapting")
    least = LEAST_ROWS * len(learners.coding)
    if all_materials and len(X) < least:
        raise ValueError(
            f"all_materials=True needs {LEAST_ROWS} recordings a material in the mean, {least} for "
            f"{len(learners.coding)} materials, got {len(X)}: record more, or leave all_materials out"
        )
    if all_materials:
        learners, source = standardised(learners, source, X)
    else:
        learners = balanced_shift(recentred(learners, source, X), source, X, caution=caution)
    return self_trained(learners, source, X, rounds, blocks, even=all_materials), source


def recentred(learners: Learners, source: SourceStatistics, X: FloatArray) -> Learners:
    """Take the difference of the mean scores of rows (n, D) to those of the training, less so where rows are few."""
    offset = learners.scores(X).mean(axis=0) - source.scores.mean(axis=0)
    return learners.shifted(offset * (len(X) / (len(X) + _STILL_ROWS)))


def balanced_shift(
    learners: Learners, source: SourceStatistics, X: FloatArray, *, caution: float = 0.0
) -> Learners:
    """Take the common offset of rows (n, D) of another set-up from the scores, whatever classes they hold.

    Rows are named, the surest of each class are kept, and their mean scores are compared with those of the training:
    one offset for all classes, and one slope, since scores of rows that did not train are smaller. Each class counts
    by its rows, at most 5 of them; with less than a quarter of the classes the slope stays 1. A row a class, and
    `caution` more, ask for no offset.
    """
    scores, n_classes = learners.scores(X), len(learners.coding)
    offset = np.zeros(scores.shape[1])
    still = (_STILL_ROWS_A_CLASS + caution) * n_classes
    for _ in range(_STEPS):
        rows, codes = _surest(learners.losses(scores - offset), n_classes)
        present, counts = np.unique(codes, return_counts=True)
        weights = np.minimum(counts, _MOST_ROWS).astype(np.float64)
        total = weights.sum()
        found = np.array([scores[rows[codes == k]].mean(axis=0) for k in present])
        known = source.scores[present]
        mean_found, mean_known = weights @ found / total, weights @ known / total
        within = weights @ ((known - mean_known) ** 2).sum(axis=1)
        slope = 1.0
        if within > 0 and total**2 >= _SHARE_FOR_SLOPE * n_classes * (weights @ weights):
            slope = weights @ ((found - mean_found) * (known - mean_known)).sum(axis=1) / within
        slope = float(np.clip(slope, _LEAST_SLOPE, 1.0))
        offset = (mean_found - slope * mean_known) * (total / (total + still))
    return learners.shifted(offset)


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
    learners: Learners,
    source: SourceStatistics,
    X: FloatArray,
    rounds: int,
    blocks: Mapping[str, int] | None,
    *,
    even: bool,
) -> Learners:
    """Correct scores by rows (n, D) as `recalibrated` does, by memberships that the scores give in place of labels.

    Where rows are of all classes about equally (`even`), classes that are named too often are named less. Regression
    follows that by one step only: what it learns does not go away.
    """
    for _ in range(rounds):
        for _ in range(_RECENTRED):
            scores = learners.scores(X)
            members = _memberships(learners.losses(scores), _EVEN_STEPS if even else 0)
            learners = learners.shifted(_own_offsets(scores, members, source, learners.coding))
        if blocks is not None:
            members = _memberships(learners.losses(learners.scores(X)), int(even))
            learners = _regressed(learners, source, X, members, blocks, _RIDGE_UNSURE)
    return learners


def recalibrated(
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
    width = max(_WIDTH * float(np.median(_answers(losses)[1])), _LEAST_SHARE)
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


def _answers(losses: FloatArray) -> tuple[IntArray, FloatArray]:
    """Class (n,) of the least loss, and by how much it is less than the next."""
    least = np.partition(losses, 1, axis=1)
    return losses.argmin(axis=1), least[:, 1] - least[:, 0]


def _surest(losses: FloatArray, n_classes: int) -> tuple[IntArray, IntArray]:
    """Return the rows of largest margin, a share of those named for each class and one at least, and their classes."""
    named, margins = _answers(losses)
    kept = []
    for k in range(n_classes):
        rows = np.flatnonzero(named == k)
        order = np.argsort(-margins[rows], kind="stable")
        kept.append(rows[order[: max(1, int(_KEPT * rows.size))]])
    rows = np.concatenate(kept)
    return rows, named[rows]


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
        *,
        all_materials: bool = False,
        rounds: int | None = None,
    ) -> Self:
        """Return a classifier for another set-up, learned from recordings of it without labels.

        Parameters
        ----------
        X : array-like, shape (n, D)
            Plain features of the training rows, as given to `fit`.
        y : array-like, shape (n,)
            Their labels.
        X_new : array-like, shape (m, D)
            Features of recordings of the new set-up, of whichever classes.
        all_materials : bool, default False
            Declare that `X_new` holds all classes about equally: each column gets mean and spread of the training.
            Gains more than the shift, and loses where it is not so: with half of the classes 2 to 18 points. By
            default only a common offset of the scores is taken away, which costs nothing in the mean with any shares
            of three classes or more.
        rounds : int, optional
            Self-training after that: so often rows with the memberships that their scores give them do what labelled
            ones do in `recalibrate`. Default: 2 with `all_materials`, else 0: where half of the classes are missing
            it costs 4 points.

        Returns
        -------
        Self
            A new classifier with other `coef_` and `intercept_`, and no `held_out_scores_`; this one stays. The new one
            keeps what is known of the training rows (`source_`), and goes by that when it is adapted again.

        Raises
        ------
        TypeError, ValueError
            A `Dataset` in place of features, another number of columns, NaN or infinity, labels other than in `fit`,
            fewer than three new rows; with `all_materials` fewer than three a class, in the mean, or a classifier that
            was adapted before.

        Notes
        -----
        The default takes away n / (n + 20) of the difference of the mean scores of n rows to those of the training.
        Then it goes four times: name the rows, keep the 70 % of each class with the largest margin, and compare
        their mean scores with those of the training, where each class counts by its rows, at most by five: an offset
        for each learner, drawn to 0 by a row a class, and one slope in [0.8, 1], since rows that did not train have
        smaller scores; 1 where less than a quarter of the classes is named.

        Memberships are exp(-loss / w), w = 0.15 of the median margin, over their sum. With `all_materials` 30 steps
        of Sinkhorn and Knopp make the shares of all classes equal for recentring, one step for the regression, whose
        ridge is the mean squared norm of the rows.

        References
        ----------
        Re-centring: Zanini et al., "Transfer learning: a Riemannian geometry framework with applications to
        brain-computer interfaces", IEEE TBME 65 (2018); under other shares of classes: Li et al., "SPDIM:
        source-free unsupervised conditional and label shift adaptation in EEG" (2024). Equal shares: Asano et al.,
        "Self-labelling via simultaneous clustering and representation learning" (ICLR 2020).

        Examples
        --------
        >>> from sklearn.datasets import load_iris
        >>> from granular_id import BestClassifier
        >>> X, y = load_iris(return_X_y=True)
        >>> clf = BestClassifier().fit(X[::2], y[::2])
        >>> moved = X[1::2] + [0.5, 0.0, 1.0, 0.5]
        >>> new = clf.adapt(X[::2], y[::2], moved)
        >>> bool((clf.predict(moved) == y[1::2]).mean() < 0.7 < 0.9 < (new.predict(moved) == y[1::2]).mean())
        True
        """
        rounds = checked_rounds(rounds, all_materials)
        with single_threaded_blas():
            learners, source, blocks = self._known(X, y)
            rows = self._rows(X_new, "X_new")
            made, known = adapted(
                learners, source, rows, all_materials=all_materials, rounds=rounds, blocks=blocks
            )
        return self._with(made, known)

    def recalibrate(
        self,
        X: npt.ArrayLike,
        y: npt.ArrayLike,
        X_new: npt.ArrayLike,
        y_new: npt.ArrayLike,
        *,
        allow_missing: bool = False,
    ) -> Self:
        """Return a classifier for another set-up, learned from a few labelled recordings of each class.

        Parameters
        ----------
        X, y
            As in `adapt`.
        X_new : array-like, shape (m, D)
            Features of recordings of the new set-up.
        y_new : array-like, shape (m,)
            Their labels, each of `classes_`.
        allow_missing : bool, default False
            Go on without some of the classes. What is learned of the others does not carry over to them.

        Returns
        -------
        Self
            As of `adapt`.

        Raises
        ------
        TypeError, ValueError
            As `adapt`; labels that were not in training; classes that are missing: the message names them.

        Notes
        -----
        Each learner is recentred on its own classes, with few rows more on all of them; the difference that is left
        to the mean scores of the training is learned by kernel ridge regression on standardised columns, with a
        ridge of 0.1 of the mean squared norm of the rows. It is linear, too.
        """
        with single_threaded_blas():
            learners, source, blocks = self._known(X, y)
            rows = self._rows(X_new, "X_new")
            labels = [str(label) for label in self.classes_]
            codes = codes_of(np.asarray(y_new), self.classes_, len(rows), "y_new")
            refuse_few(len(codes), "recalibration")
            refuse_missing(codes, labels, allow_missing)
            made = recalibrated(learners, source, rows, codes, blocks)
        return self._with(made, source)

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


def refuse_few(n: int, what: str) -> None:
    """Refuse fewer recordings than tell a set-up from chance."""
    if n < LEAST_ROWS:
        raise ValueError(
            f"{what} needs at least {LEAST_ROWS} recordings, got {n}: the offset of one cannot be told from its "
            "material; record more, of more materials"
        )


def missing_of(codes: IntArray, labels: Sequence[Label]) -> list[Label]:
    """Return the classes that no row has."""
    there = set(codes.tolist())
    return [label for code, label in enumerate(labels) if code not in there]


def refuse_missing(codes: IntArray, labels: Sequence[str], allow_missing: bool) -> list[str]:
    """Return the classes without a recording; refuse them unless they are allowed."""
    missing = missing_of(codes, labels)
    if missing and not allow_missing:
        raise ValueError(
            f"recalibration needs recordings of every material, {', '.join(missing)} "
            f"{'is' if len(missing) == 1 else 'are'} missing: what the others show does not carry over; record them, "
            "or pass allow_missing=True"
        )
    return missing

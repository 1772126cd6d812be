"""Posterior probabilities: a sigmoid for each learner, then one distribution over the classes.

Sources: Platt (1999), "Probabilistic outputs for support vector machines" (sigmoid, softened targets); Lin, Lin, Weng
(2007), "A note on Platt's probabilistic outputs for support vector machines", Machine Learning 68:267-276 (its
Newton's method). Coupling by divergence: Hastie, Tibshirani (1998), "Classification by pairwise coupling", Annals of
Statistics 26:451-471 (pairs), Zadrozny (2002), "Reducing multiclass to binary by coupling probability estimates",
NIPS 14 (any coding matrix). Coupling by squares: Wu, Lin, Weng (2004), "Probability estimates for multi-class
classification by pairwise coupling", JMLR 5:975-1005, second method.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.special import expit
from sklearn.exceptions import ConvergenceWarning

from granular_id._checks import argument_error
from granular_id._parallel import single_threaded_blas
from granular_id.ecoc.codings import CodingMatrix
from granular_id.ecoc.learners import Task

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

POSTERIORS: Mapping[str, str] = MappingProxyType(
    {
        "kullback_leibler": "least divergence from what the learners say, for any coding",
        "wu_lin_weng": "least squares over pairs of classes, for one-vs-one",
    }
)
"""How probabilities of learners are coupled, by name."""

N_FOLDS = 5
"""Folds of the cross-fit: four fifths of the rows train, close to the learners that are used in the end."""

KEPT = N_FOLDS
"""Number of the fold that always trains."""

# Coupling.
_LEAST = 1e-12  # a learner that is certain would make the divergence infinite
_TOLERANCE = 1e-11  # of the gradient, for weights that sum to 1
_ACCEPTED = 1e-8  # of the gradient where the steps ran out: the probabilities are right to many digits
_MAX_STEPS = 500
_LONGEST_STEP = 5.0  # of a log-probability: past it the quadratic model says nothing
_LEAST_CURVATURE = 1e-14
_MAX_HALVINGS = 40
_ENOUGH_DESCENT = 1e-4
_ROUNDING = 1e-15
_BLOCK_BYTES = 20_000_000
# Sigmoid.
_MAX_STEPS_SIGMOID = 100
_GRADIENT_TOLERANCE = 1e-9  # relative to the sum of weights
_RIDGE = 1e-12
_SMALLEST_STEP = 1e-10


@dataclass(frozen=True)
class Posterior:
    """Fitted sigmoids and how to couple them.

    Attributes
    ----------
    method : str
        A key of `POSTERIORS`.
    slope, offset : ndarray, shape (L,)
        Of the sigmoid of each learner.
    weights : ndarray, shape (L,)
        Sum of the weights of the rows behind each learner.
    """

    method: str
    slope: FloatArray
    offset: FloatArray
    weights: FloatArray

    def probabilities(self, scores: FloatArray, coding_matrix: CodingMatrix) -> FloatArray:
        """Probabilities (n, K) of the classes from scores (n, L); rows sum to 1."""
        of_learners = sigmoid(scores, self.slope, self.offset)
        pairs = pairs_of(coding_matrix) if self.method == "wu_lin_weng" else None
        if pairs is not None:
            return couple_wu_lin_weng(of_learners, pairs)
        return couple_kullback_leibler(of_learners, coding_matrix, self.weights)


def check_posterior(method: str, coding_matrix: CodingMatrix) -> None:
    """Raise a ValueError for a method of `POSTERIORS` that does not serve the coding."""
    if method == "wu_lin_weng" and pairs_of(coding_matrix) is None:
        raise argument_error(
            ValueError,
            "posterior",
            "='wu_lin_weng' needs one learner for each pair of classes (coding='onevsone'); "
            "'kullback_leibler' serves any coding",
        )


def fit_posterior(method: str, scores: FloatArray, task: Task) -> Posterior:
    """Fit the sigmoid of each learner to cross-fitted scores (n, L) of its rows."""
    slope, offset, weights = (np.empty(task.n_learners) for _ in range(3))
    for learner in range(task.n_learners):
        rows = task.rows(learner)
        own = None if task.weights is None else task.weights[rows]
        slope[learner], offset[learner] = fit_sigmoid(scores[rows, learner], task.targets(learner, rows), own)
        weights[learner] = len(rows) if own is None else own.sum()
    return Posterior(method, slope, offset, weights)


# A support vector machine with more features than rows puts every training row on its margin or beyond: the scores
# of its own rows say nothing of how sure it is. Each row is scored by learners trained on the other folds instead.


def folds_of(rows: npt.NDArray[np.generic], task: Task, seed: int) -> IntArray:
    """Deal the rows (n, m) of each class out to `N_FOLDS` folds; -1 for rows that do not count.

    Equal rows of a class stay together. A fold would otherwise be scored by learners that know some of its rows, and a
    weight of 2 would not mean the same as a row given twice. Within a class different rows are put in order, shuffled
    and dealt out in turn, going on in the next class with the next fold: same seed, same folds, in whatever order the
    rows come. The one row of a class cannot be held out: it goes to the fold `KEPT`, which always trains, and a
    warning says that learners which know it score it. How sure they are of it is bounded by the softened target of the
    sigmoid, 2/3 for one row.
    """
    rng = np.random.default_rng(seed)
    folds = np.full(len(task.index), -1)
    next_fold, single = 0, []
    for k, name in enumerate(task.names):
        own = task.counted[task.index[task.counted] == k]
        different, inverse = np.unique(rows[own], axis=0, return_inverse=True)
        if len(different) < 2:
            folds[own] = KEPT
            single.append(repr(str(name)))
            continue
        order = rng.permutation(len(different))
        folds[own] = (next_fold + order[inverse.ravel()]) % N_FOLDS
        next_fold += len(different)
    if single:
        warnings.warn(
            "posterior needs 2 different rows of a class, to score each by learners trained on the other; "
            f"scored by learners that know it: the one row of {', '.join(single)}",
            UserWarning,
            stacklevel=2,
        )
    return folds


def cross_fitted(
    fit_and_score: Callable[[IntArray, IntArray], FloatArray], folds: IntArray, n_learners: int
) -> FloatArray:
    """Scores (n, L) of all rows that count, each from learners trained on the other folds; 0 for other rows.

    `fit_and_score` takes the indices of the rows to train on and of the rows to score.
    """
    scores = np.zeros((len(folds), n_learners))
    for fold in np.unique(folds[folds >= 0]):
        trains = (folds >= 0) & ((folds != fold) | (folds == KEPT))
        scored = np.flatnonzero(folds == fold)
        scores[scored] = fit_and_score(np.flatnonzero(trains), scored)
    return scores


def sigmoid(scores: FloatArray, slope: FloatArray, offset: FloatArray) -> FloatArray:
    """Probability 1 / (1 + exp(slope * score + offset)) of the code +1; shapes that broadcast."""
    probability: FloatArray = expit(-(slope * scores + offset))
    return probability


def fit_sigmoid(scores: FloatArray, targets: FloatArray, weights: FloatArray | None) -> tuple[float, float]:
    """Slope and offset of Platt's sigmoid by maximum likelihood, from scores of rows that were not trained on.

    Targets +1.0 and -1.0 are softened to (N+ + 1) / (N+ + 2) and 1 / (N- + 2), so that scores that separate the sides
    do not give certainty. A whole weight equals as many repetitions.
    """
    counts = np.ones(len(scores)) if weights is None else weights
    positive = targets > 0
    n_positive, n_negative = float(counts[positive].sum()), float(counts[~positive].sum())
    wanted = np.where(positive, (n_positive + 1.0) / (n_positive + 2.0), 1.0 / (n_negative + 2.0))
    unit = float(np.abs(scores).max()) or 1.0  # scores of any size, one ridge and one tolerance
    features = np.stack((scores / unit, np.ones(len(scores))))
    point = np.array([0.0, np.log((n_negative + 1.0) / (n_positive + 1.0))])
    cost = _cost(point @ features, wanted, counts)
    for _ in range(_MAX_STEPS_SIGMOID):
        probability = expit(-(point @ features))
        gradient = features @ (counts * (wanted - probability))
        if np.abs(gradient).max() <= _GRADIENT_TOLERANCE * counts.sum():
            break
        hessian = (features * (counts * probability * (1.0 - probability))) @ features.T + _RIDGE * np.eye(2)
        direction = -np.linalg.solve(hessian, gradient)
        slope_along = float(gradient @ direction)
        step = 1.0
        while step >= _SMALLEST_STEP:
            moved = point + step * direction
            moved_cost = _cost(moved @ features, wanted, counts)
            if moved_cost < cost + _ENOUGH_DESCENT * step * slope_along:
                point, cost = moved, moved_cost
                break
            step /= 2.0
        else:
            break  # no lower cost in floating point: this is the minimum
    return float(point[0]) / unit, float(point[1])


def _cost(exponent: FloatArray, wanted: FloatArray, counts: FloatArray) -> float:
    """Negative log-likelihood; `wanted` is the target for 1 / (1 + exp(exponent))."""
    losses = wanted * np.logaddexp(0.0, exponent) + (1.0 - wanted) * np.logaddexp(0.0, -exponent)
    return float(counts @ losses)


def couple_kullback_leibler(
    probabilities: FloatArray, coding_matrix: CodingMatrix, weights: FloatArray
) -> FloatArray:
    """Class probabilities (n, K) whose consequences for the learners diverge least from what the learners say (n, L).

    Minimises the sum over learners of ``w (r log(r / s) + (1 - r) log((1 - r) / (1 - s)))``, in which r is the
    probability that a learner gives to its positive side, and s the share of its positive classes in the probability
    of all classes that it was shown. By Newton's method in the logarithms of the probabilities, from equal ones, so
    that the same input always ends in the same place; with an update of one factor per class, as first published,
    designs other than one-vs-one need thousands of steps where a class tends to 0. A row alone gives the bits that
    it gives in any batch.
    """
    n_classes = coding_matrix.shape[0]
    divergence = _Divergence(coding_matrix, weights)
    given = np.clip(probabilities, _LEAST, 1.0 - _LEAST).T
    coupled = np.empty((len(probabilities), n_classes))
    unfinished = 0
    step = max(1, _BLOCK_BYTES // (8 * n_classes**2))
    for start in range(0, len(coupled), step):
        rows = slice(start, start + step)
        with single_threaded_blas():  # thousands of tiny decompositions
            logs, missed = _minimised(divergence, given[:, rows])
        coupled[rows] = _shares(logs).T
        unfinished += missed
    if unfinished:
        warnings.warn(
            f"coupling did not converge for {unfinished} of {len(coupled)} rows",
            ConvergenceWarning,
            stacklevel=2,
        )
    return coupled


class _Divergence:
    """Divergence, gradient and curvature in the log-probabilities (K, n), for learners' probabilities (L, n).

    Sums run over sparse matrices, in a fixed order: BLAS would round a row in another way alone than in a batch.
    """

    def __init__(self, matrix: CodingMatrix, weights: FloatArray) -> None:
        self.n_classes = int(matrix.shape[0])
        self._weights = (weights / weights.sum())[:, None]
        self._sides = tuple(csr_array((matrix == side).astype(np.float64)) for side in (1, -1))
        self._totals = tuple(csr_array(side.T) for side in self._sides)
        shown = matrix != 0
        self._pairs = tuple(_pairs_of_classes(mask) for mask in (matrix == 1, matrix == -1, shown))

    def value(self, logs: FloatArray, given: FloatArray) -> FloatArray:
        """Divergence (n,) up to a constant."""
        positive, negative = (total @ _shares(logs) for total in self._totals)
        agreement = given * np.log(positive) + (1.0 - given) * np.log(negative) - np.log(positive + negative)
        value: FloatArray = -_summed(self._weights * agreement)
        return value

    def slopes(self, logs: FloatArray, given: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (K, n) and matrices of second derivatives (n, K, K)."""
        shares = _shares(logs)
        positive, negative = (total @ shares for total in self._totals)
        both = positive + negative
        for_positive, for_negative, against = (
            self._weights * factor for factor in (given / positive, (1.0 - given) / negative, 1.0 / both)
        )
        plus, minus = self._sides
        gradient = shares * (plus @ (against - for_positive) + minus @ (against - for_negative))
        of_positive, of_negative, of_both = self._pairs
        products = (
            of_positive @ (for_positive / positive)
            + of_negative @ (for_negative / negative)
            - of_both @ (against / both)
        )
        curvature = (
            products.T.reshape(-1, self.n_classes, self.n_classes)
            * shares.T[:, :, None]
            * shares.T[:, None, :]
        )
        diagonal = np.arange(self.n_classes)
        curvature[:, diagonal, diagonal] += gradient.T
        return gradient, curvature


def _pairs_of_classes(mask: npt.NDArray[np.bool_]) -> csr_array:
    """Sparse (K * K, L): 1 where a learner holds both classes of a pair within a mask (K, L)."""
    n_classes, n_learners = mask.shape
    members = [np.flatnonzero(column) for column in mask.T]
    pairs = [np.add.outer(own * n_classes, own).ravel() for own in members]
    learner = np.repeat(np.arange(n_learners), [len(own) for own in pairs])
    row = np.concatenate(pairs)
    return csr_array((np.ones(len(row)), (row, learner)), shape=(n_classes**2, n_learners))


def _minimised(divergence: _Divergence, given: FloatArray) -> tuple[FloatArray, int]:
    """Log-probabilities (K, n) at the minimum; number of rows that did not reach it."""
    logs = np.zeros((divergence.n_classes, given.shape[1]))
    active = np.arange(given.shape[1])
    for _ in range(_MAX_STEPS):
        gradient, curvature = divergence.slopes(logs[:, active], given[:, active])
        moving = np.abs(gradient).max(axis=0) > _TOLERANCE
        if not moving.any():
            return logs, 0
        active, gradient, curvature = active[moving], gradient[:, moving], curvature[moving]
        # Where the divergence is not convex, the size of the curvature without its sign still leads downhill.
        size, axes = np.linalg.eigh(curvature)
        size = np.maximum(np.abs(size), _LEAST_CURVATURE)
        along = (axes * gradient.T[:, :, None]).sum(axis=1) / size
        direction = -(axes * along[:, None, :]).sum(axis=2).T
        direction *= np.minimum(1.0, _LONGEST_STEP / np.abs(direction).max(axis=0))
        logs[:, active] = _line_search(divergence, logs[:, active], given[:, active], gradient, direction)
    gradient, _ = divergence.slopes(logs[:, active], given[:, active])
    return logs, int((np.abs(gradient).max(axis=0) > _ACCEPTED).sum())


def _line_search(
    divergence: _Divergence, logs: FloatArray, given: FloatArray, gradient: FloatArray, direction: FloatArray
) -> FloatArray:
    """Step of each row (column of the arrays), halved until the divergence falls enough."""
    value = divergence.value(logs, given)
    descent = _summed(gradient * direction)
    moved = logs + direction
    open_rows = np.arange(logs.shape[1])
    step = 1.0
    for _ in range(_MAX_HALVINGS):
        reached = divergence.value(moved[:, open_rows], given[:, open_rows])
        enough = value[open_rows] + _ENOUGH_DESCENT * step * descent[open_rows] + _ROUNDING
        open_rows = open_rows[~(reached <= enough)]
        if len(open_rows) == 0:
            break
        step /= 2.0
        moved[:, open_rows] = logs[:, open_rows] + step * direction[:, open_rows]
    moved -= moved.max(axis=0)
    return moved


def _shares(logs: FloatArray) -> FloatArray:
    """Probabilities (K, n) from their logarithms up to a constant; none is 0."""
    shares: FloatArray = np.exp(np.maximum(logs - logs.max(axis=0), -500.0))
    shares /= _summed(shares)
    return shares


def _summed(values: FloatArray) -> FloatArray:
    """Sum over the first axis, term by term: `numpy.sum` adds a single column in another order than many."""
    total = np.zeros(values.shape[1])
    for row in values:
        total += row
    return total


def pairs_of(coding_matrix: CodingMatrix) -> tuple[IntArray, IntArray] | None:
    """Positive and negative class (L,) of each learner if each pair of classes has one learner, else None."""
    n_classes, n_learners = coding_matrix.shape
    if n_learners != n_classes * (n_classes - 1) // 2 or not (np.abs(coding_matrix).sum(axis=0) == 2).all():
        return None
    positive, negative = coding_matrix.argmax(axis=0), coding_matrix.argmin(axis=0)
    met = {frozenset(pair) for pair in zip(positive.tolist(), negative.tolist(), strict=True)}
    return (positive, negative) if len(met) == n_learners else None


def couple_wu_lin_weng(probabilities: FloatArray, pairs: tuple[IntArray, IntArray]) -> FloatArray:
    """Class probabilities (n, K) with r_ji p_i as near to r_ij p_j as can be, in squares, over all `pairs_of`."""
    positive, negative = pairs
    n_classes = int(max(positive.max(), negative.max())) + 1
    given = np.clip(probabilities, _LEAST, 1.0 - _LEAST)
    coupled = np.empty((len(given), n_classes))
    diagonal = np.arange(n_classes)
    step = max(1, _BLOCK_BYTES // (8 * (n_classes + 1) ** 2))
    for start in range(0, len(given), step):
        r = given[start : start + step]
        # Minimum of p Q p / 2 with sum p = 1: Q p = b 1 with a multiplier b.
        system = np.zeros((len(r), n_classes + 1, n_classes + 1))
        system[:, positive, negative] = system[:, negative, positive] = -r * (1.0 - r)
        wins = np.zeros((len(r), n_classes, n_classes))
        wins[:, positive, negative] = r
        wins[:, negative, positive] = 1.0 - r
        system[:, diagonal, diagonal] = np.square(wins).sum(axis=1)
        system[:, :-1, -1] = system[:, -1, :-1] = 1.0
        wanted = np.zeros((len(r), n_classes + 1, 1))
        wanted[:, -1] = 1.0
        with single_threaded_blas():
            solved = np.linalg.solve(system, wanted)[:, :-1, 0]
        coupled[start : start + step] = np.maximum(solved, 0.0)  # below 0 by rounding only
    coupled /= coupled.sum(axis=1, keepdims=True)
    return coupled

"""From the probabilities of all learners to those of all classes.

Sources: Hastie, Tibshirani (1998), "Classification by pairwise coupling", Annals of Statistics 26:451-471, and Zadrozny
(2002), "Reducing multiclass to binary by coupling probability estimates", NIPS 14, for the divergence, of pairs and of
any coding matrix; Wu, Lin, Weng (2004), "Probability estimates for multi-class classification by pairwise coupling",
JMLR 5:975-1005, second method.
"""

from __future__ import annotations

import warnings

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from sklearn.exceptions import ConvergenceWarning

from granular_id._blas import single_threaded_blas
from granular_id.ecoc.coding_matrix import CodingMatrix

__all__ = ["couple_kullback_leibler", "couple_wu_lin_weng", "pairs_of"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

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


def couple_kullback_leibler(
    probabilities: FloatArray, coding_matrix: CodingMatrix, weights: FloatArray
) -> FloatArray:
    """Class probabilities whose consequences for the learners diverge least from what the learners say.

    Minimises the sum over learners of ``w (r log(r / s) + (1 - r) log((1 - r) / (1 - s)))``, in which r is the
    probability that a learner gives to its positive side, and s the share of its positive classes in the probability
    of all classes that it was shown. By Newton's method in the logarithms of the probabilities, from equal ones, so
    that the same input always ends in the same place; with an update of one factor per class, as first published,
    designs other than one-vs-one need thousands of steps where a class tends to 0.

    Parameters
    ----------
    probabilities : ndarray, shape (n, L)
        Of the code +1.
    coding_matrix : ndarray of int8, shape (K, L)
        Codes -1, 0, +1.
    weights : ndarray, shape (L,)
        Positive; how much each learner counts (its rows in training).

    Returns
    -------
    ndarray, shape (n, K)
        Rows sum to 1. A row alone gives the bits that it gives in any batch.

    Warns
    -----
    ConvergenceWarning
        Rows for which the minimum was not reached; they hold the best point found.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.ecoc.codings import onevsone
    >>> from granular_id.ecoc.coupling import couple_kullback_leibler
    >>> pairs = np.array([[0.6 / 0.9, 0.6 / 0.7, 0.3 / 0.4]])
    >>> couple_kullback_leibler(pairs, onevsone(3), np.ones(3)).round(9)
    array([[0.6, 0.3, 0.1]])
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
    """Class probabilities p with r_ji p_i as near to r_ij p_j as can be, in squares, over all pairs.

    Parameters
    ----------
    probabilities : ndarray, shape (n, K (K - 1) / 2)
        Of the positive class of each pair: r_ij.
    pairs : tuple of two ndarrays of int
        From `pairs_of`.

    Returns
    -------
    ndarray, shape (n, K)
        Rows sum to 1.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.ecoc.codings import onevsone
    >>> from granular_id.ecoc.coupling import couple_wu_lin_weng, pairs_of
    >>> pairs = np.array([[0.6 / 0.9, 0.6 / 0.7, 0.3 / 0.4]])
    >>> couple_wu_lin_weng(pairs, pairs_of(onevsone(3))).round(9)
    array([[0.6, 0.3, 0.1]])
    """
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

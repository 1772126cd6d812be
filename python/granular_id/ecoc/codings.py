"""Codes of the classes: which learner sees which classes on which side, and how scores become one decision.

A coding matrix has a row for each class and a column for each learner: +1 positive, -1 negative, 0 not shown. A
class is worth minus the mean loss of its codes, over the learners that saw it.

Sources: Allwein, Schapire, Singer (2000), "Reducing multiclass to binary", JMLR 1:113-141 (codes, loss-based decoding);
Escalera, Pujol, Radeva (2010), "On the decoding process in ternary error-correcting output codes", IEEE TPAMI
32:120-134 (loss-weighted decoding). Names and scale are those of MATLAB's `fitcecoc`, but for the loss "root", which
is ours: half way from votes (the power 0 of a score) to the hinge (the power 1).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from granular_id._checks import argument_error, named

CodingMatrix = npt.NDArray[np.int8]
FloatArray = npt.NDArray[np.float64]

MAX_LEARNERS = 100_000
"""Of more pairs of classes than this one-vs-one is refused."""

# Losses are made for as many rows at a time.
_BLOCK_BYTES = 10_000_000


def onevsone(n_classes: int) -> CodingMatrix:
    """One learner for each pair of classes.

    Parameters
    ----------
    n_classes : int
        Number of classes K, at least 2.

    Returns
    -------
    ndarray of int8, shape (K, K (K - 1) / 2)
        Columns in the order (0, 1), (0, 2), ..., (1, 2), ...: +1 for the lower class index, -1 for the
        higher.

    Examples
    --------
    >>> from granular_id.ecoc import onevsone
    >>> onevsone(3)
    array([[ 1,  1,  0],
           [-1,  0,  1],
           [ 0, -1, -1]], dtype=int8)
    """
    low, high = np.triu_indices(n_classes, 1)
    matrix = np.zeros((n_classes, len(low)), dtype=np.int8)
    learner = np.arange(len(low))
    matrix[low, learner] = 1
    matrix[high, learner] = -1
    return matrix


def onevsall(n_classes: int) -> CodingMatrix:
    """One learner for each class against all others, shape (K, K): +1 on the diagonal, -1 elsewhere."""
    return np.where(np.eye(n_classes, dtype=bool), 1, -1).astype(np.int8)


CODINGS: Mapping[str, Callable[[int], CodingMatrix]] = MappingProxyType(
    {"onevsone": onevsone, "onevsall": onevsall}
)
"""Designs by name."""


def design(coding: object, n_classes: int) -> CodingMatrix:
    """Coding matrix for K classes, from the name of a design or a matrix of one's own.

    Parameters
    ----------
    coding : str or array-like, shape (K, L)
        A key of `CODINGS`, or codes -1, 0, +1 with one row per class in sorted order.
    n_classes : int
        K, at least 2.

    Returns
    -------
    ndarray of int8, shape (K, L)

    Raises
    ------
    TypeError, ValueError
        Unknown name, more than `MAX_LEARNERS` pairs of classes, or a matrix that cannot be learned.

    Examples
    --------
    >>> from granular_id.ecoc import design
    >>> design("onevsall", 3)
    array([[ 1, -1, -1],
           [-1,  1, -1],
           [-1, -1,  1]], dtype=int8)
    """
    if not isinstance(coding, str):
        return own_coding(coding, n_classes)
    matrix_of: Callable[[int], CodingMatrix] = named(CODINGS, "coding", coding)
    n_pairs = n_classes * (n_classes - 1) // 2
    if coding == "onevsone" and n_pairs > MAX_LEARNERS:
        raise argument_error(
            ValueError,
            "coding",
            f"='onevsone' needs {n_pairs:,} learners for {n_classes} classes, more than {MAX_LEARNERS:,}; "
            f"'onevsall' needs {n_classes}",
        )
    return matrix_of(n_classes)


def own_coding(coding: object, n_classes: int) -> CodingMatrix:
    """Check a user's coding matrix: a row for each class, all rows and all learners different."""
    try:
        given = np.asarray(coding)
        is_matrix = given.dtype.kind in "biuf" and given.ndim > 0
    except ValueError:  # rows of different lengths
        is_matrix = False
    if not is_matrix:
        raise argument_error(
            TypeError, "coding", f"must be the name of a design or a matrix of -1, 0 and +1, got {coding!r}"
        )
    if given.ndim != 2 or len(given) != n_classes or given.shape[1] < 1:
        problem = (
            f"must have {n_classes} rows, one per class, and a column per learner, got shape {given.shape}"
        )
        raise argument_error(ValueError, "coding", problem)
    if not np.isin(given, (-1, 0, 1)).all():
        raise argument_error(ValueError, "coding", "must hold -1, 0 and +1 only")
    matrix = given.astype(np.int8)
    one_sided = (matrix.max(axis=0) != 1) | (matrix.min(axis=0) != -1)
    if one_sided.any():
        raise argument_error(ValueError, "coding", f"column {one_sided.argmax()} must hold both +1 and -1")
    unseen = ~matrix.any(axis=1)
    if unseen.any():
        problem = f"row {unseen.argmax()} is all 0: no learner ever sees this class"
        raise argument_error(ValueError, "coding", problem)
    # A column and its negative make the same learner: compare them with their first sign +.
    leading = matrix[(matrix != 0).argmax(axis=0), np.arange(matrix.shape[1])]
    for what, lines, why in (
        ("rows", matrix, "these classes are never told apart"),
        ("columns", (matrix * leading).T, "the same learner twice, but for the sign"),
    ):
        seen: dict[bytes, int] = {}
        for number, line in enumerate(lines):
            first = seen.setdefault(line.tobytes(), number)
            if first != number:
                raise argument_error(ValueError, "coding", f"{what} {first} and {number} are alike: {why}")
    return matrix


def _hinge(z: FloatArray) -> FloatArray:
    loss: FloatArray = np.maximum(0.0, 1.0 - z) / 2.0
    return loss


def _root(z: FloatArray) -> FloatArray:
    graded: FloatArray = np.copysign(np.sqrt(np.abs(np.minimum(z, 1.0))), z)
    return (1.0 - graded) / 2.0


LOSSES: Mapping[str, Callable[[FloatArray], FloatArray]] = MappingProxyType({"hinge": _hinge, "root": _root})
"""Binary losses by name: of the agreement z of a code with a score (code times score), 1/2 where that says nothing."""


def decode(scores: FloatArray, coding_matrix: CodingMatrix, loss: str = "hinge") -> FloatArray:
    """Decision value of each class: minus its mean binary loss over the learners that saw it.

    The largest value wins. Take the first of equal ones (`numpy.argmax` does): ties go to the class that
    comes first. Losses are added in the order of the learners, so that a row gives the same bits alone
    and within any batch.

    Parameters
    ----------
    scores : ndarray, shape (n, L)
        Scores of the L binary learners; positive speaks for the classes with code +1.
    coding_matrix : ndarray of int8, shape (K, L)
        Codes -1, 0, +1.
    loss : str, default "hinge"
        A key of `LOSSES`. The hinge belongs to support vector machines, and is what the paper uses.

    Returns
    -------
    ndarray of float64, shape (n, K)

    Raises
    ------
    ValueError
        An unknown loss.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.ecoc import decode, onevsone
    >>> decode(np.array([[2.0, 0.5, -1.0]]), onevsone(3))
    array([[-0.125, -1.25 , -0.375]])
    """
    of_agreement: Callable[[FloatArray], FloatArray] = named(LOSSES, "loss", loss)
    n_classes, n_learners = coding_matrix.shape
    steps, divisor = _steps(coding_matrix), np.abs(coding_matrix).sum(axis=1, dtype=np.float64)
    values = np.empty((len(scores), n_classes))
    size = max(1, _BLOCK_BYTES // (16 * n_learners))
    for start in range(0, len(scores), size):
        block = scores[start : start + size].T
        # Row l: the loss of a class with code +1 at learner l. Then the same for -1, then a row of zeros.
        costs = np.concatenate((of_agreement(block), of_agreement(-block), np.zeros((1, block.shape[1]))))
        total = np.zeros((n_classes, block.shape[1]))
        # One step adds the next learner of every class: as many steps as the busiest class has learners.
        for taken in steps:
            total += costs[taken]
        values[start : start + size] = -total.T / divisor
    return values


def _steps(matrix: CodingMatrix) -> npt.NDArray[np.intp]:
    """For each step and class the row of the cost of its next learner, or of the zeros when it has none."""
    n_classes, n_learners = matrix.shape
    classes, learners = np.nonzero(matrix)
    counts = np.bincount(classes, minlength=n_classes)
    step = np.arange(len(classes)) - np.repeat(np.cumsum(counts) - counts, counts)
    rows = np.full((int(counts.max()), n_classes), 2 * n_learners)
    rows[step, classes] = np.where(matrix[classes, learners] > 0, learners, n_learners + learners)
    return rows

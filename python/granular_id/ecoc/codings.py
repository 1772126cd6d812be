"""Coding matrices: which binary learner is shown which classes, and on which side.

A matrix has a row for each class and a column for each learner: +1 positive, -1 negative, 0 not shown.

Sources: Allwein, Schapire, Singer (2000), "Reducing multiclass to binary", JMLR 1:113-141; Dietterich, Bakiri
(1995), "Solving multiclass learning problems via error-correcting output codes", JAIR 2:263-286. Names and sizes
are those of MATLAB's `designecoc`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from granular_id._checks import argument_error, named
from granular_id._parallel import single_threaded_blas

CodingMatrix = npt.NDArray[np.int8]

MAX_LEARNERS = 100_000
"""More columns than this are refused. It admits all ternary columns of 11 classes (86,526)."""

_DRAWS = 10_000
# Entries drawn at a time: large enough for numpy to be fast, small enough for a few tens of megabytes.
_BLOCK_ENTRIES = 1_000_000


def design(coding: object, n_classes: int, rng: np.random.Generator) -> CodingMatrix:
    """Coding matrix for K classes, from the name of a design or a matrix of one's own.

    Parameters
    ----------
    coding : str or array-like, shape (K, L)
        A key of `CODINGS`, or codes -1, 0, +1 with one row per class in sorted order.
    n_classes : int
        K, at least 2.
    rng : numpy.random.Generator
        Draws the random designs.

    Returns
    -------
    ndarray of int8, shape (K, L)

    Raises
    ------
    TypeError, ValueError
        Unknown name, fewer than two classes, more than `MAX_LEARNERS` columns, or a matrix that cannot be learned.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.ecoc import design
    >>> design("ordinal", 3, np.random.default_rng(0))
    array([[-1, -1],
           [ 1, -1],
           [ 1,  1]], dtype=int8)
    """
    if not isinstance(coding, str):
        return own_coding(coding, n_classes)
    entry: Coding = named(CODINGS, "coding", coding)
    _check_at_least_two(n_classes)
    n_learners = entry.n_learners(n_classes)
    if n_learners > MAX_LEARNERS:
        count = f"{n_learners:,}" if n_learners < 10**12 else f"{Decimal(n_learners):.2e}"
        raise argument_error(
            ValueError,
            "coding",
            f"={coding!r} needs {entry.formula} = {count} learners for K = {n_classes} classes, more than "
            f"{MAX_LEARNERS:,}; 'denserandom' needs {CODINGS['denserandom'].n_learners(n_classes)}",
        )
    return entry.matrix(n_classes, rng)


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

    Raises
    ------
    ValueError
        `n_classes` is below 2.

    Examples
    --------
    >>> from granular_id.ecoc import onevsone
    >>> onevsone(3)
    array([[ 1,  1,  0],
           [-1,  0,  1],
           [ 0, -1, -1]], dtype=int8)
    """
    _check_at_least_two(n_classes)
    low, high = np.triu_indices(n_classes, 1)
    matrix = np.zeros((n_classes, len(low)), dtype=np.int8)
    learner = np.arange(len(low))
    matrix[low, learner] = 1
    matrix[high, learner] = -1
    return matrix


def onevsall(n_classes: int) -> CodingMatrix:
    """One learner for each class against all others, shape (K, K): +1 on the diagonal, -1 elsewhere."""
    return np.where(np.eye(n_classes, dtype=bool), 1, -1).astype(np.int8)


def ordinal(n_classes: int) -> CodingMatrix:
    """One learner for each cut of the sorted classes, shape (K, K - 1): -1 up to the cut, +1 beyond it."""
    return np.where(np.arange(n_classes)[:, None] > np.arange(n_classes - 1), 1, -1).astype(np.int8)


def binarycomplete(n_classes: int) -> CodingMatrix:
    """Every division of all classes into two sides, shape (K, 2^(K-1) - 1); class 0 is always on the + side."""
    number = np.arange(1, 2 ** (n_classes - 1))
    bits = (number >> np.arange(n_classes - 1)[::-1, None]) & 1
    first = np.ones((1, len(number)), dtype=np.int8)
    return np.concatenate((first, np.where(bits == 1, -1, 1).astype(np.int8)))


def ternarycomplete(n_classes: int) -> CodingMatrix:
    """Every column with both signs, shape (K, (3^K - 2^(K+1) + 1) / 2); the first entry that is not 0 is +1."""
    number = np.arange(3**n_classes)
    # Digits 0, 1, 2 stand for +1, -1, 0, the first class in the highest place.
    digits = (number // 3 ** np.arange(n_classes)[::-1, None]) % 3
    columns = np.array([1, -1, 0], dtype=np.int8)[digits]
    leading = columns[(columns != 0).argmax(axis=0), np.arange(len(number))]
    return np.ascontiguousarray(columns[:, (leading == 1) & (columns == -1).any(axis=0)])


def _n_binary(n_classes: int) -> int:
    return int(2 ** (n_classes - 1) - 1)


def _n_ternary(n_classes: int) -> int:
    return int((3**n_classes - 2 ** (n_classes + 1) + 1) // 2)


def _n_dense(n_classes: int) -> int:
    return min(math.ceil(10 * math.log2(n_classes)), _n_binary(n_classes))


def _n_sparse(n_classes: int) -> int:
    return min(math.ceil(15 * math.log2(n_classes)), _n_ternary(n_classes))


def denserandom(n_classes: int, rng: np.random.Generator) -> CodingMatrix:
    """Random columns of +1 and -1, far apart in their rows; all there are, where no more are wanted."""
    if _n_dense(n_classes) == _n_binary(n_classes):
        return binarycomplete(n_classes)
    return best_random(n_classes, _n_dense(n_classes), rng, zeros=False)


def sparserandom(n_classes: int, rng: np.random.Generator) -> CodingMatrix:
    """Random columns of 0, +1 and -1, far apart in their rows; all there are, where no more are wanted."""
    if _n_sparse(n_classes) == _n_ternary(n_classes):
        return ternarycomplete(n_classes)
    return best_random(n_classes, _n_sparse(n_classes), rng, zeros=True)


@dataclass(frozen=True)
class Coding:
    """A named design: its number of learners for K classes, as text and as a function, and its matrix."""

    formula: str
    n_learners: Callable[[int], int]
    matrix: Callable[[int, np.random.Generator], CodingMatrix]


CODINGS: Mapping[str, Coding] = MappingProxyType(
    {
        "onevsone": Coding("K (K - 1) / 2", lambda k: k * (k - 1) // 2, lambda k, _: onevsone(k)),
        "onevsall": Coding("K", lambda k: k, lambda k, _: onevsall(k)),
        "ordinal": Coding("K - 1", lambda k: k - 1, lambda k, _: ordinal(k)),
        "binarycomplete": Coding("2^(K-1) - 1", _n_binary, lambda k, _: binarycomplete(k)),
        "ternarycomplete": Coding("(3^K - 2^(K+1) + 1) / 2", _n_ternary, lambda k, _: ternarycomplete(k)),
        "denserandom": Coding("10 log2 K rounded up, at most 2^(K-1) - 1", _n_dense, denserandom),
        "sparserandom": Coding(
            "15 log2 K rounded up, at most (3^K - 2^(K+1) + 1) / 2", _n_sparse, sparserandom
        ),
    }
)
"""Designs by name."""


def best_random(n_classes: int, n_learners: int, rng: np.random.Generator, *, zeros: bool) -> CodingMatrix:
    """Of 10,000 random matrices (K, L) the first of those whose closest two rows are farthest apart.

    With zeros, entries are 0 with probability 1/2, +1 and -1 with 1/4 each (Allwein et al., section 6). A column
    without both signs, and one equal to an earlier column or to its negative, is drawn again.
    """
    values = np.array([0, 0, 1, -1] if zeros else [1, -1], dtype=np.int8)
    # Equal columns have equal sums, exact in float64. Other columns that meet by chance are drawn again too.
    bits = 52 - math.ceil(math.log2(n_classes))
    keys = rng.integers(1, 2**bits, size=n_classes).astype(np.float64)
    best, best_distance = np.empty(0, dtype=np.int8), -1.0
    step = max(1, _BLOCK_ENTRIES // (n_classes * n_learners))
    for start in range(0, _DRAWS, step):
        size = min(step, _DRAWS - start)
        drawn = _draw(rng, values, (size, n_learners, n_classes))
        _replace_unusable(drawn, keys, rng, values)
        distance = smallest_distance(drawn)
        winner = int(distance.argmax())
        if distance[winner] > best_distance:
            best, best_distance = drawn[winner].T.copy(), float(distance[winner])
    return best


def smallest_distance(columns: CodingMatrix) -> npt.NDArray[np.float32]:
    """Smallest distance between two rows of each of B coding matrices, given as their columns (B, L, K).

    The distance of two rows is the number of learners that see both classes on different sides.
    """
    signs = columns.astype(np.float32)  # whole numbers below 2^24: exact
    shown = np.abs(signs)
    # Learners that see both, minus those on whose sides they agree, plus those where they differ: twice the latter.
    # In one thread: on a busy machine handing out thousands of small products costs more than making them.
    with single_threaded_blas():
        differ = (shown.transpose(0, 2, 1) @ shown - signs.transpose(0, 2, 1) @ signs) / 2
    diagonal = np.arange(columns.shape[2])
    differ[:, diagonal, diagonal] = np.inf
    smallest: npt.NDArray[np.float32] = differ.min(axis=(1, 2))
    return smallest


def _draw(rng: np.random.Generator, values: CodingMatrix, shape: tuple[int, ...]) -> CodingMatrix:
    drawn: CodingMatrix = values[rng.integers(0, len(values), size=shape, dtype=np.uint8)]
    return drawn


def _replace_unusable(
    drawn: CodingMatrix, keys: npt.NDArray[np.float64], rng: np.random.Generator, values: CodingMatrix
) -> None:
    """Draw columns anew, in place, until those of each matrix (B, L, K) are usable and all different."""
    pending = np.arange(len(drawn))
    key = np.abs(drawn @ keys)
    while len(pending):
        columns, own_key = drawn[pending], key[pending]
        order = own_key.argsort(axis=1, kind="stable")
        ranked = np.take_along_axis(own_key, order, axis=1)
        unusable = np.zeros(own_key.shape, dtype=bool)
        np.put_along_axis(unusable, order[:, 1:], ranked[:, 1:] == ranked[:, :-1], axis=1)
        unusable |= (columns.max(axis=2) != 1) | (columns.min(axis=2) != -1)
        matrix, learner = np.nonzero(unusable)
        fresh = _draw(rng, values, (len(matrix), drawn.shape[2]))
        drawn[pending[matrix], learner] = fresh
        key[pending[matrix], learner] = np.abs(fresh @ keys)
        pending = pending[unusable.any(axis=1)]


def check_coding_matrix(coding_matrix: npt.ArrayLike) -> CodingMatrix:
    """Return codes (K, L) as int8, or say in a ValueError why they cannot be learned and decoded."""
    given = np.asarray(coding_matrix)
    if given.ndim != 2 or given.shape[0] < 2 or given.shape[1] < 1:
        raise ValueError(
            f"coding_matrix must have shape (n_classes >= 2, n_learners >= 1), got shape {given.shape}"
        )
    if given.dtype.kind not in "biuf" or not np.isin(given, (-1, 0, 1)).all():
        raise ValueError("coding_matrix must hold -1, 0 and +1 only")
    matrix = given.astype(np.int8)
    one_sided = (matrix.max(axis=0) != 1) | (matrix.min(axis=0) != -1)
    if one_sided.any():
        raise ValueError(f"coding_matrix column {one_sided.argmax()} must hold both +1 and -1")
    unseen = ~matrix.any(axis=1)
    if unseen.any():
        raise ValueError(f"coding_matrix row {unseen.argmax()} is all 0: no learner ever sees this class")
    return matrix


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
    matrix = check_coding_matrix(given)
    if len(matrix) != n_classes:
        raise argument_error(
            ValueError, "coding", f"must have {n_classes} rows, one per class, got shape {matrix.shape}"
        )
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


def _check_at_least_two(n_classes: int) -> None:
    if n_classes < 2:
        raise ValueError(f"n_classes must be at least 2, got {n_classes}")

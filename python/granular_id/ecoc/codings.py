"""Coding matrices of error-correcting output codes: which learner is shown which classes, on which side.

A coding matrix has one row per class and one column per binary learner. Its entry says what a learner
makes of a class: +1 positive, -1 negative, 0 not shown to this learner.

Sources: Allwein, Schapire, Singer (2000), "Reducing multiclass to binary", JMLR 1:113-141; Dietterich, Bakiri
(1995), "Solving multiclass learning problems via error-correcting output codes", JAIR 2:263-286. Names and sizes
are those of MATLAB's `designecoc`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from types import MappingProxyType

import numpy as np

from granular_id.ecoc.coding_matrix import CodingMatrix, own_coding
from granular_id.ecoc.random_codings import best_random, n_dense, n_sparse
from granular_id.ecoc.training import named

__all__ = [
    "CODINGS",
    "MAX_LEARNERS",
    "Coding",
    "binarycomplete",
    "design",
    "onevsall",
    "onevsone",
    "ordinal",
    "ternarycomplete",
]

MAX_LEARNERS = 100_000
"""More columns than this are refused. It admits all ternary columns of 11 classes (86,526)."""


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
    >>> from granular_id.ecoc.codings import onevsone
    >>> onevsone(3)
    array([[ 1,  1,  0],
           [-1,  0,  1],
           [ 0, -1, -1]], dtype=int8)
    """
    _at_least_two(n_classes)
    low, high = np.triu_indices(n_classes, 1)
    matrix = np.zeros((n_classes, len(low)), dtype=np.int8)
    learner = np.arange(len(low))
    matrix[low, learner] = 1
    matrix[high, learner] = -1
    return matrix


def onevsall(n_classes: int) -> CodingMatrix:
    """One learner for each class against all others, shape (K, K): +1 on the diagonal, -1 elsewhere."""
    _at_least_two(n_classes)
    return np.where(np.eye(n_classes, dtype=bool), 1, -1).astype(np.int8)


def ordinal(n_classes: int) -> CodingMatrix:
    """One learner for each cut of the sorted classes, shape (K, K - 1): -1 up to the cut, +1 beyond it.

    Examples
    --------
    >>> from granular_id.ecoc.codings import ordinal
    >>> ordinal(3)
    array([[-1, -1],
           [ 1, -1],
           [ 1,  1]], dtype=int8)
    """
    _at_least_two(n_classes)
    return np.where(np.arange(n_classes)[:, None] > np.arange(n_classes - 1), 1, -1).astype(np.int8)


def binarycomplete(n_classes: int) -> CodingMatrix:
    """Every division of all classes into two sides, shape (K, 2^(K-1) - 1); class 0 is always on the + side.

    Examples
    --------
    >>> from granular_id.ecoc.codings import binarycomplete
    >>> binarycomplete(3)
    array([[ 1,  1,  1],
           [ 1, -1, -1],
           [-1,  1, -1]], dtype=int8)
    """
    _at_least_two(n_classes)
    number = np.arange(1, 2 ** (n_classes - 1))
    bits = (number >> np.arange(n_classes - 1)[::-1, None]) & 1
    first = np.ones((1, len(number)), dtype=np.int8)
    return np.concatenate((first, np.where(bits == 1, -1, 1).astype(np.int8)))


def ternarycomplete(n_classes: int) -> CodingMatrix:
    """Every column with both signs, shape (K, (3^K - 2^(K+1) + 1) / 2); the first entry that is not 0 is +1."""
    _at_least_two(n_classes)
    number = np.arange(3**n_classes)
    # Digits 0, 1, 2 stand for +1, -1, 0, the first class in the highest place.
    digits = (number // 3 ** np.arange(n_classes)[::-1, None]) % 3
    columns = np.array([1, -1, 0], dtype=np.int8)[digits]
    leading = columns[(columns != 0).argmax(axis=0), np.arange(len(number))]
    return np.ascontiguousarray(columns[:, (leading == 1) & (columns == -1).any(axis=0)])


def _dense(n_classes: int, rng: np.random.Generator) -> CodingMatrix:
    """Random columns of +1 and -1; where all columns are no more than wanted, all of them."""
    n_learners = CODINGS["denserandom"].n_learners(n_classes)
    if n_learners == _n_binary(n_classes):
        return binarycomplete(n_classes)
    return best_random(n_classes, n_learners, rng, zeros=False)


def _sparse(n_classes: int, rng: np.random.Generator) -> CodingMatrix:
    """Random columns of 0, +1 and -1; where all columns are no more than wanted, all of them."""
    n_learners = CODINGS["sparserandom"].n_learners(n_classes)
    if n_learners == _n_ternary(n_classes):
        return ternarycomplete(n_classes)
    return best_random(n_classes, n_learners, rng, zeros=True)


def _n_binary(n_classes: int) -> int:
    return int(2 ** (n_classes - 1) - 1)


def _n_ternary(n_classes: int) -> int:
    return int((3**n_classes - 2 ** (n_classes + 1) + 1) // 2)


@dataclass(frozen=True)
class Coding:
    """A named design.

    Attributes
    ----------
    formula : str
        Number of learners for K classes, as text.
    n_learners : callable
        The same as a function of K.
    matrix : callable
        From K and a random generator, which only random designs use, to the coding matrix.
    """

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
        "denserandom": Coding(
            "10 log2 K rounded up, at most 2^(K-1) - 1", lambda k: min(n_dense(k), _n_binary(k)), _dense
        ),
        "sparserandom": Coding(
            "15 log2 K rounded up, at most (3^K - 2^(K+1) + 1) / 2",
            lambda k: min(n_sparse(k), _n_ternary(k)),
            _sparse,
        ),
    }
)
"""Designs by name."""


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
    >>> from granular_id.ecoc.codings import design
    >>> design("sparserandom", 11, np.random.default_rng(0)).shape
    (11, 52)
    """
    if not isinstance(coding, str):
        return own_coding(coding, n_classes)
    entry: Coding = named(CODINGS, "coding", coding)
    _at_least_two(n_classes)
    n_learners = entry.n_learners(n_classes)
    if n_learners > MAX_LEARNERS:
        count = f"{n_learners:,}" if n_learners < 10**12 else f"{Decimal(n_learners):.2e}"
        raise ValueError(
            f"coding={coding!r} needs {entry.formula} = {count} learners for K = {n_classes} classes, more than "
            f"{MAX_LEARNERS:,}; 'denserandom' needs {CODINGS['denserandom'].n_learners(n_classes)}"
        )
    return entry.matrix(n_classes, rng)


def _at_least_two(n_classes: int) -> None:
    if n_classes < 2:
        raise ValueError(f"n_classes must be at least 2, got {n_classes}")

"""Random coding matrices: of 10,000 draws the one whose closest two rows are farthest apart.

Source: Allwein, Schapire, Singer (2000), "Reducing multiclass to binary", JMLR 1:113-141, section 6: dense matrices
of about 10 log2 K columns of +1 and -1, sparse ones of about 15 log2 K columns in which half of the entries are 0.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from granular_id._blas import single_threaded_blas

__all__ = ["best_random", "n_dense", "n_sparse", "smallest_distance"]

CodingMatrix = npt.NDArray[np.int8]

_DRAWS = 10_000
# Entries drawn at a time: large enough for numpy to be fast, small enough for a few tens of megabytes.
_BLOCK_ENTRIES = 1_000_000


def n_dense(n_classes: int) -> int:
    """Columns of a dense random matrix for K classes: 10 log2 K, rounded up."""
    return math.ceil(10 * math.log2(n_classes))


def n_sparse(n_classes: int) -> int:
    """Columns of a sparse random matrix for K classes: 15 log2 K, rounded up."""
    return math.ceil(15 * math.log2(n_classes))


def best_random(n_classes: int, n_learners: int, rng: np.random.Generator, *, zeros: bool) -> CodingMatrix:
    """Draw coding matrices and keep the one with the largest smallest distance between two rows.

    A column without both signs, and one equal to an earlier column or to its negative, is drawn again.

    Parameters
    ----------
    n_classes, n_learners : int
        K and L; fewer columns than there are different ones.
    rng : numpy.random.Generator
        Same state, same matrix.
    zeros : bool
        Entries 0 with probability 1/2, +1 and -1 with 1/4 each; without zeros +1 and -1 with 1/2 each.

    Returns
    -------
    ndarray of int8, shape (K, L)
        Of equally good draws the first.
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

    The distance of rows a and b is half the sum of ``|m_al| |m_bl| |m_al - m_bl|``: the number of learners
    that see both classes on different sides.
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

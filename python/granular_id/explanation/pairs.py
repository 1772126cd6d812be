"""One score for two classes, as a weighted sum of the scores of binary learners."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["pair_factors"]


def pair_factors(
    coding_matrix: npt.NDArray[np.int8], first: int, second: int, *, decoding: str
) -> npt.NDArray[np.float64]:
    """Factors of the learners' scores whose sum speaks for one class against another.

    Learners trained on these two classes alone speak for them: with one-vs-one there is exactly one, whose
    score is taken as it is (with several, their mean). Where the coding has none, the sum is the difference
    between the decision values of the two classes when decoded with the linear loss (1 - m s) / 2, the only loss
    that keeps the sum linear: each learner counts with half the difference of the two codes, each divided by
    what the decoding divides by.

    Parameters
    ----------
    coding_matrix : ndarray of int8, shape (K, L)
        Codes -1, 0, +1.
    first, second : int
        Rows of the two classes.
    decoding : {"loss_weighted", "loss_based"}
        The former divides by the number of learners that know the class, the latter by L.

    Returns
    -------
    ndarray, shape (L,)

    Examples
    --------
    >>> import numpy as np
    >>> onevsone = np.array([[1, 1, 0], [-1, 0, 1], [0, -1, -1]], dtype=np.int8)
    >>> pair_factors(onevsone, 2, 0, decoding="loss_weighted").tolist()
    [0.0, -1.0, 0.0]
    >>> onevsall = 2 * np.eye(3, dtype=np.int8) - 1
    >>> pair_factors(onevsall, 0, 1, decoding="loss_weighted").round(3).tolist()
    [0.333, -0.333, 0.0]
    """
    codes = coding_matrix.astype(np.float64)
    known = np.abs(codes)
    alone = (known.sum(axis=0) == 2) & (codes[first] * codes[second] == -1)
    if alone.any():
        only: npt.NDArray[np.float64] = np.where(alone, codes[first], 0.0) / alone.sum()
        return only + 0.0  # no negative zeros
    divisors = known.sum(axis=1) if decoding == "loss_weighted" else np.full(len(codes), codes.shape[1])
    factors: npt.NDArray[np.float64] = 0.5 * (
        codes[first] / divisors[first] - codes[second] / divisors[second]
    )
    return factors

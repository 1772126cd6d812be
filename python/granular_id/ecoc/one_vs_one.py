"""All pairs of classes in one call of libsvm: where the exact solution of each pair starts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from granular_id.ecoc.libsvm import TOLERANCES, centred_gram, run_libsvm, snapped, upper_bounds

__all__ = ["OneVsOneGuess", "one_vs_one_guess"]

FloatArray = npt.NDArray[np.float64]

# For a guess it does not pay to wait: pairs that need longer are solved on their own.
_MAX_STEPS_GUESS = 100_000


@dataclass(frozen=True)
class OneVsOneGuess:
    """Multipliers of all pairs of classes, kept as libsvm keeps them: 19,900 pairs of 200 classes would not fit.

    Attributes
    ----------
    by_opponent : ndarray, shape (K - 1, n)
        Multipliers of each row against each other class: the classes below its own first, then those above.
    codes : ndarray of int, shape (n,)
        Class index of each row.
    pairs : tuple of two ndarrays of int, shape (K (K - 1) / 2,)
        Lower and higher class of each learner.
    """

    by_opponent: FloatArray
    codes: npt.NDArray[np.intp]
    pairs: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]

    def of_rows(self, learner: int, rows: npt.NDArray[np.intp]) -> FloatArray:
        """Multipliers of the rows of one learner, to start `solve_binary` from."""
        low, high = self.pairs[0][learner], self.pairs[1][learner]
        opponent = np.where(self.codes[rows] == low, high - 1, low)
        multipliers: FloatArray = self.by_opponent[opponent, rows]
        return multipliers


def one_vs_one_guess(
    gram: FloatArray, codes: npt.NDArray[np.intp], bounds: FloatArray | None
) -> OneVsOneGuess:
    """Multipliers of all pairs of classes from a single call of libsvm.

    Parameters
    ----------
    gram : ndarray, shape (n, n)
        Scalar products of the rows of all classes.
    codes : ndarray of int, shape (n,)
        Class index of each row; every index from 0 to K - 1 occurs.
    bounds : ndarray, shape (n,), or None
        As for `solve_binary`.

    Returns
    -------
    OneVsOneGuess
        Pairs in the order of `granular_id.ecoc.codings.onevsone`.
    """
    centred, _, scale = centred_gram(gram)
    upper = upper_bounds(bounds, len(codes), scale)
    machine = run_libsvm(centred, codes, upper, TOLERANCES[0], _MAX_STEPS_GUESS)
    by_opponent = np.zeros((machine.dual_coef_.shape[0], len(codes)))
    by_opponent[:, machine.support_] = np.abs(machine.dual_coef_)
    low, high = np.triu_indices(len(machine.classes_), 1)
    return OneVsOneGuess(snapped(by_opponent, upper) / scale, codes, (low, high))

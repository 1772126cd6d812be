"""What RICA minimises: reconstruction and contrast, each with its gradient."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

__all__ = ["CONTRASTS", "Objective"]

FloatArray = npt.NDArray[np.float64]
Contrast = Callable[[FloatArray, FloatArray], FloatArray]

# A product of so many factors from 1 to 2 stays in the range of float64.
_FACTORS = 1000


def _logcosh(projections: FloatArray, work: FloatArray) -> FloatArray:
    """``log(cosh(2 z)) / 2`` with slope ``tanh(2 z)``, from one exponential which cannot overflow.

    With e = exp(-4 |z|) the value is ``|z| + log(1 + e) / 2 - log(2) / 2``, and the slope ``2 / (1 + e) - 1`` with
    the sign of z. The logarithms of a column are taken together, as that of a product: each costs as much as
    all the rest.
    """
    np.abs(projections, out=work)
    sums: FloatArray = work.sum(axis=0)
    work *= -4.0
    np.exp(work, out=work)
    work += 1.0
    products = np.multiply.reduceat(work, np.arange(0, len(work), _FACTORS), axis=0)
    sums += 0.5 * np.log(products).sum(axis=0) - 0.5 * math.log(2.0) * len(work)
    np.divide(2.0, work, out=work)
    work -= 1.0
    np.copysign(work, projections, out=projections)
    return sums


def _exp(projections: FloatArray, work: FloatArray) -> FloatArray:
    """``-exp(-z**2 / 2)`` with slope ``z * exp(-z**2 / 2)``."""
    np.square(projections, out=work)
    work *= -0.5
    np.exp(work, out=work)
    projections *= work
    sums: FloatArray = -work.sum(axis=0)
    return sums


def _sqrt(projections: FloatArray, work: FloatArray) -> FloatArray:
    """``sqrt(z**2 + 1e-8)``, an absolute value with a round corner, with slope ``z / sqrt(z**2 + 1e-8)``."""
    np.square(projections, out=work)
    work += 1e-8
    np.sqrt(work, out=work)
    projections /= work
    sums: FloatArray = work.sum(axis=0)
    return sums


CONTRASTS: dict[str, Contrast] = {"logcosh": _logcosh, "exp": _exp, "sqrt": _sqrt}
"""Each takes projections (n, p), returns their sums (p,) over rows, and leaves slopes in their place.

The second array, of the same shape, is room to work in: to ask for new memory takes longer than to fill it.
"""


class Objective:
    """``alpha * ||X W W' - X||^2 + sum of signs * g(X W)`` for W of unit columns.

    The reconstruction needs the rows only through S = X' X: it is ``<W'W, W'SW> - 2 trace(W'SW) + trace(S)``, which
    never makes the n x D residual. With more features than rows S would be the larger, and S W is made from X W.
    It holds room for its work: one for each thread.

    Parameters
    ----------
    rows : ndarray, shape (n, D)
        X.
    alpha : float
        Weight of the reconstruction.
    contrast : str
        Key of `CONTRASTS`.
    signs : ndarray, shape (p,)
        +1 or -1 per component.

    Raises
    ------
    ValueError
        X is so large that its fourth powers overflow.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.rica_objective import Objective
    >>> value, gradient = Objective(np.eye(2), 1.0, "exp", np.ones(2))(np.eye(2))
    >>> round(value, 4), gradient.shape
    (-3.2131, (2, 2))
    """

    def __init__(self, rows: FloatArray, alpha: float, contrast: str, signs: FloatArray) -> None:
        with np.errstate(over="ignore"):
            self._total = float(np.einsum("ij,ij->", rows, rows))
        # The search squares gradients, which are as large as the total.
        if not self._total < 1e-10 * math.sqrt(np.finfo(np.float64).max):
            raise ValueError(
                f"X is too large (up to {np.abs(rows).max():.3g}): the search would overflow; use other units"
            )
        self._rows = rows
        self._scatter = rows.T @ rows if rows.shape[1] <= len(rows) else None
        self._alpha = alpha
        self._contrast = CONTRASTS[contrast]
        self._signs = signs
        self._projections = np.empty((len(rows), len(signs)))
        self._work = np.empty_like(self._projections)

    def __call__(self, units: FloatArray) -> tuple[float, FloatArray]:
        """Value, and gradient (D, p) with respect to W as if its columns were free."""
        projections = np.matmul(self._rows, units, out=self._projections)
        image = self._rows.T @ projections if self._scatter is None else self._scatter @ units
        between = units.T @ units
        energy = units.T @ image
        rebuilt = float(np.vdot(between, energy)) - 2.0 * float(np.trace(energy)) + self._total
        between.flat[:: len(between) + 1] -= 2.0
        gradient: FloatArray = image @ between
        gradient += units @ energy
        gradient *= 2.0 * self._alpha
        contrasts = self._contrast(projections, self._work)
        slopes = np.multiply(projections, self._signs, out=projections)
        gradient += self._rows.T @ slopes
        return self._alpha * rebuilt + float(contrasts @ self._signs), gradient

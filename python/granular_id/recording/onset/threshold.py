"""How many standard errors a change must measure before chance is ruled out for a whole recording."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from granular_id.recording._values import FloatArray

__all__ = ["critical_factors"]

# Degrees of freedom of the table; below the first nothing is known about the noise, above the last all is.
_LEAST, _MOST, _POINTS = 0.5, 1e4, 160
# Numbers of tests are rounded up to the next of 5 % steps: recordings of similar length share one table.
_GRID = 1.05
# Variances are integrated over their probability, from this upwards: less than any rate that can be asked for.
_RAREST = 1e-16
_NODES, _HALVINGS = 160, 32


def critical_factors(dof: FloatArray, n_tests: int, rate: float) -> FloatArray:
    """Return the upper point of the studentised maximum modulus for these degrees of freedom.

    The factor c with P(max |N_i| > c s) = `rate` for `n_tests` standard normal N_i and an independent estimate s
    of their standard deviation with `dof` degrees of freedom. The estimate is shared by all tests of an axis: a
    noise taken for too small by chance is too small for all of them, which Student's t per test would not know.
    By Sidak's inequality tests may be correlated in any way, as overlapping windows are: the rate is then lower.

    Parameters
    ----------
    dof : ndarray
        Degrees of freedom; below 0.5 the factor is infinite.
    n_tests : int
        How many tests are made, at least 1.
    rate : float
        Probability that any of them exceeds the factor by chance.

    Returns
    -------
    ndarray
        In the shape of `dof`.

    References
    ----------
    Z. Sidak, "Rectangular confidence regions for the means of multivariate normal distributions", Journal of
    the American Statistical Association 62 (1967). M. R. Stoline and H. K. Ury, "Tables of the studentized
    maximum modulus distribution", Technometrics 21 (1979).

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording.onset.threshold import critical_factors
    >>> critical_factors(np.array([10.0, 1e4]), 1, 0.05).round(2).tolist()       # Student's t
    [2.23, 1.96]
    """
    grid = n_tests if n_tests < 20 else math.ceil(_GRID ** math.ceil(math.log(n_tests, _GRID) - 1e-9))
    known, factors = _table(grid, rate)
    found = np.exp(np.interp(np.log(np.clip(dof, _LEAST, _MOST)), known, factors))
    return np.where(dof < _LEAST, np.inf, found)


@lru_cache(maxsize=256)
def _table(n_tests: int, rate: float) -> tuple[FloatArray, FloatArray]:
    """Logarithms of degrees of freedom and of the factor, by bisection for all of them at once."""
    from scipy.special import ndtr  # slow to import, and only this step needs it  # noqa: PLC0415

    dof, sd, weights = _estimates()
    low, high = np.zeros(_POINTS), np.full(_POINTS, math.log(1e30))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        with np.errstate(divide="ignore"):
            all_inside = n_tests * np.log1p(-2 * ndtr(-np.exp(middle)[:, np.newaxis] * sd))
        too_often = -np.expm1(all_inside) @ weights > rate
        low, high = np.where(too_often, middle, low), np.where(too_often, high, middle)
    return np.log(dof), high


@lru_cache(maxsize=1)
def _estimates() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Degrees of freedom, the standard deviations that each may estimate where 1 is true, and their weights."""
    from scipy.special import gammaincinv  # noqa: PLC0415

    dof = np.geomspace(_LEAST, _MOST, _POINTS)
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    # equal care for every decade of probability: the small variances make the false alarms
    probability = np.exp(0.5 * math.log(_RAREST) * (1.0 - nodes))
    weights = weights * -0.5 * math.log(_RAREST) * probability
    sd = np.sqrt(gammaincinv(dof[:, np.newaxis] / 2, probability) * 2 / dof[:, np.newaxis])
    return dof, sd, weights

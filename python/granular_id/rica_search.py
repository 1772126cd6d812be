"""How RICA looks for a minimum: L-BFGS over free vectors, whose directions are the components."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from granular_id.rica_objective import Objective

__all__ = ["REACHED_MAX_ITER", "End", "descend", "unit_columns"]

FloatArray = npt.NDArray[np.float64]

REACHED_MAX_ITER = 1
"""Status of scipy's L-BFGS-B."""


@dataclass(frozen=True)
class End:
    """Where one start led.

    Attributes
    ----------
    components : ndarray, shape (p, D)
        Unit rows.
    value : float
        Of the objective.
    n_iter : int
        Iterations taken.
    status : int
        Of L-BFGS-B: 0 converged, `REACHED_MAX_ITER`, or 2 where its line search found nothing lower.
    """

    components: FloatArray
    value: float
    n_iter: int
    status: int


def descend(objective: Objective, start: FloatArray, options: dict[str, float]) -> End:
    """Follow an objective downhill.

    Parameters
    ----------
    objective : Objective
    start : ndarray, shape (D, p)
        Free vectors as columns.
    options : dict
        Of scipy's L-BFGS-B: ``maxiter``, ``gtol``, ``ftol``.
    """
    shape = start.shape

    def of_free_vectors(flat: FloatArray) -> tuple[float, FloatArray]:
        vectors = flat.reshape(shape)
        norms = np.linalg.norm(vectors, axis=0)
        units = vectors / norms
        value, gradient = objective(units)
        gradient -= units * np.einsum("ij,ij->j", units, gradient)
        gradient /= norms
        return value, gradient.ravel()

    # Each iteration asks for about one value; the limit on values must never be the one that stops.
    found = minimize(
        of_free_vectors,
        start.ravel(),
        jac=True,
        method="L-BFGS-B",
        options={**options, "maxfun": 100 * int(options["maxiter"]) + 100},
    )
    components = np.ascontiguousarray(unit_columns(found.x.reshape(shape)).T)
    return End(components, float(found.fun), max(1, int(found.nit)), int(found.status))


def unit_columns(vectors: FloatArray) -> FloatArray:
    """Columns (D, p) divided by their length; none may be zero."""
    # By the largest element first: squares neither overflow nor vanish.
    scaled = vectors / np.abs(vectors).max(axis=0)
    columns: FloatArray = scaled / np.linalg.norm(scaled, axis=0)
    return columns

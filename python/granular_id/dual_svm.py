"""One two-class linear support vector machine, solved on the Gram matrix of its rows.

libsvm finds which rows carry the margin; one linear system in float64 then gives the multipliers. libsvm stops at a
tolerance and keeps its kernel in float32, so its answer depends on the order of the rows, on where the
origin lies and on whether a row was repeated or weighted. The solution of the linear system does not.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from sklearn import config_context
from sklearn.exceptions import ConvergenceWarning
from sklearn.svm import SVC

__all__ = ["BinarySolution", "NotSeparableError", "solve_binary"]

FloatArray = npt.NDArray[np.float64]

# libsvm needs to name the right rows only, its multipliers are computed anew: its own default does in nearly all
# cases, and the second value where it did not.
_TOLERANCES = (1e-3, 1e-6)
# libsvm's own limit; scikit-learn's default is none, and a problem past the accuracy of float32 then never ends.
_MAX_STEPS = 10_000_000
# With a margin that libsvm can resolve in float32 it ends far below this number of steps.
_MAX_STEPS_HARD = 1_000_000
# Relative to the squared spread of the rows. Multipliers of separable rows stay below 1 / (relative margin)^2,
# and float32 resolves no margin of less than about 1e-4 of the spread.
_HARD_BOUND = 1e10
_KKT_TOLERANCE = 1e-8


class NotSeparableError(ValueError):
    """No hyperplane separates the two classes, or none that can be found numerically."""


@dataclass(frozen=True)
class BinarySolution:
    """Solution of one two-class problem.

    Attributes
    ----------
    dual_coef : ndarray, shape (n,)
        Target times multiplier of each row; 0 for rows that carry nothing.
    intercept : float
        Score at the origin of the Gram matrix.
    at_bound : int
        Number of multipliers at their upper bound.
    converged : bool
        False when the solver gave up before its tolerance was met.
    """

    dual_coef: FloatArray
    intercept: float
    at_bound: int
    converged: bool


def solve_binary(
    gram: FloatArray, targets: FloatArray, bounds: FloatArray | None, *, scale_free_bound: float = _HARD_BOUND
) -> BinarySolution:
    """Maximise the margin between the rows with target +1 and those with target -1.

    Parameters
    ----------
    gram : ndarray, shape (n, n)
        Scalar products of the rows, finite and symmetric. The origin does not matter: rows are centred here,
        as an intercept that is not penalised allows. Without this a common offset of 1000 standard deviations
        makes the scores of libsvm (float32) meaningless.
    targets : ndarray, shape (n,)
        +1.0 or -1.0, both present.
    bounds : ndarray, shape (n,), or None
        Upper bound of each multiplier (C times the weight of the row), positive. None asks for the hard margin.
    scale_free_bound : float, default 1e10
        Stands for infinity in the hard margin, in units of 1 / (mean squared distance from the centre).

    Returns
    -------
    BinarySolution

    Raises
    ------
    NotSeparableError
        `bounds` is None and the classes overlap, or lie too close for the solver.
    """
    row_mean = gram.mean(axis=0)
    centred = gram - row_mean
    centred -= row_mean[:, None]
    centred += row_mean.mean()
    # A power of two scales without rounding, and keeps float32 kernels inside their range.
    spread = float(np.trace(centred)) / len(targets)
    scale = float(np.ldexp(1.0, int(np.frexp(spread)[1]))) if spread > 0 else 1.0
    centred /= scale
    hard = bounds is None
    upper = np.full(len(targets), scale_free_bound) if bounds is None else bounds * scale

    dual, intercept, converged = _libsvm(centred, targets, upper, _TOLERANCES[0], hard=hard)
    exact = _active_set_solution(centred, targets, upper, dual)
    if exact is None and converged:
        tighter, intercept_tighter, ended = _libsvm(centred, targets, upper, _TOLERANCES[1], hard=hard)
        exact = _active_set_solution(centred, targets, upper, tighter)
        if ended:
            dual, intercept = tighter, intercept_tighter
    if exact is not None:
        dual, intercept = exact
        converged = True
    at_bound = int(np.count_nonzero(np.abs(dual) >= upper))
    if hard:
        _check_separated(targets * (centred @ dual + intercept), at_bound, converged)
    dual = dual / scale
    return BinarySolution(dual, intercept - float(dual @ row_mean), at_bound, converged)


def _libsvm(
    gram: FloatArray, targets: FloatArray, upper: FloatArray, tolerance: float, *, hard: bool
) -> tuple[FloatArray, float, bool]:
    """Multipliers with sign, intercept, and whether the tolerance was met."""
    largest = float(upper.max())
    machine = SVC(
        C=largest,
        kernel="precomputed",
        tol=tolerance,
        shrinking=False,  # slower than it saves for the few hundred rows of a pair, and less exact
        max_iter=_MAX_STEPS_HARD if hard else _MAX_STEPS,
    )
    weights = None if float(upper.min()) == largest else upper / largest
    with warnings.catch_warnings(), config_context(assume_finite=True, skip_parameter_validation=True):
        warnings.simplefilter("ignore", ConvergenceWarning)  # the caller names the classes in its own warning
        machine.fit(gram, targets, sample_weight=weights)
    dual = np.zeros(len(targets))
    # np.minimum: libsvm multiplies C and the weights in another order, so a bound may differ in its last bit.
    multipliers = np.abs(machine.dual_coef_[0])
    limits = upper[machine.support_]
    multipliers = np.where(multipliers >= limits * (1 - 1e-12), limits, multipliers)
    dual[machine.support_] = targets[machine.support_] * multipliers
    return dual, float(machine.intercept_[0]), machine.fit_status_ == 0


def _active_set_solution(
    gram: FloatArray, targets: FloatArray, upper: FloatArray, dual: FloatArray
) -> tuple[FloatArray, float] | None:
    """Solve for the free multipliers and the intercept, given which rows are free and which at their bound.

    None when the system is singular or its solution breaks an optimality condition: the guess was wrong.
    """
    bound = np.abs(dual) >= upper
    free = (dual != 0) & ~bound
    n_free = int(free.sum())
    if n_free == 0:
        return None
    at_bound = np.where(bound, dual, 0.0)
    system = np.ones((n_free + 1, n_free + 1))
    system[:n_free, :n_free] = gram[np.ix_(free, free)]
    system[n_free, n_free] = 0.0
    wanted = np.append(targets[free] - gram[free] @ at_bound, -at_bound.sum())
    try:
        solution = np.linalg.solve(system, wanted)
    except np.linalg.LinAlgError:
        return None
    exact = at_bound
    exact[free] = solution[:n_free]
    intercept = float(solution[n_free])
    multipliers = exact * targets
    if (multipliers < 0).any() or (multipliers > upper).any():
        return None
    # Functional margins: 1 for free rows, at least 1 for rows without, at most 1 for rows at the bound.
    excess = targets * (gram @ exact + intercept) - 1.0
    violation = np.where(free, np.abs(excess), np.where(bound, excess, -excess))
    # Written so that a NaN from a system that is singular to working precision refuses too.
    if not violation.max() <= _KKT_TOLERANCE:
        return None
    return exact, intercept


def _check_separated(margins: FloatArray, at_bound: int, converged: bool) -> None:
    smallest = float(margins.min())
    if converged and not at_bound and smallest >= 1.0 - 2.0 * _TOLERANCES[0]:
        return
    wrong = int((margins <= 0).sum())
    if wrong:
        raise NotSeparableError(f"no hyperplane with a usable margin found ({wrong} rows on the wrong side)")
    raise NotSeparableError("the gap between them is too narrow for the solver")

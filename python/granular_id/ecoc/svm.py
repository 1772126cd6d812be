"""One two-class linear support vector machine, solved on the Gram matrix of its rows.

libsvm finds which rows carry the margin; one linear system in float64 then gives the multipliers. libsvm
stops at a tolerance and keeps its kernel in float32, so its answer depends on the order of the rows, on where
the origin lies and on whether a row was repeated or weighted. The solution of the linear system does not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn import config_context
from sklearn.svm import SVC

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

# libsvm needs to name the right rows only, its multipliers are computed anew: its own default does in nearly
# all cases, the second value where it did not.
_TOLERANCES = (1e-3, 1e-6)
# libsvm's own limit. scikit-learn has none, and problems past the accuracy of float32 then never end.
_MAX_STEPS = 10_000_000
# For a guess it does not pay to wait: pairs that need longer are solved on their own.
_MAX_STEPS_GUESS = 100_000
# What costs and weights far out of the ordinary are brought back to.
_LARGEST_BOUND, _LEAST_BOUND = 1e300, 1e-300
_KKT_TOLERANCE = 1e-8
_MAX_ROUNDS = 20
# Squared distance at which rows count as equal, on the scale of their mean squared distance from the centre: products
# of equal rows can differ in their last bits.
_SAME = 1e-10


@dataclass(frozen=True)
class BinarySolution:
    """Solution of one two-class problem.

    `dual_coef` (n,) is target times multiplier, `intercept` the score at the origin of the Gram matrix, `at_bound`
    the number of multipliers at their upper bound; not `converged` where the solver gave up before its tolerance.
    """

    dual_coef: FloatArray
    intercept: float
    at_bound: int
    converged: bool


def solve_binary(
    gram: FloatArray,
    targets: FloatArray,
    bounds: FloatArray,
    *,
    guess: FloatArray | None = None,
) -> BinarySolution:
    """Maximise the margin between the rows with target +1 and those with target -1.

    `bounds` (n,) are upper bounds of the multipliers (C times the weight of the row).
    `guess` (n,) holds multipliers near enough to tell free, bound and idle rows apart; it is forgotten where it does
    not lead to the solution. The origin of the Gram matrix does not matter: rows are centred here, as an intercept
    that is not penalised allows. Else an offset of 1000 standard deviations makes libsvm's scores meaningless.
    """
    centred, row_mean, scale = _centred_gram(gram)
    upper = _upper_bounds(bounds, scale)

    dual, intercept, converged = np.zeros(len(targets)), 0.0, False
    exact = None if guess is None else _active_set_solution(centred, targets, upper, targets * guess * scale)
    for tolerance in _TOLERANCES:
        if exact is not None:
            break
        machine = _run_libsvm(centred, targets, upper, tolerance, _MAX_STEPS)
        if converged and machine.fit_status_ != 0:
            break  # the looser tolerance was met, the tighter one is out of reach
        converged = machine.fit_status_ == 0
        dual = np.zeros(len(targets))
        dual[machine.support_] = machine.dual_coef_[0]
        dual = _snapped(dual, upper)
        intercept = float(machine.intercept_[0])
        exact = _active_set_solution(centred, targets, upper, dual)
        if not converged:
            break
    if exact is not None:
        dual, intercept = exact
        converged = True
    else:
        merged = _without_repetitions(centred, gram, targets, bounds)
        if merged is not None:
            return merged
    at_bound = int(np.count_nonzero(np.abs(dual) >= upper))
    dual = dual / scale
    return BinarySolution(dual, intercept - float(dual @ row_mean), at_bound, converged)


def _without_repetitions(
    centred: FloatArray, gram: FloatArray, targets: FloatArray, bounds: FloatArray
) -> BinarySolution | None:
    """Solve with one row for all rows that are equal, which then share its multiplier; None when all differ.

    Of equal rows one may sit at its bound and the next not, in as many ways as there are copies: to tell free rows
    from bound ones then leads nowhere.
    """
    first = first_equal(centred, targets)
    kept, kind = np.unique(first, return_inverse=True)
    if len(kept) == len(targets):
        return None
    total = np.bincount(kind, weights=bounds).astype(np.float64)
    solution = solve_binary(gram[np.ix_(kept, kept)], targets[kept], total)
    at_bound = np.count_nonzero((np.abs(solution.dual_coef) >= total)[kind])
    dual_coef = solution.dual_coef[kind] * (bounds / total[kind])
    return BinarySolution(dual_coef, solution.intercept, int(at_bound), solution.converged)


def _active_set_solution(
    gram: FloatArray, targets: FloatArray, upper: FloatArray, dual: FloatArray
) -> tuple[FloatArray, float] | None:
    """Exact multipliers (with sign) and intercept, given a guess of which rows are free, bound and idle.

    Rows that turn out to be guessed wrong change sides, a few times at most. None when the conditions of
    optimality still do not hold then.
    """
    bound = np.abs(dual) >= upper
    free = (dual != 0) & ~bound
    for _ in range(_MAX_ROUNDS):
        exact, intercept = _stationary_point(gram, targets, np.where(bound, targets * upper, 0.0), free)
        multipliers = exact * targets
        # Functional margins: 1 for free rows, at least 1 for idle rows, at most 1 for rows at their bound.
        excess = targets * (gram @ exact + intercept) - 1.0
        if not np.abs(excess[free]).max(initial=0.0) <= _KKT_TOLERANCE:  # NaN too: nothing to learn from it
            return None
        to_idle, to_bound = free & (multipliers < 0), free & (multipliers > upper)
        if not (to_idle | to_bound).any():
            # Written so that rows of a NaN intercept (no row tells where it lies) are freed too.
            to_free = ~free & ~(np.where(bound, excess, -excess) <= _KKT_TOLERANCE)
            if not to_free.any():
                balanced = abs(exact.sum()) <= _KKT_TOLERANCE * np.abs(exact).sum()
                return (exact, intercept) if balanced else None
            free |= to_free
            bound &= ~to_free
        free &= ~(to_idle | to_bound)
        bound |= to_bound
    return None


def _stationary_point(
    gram: FloatArray, targets: FloatArray, at_bound: FloatArray, free: npt.NDArray[np.bool_]
) -> tuple[FloatArray, float]:
    """Multipliers (with sign) and intercept that put the free rows on the margin."""
    n_free = int(free.sum())
    if n_free == 0:
        return at_bound, _middle_intercept(targets, at_bound, gram @ at_bound)
    system = np.ones((n_free + 1, n_free + 1))
    system[:n_free, :n_free] = gram[np.ix_(free, free)]
    system[n_free, n_free] = 0.0
    wanted = np.append(targets[free] - gram[free] @ at_bound, -at_bound.sum())
    try:
        solution = np.linalg.solve(system, wanted)
        solved = bool(np.abs(system @ solution - wanted).max() <= _KKT_TOLERANCE)
    except np.linalg.LinAlgError:
        solved = False
    if not solved:
        # Repeated rows make the system singular, not unsolvable: the shortest solution shares their weight.
        solution = np.linalg.lstsq(system, wanted, rcond=None)[0]
    exact = at_bound.copy()
    exact[free] = solution[:n_free]
    return exact, float(solution[n_free])


def _middle_intercept(targets: FloatArray, at_bound: FloatArray, scores: FloatArray) -> float:
    """Middle of the optimal intercepts when no row is free, as libsvm takes it; NaN when no row tells."""
    wanted = targets - scores
    is_bound = at_bound != 0
    # A row at its bound must not be beyond its margin, an idle row not inside it.
    from_below = wanted[(targets > 0) != is_bound]
    from_above = wanted[(targets > 0) == is_bound]
    if len(from_below) == 0 or len(from_above) == 0:
        return float("nan")
    return float(from_below.max() + from_above.min()) / 2.0


class _QuietSVC(SVC):  # type: ignore[misc]
    """SVC whose caller looks at `fit_status_` and names the classes in a warning of its own.

    `warnings.catch_warnings` would do the same for the whole process, and partitions are trained in threads.
    """

    def _warn_from_fit_status(self) -> None:
        pass


def _centred_gram(gram: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Gram matrix of the rows about their mean in units of their spread; mean of each row before; the unit.

    The unit is a power of two, so that it scales without rounding; it keeps kernels in the range of float32.
    """
    row_mean = gram.mean(axis=0)
    centred = gram - row_mean
    centred -= row_mean[:, None]
    centred += row_mean.mean()
    spread = float(np.trace(centred)) / len(gram)
    scale = float(np.ldexp(1.0, int(np.frexp(spread)[1]))) if spread > 0 else 1.0
    centred /= scale
    return centred, row_mean, scale


def _upper_bounds(bounds: FloatArray, scale: float) -> FloatArray:
    """Bounds (n,) of the multipliers in units of 1 / `scale`; none overflows or vanishes."""
    with np.errstate(over="ignore"):
        scaled = bounds * scale
    # libsvm drops rows of weight 0, and with them a class.
    upper: FloatArray = np.clip(scaled, _LEAST_BOUND, _LARGEST_BOUND)
    return upper


def _run_libsvm(
    gram: FloatArray, labels: npt.NDArray[Any], upper: FloatArray, tolerance: float, max_steps: int
) -> SVC:
    """Fit libsvm to labels with an upper bound (n,) for the multiplier of each row, in at most `max_steps` steps."""
    largest = float(upper.max())
    machine = _QuietSVC(
        C=largest,
        kernel="precomputed",
        tol=tolerance,
        shrinking=False,  # slower than it saves for the few hundred rows of a pair, and less exact
        max_iter=max_steps,
    )
    weights = None if float(upper.min()) == largest else upper / largest
    with config_context(assume_finite=True, skip_parameter_validation=True):
        return machine.fit(gram, labels, sample_weight=weights)


def _snapped(dual: FloatArray, upper: FloatArray) -> FloatArray:
    """Multipliers within rounding of their bound, put on it: libsvm multiplies C and weight on its own."""
    return np.where(np.abs(dual) >= upper * (1 - 1e-12), np.copysign(upper, dual), dual)


def one_vs_one_guess(
    gram: FloatArray, codes: IntArray, bounds: FloatArray
) -> Callable[[int, IntArray], FloatArray]:
    """Train all pairs of classes by one call of libsvm; every class index occurs in `codes`.

    Returns a function from a learner (in the order of `onevsone`) and its rows to multipliers that `solve_binary` can
    start from. They are kept as libsvm keeps them: 19,900 pairs of 200 classes would not fit.
    """
    centred, _, scale = _centred_gram(gram)
    upper = _upper_bounds(bounds, scale)
    machine = _run_libsvm(centred, codes, upper, _TOLERANCES[0], _MAX_STEPS_GUESS)
    # Of each row against each other class: the classes below its own first, then those above.
    by_opponent = np.zeros((machine.dual_coef_.shape[0], len(codes)))
    by_opponent[:, machine.support_] = np.abs(machine.dual_coef_)
    by_opponent = _snapped(by_opponent, upper) / scale
    lower, higher = np.triu_indices(len(machine.classes_), 1)

    def multipliers(learner: int, rows: IntArray) -> FloatArray:
        low, high = lower[learner], higher[learner]
        found: FloatArray = by_opponent[np.where(codes[rows] == low, high - 1, low), rows]
        return found

    return multipliers


def first_equal(gram: FloatArray, labels: npt.NDArray[np.generic] | None = None) -> IntArray:
    """For each row the index of the first row that equals it, told by scalar products; other labels differ.

    >>> first_equal(np.array([[5.0, 10.0, 5.0], [10.0, 25.0, 10.0], [5.0, 10.0, 5.0]]))
    array([0, 1, 0])
    """
    squares = np.diag(gram)
    distance = squares[:, None] + squares - 2.0 * gram
    spread = max(float(np.trace(gram)) / len(gram) - float(gram.mean()), 0.0)
    same = distance <= _SAME * spread
    np.fill_diagonal(same, val=True)  # rounding of large products may deny that a row equals itself
    if labels is not None:
        same &= labels[:, None] == labels
    first: IntArray = same.argmax(axis=1)
    return first

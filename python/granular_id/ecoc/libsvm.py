"""libsvm on a Gram matrix: what it needs to stay exact in its float32, and a call that says nothing by itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn import config_context
from sklearn.svm import SVC

__all__ = ["HARD_BOUND", "TOLERANCES", "centred_gram", "run_libsvm", "snapped", "upper_bounds"]

FloatArray = npt.NDArray[np.float64]

# libsvm needs to name the right rows only, its multipliers are computed anew: its own default does in nearly
# all cases, the second value where it did not.
TOLERANCES = (1e-3, 1e-6)
# Stands for infinity, in units of 1 / (mean squared distance from the centre). Multipliers of separable rows
# stay below 1 / (relative margin)^2, and float32 resolves no margin of less than about 1e-4 of the spread.
HARD_BOUND = 1e10
# What costs and weights far out of the ordinary are brought back to.
_LARGEST_BOUND, _LEAST_BOUND = 1e300, 1e-300


class _QuietSVC(SVC):  # type: ignore[misc]
    """SVC whose caller looks at `fit_status_` and names the classes in a warning of its own.

    `warnings.catch_warnings` would do the same for the whole process, and partitions are trained in threads.
    """

    def _warn_from_fit_status(self) -> None:
        pass


def centred_gram(gram: FloatArray) -> tuple[FloatArray, FloatArray, float]:
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


def upper_bounds(bounds: FloatArray | None, n_rows: int, scale: float) -> FloatArray:
    """Bounds (n,) of the multipliers in units of 1 / `scale`, `HARD_BOUND` for None; none overflows or vanishes."""
    if bounds is None:
        return np.full(n_rows, HARD_BOUND)
    with np.errstate(over="ignore"):
        scaled = bounds * scale
    # libsvm drops rows of weight 0, and with them a class.
    upper: FloatArray = np.clip(scaled, _LEAST_BOUND, _LARGEST_BOUND)
    return upper


def run_libsvm(
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


def snapped(dual: FloatArray, upper: FloatArray) -> FloatArray:
    """Multipliers within rounding of their bound, put on it: libsvm multiplies C and weight on its own."""
    return np.where(np.abs(dual) >= upper * (1 - 1e-12), np.copysign(upper, dual), dual)

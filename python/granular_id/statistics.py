"""Whether one method is better than another, from accuracies on overlapping partitions (shares of 1, one a partition).

Partitions of one data set share most of their recordings: a test that takes their accuracies for independent calls
chance a difference. The tests here allow for the overlap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from sklearn.metrics import confusion_matrix

FloatArray = NDArray[np.float64]

MIN_PARTITIONS = 3
"""Below this nothing but differences is given. Two partitions leave one degree of freedom: a 95 % interval
is then +- 12.7 standard errors."""

# Accuracies are ratios of counts below 1e6 in float64: a spread below this is rounding.
_NO_SPREAD = 1e-12


def corrected_resampled_t(differences: ArrayLike, n_train: float, n_test: float) -> float:
    """Two-sided p-value of the test whether a mean difference (J,) over overlapping partitions is zero.

    ``t = mean(d) / sqrt((1/J + n_test/n_train) var(d))`` with J - 1 degrees of freedom; the plain paired t-test has 1/J
    alone, as if each partition had brought recordings of its own. Differences that are all zero give p = 1. A single
    difference, or the same one in every partition, gives NaN: nothing tells how far it would vary. Nadeau & Bengio,
    "Inference for the generalization error", Machine Learning 52 (2003), section 3.
    """
    d = np.asarray(differences, dtype=np.float64)
    if np.abs(d).max() <= _NO_SPREAD:
        return 1.0
    statistic = float(d.mean()) / _standard_error(d, n_test / n_train)
    return float(2 * stats.t.sf(abs(statistic), d.size - 1))


def mean_interval(
    accuracies: ArrayLike, n_train: float | Sequence[float], n_test: float | Sequence[float]
) -> tuple[float, float]:
    """95 % confidence interval of a mean accuracy (J,) over overlapping partitions, inside [0, 1].

    ``mean +- t * sqrt((1/J + n_test/n_train) var)``, the interval that belongs to `corrected_resampled_t`; of sizes
    that differ the means count. NaN for fewer than three partitions and where all agree (all at 100 %, for instance):
    their spread says nothing about new recordings.
    """
    shares = np.asarray(accuracies, dtype=np.float64)
    error = _standard_error(shares, float(np.mean(n_test)) / float(np.mean(n_train)))
    if shares.size < MIN_PARTITIONS or math.isnan(error):
        return math.nan, math.nan
    reach = float(stats.t.ppf(0.975, shares.size - 1)) * error
    mean = float(shares.mean())
    return max(0.0, mean - reach), min(1.0, mean + reach)


def mann_whitney(first: ArrayLike, second: ArrayLike) -> float:
    """Two-sided p-value of the Mann-Whitney U test, which the paper reports.

    It takes all values for independent. Accuracies of overlapping partitions are not, and its p-value is far too small.
    """
    if np.ptp(np.concatenate((first, second))) <= _NO_SPREAD:
        return 1.0  # ranks without any order, where the normal approximation divides by zero
    return float(stats.mannwhitneyu(first, second, alternative="two-sided").pvalue)


def holm(p_values: ArrayLike) -> FloatArray:
    """Adjust p-values (m,) for their number, by Holm's step-down method; NaN, of a test not made, does not count.

    Rejecting where the adjusted value is below alpha keeps the chance of any false rejection below alpha, whatever the
    dependence between the tests. Holm, Scandinavian Journal of Statistics 6 (1979).
    """
    p = np.asarray(p_values, dtype=np.float64)
    made = np.flatnonzero(~np.isnan(p))
    order = made[np.argsort(p[made], kind="stable")]
    adjusted = np.full(p.shape, np.nan)
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(np.arange(order.size, 0, -1) * p[order]))
    return adjusted


def _standard_error(values: FloatArray, overlap: float) -> float:
    """Corrected standard error of the mean; NaN where the values have no spread to estimate it from."""
    if values.size < 2 or np.ptp(values) <= _NO_SPREAD:
        return math.nan
    return math.sqrt((1 / values.size + overlap) * float(values.var(ddof=1)))


# Figures from true and predicted class numbers, for results and model cards.


def confusion_counts(
    truth: NDArray[np.intp], predicted: NDArray[np.intp], n_classes: int
) -> NDArray[np.int64]:
    """Count pairs of class numbers: true classes in rows, predicted ones in columns, (K, K)."""
    counts: NDArray[np.int64] = confusion_matrix(truth, predicted, labels=range(n_classes))
    return counts


# scikit-learn's recall and F1 have the same bits, but count the pairs anew for each figure.


def recall_per_class(confusion: NDArray[np.int64]) -> FloatArray:
    """Share of each class that was recognised, (K,); NaN for a class that was never tested."""
    with np.errstate(invalid="ignore"):
        shares: FloatArray = np.diag(confusion) / confusion.sum(axis=1)
    return shares


def macro_f1(confusion: NDArray[np.int64]) -> float:
    """Mean over classes of F1; a class that is neither present nor predicted counts as 0."""
    present_and_predicted = confusion.sum(axis=0) + confusion.sum(axis=1)
    return float((2 * np.diag(confusion) / np.maximum(present_and_predicted, 1)).mean())


def sample_sd(values: FloatArray) -> float:
    """Sample standard deviation (divisor n - 1); NaN for a single value, which has none."""
    return float(values.std(ddof=1)) if values.size > 1 else math.nan  # numpy would warn

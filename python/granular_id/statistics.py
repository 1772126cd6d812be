"""Whether one method is better than another, from accuracies on overlapping partitions (shares of 1, one a partition).

Partitions of one data set share most of their recordings: a test that takes their accuracies for independent calls
chance a difference. The tests here allow for the overlap.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components
from scipy.special import stdtr, stdtrit

FloatArray = NDArray[np.float64]

MIN_PARTITIONS = 3
"""Below this nothing but differences is given: two partitions leave one degree of freedom."""

MIN_SESSIONS = 3
"""Below this no interval is given: with two sessions it is +- 12.7 standard errors."""

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
    return float(2 * stdtr(d.size - 1, -abs(statistic)))


def cluster_interval(
    right: NDArray[np.bool_], truth: NDArray[np.intp], clusters: NDArray[np.intp]
) -> tuple[float, float]:
    """95 % interval of balanced accuracy over new clusters, inside [0, 1]: Student's t over sessions.

    `right`, `truth` and `clusters` (n,) say of each answer whether it is right, and number its class and its session.
    Answers of a session resemble each other: the session is what is drawn anew, and its share in the mean recall over
    classes is what varies. The error is that of leaving one session out after the other. Degrees of freedom (Welch)
    come from groups of classes that share sessions, each with its sessions less one; a session of many recordings makes
    the others count for less. NaN for fewer than three sessions, where some class has one alone, and where all answers
    are alike.
    """
    numbers, cluster = np.unique(clusters, return_inverse=True)
    classes, of_class = np.unique(truth, return_inverse=True)
    if numbers.size < MIN_SESSIONS:
        return math.nan, math.nan
    influence, weight = np.zeros(numbers.size), np.zeros(numbers.size)
    recalls = np.zeros(classes.size)
    shared = np.zeros((classes.size, numbers.size), dtype=np.bool_)
    for k in range(classes.size):
        own = of_class == k
        n_of = np.bincount(cluster[own], minlength=numbers.size)
        hits = np.bincount(cluster[own], weights=right[own], minlength=numbers.size)
        shared[k] = n_of > 0
        n_clusters = int(shared[k].sum())
        if n_clusters < 2:
            return math.nan, math.nan
        recalls[k] = hits.sum() / n_of.sum()
        share = n_of / n_of.sum()
        left_out = math.sqrt((n_clusters - 1) / n_clusters) / (1 - share)
        influence += left_out * (hits - recalls[k] * n_of) / (n_of.sum() * classes.size)
        weight += share / classes.size
    variance = float((influence**2).sum())
    if variance <= _NO_SPREAD**2:
        return math.nan, math.nan
    n_groups, group = connected_components(shared @ shared.T, directed=False)
    uncertainty = 0.0
    for g in range(n_groups):
        own = shared[group == g].any(axis=0)
        # As many sessions of one size weigh the same.
        n_alike = weight[own].sum() ** 2 / (weight[own] ** 2).sum()
        uncertainty += float((influence[own] ** 2).sum()) ** 2 / max(n_alike - 1, _NO_SPREAD)
    freedom = max(1.0, variance**2 / uncertainty)
    reach = float(stdtrit(freedom, 0.975)) * math.sqrt(variance)
    mean = float(recalls.mean())
    return max(0.0, mean - reach), min(1.0, mean + reach)


def mean_interval(values: ArrayLike) -> tuple[float, float]:
    """95 % interval of the mean of independent values (J,), one a session: Student's t. NaN for fewer than three."""
    own = np.asarray(values, dtype=np.float64)
    if own.size < MIN_SESSIONS:
        return math.nan, math.nan
    reach = float(stdtrit(own.size - 1, 0.975)) * float(own.std(ddof=1)) / math.sqrt(own.size)
    return float(own.mean()) - reach, float(own.mean()) + reach


def mann_whitney(first: ArrayLike, second: ArrayLike) -> float:
    """Two-sided p-value of the Mann-Whitney U test, which the paper reports.

    It takes all values for independent. Accuracies of overlapping partitions are not, and its p-value is far too small.
    """
    if np.ptp(np.concatenate((first, second))) <= _NO_SPREAD:
        return 1.0  # ranks without any order, where the normal approximation divides by zero
    from scipy.stats import mannwhitneyu  # slow to import, and only the paper's table asks for it

    return float(mannwhitneyu(first, second, alternative="two-sided").pvalue)


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

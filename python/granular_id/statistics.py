"""Whether one method is better than another, from accuracies on overlapping partitions (shares of 1, one a partition).

Partitions of one data set share most of their recordings: a test that takes their accuracies for independent calls
chance a difference. The tests here allow for the overlap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats
from sklearn.metrics import confusion_matrix

FloatArray = NDArray[np.float64]

ROPE = 0.01
"""Accuracies closer than this count as equivalent: one recording in a hundred (Corani & Benavoli's choice)."""

MIN_PARTITIONS = 3
"""Below this nothing but differences is given. Two partitions leave one degree of freedom: a 95 % interval
is then +- 12.7 standard errors."""

# Accuracies are ratios of counts below 1e6 in float64: a spread below this is rounding.
_NO_SPREAD = 1e-12


class CorrectedT(NamedTuple):
    """Result of `corrected_resampled_t`.

    Attributes
    ----------
    mean : float
        Mean difference.
    standard_error : float
        Of the mean, corrected for the overlap; NaN where the differences have no spread.
    statistic : float
        ``mean / standard_error``, Student with `df` degrees of freedom if the methods are equally good.
    df : int
        Number of differences minus 1.
    p_value : float
        Two-sided.
    """

    mean: float
    standard_error: float
    statistic: float
    df: int
    p_value: float


class Posterior(NamedTuple):
    """Result of `bayesian_correlated_t`: three probabilities that add up to 1, or three NaN."""

    worse: float
    equivalent: float
    better: float


def corrected_resampled_t(differences: ArrayLike, n_train: float, n_test: float) -> CorrectedT:
    """Test whether a mean difference over overlapping partitions is zero.

    ``t = mean(d) / sqrt((1/J + n_test/n_train) var(d))`` with J - 1 degrees of freedom; the plain paired t-test
    has 1/J alone, as if each partition had brought recordings of its own.

    Parameters
    ----------
    differences : array-like, shape (J,)
        Accuracy of one method minus that of the other on the same partition.
    n_train, n_test : float
        Recordings that train and that are tested in a partition (the mean, where partitions differ).

    Returns
    -------
    CorrectedT
        Differences that are all zero give p = 1. A single difference, or the same difference in every
        partition, gives NaN: nothing tells how far it would vary.

    Raises
    ------
    ValueError
        No differences, more than one dimension, NaN or infinity, or a count that is not positive.

    Notes
    -----
    Nadeau & Bengio, "Inference for the generalization error", Machine Learning 52 (2003), section 3.

    Examples
    --------
    >>> result = corrected_resampled_t([0.02, 0.00, 0.01, 0.03, -0.01], n_train=40, n_test=10)
    >>> round(result.statistic, 4), result.df, round(result.p_value, 4)
    (0.9428, 4, 0.3992)
    """
    d = _values("differences", differences)
    ratio = _positive("n_test", n_test) / _positive("n_train", n_train)
    mean, df = float(d.mean()), d.size - 1
    error = _standard_error(d, ratio)
    if np.abs(d).max() <= _NO_SPREAD:
        return CorrectedT(0.0, error, 0.0, df, 1.0)
    if math.isnan(error):
        return CorrectedT(mean, error, math.nan, df, math.nan)
    statistic = mean / error
    return CorrectedT(mean, error, statistic, df, float(2 * stats.t.sf(abs(statistic), df)))


def bayesian_correlated_t(differences: ArrayLike, rho: float, rope: float = ROPE) -> Posterior:
    """Return the probabilities that the first method is worse, equivalent and better.

    The posterior of the mean difference, with a flat prior, is Student with J - 1 degrees of freedom around
    ``mean(d)`` with scale ``sqrt((1/J + rho / (1 - rho)) var(d))``. With ``rho = n_test / n`` this is the
    sampling distribution of `corrected_resampled_t`.

    Parameters
    ----------
    differences : array-like, shape (J,)
        Accuracy of the first method minus that of the second on the same partition.
    rho : float
        Correlation of two partitions' differences, in [0, 1): ``n_test / (n_train + n_test)``.
    rope : float
        Region of practical equivalence: differences within +- `rope` count as none. Default 0.01.

    Returns
    -------
    Posterior
        Differences that are all zero give (0, 1, 0). A single difference, or the same difference in every
        partition, gives NaN.

    Raises
    ------
    ValueError
        As `corrected_resampled_t`; `rho` outside [0, 1); a negative `rope`.

    Notes
    -----
    Corani & Benavoli, "A Bayesian approach for comparing cross-validated algorithms on multiple data sets",
    Machine Learning 100 (2015), section 2.

    Examples
    --------
    >>> worse, equivalent, better = bayesian_correlated_t([0.02, 0.00, 0.01, 0.03, -0.01], rho=0.2)
    >>> round(worse, 3), round(equivalent, 3), round(better, 3)
    (0.066, 0.434, 0.5)
    """
    d = _values("differences", differences)
    if not 0 <= rho < 1:
        raise ValueError(f"rho must lie in [0, 1), got {rho!r}")
    if not (math.isfinite(rope) and rope >= 0):
        raise ValueError(f"rope must not be negative, got {rope!r}")
    scale = _standard_error(d, rho / (1 - rho))
    if np.abs(d).max() <= _NO_SPREAD:
        return Posterior(0.0, 1.0, 0.0)
    if math.isnan(scale):
        return Posterior(math.nan, math.nan, math.nan)
    posterior = stats.t(d.size - 1, loc=float(d.mean()), scale=scale)
    worse, better = float(posterior.cdf(-rope)), float(posterior.sf(rope))
    return Posterior(worse, max(0.0, 1.0 - worse - better), better)


def corrected_interval(
    accuracies: ArrayLike, n_train: float, n_test: float, confidence: float = 0.95
) -> tuple[float, float]:
    """Confidence interval of a mean accuracy over overlapping partitions, inside [0, 1].

    ``mean +- t * sqrt((1/J + n_test/n_train) var)``, the interval that belongs to `corrected_resampled_t`.

    Parameters
    ----------
    accuracies : array-like, shape (J,)
        One per partition, in [0, 1].
    n_train, n_test : float
        As in `corrected_resampled_t`.
    confidence : float
        Default 0.95.

    Returns
    -------
    low, high : float
        NaN for a single partition and where all partitions agree (all at 100 %, for instance): their spread
        then says nothing about new recordings.

    Raises
    ------
    ValueError
        As `corrected_resampled_t`; accuracies outside [0, 1]; `confidence` outside (0, 1).

    Examples
    --------
    >>> low, high = corrected_interval([0.90, 0.94, 0.92, 0.88, 0.96], n_train=40, n_test=10)
    >>> round(low, 3), round(high, 3)
    (0.861, 0.979)
    """
    shares = _values("accuracies", accuracies)
    if shares.min() < 0 or shares.max() > 1:
        raise ValueError(f"accuracies must lie in [0, 1], got {shares.min():g} to {shares.max():g}")
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must lie between 0 and 1, got {confidence!r}")
    error = _standard_error(shares, _positive("n_test", n_test) / _positive("n_train", n_train))
    if math.isnan(error):
        return math.nan, math.nan
    reach = float(stats.t.ppf((1 + confidence) / 2, shares.size - 1)) * error
    mean = float(shares.mean())
    return max(0.0, mean - reach), min(1.0, mean + reach)


def mean_interval(
    accuracies: FloatArray, n_train: float | Sequence[float], n_test: float | Sequence[float]
) -> tuple[float, float]:
    """Return `corrected_interval` for the mean sizes of partitions; NaN where they are fewer than three."""
    if len(accuracies) < MIN_PARTITIONS:
        return math.nan, math.nan
    return corrected_interval(accuracies, float(np.mean(n_train)), float(np.mean(n_test)))


def mann_whitney(first: ArrayLike, second: ArrayLike) -> float:
    """Two-sided p-value of the Mann-Whitney U test, which the paper reports.

    It takes all values for independent. Accuracies of overlapping partitions are not, and its p-value is then
    far too small: see `corrected_resampled_t`.

    Parameters
    ----------
    first, second : array-like, shapes (m,) and (n,)
        Accuracies; pairs are not used.

    Returns
    -------
    float
        1.0 where all values are equal.

    Raises
    ------
    ValueError
        No values, more than one dimension, NaN or infinity.

    Examples
    --------
    >>> round(mann_whitney([0.90, 0.91, 0.92, 0.93], [0.80, 0.81, 0.82, 0.83]), 4)
    0.0286
    """
    a, b = _values("first", first), _values("second", second)
    if np.ptp(np.concatenate((a, b))) <= _NO_SPREAD:
        return 1.0  # ranks without any order, where the normal approximation divides by zero
    return float(stats.mannwhitneyu(a, b, alternative="two-sided").pvalue)


def holm(p_values: ArrayLike) -> NDArray[np.float64]:
    """Adjust p-values for their number, by Holm's step-down method.

    Rejecting where the adjusted value is below alpha keeps the chance of any false rejection below alpha,
    whatever the dependence between the tests.

    Parameters
    ----------
    p_values : array-like, shape (m,)
        In [0, 1]. NaN stands for a test that could not be made: it stays NaN and does not count.

    Returns
    -------
    (m,) float array
        In the order given, none below its own p-value, none above 1.

    Raises
    ------
    ValueError
        More than one dimension, or values outside [0, 1].

    Notes
    -----
    Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6
    (1979).

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03, 0.005]).round(3).tolist()
    [0.03, 0.06, 0.06, 0.02]
    """
    p = np.asarray(p_values, dtype=np.float64)
    if p.ndim != 1:
        raise ValueError(f"p_values must have one dimension, got shape {p.shape}")
    made = np.flatnonzero(~np.isnan(p))
    if ((p[made] < 0) | (p[made] > 1)).any():
        raise ValueError(f"p_values must lie in [0, 1], got {p[made].min():g} to {p[made].max():g}")
    order = made[np.argsort(p[made], kind="stable")]
    adjusted = np.full(p.shape, np.nan)
    factors = np.arange(order.size, 0, -1)
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(factors * p[order]))
    return adjusted


def _standard_error(values: FloatArray, overlap: float) -> float:
    """Corrected standard error of the mean; NaN where the values have no spread to estimate it from."""
    if values.size < 2 or np.ptp(values) <= _NO_SPREAD:
        return math.nan
    return math.sqrt((1 / values.size + overlap) * float(values.var(ddof=1)))


def _values(name: str, values: ArrayLike) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"{name} must have shape (J,) with J >= 1, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite, got {array[~np.isfinite(array)][0]}")
    return array


def _positive(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be positive, got {value!r}")
    return float(value)


# Figures from true and predicted class numbers, for results and model cards.


def confusion_counts(
    truth: NDArray[np.intp], predicted: NDArray[np.intp], n_classes: int
) -> NDArray[np.int64]:
    """Count pairs of class numbers: true classes in rows, predicted ones in columns, (K, K)."""
    counts: NDArray[np.int64] = confusion_matrix(truth, predicted, labels=range(n_classes))
    return counts


# scikit-learn's recall and F1 have the same bits, but count the pairs anew for each figure.


def recall_per_class(confusion: NDArray[np.int64]) -> NDArray[np.float64]:
    """Share of each class that was recognised, (K,); NaN for a class that was never tested."""
    with np.errstate(invalid="ignore"):
        shares: NDArray[np.float64] = np.diag(confusion) / confusion.sum(axis=1)
    return shares


def macro_f1(confusion: NDArray[np.int64]) -> float:
    """Mean over classes of F1; a class that is neither present nor predicted counts as 0."""
    present_and_predicted = confusion.sum(axis=0) + confusion.sum(axis=1)
    return float((2 * np.diag(confusion) / np.maximum(present_and_predicted, 1)).mean())


def sample_sd(values: NDArray[np.float64]) -> float:
    """Sample standard deviation (divisor n - 1); NaN for a single value, which has none."""
    return float(values.std(ddof=1)) if values.size > 1 else math.nan  # numpy would warn

"""Figures computed from true and predicted class numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["confusion_counts", "macro_f1", "recall_per_class", "sample_sd"]


def confusion_counts(
    truth: NDArray[np.intp], predicted: NDArray[np.intp], n_classes: int
) -> NDArray[np.int64]:
    """Count pairs of true and predicted class.

    Parameters
    ----------
    truth, predicted : (n,) int arrays
        Class numbers in ``range(n_classes)``.
    n_classes : int
        Number of classes K.

    Returns
    -------
    (K, K) int array
        Row: true class, column: predicted class.

    Examples
    --------
    >>> confusion_counts(np.array([0, 0, 1]), np.array([0, 1, 1]), 2).tolist()
    [[1, 1], [0, 1]]
    """
    cells = np.bincount(truth * n_classes + predicted, minlength=n_classes * n_classes)
    return cells.reshape(n_classes, n_classes).astype(np.int64)


def recall_per_class(confusion: NDArray[np.int64]) -> NDArray[np.float64]:
    """Share of each class that was recognised; NaN for a class that was never tested.

    Parameters
    ----------
    confusion : (K, K) int array
        From `confusion_counts`.

    Returns
    -------
    (K,) float array

    Examples
    --------
    >>> recall_per_class(np.array([[3, 1], [0, 2]])).tolist()
    [0.75, 1.0]
    """
    tested = confusion.sum(axis=1).astype(np.float64)
    share = np.full(tested.shape, np.nan)
    np.divide(np.diag(confusion), tested, out=share, where=tested > 0)
    return share


def macro_f1(confusion: NDArray[np.int64]) -> float:
    """Mean over classes of F1, the harmonic mean of precision and recall.

    A class that is neither present nor predicted counts as 0, as in scikit-learn with ``zero_division=0``.

    Parameters
    ----------
    confusion : (K, K) int array
        From `confusion_counts`.

    Returns
    -------
    float

    Examples
    --------
    >>> round(macro_f1(np.array([[1, 1], [0, 2]])), 4)
    0.7333
    """
    hits = np.diag(confusion).astype(np.float64)
    both = (confusion.sum(axis=0) + confusion.sum(axis=1)).astype(np.float64)
    f1 = np.zeros(hits.shape)
    np.divide(2 * hits, both, out=f1, where=both > 0)
    return float(f1.mean())


def sample_sd(values: NDArray[np.float64]) -> float:
    """Sample standard deviation (divisor n - 1); NaN for a single value, which has none.

    Parameters
    ----------
    values : (n,) float array

    Returns
    -------
    float

    Examples
    --------
    >>> sample_sd(np.array([1.0, 3.0]))
    1.4142135623730951
    """
    return float(values.std(ddof=1)) if values.size > 1 else float("nan")

"""What learners are trained with, checked: names of options, cost of a violated margin, weights of rows, classes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.utils.multiclass import check_classification_targets

from granular_id._arrays import float_array
from granular_id._numbers import real_number

__all__ = ["checked_cost", "checked_flag", "checked_n_jobs", "checked_weights", "class_indices", "named"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_EXTREME_WEIGHT = 1e100


def named(table: Mapping[str, Any], argument: str, name: object) -> Any:
    """Return the entry of a table of options, or raise a ValueError that lists their names."""
    if not isinstance(name, str) or name not in table:
        raise ValueError(f"{argument} must be one of {', '.join(map(repr, table))}, got {name!r}")
    return table[name]


def checked_flag(argument: str, value: object) -> bool:
    """Return True or False as a bool, or raise a TypeError for anything else (1 and "yes" included)."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{argument} must be True or False, got {value!r}")
    return bool(value)


def checked_n_jobs(n_jobs: object) -> int | None:
    """Return the number of threads as joblib takes it, or say in an error what is wrong with it."""
    if n_jobs is None:
        return None
    if isinstance(n_jobs, bool) or not isinstance(n_jobs, (int, np.integer)):
        raise TypeError(f"n_jobs must be None or a whole number, got {n_jobs!r}")
    if n_jobs == 0:
        raise ValueError(
            "n_jobs must be None, positive, or negative to leave processors out (-1: none), got 0"
        )
    return int(n_jobs)


def checked_cost(C: object) -> float:
    """Return the cost `C` of a violated margin as a float, or say what is wrong with it.

    Raises
    ------
    TypeError
        `C` is not a number.
    ValueError
        `C` is not positive and finite.
    """
    cost = real_number("C", C)
    if not 0 < cost < math.inf:
        raise ValueError(f"C must be positive and finite, got {cost!r}; for no limit hard_margin=True")
    return cost


def checked_weights(sample_weight: npt.ArrayLike, n_rows: int) -> FloatArray:
    """Return the weights of rows, shape (n_rows,), as float64.

    Raises
    ------
    ValueError
        Another shape, NaN, infinity, a negative weight, none above 0, or one so large or small that sums and
        ratios of weights would leave the range of float64.
    """
    weights = float_array("sample_weight", sample_weight)
    if weights.shape != (n_rows,):
        raise ValueError(f"sample_weight must have shape ({n_rows},), one per row, got shape {weights.shape}")
    if not np.isfinite(weights).all():
        raise ValueError("sample_weight must be finite: it contains NaN or inf")
    if weights.min() < 0:
        raise ValueError(f"sample_weight must not be negative, got {weights.min()}")
    if not weights.any():
        raise ValueError("sample_weight must not be zero for every row")
    least, most = float(weights[weights > 0].min()), float(weights.max())
    if least < 1.0 / _EXTREME_WEIGHT or most > _EXTREME_WEIGHT:
        raise ValueError(
            f"sample_weight must be 0 or from {1.0 / _EXTREME_WEIGHT:g} to {_EXTREME_WEIGHT:g}, "
            f"got {least:g} to {most:g}"
        )
    return weights


def _examples(labels: npt.NDArray[Any]) -> str:
    """Text of the first few different labels, for a message."""
    different = dict.fromkeys(map(repr, labels[:100].tolist()))
    return ", ".join(list(different)[:3])


def class_indices(labels: npt.NDArray[Any], weights: FloatArray | None) -> tuple[npt.NDArray[Any], IntArray]:
    """Return the classes of the rows that count, sorted, and the index of each row's class.

    Parameters
    ----------
    labels : ndarray, shape (n,)
        One label per row.
    weights : ndarray, shape (n,), or None
        From `checked_weights`.

    Returns
    -------
    classes : ndarray, shape (K,)
        Labels of the rows with a weight above 0.
    codes : ndarray of int, shape (n,)
        Class index of each row; any index for a row of weight 0, which training leaves out.

    Raises
    ------
    ValueError
        Labels that are no classes, or fewer than two of them.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.ecoc.training import class_indices
    >>> class_indices(np.array(["rice", "oat", "rice"]), None)
    (array(['oat', 'rice'], dtype='<U4'), array([1, 0, 1]))
    """
    if labels.dtype.kind == "f" and np.isnan(labels).any():
        raise ValueError("y must hold a label for each row, got NaN")
    try:
        check_classification_targets(labels)
    except ValueError as reason:
        raise ValueError(
            f"y must hold labels of one kind, text or whole numbers, got {_examples(labels)}: {reason}"
        ) from None
    classes = np.unique(labels if weights is None else labels[weights > 0])
    if len(classes) < 2:
        raise ValueError(f"y holds one class only ({classes.tolist()[0]!r}): nothing to tell apart")
    return classes, np.minimum(np.searchsorted(classes, labels), len(classes) - 1)

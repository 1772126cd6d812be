"""What went into an evaluation, in types that JSON knows."""

from __future__ import annotations

import math
import platform
from typing import Any

import joblib
import numpy as np
import scipy
import sklearn
from sklearn.base import BaseEstimator

from granular_id import _core
from granular_id._core import AXES
from granular_id.recording import Dataset
from granular_id.recording.setup import mixed

__all__ = [
    "SEVERE",
    "describe_data",
    "describe_estimator",
    "not_drawn",
    "of_check",
    "versions",
    "warnings_in",
]

SEVERE = ("error: ", "warning: ")
"""How the lines of `warnings_in` begin."""


def describe_estimator(estimator: BaseEstimator) -> dict[str, Any]:
    """Return class name and all parameters of an estimator, nested estimators included.

    Parameters
    ----------
    estimator : scikit-learn estimator

    Returns
    -------
    dict
        ``{"class": name, parameter: value, ...}``; values that JSON does not know become their ``repr``.
    """
    described: dict[str, Any] = {"class": type(estimator).__name__}
    described.update({name: _plain(value) for name, value in estimator.get_params(deep=False).items()})
    return described


def describe_data(data: Dataset) -> dict[str, Any]:
    """Return size, rate and summary of a data set with the history of the steps that made it."""
    n_recordings, n_samples, n_axes = data.X.shape
    return {
        "n_recordings": n_recordings,
        "n_samples": n_samples,
        "n_axes": n_axes,
        "rate_hz": data.rate_hz,
        "summary": data.summary().to_dict(),
        "history": [step.to_dict() for step in data.history],
    }


def warnings_in(data: Dataset) -> list[str]:
    """Return what may mislead a reader of the accuracies, one line each.

    These are set-ups that differ, and the errors and warnings of `Dataset.check`.
    """
    return mixed(data) + [str(finding) for finding in data.check() if finding.severity != "info"]


def of_check(note: str) -> str:
    """Say in front of a line of `warnings_in` whose it is: "error: " alone is what a command prints that has failed.

    Examples
    --------
    >>> of_check("error: 1 pair of recordings shares samples"), of_check("nothing is drawn")
    ('data check: error: 1 pair of recordings shares samples', 'nothing is drawn')
    """
    return f"data check: {note}" if note.startswith(SEVERE) else note


def not_drawn(data: Dataset) -> list[str]:
    """Return one line on why a report does not draw the recordings; none where it does."""
    if data.axes == AXES:
        return []
    return [
        f"recordings and weights are not drawn: that is for the axes {' '.join(AXES)}, these have {' '.join(data.axes)}"
    ]


def versions() -> dict[str, str]:
    """Versions of everything that has a say in the numbers."""
    return {
        "granular_id": _core.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "scikit-learn": sklearn.__version__,
        "joblib": joblib.__version__,
        "machine": f"{platform.system()} {platform.machine()}",
    }


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if hasattr(value, "__qualname__"):  # functions and classes: their repr tells where in memory they are
        return f"{value.__module__}.{value.__qualname__}"
    return describe_estimator(value) if hasattr(value, "get_params") else repr(value)

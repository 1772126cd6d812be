"""What scikit-learn estimators are asked: what they are, what `fit` takes, what they warn of."""

from __future__ import annotations

import math
import platform
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import joblib
import numpy as np
import numpy.typing as npt
import scipy
import sklearn
from sklearn.base import BaseEstimator, ClassifierMixin, clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import has_fit_parameter

from granular_id import _core

# Convergence warnings that are listed one by one.
_AT_MOST = 3

# What a pipeline that is given a data set alone hands from step to step.


@dataclass(frozen=True, eq=False)
class Origin:
    """Which recordings the rows of an array are of: what steps behind a feature space may ask."""

    axes: tuple[str, ...] | None = None
    """Names; None where recordings had none."""
    units: tuple[str, ...] = ()
    """Of each axis, "" where not known; none without names."""
    rate_hz: float | None = None
    dataset: Any = None
    """The `Dataset`, with labels, sessions and order in time; None where recordings came as arrays or tables."""
    blocks: Mapping[str, int] | None = None
    """Columns of each block of features, where they come in blocks."""


class TracedRows(np.ndarray):
    """An array that knows its `Origin`; whatever is made of it does not."""

    origin: Origin | None = None

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        plain = np.asarray(array)
        return plain[()] if return_scalar or plain.ndim == 0 else plain

    def __repr__(self) -> str:
        return repr(np.asarray(self))


def traced(rows: Any, origin: Origin | None, **changes: Any) -> Any:
    """Return an array that knows its origin, with changes; where there is none to speak of, or no array, as it came."""
    if origin is None or (origin.dataset is None and origin.axes is None) or not isinstance(rows, np.ndarray):
        return rows
    known = np.asarray(rows).view(TracedRows)
    known.origin = replace(origin, **changes)
    known.flags.writeable = False  # rows that change their places would keep the labels of others
    return known


def origin_of(X: Any) -> Origin | None:
    """Return what a step in front of this one told of the rows; None where it told nothing, or a step dropped it."""
    return X.origin if isinstance(X, TracedRows) else None


def origin_for_fit(X: Any, who: Any) -> Origin | None:
    """Return the origin of rows to fit on, with a warning where it was lost on the way: results would differ unseen."""
    if isinstance(X, TracedRows) and X.origin is None:
        warnings.warn(
            f"X lost what its Dataset knows (sessions, order in time, blocks), by a choice of rows or a cache; "
            f"{type(who).__name__} goes on without: fit a pipeline on the Dataset, or pass them",
            stacklevel=3,
        )
    return origin_of(X)


def labels_of(X: Any, y: Any, who: Any) -> Any:
    """Return the labels of rows: `y`, or those of the data set that the rows are of."""
    if y is not None:
        return y
    origin = origin_of(X)
    if hasattr(X, "recordings") and hasattr(X, "sessions"):
        raise ValueError(
            f"{type(who).__name__} takes features, got a Dataset: put a feature space in front, as in "
            f"make_pipeline(RawHFMH(), {type(who).__name__}()).fit(data)"
        )
    if origin is None or origin.dataset is None:
        raise ValueError(
            f"This {type(who).__name__} estimator requires y to be passed, but the target y is None: X is no Dataset, "
            "or a step in front that is not of this package (StandardScaler, FeatureUnion) dropped its labels; pass "
            "them, as in fit(data, data.y)"
        )
    return origin.dataset.y


class LabelledClassifier(ClassifierMixin):  # type: ignore[misc]
    """A classifier whose `score` takes labels from a data set, as its `fit` does."""

    def score(
        self, X: npt.ArrayLike, y: npt.ArrayLike | None = None, sample_weight: npt.ArrayLike | None = None
    ) -> float:
        """Return the share of rows that are named right; without `y`, labels are those of the `Dataset`."""
        return float(super().score(X, labels_of(X, y, self), sample_weight))


def with_rate(estimator: Any, rate_hz: float) -> Any:
    """Return an estimator for recordings of this rate: a clone, where it or a part of it leaves the rate open."""
    parameters = estimator.get_params(deep=True) if hasattr(estimator, "get_params") else {}
    left_open = [
        key for key, value in parameters.items() if key.rpartition("__")[2] == "rate_hz" and value is None
    ]
    return clone(estimator).set_params(**dict.fromkeys(left_open, rate_hz)) if left_open else estimator


# What an estimator says of itself.


def describe_estimator(estimator: BaseEstimator) -> dict[str, Any]:
    """Class name and parameters, nested estimators included; values that JSON does not know become their repr."""
    described: dict[str, Any] = {"class": type(estimator).__name__}
    described.update({name: _plain(value) for name, value in estimator.get_params(deep=False).items()})
    return described


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


def real_steps(pipeline: Pipeline) -> list[Any]:
    """List the steps of a pipeline that do something, those of pipelines within it included."""
    steps: list[Any] = []
    for _, step in pipeline.steps:
        if isinstance(step, Pipeline):
            steps.extend(real_steps(step))
        elif step is not None and step != "passthrough":
            steps.append(step)
    return steps


def learns(transformer: Any) -> bool:
    """Whether fitting takes anything from the data but their shape; yes for what does not say (no ``learns``)."""
    if isinstance(transformer, Pipeline):
        return any(learns(step) for step in real_steps(transformer))
    return bool(getattr(transformer, "learns", True))


def routed(estimator: Any, known: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the known things that `fit` has a parameter for, in a pipeline as ``step__name`` of its last step."""
    prefix = ""
    while isinstance(estimator, Pipeline):
        name, estimator = estimator.steps[-1]
        prefix += f"{name}__"
    return {f"{prefix}{name}": value for name, value in known.items() if has_fit_parameter(estimator, name)}


def seeded_clone(estimator: Any, seed: np.random.SeedSequence) -> Any:
    """Clone an estimator and give every ``random_state`` in it that is None a number of its own."""
    fresh = clone(estimator)
    names = sorted(
        name
        for name, value in fresh.get_params(deep=True).items()
        if value is None and (name == "random_state" or name.endswith("__random_state"))
    )
    if names:
        words = seed.generate_state(len(names)).tolist()
        fresh.set_params(**dict(zip(names, words, strict=True)))
    return fresh


@contextmanager
def named_errors(name: str, kind: str = "feature space") -> Iterator[None]:
    """Let errors say which space they are from: of eleven only one may not suit the recordings."""
    try:
        yield
    except ValueError as error:
        if repr(name) in str(error):
            raise
        raise ValueError(f"{kind} {name!r}: {error}") from error


@contextmanager
def convergence_warnings(who: str) -> Iterator[list[str]]:
    """Gather the convergence warnings of a block, from any thread: lines that begin with `who`, filled at its end."""
    lines: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ConvergenceWarning)
        yield lines
    counts: Counter[str] = Counter()
    for one in caught:
        if issubclass(one.category, ConvergenceWarning):
            counts[str(one.message)] += 1
        else:
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    for text, count in counts.most_common(_AT_MOST):
        lines.append(f"{who}: {text} ({count} times)" if count > 1 else f"{who}: {text}")
    if len(counts) > _AT_MOST:
        lines.append(f"{who}: {len(counts) - _AT_MOST} other warnings of this kind")

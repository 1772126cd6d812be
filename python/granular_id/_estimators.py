"""What scikit-learn estimators answer: what they are, what `fit` takes, what they warn of."""

from __future__ import annotations

import math
import platform
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import joblib
import numpy as np
import scipy
import sklearn
from sklearn.base import BaseEstimator, clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.pipeline import FeatureUnion, Pipeline
from sklearn.utils.validation import has_fit_parameter

from granular_id import _core
from granular_id._core import GranularIdError

# Convergence warnings that are listed one by one.
_AT_MOST = 3


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
    if isinstance(transformer, FeatureUnion):
        return any(learns(step) for _, step in transformer.transformer_list)
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
def named_errors(name: str) -> Iterator[None]:
    """Let errors say which space they are from: of eleven only one may not suit the recordings."""
    try:
        yield
    except ValueError as error:
        if repr(name) in str(error):
            raise
        raise GranularIdError(f"feature space {name!r}: {error}") from error


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

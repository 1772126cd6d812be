"""What scikit-learn estimators are asked: what they are, what `fit` takes, what they warn of."""

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
from sklearn.pipeline import Pipeline
from sklearn.utils.validation import has_fit_parameter

from granular_id import _core


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


def asked_for(estimator: Any, known: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of the known things that `fit` has a parameter for, in a pipeline that of its last step.

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> from granular_id.spaces.best import BestClassifier
    >>> asked_for(make_pipeline(BestClassifier()), {"order": None, "weather": "dry"})
    {'bestclassifier__order': None}
    """
    prefix = ""
    while isinstance(estimator, Pipeline):
        name, estimator = estimator.steps[-1]
        prefix += f"{name}__"
    return {f"{prefix}{name}": value for name, value in known.items() if has_fit_parameter(estimator, name)}


def learns(transformer: Any) -> bool:
    """Whether fitting takes anything from the data but their shape.

    A pipeline learns when one of its steps does. What does not say (no boolean ``learns``) counts as learning,
    the safe side: it is then fitted on training rows only.

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> from sklearn.preprocessing import StandardScaler
    >>> from granular_id.spaces import RawSignal
    >>> learns(RawSignal()), learns(make_pipeline(RawSignal(), StandardScaler()))
    (False, True)
    """
    if isinstance(transformer, Pipeline):
        return any(learns(step) for step in real_steps(transformer))
    return bool(getattr(transformer, "learns", True))


def real_steps(pipeline: Pipeline) -> list[Any]:
    """List the steps of a pipeline that do something, those of pipelines within it included."""
    steps: list[Any] = []
    for _, step in pipeline.steps:
        if isinstance(step, Pipeline):
            steps.extend(real_steps(step))
        elif step is not None and step != "passthrough":
            steps.append(step)
    return steps


# Seeds for estimators: same seed, same numbers, whatever runs first.


def seeded_clone(estimator: Any, seed: np.random.SeedSequence) -> Any:
    """Clone an estimator and give every open ``random_state`` in it a number of its own.

    Parameters
    ----------
    estimator : scikit-learn estimator
        Not changed. Parameters named ``random_state``, its own and those of the estimators inside, are open when
        they are None; a number that is set stays.
    seed : numpy.random.SeedSequence
        Same entropy and spawn key, same numbers.

    Returns
    -------
    estimator
        Unfitted.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.linear_model import SGDClassifier
    >>> from granular_id._estimators import seeded_clone
    >>> seeded_clone(SGDClassifier(), np.random.SeedSequence(0)).random_state
    2968811710
    >>> seeded_clone(SGDClassifier(random_state=7), np.random.SeedSequence(0)).random_state
    7
    """
    fresh = clone(estimator)
    names = sorted(
        name
        for name, value in fresh.get_params(deep=True).items()
        if value is None and (name == "random_state" or name.endswith("__random_state"))
    )
    if names:
        words = seed.generate_state(len(names))
        fresh.set_params(**{name: int(word) for name, word in zip(names, words, strict=True)})
    return fresh


# What feature spaces complain of: errors that say whose they are, and solvers that stop early in a line each.

AT_MOST = 3


@contextmanager
def named_errors(name: str, kind: str = "feature space") -> Iterator[None]:
    """Let errors say which space they are from: of eleven only one may not suit the recordings.

    Examples
    --------
    >>> with named_errors("raw"):
    ...     raise ValueError("no good")
    Traceback (most recent call last):
    ValueError: feature space 'raw': no good
    """
    try:
        yield
    except ValueError as error:
        if repr(name) in str(error):
            raise
        raise ValueError(f"{kind} {name!r}: {error}") from error


@contextmanager
def heard_complaints(who: str) -> Iterator[list[str]]:
    """Gather the convergence warnings of a block, whatever thread they come from.

    Parameters
    ----------
    who : str
        What begins each line, the name of a feature space.

    Yields
    ------
    list of str
        Filled when the block ends: the most frequent warnings with their number, three at most. Warnings of
        other kinds pass.

    Examples
    --------
    >>> with heard_complaints("raw") as lines:
    ...     for _ in range(2):
    ...         warnings.warn("stopped early", ConvergenceWarning, stacklevel=1)
    >>> lines
    ['raw: stopped early (2 times)']
    """
    lines: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ConvergenceWarning)
        yield lines
    for one in caught:
        if not issubclass(one.category, ConvergenceWarning):
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    counts = Counter(str(one.message) for one in caught if issubclass(one.category, ConvergenceWarning))
    for text, count in counts.most_common(AT_MOST):
        lines.append(f"{who}: {text} ({count} times)" if count > 1 else f"{who}: {text}")
    if len(counts) > AT_MOST:
        lines.append(f"{who}: {len(counts) - AT_MOST} other warnings of this kind")

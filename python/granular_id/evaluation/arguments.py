"""What `evaluate` is asked: the data set, the feature spaces and the seed, checked."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from sklearn.base import BaseEstimator

from granular_id._checks import argument_error, whole_number
from granular_id._estimators import with_rate
from granular_id.ecoc import ECOCClassifier
from granular_id.recording import Dataset
from granular_id.spaces import FeatureSpace, feature_spaces, in_paper_order, paper_spaces


def check_dataset(data: Dataset) -> None:
    """Refuse what is no data set before any work."""
    if not isinstance(data, Dataset):
        raise argument_error(TypeError, "data", f"must be a granular_id.Dataset, got {type(data).__name__}")


def plan_seed(random_state: int | None) -> int:
    """Return the seed: the given one, or for None a fresh one that the result will record."""
    if random_state is None:
        return secrets.randbits(32)
    return whole_number("random_state", random_state, least=0, or_else=" or None")


def plan_classifier(classifier: BaseEstimator | None) -> BaseEstimator:
    """Return the classifier: the given one, or the paper's."""
    if classifier is None:
        return ECOCClassifier()
    if isinstance(classifier, type) or not all(hasattr(classifier, name) for name in ("fit", "get_params")):
        wanted = f"must be a classifier of scikit-learn such as LinearSVC(), got {classifier!r:.60}"
        raise argument_error(TypeError, "classifier", wanted)
    return classifier


def plan_spaces(
    spaces: str | Sequence[str] | Mapping[str, BaseEstimator | FeatureSpace], rate_hz: float
) -> list[FeatureSpace]:
    """Turn the `spaces` argument of `evaluate` into a list, for recordings of this rate."""
    if isinstance(spaces, Mapping):
        plan = [_own_space(name, transformer, rate_hz) for name, transformer in spaces.items()]
    else:
        known = feature_spaces(rate_hz=rate_hz)
        plan = [known[name] for name in _names(spaces, known)]
    if not plan:
        raise argument_error(ValueError, "spaces", "must name at least one feature space, got none")
    return plan


def _names(spaces: str | Sequence[str], known: Mapping[str, FeatureSpace]) -> list[str]:
    if spaces == "all":
        return in_paper_order(known)
    if spaces == "paper":
        return paper_spaces(known)
    names = [spaces] if isinstance(spaces, str) else list(spaces)
    for name in names:
        if name not in known:
            choices = ", ".join(map(repr, ("all", "paper", *known)))
            raise argument_error(ValueError, "spaces", f"must be among {choices}, got {name!r}")
    if len(set(names)) < len(names):
        raise argument_error(ValueError, "spaces", f"must name each feature space once, got {names!r}")
    return names


def _own_space(name: Any, given: Any, rate_hz: float) -> FeatureSpace:
    if not isinstance(name, str) or not name:
        raise argument_error(TypeError, "spaces", f": a name must be non-empty text, got {name!r}")
    if isinstance(given, FeatureSpace):
        space = replace(given, name=name)
    elif hasattr(given, "fit") and hasattr(given, "transform"):
        space = FeatureSpace(name, given, None)
    else:
        wanted = "must have fit and transform like a scikit-learn transformer"
        raise argument_error(TypeError, "spaces", f"[{name!r}] {wanted}, got {type(given).__name__}")
    _refuse_other_rate(space, rate_hz)
    return replace(space, transformer=with_rate(space.transformer, rate_hz))


def _refuse_other_rate(space: FeatureSpace, rate_hz: float) -> None:
    """Refuse a filter designed for another rate: its cut-off would silently lie elsewhere."""
    get_params = getattr(space.transformer, "get_params", None)
    parameters = {} if get_params is None else get_params(deep=True)
    for key, value in parameters.items():
        if key.rpartition("__")[2] != "rate_hz" or value is None or value == rate_hz:
            continue
        owner = parameters[key.removesuffix("__rate_hz")] if "__" in key else space.transformer
        kind = type(owner).__name__
        raise argument_error(
            ValueError,
            "spaces",
            f"[{space.name!r}]: {kind} has rate_hz={value:g}, the recordings have {rate_hz:g} Hz: "
            f"pass {kind}(rate_hz={rate_hz:g})",
        )

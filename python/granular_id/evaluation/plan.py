"""From the arguments of `evaluate` to a checked plan: which spaces, which seed."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any

from sklearn.base import BaseEstimator

from granular_id.spaces import FeatureSpace, feature_spaces, learns

__all__ = ["Space", "in_paper_order", "plan_seed", "plan_spaces"]


@dataclass(frozen=True)
class Space:
    """A feature space to evaluate: a name and a transformer of (n, T, C) recordings to (n, D) features.

    `classifier` is its own, where it does not take that of the evaluation.
    """

    name: str
    transformer: BaseEstimator
    paper_accuracy: float | None
    learns: bool
    classifier: BaseEstimator | None = None


def plan_seed(random_state: int | None) -> int:
    """Return the seed: the given one, or for None a fresh one that the result will record."""
    if random_state is None:
        return secrets.randbits(32)
    if isinstance(random_state, bool) or not isinstance(random_state, Integral):
        raise TypeError(
            f"random_state must be a whole number or None, got {type(random_state).__name__} {random_state!r}"
        )
    if random_state < 0:
        raise ValueError(f"random_state must not be negative, got {random_state}")
    return int(random_state)


def plan_spaces(
    spaces: str | Sequence[str] | Mapping[str, BaseEstimator | FeatureSpace], rate_hz: float
) -> list[Space]:
    """Turn the `spaces` argument of `evaluate` into a list.

    Parameters
    ----------
    spaces : str, sequence of str or mapping
        ``"all"``: every space but the controls, those of the paper in its order (best accuracy first), then ours.
        ``"paper"``: the paper's alone. Names: those, in the order given. A mapping of name to transformer or
        `FeatureSpace`: those.
    rate_hz : float
        Sampling rate of the recordings, which the named spaces need for their filter and given ones must have.

    Returns
    -------
    list of Space
        A transformer without a boolean attribute ``learns`` counts as learning, the safe side: it is then
        fitted on the training rows of each partition.

    Raises
    ------
    TypeError, ValueError
        Neither of the above; an unknown name; none at all; twice the same; a transformer (or a step of a
        pipeline) whose `rate_hz` is not that of the recordings.
    """
    if isinstance(spaces, Mapping):
        plan = [_own(name, transformer) for name, transformer in spaces.items()]
        for space in plan:
            _refuse_other_rate(space, rate_hz)
    else:
        known = feature_spaces(rate_hz=rate_hz)
        plan = [_known(known[name]) for name in _names(spaces, known)]
    if not plan:
        raise ValueError("spaces must name at least one feature space, got none")
    return plan


def in_paper_order(known: Mapping[str, FeatureSpace]) -> list[str]:
    """Names of feature spaces without the controls: the paper's, best accuracy first, then those it does not have."""
    names = [name for name, space in known.items() if not space.control]
    return sorted(names, key=lambda name: -(known[name].paper_accuracy or 0.0))


def _names(spaces: str | Sequence[str], known: Mapping[str, FeatureSpace]) -> list[str]:
    if spaces == "all":
        return in_paper_order(known)
    if spaces == "paper":
        return [name for name in in_paper_order(known) if known[name].paper_accuracy is not None]
    names = [spaces] if isinstance(spaces, str) else list(spaces)
    for name in names:
        if name not in known:
            choices = ", ".join(map(repr, ("all", "paper", *known)))
            raise ValueError(f"spaces must be among {choices}, got {name!r}")
    if len(set(names)) < len(names):
        raise ValueError(f"spaces must name each feature space once, got {names!r}")
    return names


def _known(space: FeatureSpace) -> Space:
    return Space(space.name, space.transformer, space.paper_accuracy, space.learns, space.classifier)


def _own(name: Any, transformer: Any) -> Space:
    if not isinstance(name, str) or not name:
        raise TypeError(f"spaces: a name must be non-empty text, got {name!r}")
    if isinstance(transformer, FeatureSpace):
        return _known(replace(transformer, name=name))
    if not (hasattr(transformer, "fit") and hasattr(transformer, "transform")):
        raise TypeError(
            f"spaces[{name!r}] must have fit and transform like a scikit-learn transformer, "
            f"got {type(transformer).__name__}"
        )
    return Space(name, transformer, None, learns(transformer))


def _refuse_other_rate(space: Space, rate_hz: float) -> None:
    """Refuse a filter designed for another rate: its cut-off would silently lie elsewhere."""
    get_params = getattr(space.transformer, "get_params", None)
    parameters = {} if get_params is None else get_params(deep=True)
    for key, value in parameters.items():
        if key.rpartition("__")[2] != "rate_hz" or value is None or value == rate_hz:
            continue
        owner = parameters[key.removesuffix("__rate_hz")] if "__" in key else space.transformer
        kind = type(owner).__name__
        raise ValueError(
            f"spaces[{space.name!r}]: {kind} has rate_hz={value:g}, the recordings have {rate_hz:g} Hz: "
            f"pass {kind}(rate_hz={rate_hz:g})"
        )

"""What can be chosen: feature spaces, with every way to weight their blocks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline

from granular_id._seeds import seeded_clone
from granular_id.evaluation.plan import Space, plan_spaces
from granular_id.spaces import BlockUnion, FeatureSpace, RawHFMH, learns
from granular_id.spaces.base import real_steps

__all__ = ["DEFAULT_SPACES", "Candidate", "checked_costs", "plan_candidates", "refuse_own_classifiers"]

DEFAULT_SPACES = (
    "raw+hfmh",
    "norm-raw+hfmh",
    "norm-raw",
    "hfmh",
    "norm-raw+dft",
    "raw",
    "pca",
    "raw-histogram",
)
"""The paper's spaces but three, in its order.

The complex Fourier transform is a rotation: with a linear classifier and C in units of the spread, "dft" and
"raw+dft" are "raw" again, and three names for one candidate would split its votes. "pca+rica" takes many times
the time of all others together.
"""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A feature space with a way to weight its blocks.

    Attributes
    ----------
    space : str
        Name of the space.
    block_weights : None, "unit" or tuple of float
        As in `BlockUnion`; None too where there is one block only.
    transformer : estimator
        Not fitted, with these weights.
    parts : int
        Blocks and steps, and one more for each that learns from training rows: the less the simpler.
    """

    space: str
    block_weights: Any
    transformer: BaseEstimator
    parts: int

    @property
    def name(self) -> str:
        """Space and weights in a word, such as ``raw+hfmh (unit)``."""
        if self.block_weights is None:
            return self.space
        if isinstance(self.block_weights, str):
            return f"{self.space} ({self.block_weights})"
        return f"{self.space} ({', '.join(f'{weight:g}' for weight in self.block_weights)})"


def plan_candidates(
    spaces: str | Sequence[str] | Mapping[str, BaseEstimator | FeatureSpace] | None,
    block_weights: Iterable[Any],
    rate_hz: float,
    seed: int,
) -> list[Candidate]:
    """Turn the arguments of `select` into candidates, in order.

    Parameters
    ----------
    spaces : None, str, sequence of str or mapping
        None: `DEFAULT_SPACES`. Otherwise as in `evaluate`.
    block_weights : iterable
        Each None, "unit" or one number per block. A space with several blocks becomes one candidate for each,
        in place of its own weights; a space without blocks ignores them.
    rate_hz : float
        Sampling rate of the recordings.
    seed : int
        For transformers with an open ``random_state``.

    Returns
    -------
    list of Candidate

    Raises
    ------
    TypeError, ValueError
        As `plan_spaces`; a space with a classifier of its own; no weights, weights that are none, or the same twice.
    """
    weightings = _checked_weightings(block_weights)
    if spaces is None:
        spaces = DEFAULT_SPACES
    candidates = []
    planned = plan_spaces(spaces, rate_hz)
    refuse_own_classifiers(planned)
    for k, space in enumerate(planned):
        transformer = seeded_clone(space.transformer, np.random.SeedSequence(seed, spawn_key=(5, k)))
        key = _weights_key(transformer)
        if key is None:
            candidates.append(Candidate(space.name, None, transformer, _parts(transformer)))
            continue
        for weights in weightings:
            weighted = clone(transformer).set_params(**{key: weights})
            candidates.append(Candidate(space.name, weights, weighted, _parts(weighted)))
    names = [candidate.name for candidate in candidates]
    if len(set(names)) < len(names):
        raise ValueError(
            f"spaces and block_weights must give each candidate a name of its own, got {names!r}"
        )
    return candidates


def refuse_own_classifiers(spaces: Sequence[Space | FeatureSpace]) -> None:
    """Refuse spaces that bring a classifier, whose cost cannot be chosen here.

    Raises
    ------
    ValueError
        Naming all of them, and what compares them with others.

    Examples
    --------
    >>> from granular_id.spaces import feature_spaces
    >>> refuse_own_classifiers([feature_spaces()["best"]])
    Traceback (most recent call last):
        ...
    ValueError: spaces must leave out 'best', with a classifier of its own: granular-id evaluate --spaces best, ...
    """
    names = [space.name for space in spaces]
    own = [repr(space.name) for space in spaces if space.classifier is not None]
    if own:
        raise ValueError(
            f"spaces must leave out {' and '.join(own)}, with a classifier of {'its' if len(own) == 1 else 'their'} "
            f"own: granular-id evaluate --spaces {','.join(names)}, or evaluate() in Python, compares them"
        )


def checked_costs(relative_costs: Any) -> tuple[float, ...]:
    """Return the grid of relative costs in ascending order, or say what is wrong with it."""
    try:
        costs = np.asarray(relative_costs, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"relative_costs must be a sequence of numbers, got {relative_costs!r}") from None
    if costs.ndim != 1 or costs.size == 0:
        raise ValueError(f"relative_costs must be a sequence of at least one number, got {relative_costs!r}")
    if not (np.isfinite(costs) & (costs > 0)).all():
        raise ValueError(f"relative_costs must be positive and finite, got {relative_costs!r}")
    if np.unique(costs).size < costs.size:
        raise ValueError(f"relative_costs must hold each number once, got {relative_costs!r}")
    return tuple(np.sort(costs).tolist())


def _checked_weightings(block_weights: Iterable[Any]) -> list[Any]:
    wanted = "block_weights must be a sequence of choices, each None, 'unit' or one number per block"
    if isinstance(block_weights, str) or not isinstance(block_weights, Iterable):
        raise TypeError(f"{wanted}, got {block_weights!r}: put it into a list")
    weightings: list[Any] = []
    for choice in block_weights:
        if choice is None or isinstance(choice, str):
            weightings.append(choice)
        elif isinstance(choice, Iterable):
            weightings.append(tuple(choice))
        else:
            raise TypeError(f"{wanted}, got {choice!r} among them")
    if not weightings:
        raise ValueError(f"{wanted}, got none")
    if len(set(weightings)) < len(weightings):
        raise ValueError(f"block_weights must hold each choice once, got {weightings!r}")
    return weightings


def _weights_key(transformer: Any) -> str | None:
    """Name of the parameter that weights the blocks of a space, or None where it has one block."""
    keys = [
        key
        for key, value in (("", transformer), *transformer.get_params(deep=True).items())
        if isinstance(value, BlockUnion | RawHFMH)
    ]
    if not keys:
        return None
    outermost = min(keys, key=lambda key: key.count("__"))
    return f"{outermost}__block_weights" if outermost else "block_weights"


def _parts(transformer: Any) -> int:
    steps = real_steps(transformer) if isinstance(transformer, Pipeline) else [transformer]
    return sum(_n_blocks(step) + learns(step) for step in steps)


def _n_blocks(step: Any) -> int:
    if isinstance(step, BlockUnion):
        return len(step.blocks)
    return 2 if isinstance(step, RawHFMH) else 1

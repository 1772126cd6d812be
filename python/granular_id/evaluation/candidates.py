"""What `select` tries: feature spaces with every way to weight their blocks, and their accuracies on folds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline

from granular_id._checks import argument_error, positive_number
from granular_id._estimators import convergence_warnings, named_errors, real_steps, seeded_clone
from granular_id._parallel import single_threaded_blas
from granular_id._progress import Ticker
from granular_id.evaluation.arguments import plan_spaces
from granular_id.evaluation.features import GramBank, SpaceFeatures
from granular_id.evaluation.scoring import CostGrid, Task, answers_of, nonzero_spread
from granular_id.partitions import Partition
from granular_id.spaces import HFMH, BlockUnion, FeatureSpace, MultiBand, RawHFMH, RawSignal, learns
from granular_id.splits import Groups

Floats = NDArray[np.float64]

DEFAULT_SPACES = ("raw+hfmh", "hfmh", "raw", "multiband", "best")
"""The spaces that run live: what is chosen among them, ``train`` takes."""

_LIVE = (RawSignal, HFMH, RawHFMH, MultiBand)
"""Features that are computed while samples arrive."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A feature space with a way to weight its blocks; `Scored` says what the fields hold."""

    space: str
    block_weights: Any
    transformer: BaseEstimator
    parts: int
    classifier: BaseEstimator | None = field(default=None, kw_only=True)

    @property
    def live(self) -> bool:
        """Whether its features can be computed while samples arrive."""
        return type(self.transformer) in _LIVE

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
    """Turn the arguments of `select` into candidates: a space of several blocks becomes one for each of the weights."""
    weightings = _checked_weightings(block_weights)
    planned = plan_spaces(DEFAULT_SPACES if spaces is None else spaces, rate_hz)
    candidates = []
    for k, space in enumerate(planned):
        transformer = seeded_clone(space.transformer, np.random.SeedSequence(seed, spawn_key=(5, k)))
        key = _weights_key(transformer)
        if space.classifier is not None:
            own = seeded_clone(space.classifier, np.random.SeedSequence(seed, spawn_key=(6, k)))
            parts = _parts(transformer, own)
            candidates.append(Candidate(space.name, None, transformer, parts, classifier=own))
            continue
        if key is None:
            candidates.append(Candidate(space.name, None, transformer, _parts(transformer)))
            continue
        for weights in weightings:
            weighted = clone(transformer).set_params(**{key: weights})
            candidates.append(Candidate(space.name, weights, weighted, _parts(weighted)))
    names = [candidate.name for candidate in candidates]
    if len(set(names)) < len(names):
        problem = f"and block_weights must give each candidate a name of its own, got {names!r}"
        raise argument_error(ValueError, "spaces", problem)
    return candidates


def checked_costs(relative_costs: Any) -> tuple[float, ...]:
    """Return the grid of relative costs in ascending order, or say what is wrong with it."""
    costs = _each_once("relative_costs", relative_costs, "numbers")
    return tuple(sorted(positive_number("relative_costs", cost) for cost in costs))


def _checked_weightings(block_weights: Any) -> list[Any]:
    wanted = "choices, each None, 'unit' or one number per block"
    weightings = _each_once("block_weights", block_weights, wanted)
    for choice in weightings:
        if not (choice is None or isinstance(choice, str | tuple)):
            raise argument_error(
                TypeError, "block_weights", f"must be a sequence of {wanted}, got {choice!r} among them"
            )
    return weightings


def _each_once(argument: str, values: Any, what: str) -> list[Any]:
    if isinstance(values, str) or not isinstance(values, Iterable) or getattr(values, "ndim", 1) == 0:
        raise argument_error(
            TypeError, argument, f"must be a sequence of {what}, got {values!r}: put it into a list"
        )
    found = [
        tuple(value) if isinstance(value, Iterable) and not isinstance(value, str) else value
        for value in values
    ]
    if not found:
        raise argument_error(ValueError, argument, f"must be a sequence of {what}, got none")
    if len(set(found)) < len(found):
        raise argument_error(ValueError, argument, f"must hold each once, got {found!r}")
    return found


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


def _parts(transformer: Any, classifier: Any = None) -> int:
    """Count blocks and steps, and what learns; of a classifier that chooses, the blocks that it may leave out."""
    steps = real_steps(transformer) if isinstance(transformer, Pipeline) else [transformer]
    n_blocks = (
        len(step.blocks) if isinstance(step, BlockUnion) else 1 + isinstance(step, RawHFMH) for step in steps
    )
    of_statistics = len(getattr(steps[-1], "blocks", ())) if isinstance(steps[-1], MultiBand) else 0
    return (
        sum(n_blocks)
        + sum(map(learns, steps))
        + of_statistics
        + len(getattr(classifier, "optional_blocks", ()))
    )


def score_all(
    candidates: Sequence[Candidate],
    costs: Sequence[float],
    partitions: Sequence[Partition],
    y: NDArray[np.str_],
    bank: GramBank,
    groups: Groups,
    *,
    n_jobs: int | None,
    ticker: Ticker,
) -> tuple[Floats, list[int], list[str]]:
    """Train and test every candidate with every relative cost (ascending) on every partition.

    One that brings its own classifier has one accuracy for all costs. Returns the accuracies (n_partitions,
    n_candidates, n_costs), the length of each candidate's feature vectors, and the convergence warnings.
    """
    labels, truth = np.unique(y, return_inverse=True)
    accuracies = np.empty((len(partitions), len(candidates), len(costs)))
    n_features: list[int] = []
    not_converged: list[str] = []
    for k, candidate in enumerate(candidates):
        answers, lines = answers_of(
            Task(
                FeatureSpace(candidate.space, candidate.transformer, None),
                CostGrid(costs) if candidate.classifier is None else candidate.classifier,
                bank,
                groups,
            ),
            partitions={"folds": partitions},
            labels=labels,
            truth=truth,
            seed=0,  # sets nothing: candidates have theirs
            n_jobs=n_jobs,
            ticker=ticker,
            checkpoint=None,
        )
        for j, (partition, answer) in enumerate(zip(partitions, answers["folds"], strict=True)):
            named = answer.predicted.reshape(partition.test.size, -1)
            accuracies[j, k] = np.mean(named == truth[partition.test, np.newaxis], axis=0)
        n_features.append(answers["folds"][0].n_features)
        not_converged += lines
    return accuracies, n_features, list(dict.fromkeys(not_converged))


def spread_of(candidate: Candidate, bank: GramBank, y: NDArray[np.str_]) -> float:
    """Mean squared distance of all recordings from their mean, in the features of a candidate fitted on them."""
    rows = np.arange(len(y))
    # What does not converge here has been told of the folds.
    with single_threaded_blas(), convergence_warnings(candidate.name), named_errors(candidate.space):
        features = SpaceFeatures(candidate.space, candidate.transformer, bank, seed=0, by_gram=True)
        gram, _, _ = features.products(Partition("all", 0, "all", rows, rows[:1]), y, {})
        return nonzero_spread(gram)

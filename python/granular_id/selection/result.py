"""What a selection found."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline

from granular_id._files import write_json
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.compare import compare
from granular_id.evaluation.comparison import MIN_PARTITIONS, Comparison, Pair
from granular_id.evaluation.statistics import corrected_interval
from granular_id.evaluation.tables import Table
from granular_id.selection import text
from granular_id.selection.choice import best_cost

__all__ = ["Choice", "OuterFold", "Scored", "Selection"]

FORMAT = "granular_id.selection/1"


@dataclass(frozen=True)
class Choice:
    """A candidate and a C by their places in `Selection.candidates` and `Selection.relative_costs`.

    ``accuracy`` is the mean over the folds that made the choice: too good to report, see `Selection.accuracy`.
    """

    candidate: int
    cost: int
    accuracy: float

    def same_as(self, other: Choice) -> bool:
        """Whether both chose the same candidate and the same C."""
        return (self.candidate, self.cost) == (other.candidate, other.cost)


@dataclass(frozen=True)
class OuterFold:
    """What the inner folds of one outer fold chose, and the accuracy of that on the recordings held out."""

    description: str
    n_train: int
    n_test: int
    choice: Choice
    accuracy: float


@dataclass(frozen=True, eq=False)
class Scored:
    """One candidate on the outer folds.

    Attributes
    ----------
    space, block_weights, name
        As in `granular_id.selection.candidates.Candidate`.
    n_features : int
        Length of the feature vector that the classifier sees.
    transformer : estimator
        Not fitted.
    accuracies : (n_outer, n_costs) float array
        Share of tested recordings named rightly, for each outer fold and C.
    """

    space: str
    block_weights: Any
    name: str
    n_features: int
    transformer: BaseEstimator
    accuracies: NDArray[np.float64]

    @property
    def best_cost(self) -> int:
        """Place of the C with the highest mean accuracy."""
        return best_cost(self.accuracies)


@dataclass(frozen=True, eq=False, repr=False)
class Selection:
    """The choice of `granular_id.select`, and what speaks for it.

    Attributes
    ----------
    candidates : tuple of Scored
        Every space with every weighting, in the order given.
    relative_costs : tuple of float
        The grid, ascending.
    final : Choice
        What was chosen, from all recordings.
    C : float
        Its C, for features as they are.
    outer : tuple of OuterFold
        The choices without the recordings held out, and how they did on those.
    n_classes : int
        Number of labels.
    held_out : {"sessions", "halves in time", "random recordings"}
        What an outer fold is, as strict as the data allowed.
    settings, data, versions : mapping
        Arguments, summary of the recordings, versions of what computed the numbers.
    notes : tuple of str
        What kind of folds were used, and what else a reader has to know.
    synthetic : bool
        True when recordings were simulated: such a choice says nothing about real materials.
    """

    candidates: tuple[Scored, ...]
    relative_costs: tuple[float, ...]
    final: Choice
    C: float
    outer: tuple[OuterFold, ...]
    n_classes: int
    held_out: str
    settings: Mapping[str, Any]
    data: Mapping[str, Any]
    versions: Mapping[str, str]
    notes: tuple[str, ...] = ()
    synthetic: bool = False

    @property
    def best(self) -> Scored:
        """The candidate that was chosen."""
        return self.candidates[self.final.candidate]

    @property
    def accuracies(self) -> NDArray[np.float64]:
        """Honest accuracy of the whole procedure on each outer fold: (n_outer,)."""
        return np.array([fold.accuracy for fold in self.outer])

    @property
    def accuracy(self) -> float:
        """Mean of `accuracies`: what to expect of recordings that had no say in the choice."""
        return float(self.accuracies.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of `accuracy`, corrected for common training rows; NaN if it cannot be said."""
        if len(self.outer) < MIN_PARTITIONS:
            return math.nan, math.nan
        n_train, n_test = self._mean_sizes()
        return corrected_interval(self.accuracies, n_train, n_test)

    @property
    def votes(self) -> Counter[str]:
        """How many outer folds chose each candidate, by name, whatever their C."""
        return Counter(self.candidates[fold.choice.candidate].name for fold in self.outer)

    @property
    def agreement(self) -> float:
        """Share of the outer folds that chose the same space and weights as the final choice."""
        return self.votes[self.best.name] / len(self.outer)

    @cached_property
    def comparison(self) -> Comparison | None:
        """Every candidate at its best C against every other, on the outer folds; None for a single candidate.

        The folds that are compared chose each C, and that a candidate is looked at because it did well: read
        close calls with care.
        """
        if len(self.candidates) < 2:
            return None
        n_train, n_test = self._mean_sizes()
        shares = {c.name: c.accuracies[:, c.best_cost] for c in self.candidates}
        return compare(list(shares), shares, n_train, n_test)

    @property
    def runner_up(self) -> Pair | None:
        """The final choice against the best other candidate; None when there was no other."""
        if self.comparison is None:
            return None
        means = self.comparison.means
        other = max((name for name in means if name != self.best.name), key=lambda name: means[name])
        return self.comparison.pair(self.best.name, other)

    def model(self) -> Pipeline:
        """Return the chosen pipeline, not fitted: features and `ECOCClassifier`.

        Returns
        -------
        sklearn.pipeline.Pipeline
            For recordings (n, T, C).
        """
        return Pipeline(
            [("features", clone(self.best.transformer)), ("classifier", ECOCClassifier(C=self.C))]
        )

    def verdict(self) -> str:
        """Say what to take, what to expect of it and how sure that is, in a few lines."""
        return text.verdict(self)

    def table(self) -> Table:
        """Return the candidates, best first, with how often each was chosen."""
        return text.candidates_table(self)

    def __str__(self) -> str:
        return f"{self.verdict()}\n\n{self.table()}"

    def __repr__(self) -> str:
        synthetic = "SYNTHETIC, " if self.synthetic else ""
        return f"Selection({synthetic}{self.best.name}, C={self.C:.3g}, accuracy {self.accuracy:.3f})"

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows; NaN becomes None."""
        pair = self.runner_up
        low, high = self.interval
        return {
            "format": FORMAT,
            "synthetic": self.synthetic,
            "space": self.best.space,
            "block_weights": _plain(self.best.block_weights),
            "C": self.C,
            "relative_cost": self.relative_costs[self.final.cost],
            "held_out": self.held_out,
            "accuracy": self.accuracy,
            "interval": None if math.isnan(low) else [low, high],
            "agreement": self.agreement,
            "runner_up": None if pair is None else pair.to_dict(),
            "outer": [
                {
                    "description": fold.description,
                    "n_train": fold.n_train,
                    "n_test": fold.n_test,
                    "chosen": self.candidates[fold.choice.candidate].name,
                    "relative_cost": self.relative_costs[fold.choice.cost],
                    "accuracy_of_the_choice_on_inner_folds": fold.choice.accuracy,
                    "accuracy": fold.accuracy,
                }
                for fold in self.outer
            ],
            "candidates": [
                {
                    "name": candidate.name,
                    "space": candidate.space,
                    "block_weights": _plain(candidate.block_weights),
                    "n_features": candidate.n_features,
                    "accuracies": candidate.accuracies.tolist(),
                }
                for candidate in self.candidates
            ],
            "notes": list(self.notes),
            "settings": dict(self.settings),
            "data": dict(self.data),
            "versions": dict(self.versions),
        }

    def to_json(self, path: str | os.PathLike[str]) -> None:
        """Write `to_dict` as one UTF-8 JSON file; whole or not at all."""
        write_json(path, self.to_dict())

    def _mean_sizes(self) -> tuple[float, float]:
        n_train, n_test = (
            float(np.mean([getattr(fold, size) for fold in self.outer])) for size in ("n_train", "n_test")
        )
        return n_train, n_test


def _plain(block_weights: Any) -> Any:
    return list(block_weights) if isinstance(block_weights, tuple) else block_weights

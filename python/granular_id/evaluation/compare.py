"""Feature spaces against each other on the same folds: differences and p-values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from granular_id.score import Held
from granular_id.statistics import MIN_PARTITIONS, corrected_resampled_t, holm, mann_whitney


@dataclass(frozen=True)
class Pair:
    """Two feature spaces on the same folds; shares of 1, NaN where it cannot be said.

    Attributes
    ----------
    first, second : str
        Names.
    difference : float
        Mean balanced accuracy over folds of the first minus that of the second.
    corrected_p : float
        Corrected resampled t-test (Nadeau and Bengio, Machine Learning 52, 2003), two-sided.
    holm_p : float
        The same, adjusted for all pairs (Holm, Scandinavian Journal of Statistics 6, 1979).
    mann_whitney_p : float
        As the paper reports it. Far too small: folds that share recordings are taken for independent.
    """

    first: str
    second: str
    difference: float
    corrected_p: float = math.nan
    holm_p: float = math.nan
    mann_whitney_p: float = math.nan


def compare(held: Mapping[str, Held]) -> tuple[Pair, ...]:
    """Compare each space with every later one; without p-values where there are fewer than three folds."""
    accuracies = {name: one.fold_accuracies() for name, one in held.items()}
    pairs = []
    for (first, a), (second, b) in combinations(accuracies.items(), 2):
        pair = Pair(first, second, float((a - b).mean()))
        if a.size >= MIN_PARTITIONS:
            folds = held[first].folds
            sizes = (
                float(np.mean([rows.size for rows in each])) for each in list(zip(*folds, strict=True))[:2]
            )
            p = corrected_resampled_t(a - b, *sizes)
            pair = replace(pair, corrected_p=p, mann_whitney_p=mann_whitney(a, b))
        pairs.append(pair)
    adjusted = holm([pair.corrected_p for pair in pairs]).tolist()
    return tuple(replace(pair, holm_p=p) for pair, p in zip(pairs, adjusted, strict=True))

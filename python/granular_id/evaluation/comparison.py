"""What a comparison of feature spaces on the same partitions says; `granular_id.evaluation.compare` makes it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from granular_id.evaluation.comparison_table import comparison_table
from granular_id.evaluation.tables import Table

__all__ = ["MIN_PARTITIONS", "Comparison", "Pair"]

MIN_PARTITIONS = 3
"""Below this nothing but differences is given. Two partitions leave one degree of freedom: a 95 % interval
is then +- 12.7 standard errors."""


@dataclass(frozen=True)
class Pair:
    """Two methods on the same partitions; shares of 1, NaN where it cannot be said.

    Attributes
    ----------
    first, second : str
        Names.
    difference : float
        Mean accuracy of the first minus that of the second.
    mann_whitney_p : float
        As the paper reports it. Far too small: overlapping partitions are taken for independent.
    corrected_p : float
        Corrected resampled t-test.
    holm_p : float
        The same, adjusted for all pairs of the comparison.
    worse, equivalent, better : float
        Probability that the first is worse, equivalent, better, by the Bayesian correlated t-test.
    """

    first: str
    second: str
    difference: float
    mann_whitney_p: float
    corrected_p: float
    holm_p: float
    worse: float
    equivalent: float
    better: float

    def to_dict(self) -> dict[str, str | float | None]:
        """Return everything in types that JSON knows; NaN becomes None."""
        return {key: _finite(value) for key, value in asdict(self).items()}


@dataclass(frozen=True, eq=False)
class Comparison:
    """Methods measured on the same partitions, compared pair by pair; made by `granular_id.evaluation.compare.compare`.

    Attributes
    ----------
    names : tuple of str
        The methods, in order.
    means : mapping of str to float
        Mean accuracy of each.
    intervals : mapping of str to (float, float)
        95 % confidence interval of each mean, corrected for the overlap; NaN where it cannot be said.
    pairs : tuple of Pair
        Each name with every later one.
    n_partitions : int
        How many accuracies each method has.
    n_train, n_test : float
        Recordings that train and that are tested, mean over partitions.
    rope : float
        Differences within this count as equivalent.
    protocol : str or None
        Where the partitions come from.
    why_not : str
        What cannot be said, and why; empty when all can.
    """

    names: tuple[str, ...]
    means: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    pairs: tuple[Pair, ...]
    n_partitions: int
    n_train: float
    n_test: float
    rope: float
    protocol: str | None
    why_not: str

    @property
    def testable(self) -> bool:
        """Whether there are partitions enough for p-values, probabilities and intervals."""
        return self.n_partitions >= MIN_PARTITIONS

    def pair(self, first: str, second: str) -> Pair:
        """Return the comparison of `first` with `second`, in that direction.

        Raises
        ------
        ValueError
            An unknown name, or twice the same.
        """
        for pair in self.pairs:
            if (pair.first, pair.second) == (first, second):
                return pair
            if (pair.first, pair.second) == (second, first):
                return _reversed(pair)
        known = ", ".join(map(repr, self.names))
        raise ValueError(f"first and second must be two of {known}, got {first!r} and {second!r}")

    def table(self, of: str | None = None) -> Table:
        """Return the pairs as a table, with a note on each column that needs one.

        Parameters
        ----------
        of : str, optional
            Only the pairs of this method, each as "this against another". Default: all pairs.

        Raises
        ------
        ValueError
            An unknown name.
        """
        return comparison_table(self, of)

    def __str__(self) -> str:
        return str(self.table())

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows; NaN becomes None."""
        return {
            "protocol": self.protocol,
            "n_partitions": self.n_partitions,
            "n_train": self.n_train,
            "n_test": self.n_test,
            "rope": self.rope,
            "why_not": self.why_not,
            "means": dict(self.means),
            "intervals": {name: [_finite(end) for end in ends] for name, ends in self.intervals.items()},
            "pairs": [pair.to_dict() for pair in self.pairs],
        }


def _reversed(pair: Pair) -> Pair:
    return replace(
        pair,
        first=pair.second,
        second=pair.first,
        difference=-pair.difference,
        worse=pair.better,
        better=pair.worse,
    )


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and math.isnan(value) else value

"""Methods against each other on the same partitions: differences, p-values, probabilities, and their table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._checks import named
from granular_id._files import json_value
from granular_id._text import Table, counted, whole_percent
from granular_id.statistics import (
    MIN_PARTITIONS,
    ROPE,
    bayesian_correlated_t,
    corrected_resampled_t,
    holm,
    mann_whitney,
    mean_interval,
)

Floats = NDArray[np.float64]

_NOTES = (
    "‡ Mann-Whitney, as in the paper: far too small, as it takes partitions for independent",
    "p: corrected resampled t-test (Nadeau & Bengio 2003); Holm: adjusted for {tests}",
    "worse, equal (within {rope:g} %), better: probabilities (Bayesian correlated t-test)",
)


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
    mann_whitney_p: float = math.nan
    corrected_p: float = math.nan
    holm_p: float = math.nan
    worse: float = math.nan
    equivalent: float = math.nan
    better: float = math.nan

    def to_dict(self) -> dict[str, str | float | None]:
        """Return everything in types that JSON knows; NaN becomes None."""
        return {name: json_value(value) for name, value in vars(self).items()}

    def reversed(self) -> Pair:
        """Return the same comparison, of the second with the first."""
        return replace(
            self,
            first=self.second,
            second=self.first,
            difference=-self.difference,
            worse=self.better,
            better=self.worse,
        )


@dataclass(frozen=True, eq=False)
class Comparison:
    """Methods measured on the same partitions, compared pair by pair.

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
    drawn : str
        How the partitions were drawn, in words.
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
    drawn: str = ""

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
            if (pair.second, pair.first) == (first, second):
                return pair.reversed()
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
        pairs: Sequence[Pair] = self.pairs
        if of is not None:
            named(self.means, "of", of)
            pairs = [self.pair(of, other) for other in self.names if other != of]
        header: tuple[str, ...] = ("first", "second", "points")
        rows: list[tuple[str, ...]] = [
            (pair.first, pair.second, f"{100 * pair.difference:+.2f}") for pair in pairs
        ]
        notes: tuple[str, ...] = ()
        if self.testable:
            header += ("U test‡", "p", "Holm", "worse", "equal", "better")
            rows = [
                (
                    *row,
                    *map(_p_value, (pair.mann_whitney_p, pair.corrected_p, pair.holm_p)),
                    *map(probability, (pair.worse, pair.equivalent, pair.better)),
                )
                for row, pair in zip(rows, pairs, strict=True)
            ]
            tests = counted(sum(not math.isnan(pair.corrected_p) for pair in self.pairs), "pair")
            notes = tuple(note.format(tests=tests, rope=100 * self.rope) for note in _NOTES)
        if self.why_not:
            notes += (self.why_not,)
        drawn = f" ({self.drawn})" if self.drawn else ""
        title = f"Differences in accuracy on the same {counted(self.n_partitions, 'partition')}{drawn}"
        return Table(title, header, tuple(rows), notes)

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
            "intervals": json_value(self.intervals),
            "pairs": json_value(self.pairs),
        }


def compare(
    names: Sequence[str],
    accuracies: Mapping[str, ArrayLike],
    n_train: float | Sequence[float],
    n_test: float | Sequence[float],
    *,
    protocol: str | None = None,
    drawn: str = "",
) -> Comparison:
    """Compare at least two methods, each with every other.

    `accuracies` holds J values for each name, of the same partitions in the same order; `n_train` and `n_test` count
    recordings, one number or J, of which the mean is used. With fewer than three partitions only differences are
    given: halves of a data set train and test each other in turn, and two values do not show a spread.
    """
    if len(names) < 2:
        raise ValueError(f"names must hold at least 2 methods to compare, got {names!r}")
    values = {name: np.asarray(accuracies[name], dtype=np.float64) for name in names}
    n_partitions = len(values[names[0]])
    trained, tested = float(np.mean(n_train)), float(np.mean(n_test))
    pairs = [Pair(a, b, float((values[a] - values[b]).mean())) for a, b in combinations(names, 2)]
    if n_partitions >= MIN_PARTITIONS:
        pairs = [_tested(pair, values[pair.first], values[pair.second], trained, tested) for pair in pairs]
        adjusted = holm([pair.corrected_p for pair in pairs]).tolist()
        pairs = [replace(pair, holm_p=p) for pair, p in zip(pairs, adjusted, strict=True)]
    return Comparison(
        names=tuple(names),
        means={name: float(shares.mean()) for name, shares in values.items()},
        intervals={name: mean_interval(shares, trained, tested) for name, shares in values.items()},
        pairs=tuple(pairs),
        n_partitions=n_partitions,
        n_train=trained,
        n_test=tested,
        rope=ROPE,
        protocol=protocol,
        why_not=_why_not(n_partitions, pairs),
        drawn=drawn,
    )


def _tested(pair: Pair, a: Floats, b: Floats, n_train: float, n_test: float) -> Pair:
    t = corrected_resampled_t(a - b, n_train, n_test)
    worse, equivalent, better = bayesian_correlated_t(a - b, n_test / (n_train + n_test), ROPE)
    return Pair(
        pair.first,
        pair.second,
        t.mean,
        mann_whitney_p=mann_whitney(a, b),
        corrected_p=t.p_value,
        worse=worse,
        equivalent=equivalent,
        better=better,
    )


def _why_not(n_partitions: int, pairs: Sequence[Pair]) -> str:
    if n_partitions < MIN_PARTITIONS:
        count = {1: "one partition", 2: "two partitions"}[n_partitions]
        return f"{count}: too few for p-values, probabilities or intervals (at least {MIN_PARTITIONS} are needed)"
    same = [pair for pair in pairs if math.isnan(pair.corrected_p)]
    if not same:
        return ""
    listed = ", ".join(f"{pair.first} and {pair.second}" for pair in same[:3])
    more = f" and {len(same) - 3} more pairs" if len(same) > 3 else ""
    return f"{listed}{more}: the same difference in every partition, so its uncertainty is not known"


def _p_value(value: float) -> str:
    if math.isnan(value):
        return "-"
    return "<0.001" if value < 0.001 else f"{value:.3f}"


def probability(value: float) -> str:
    """Format a probability so that almost sure and almost impossible keep their rest; ``-`` for NaN."""
    if math.isnan(value):
        return "-"
    return f"{whole_percent(100 * value) if value > 0 else '0'} %"

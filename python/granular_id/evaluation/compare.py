"""Methods against each other on the same partitions: differences, p-values, and their table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from granular_id._checks import argument_error
from granular_id._text import Table, counted
from granular_id.statistics import MIN_PARTITIONS, corrected_resampled_t, holm, mann_whitney

_NOTES = (
    "‡ Mann-Whitney, as in the paper: far too small, as it takes partitions for independent",
    "p: corrected resampled t-test (Nadeau & Bengio 2003); Holm: adjusted for {tests}",
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
    """

    first: str
    second: str
    difference: float
    mann_whitney_p: float = math.nan
    corrected_p: float = math.nan
    holm_p: float = math.nan

    def of(self, name: str) -> Pair:
        """Return the comparison of one of the two with the other."""
        if name == self.first:
            return self
        return replace(self, first=self.second, second=self.first, difference=-self.difference)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Methods measured on the same partitions, compared pair by pair.

    Attributes
    ----------
    names : tuple of str
        The methods, in order.
    pairs : tuple of Pair
        Each name with every later one.
    n_partitions : int
        How many accuracies each method has.
    drawn : str
        How the partitions were drawn, in words.
    """

    names: tuple[str, ...]
    pairs: tuple[Pair, ...]
    n_partitions: int
    drawn: str

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
        if of not in (None, *self.names):
            known = ", ".join(map(repr, self.names))
            raise argument_error(ValueError, "of", f"must be one of {known}, got {of!r}")
        pairs = [
            pair if of is None else pair.of(of)
            for pair in self.pairs
            if of in (None, pair.first, pair.second)
        ]
        header: tuple[str, ...] = ("first", "second", "points")
        rows: list[tuple[str, ...]] = [
            (pair.first, pair.second, f"{100 * pair.difference:+.2f}") for pair in pairs
        ]
        if self.n_partitions < MIN_PARTITIONS:
            count = {1: "one partition", 2: "two partitions"}[self.n_partitions]
            notes: tuple[str, ...] = (
                f"{count}: too few for p-values (at least {MIN_PARTITIONS} are needed)",
            )
        else:
            header += ("U test‡", "p", "Holm")
            rows = [
                (*row, *map(_p_value, (pair.mann_whitney_p, pair.corrected_p, pair.holm_p)))
                for row, pair in zip(rows, pairs, strict=True)
            ]
            tests = counted(sum(not math.isnan(pair.corrected_p) for pair in self.pairs), "pair")
            notes = tuple(note.format(tests=tests) for note in _NOTES)
            if any(math.isnan(pair.corrected_p) for pair in pairs):
                notes += ("-: the same difference in every partition, so its uncertainty is not known",)
        title = (
            f"Differences in accuracy on the same {counted(self.n_partitions, 'partition')} ({self.drawn})"
        )
        return Table(title, header, tuple(rows), notes)

    def __str__(self) -> str:
        return str(self.table())


def compare(
    accuracies: Mapping[str, ArrayLike],
    n_train: Sequence[int],
    n_test: Sequence[int],
    drawn: str,
) -> Comparison:
    """Compare at least two methods, each with every other.

    `accuracies` holds J values for each name, of the same partitions in the same order; `n_train` and `n_test` count
    the recordings of each partition, and `drawn` says how they were drawn. With fewer than three partitions only
    differences are given: halves of a data set train and test each other in turn, and two values do not show a spread.
    """
    if len(accuracies) < 2:
        raise ValueError(
            f"wanted at least 2 feature spaces to compare, got {', '.join(map(repr, accuracies))}"
        )
    values = {name: np.asarray(shares, dtype=np.float64) for name, shares in accuracies.items()}
    trained, tested = float(np.mean(n_train)), float(np.mean(n_test))
    pairs = []
    for (first, a), (second, b) in combinations(values.items(), 2):
        pair = Pair(first, second, float((a - b).mean()))
        if a.size >= MIN_PARTITIONS:
            p = corrected_resampled_t(a - b, trained, tested)
            pair = replace(pair, mann_whitney_p=mann_whitney(a, b), corrected_p=p)
        pairs.append(pair)
    adjusted = holm([pair.corrected_p for pair in pairs]).tolist()
    pairs = [replace(pair, holm_p=p) for pair, p in zip(pairs, adjusted, strict=True)]
    return Comparison(tuple(values), tuple(pairs), len(n_train), drawn)


def _p_value(value: float) -> str:
    if math.isnan(value):
        return "-"
    return "<0.001" if value < 0.001 else f"{value:.3f}"

"""Every feature space against every other, on the same partitions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._text import Table
from granular_id.evaluation.tables import comparison_table
from granular_id.statistics import (
    MIN_PARTITIONS,
    ROPE,
    bayesian_correlated_t,
    corrected_interval,
    corrected_resampled_t,
    holm,
    mann_whitney,
)


def compare(
    names: Sequence[str],
    accuracies: Mapping[str, ArrayLike],
    n_train: ArrayLike,
    n_test: ArrayLike,
    *,
    rope: float = ROPE,
    protocol: str | None = None,
) -> Comparison:
    """Compare methods that were measured on the same partitions, each with every other.

    Parameters
    ----------
    names : sequence of str
        At least two methods, in the order of the table.
    accuracies : mapping of str to array-like, shape (J,)
        For each name, accuracy in [0, 1] per partition, partitions in the same order for all.
    n_train, n_test : float or array-like, shape (J,)
        Recordings that train and that are tested; where partitions differ, their means are used.
    rope : float
        See `bayesian_correlated_t`.
    protocol : str, optional
        Name of the protocol, for the title.

    Returns
    -------
    Comparison
        With fewer than three partitions it holds differences only: halves of a data set train and test each
        other in turn, and from two values no test can tell a difference from chance.

    Raises
    ------
    ValueError
        Fewer than two names, one twice, one without accuracies, unequal numbers of partitions, accuracies
        that are NaN or outside [0, 1], counts that are not positive or do not fit the partitions.

    Examples
    --------
    >>> comparison = compare(
    ...     ["raw", "hfmh"],
    ...     {"raw": [0.80, 0.84, 0.82, 0.79], "hfmh": [0.86, 0.88, 0.89, 0.84]},
    ...     n_train=550,
    ...     n_test=132,
    ... )
    >>> pair = comparison.pair("hfmh", "raw")
    >>> round(pair.difference, 3), round(pair.mann_whitney_p, 3), round(pair.corrected_p, 3)
    (0.055, 0.042, 0.009)
    """
    names = _checked_names(names, accuracies)
    values = _checked_accuracies(names, accuracies)
    n_partitions = len(values[names[0]])
    trained, tested = (
        _mean_count(name, count, n_partitions) for name, count in (("n_train", n_train), ("n_test", n_test))
    )
    enough = n_partitions >= MIN_PARTITIONS
    pairs = [
        _pair(first, second, values[first], values[second], trained, tested, rope, enough=enough)
        for first, second in combinations(names, 2)
    ]
    adjusted = holm([pair.corrected_p for pair in pairs])
    nothing = (math.nan, math.nan)
    return Comparison(
        names=names,
        means={name: float(values[name].mean()) for name in names},
        intervals={
            name: corrected_interval(values[name], trained, tested) if enough else nothing for name in names
        },
        pairs=tuple(replace(pair, holm_p=p) for pair, p in zip(pairs, adjusted.tolist(), strict=True)),
        n_partitions=n_partitions,
        n_train=trained,
        n_test=tested,
        rope=rope,
        protocol=protocol,
        why_not=_why_not(n_partitions, pairs),
    )


def _pair(
    first: str,
    second: str,
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    n_train: float,
    n_test: float,
    rope: float,
    *,
    enough: bool,
) -> Pair:
    if not enough:
        return Pair(first, second, float((a - b).mean()), *(math.nan,) * 6)
    t = corrected_resampled_t(a - b, n_train, n_test)
    posterior = bayesian_correlated_t(a - b, n_test / (n_train + n_test), rope)
    return Pair(first, second, t.mean, mann_whitney(a, b), t.p_value, math.nan, *posterior)


def _why_not(n_partitions: int, pairs: Iterable[Pair]) -> str:
    if n_partitions < MIN_PARTITIONS:
        count = {1: "one partition", 2: "two partitions"}[n_partitions]
        return (
            f"{count}: too few to tell a difference from chance, so no p-values, probabilities or intervals "
            f"are given (at least {MIN_PARTITIONS} are needed)"
        )
    same = [pair for pair in pairs if math.isnan(pair.corrected_p)]
    if same:
        listed = ", ".join(f"{pair.first} and {pair.second}" for pair in same[:3])
        more = f" and {len(same) - 3} more pairs" if len(same) > 3 else ""
        return f"{listed}{more}: the same difference in every partition, so its uncertainty is not known"
    return ""


def _checked_names(names: Sequence[str], accuracies: Mapping[str, ArrayLike]) -> tuple[str, ...]:
    if isinstance(names, str) or len(names) < 2:
        raise ValueError(f"names must hold at least 2 methods to compare, got {names!r}")
    if len(set(names)) < len(names):
        raise ValueError(f"names must hold each method once, got {list(names)!r}")
    missing = [name for name in names if name not in accuracies]
    if missing:
        raise ValueError(f"accuracies has no values for {missing[0]!r}")
    return tuple(names)


def _checked_accuracies(
    names: Sequence[str], accuracies: Mapping[str, ArrayLike]
) -> dict[str, NDArray[np.float64]]:
    values = {name: np.asarray(accuracies[name], dtype=np.float64) for name in names}
    for name, shares in values.items():
        if shares.ndim != 1 or shares.size == 0:
            raise ValueError(
                f"accuracies[{name!r}] must hold one value per partition, got shape {shares.shape}"
            )
        if not ((shares >= 0) & (shares <= 1)).all():  # NaN too
            raise ValueError(f"accuracies[{name!r}] must lie in [0, 1], got {shares.tolist()}")
        if shares.size != values[names[0]].size:
            raise ValueError(
                f"accuracies[{name!r}] holds {shares.size} partitions, accuracies[{names[0]!r}] holds "
                f"{values[names[0]].size}; they must be the same partitions"
            )
    return values


def _mean_count(name: str, count: ArrayLike, n_partitions: int) -> float:
    counts = np.asarray(count, dtype=np.float64)
    if counts.ndim > 1 or (counts.ndim == 1 and counts.size != n_partitions):
        raise ValueError(
            f"{name} must be a number or one per partition ({n_partitions}), got shape {counts.shape}"
        )
    if not (np.isfinite(counts) & (counts > 0)).all():
        raise ValueError(f"{name} must be positive, got {count!r}")
    return float(counts.mean())


# What a comparison of feature spaces on the same partitions says; `granular_id.evaluation.compare` makes it.


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

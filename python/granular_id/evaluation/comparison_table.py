"""The pairs of a comparison as a table, with a note on each column that needs one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from granular_id._percent import whole_percent
from granular_id._words import counted
from granular_id.evaluation.tables import Table

if TYPE_CHECKING:
    from granular_id.evaluation.comparison import Comparison

__all__ = ["MANN_WHITNEY_MARK", "comparison_table", "probability"]

MANN_WHITNEY_MARK = (
    "† Mann-Whitney, as the paper reports it, but far too small: it takes partitions that share recordings for "
    "independent. With 20 random partitions it calls one of two equally good methods better in about 4 of 10 data "
    "sets, not in 1 of 20."
)


def comparison_table(comparison: Comparison, of: str | None = None) -> Table:
    """Return all pairs, or those of one method against each other one; see `Comparison.table`."""
    if of is None:
        pairs = comparison.pairs
    elif of in comparison.names:
        pairs = tuple(comparison.pair(of, other) for other in comparison.names if other != of)
    else:
        raise ValueError(f"of must be one of {', '.join(map(repr, comparison.names))}, got {of!r}")
    count = comparison.n_partitions
    where = f", {comparison.protocol} protocol" if comparison.protocol else ""
    title = f"Differences in accuracy on the same {counted(count, 'partition')}{where}"
    why_not = (comparison.why_not,) if comparison.why_not else ()
    if not comparison.testable:
        plain = tuple((pair.first, pair.second, _points(pair.difference)) for pair in pairs)
        return Table(title, ("first", "second", "points"), plain, why_not)
    header = ("first", "second", "points", "U test†", "p", "Holm", "worse", "equal", "better")
    rows = tuple(
        (
            pair.first,
            pair.second,
            _points(pair.difference),
            *map(_p, (pair.mann_whitney_p, pair.corrected_p, pair.holm_p)),
            *map(probability, (pair.worse, pair.equivalent, pair.better)),
        )
        for pair in pairs
    )
    tests = sum(not math.isnan(pair.corrected_p) for pair in comparison.pairs)
    notes = (
        MANN_WHITNEY_MARK,
        "p: corrected resampled t-test (Nadeau & Bengio 2003); "
        f"Holm: the same, adjusted for {counted(tests, 'pair')}",
        "worse, equal, better: probability that the first is so, equal meaning within "
        f"{100 * comparison.rope:g} % (Bayesian correlated t-test, Corani & Benavoli 2015)",
    )
    return Table(title, header, rows, (*notes, *why_not))


def _points(difference: float) -> str:
    return f"{100 * difference:+.2f}"


def _p(value: float) -> str:
    if math.isnan(value):
        return "-"
    return "<0.001" if value < 0.001 else f"{value:.3f}"


def probability(value: float) -> str:
    """Format a probability so that almost sure and almost impossible keep their rest; ``-`` for NaN."""
    if math.isnan(value):
        return "-"
    return f"{whole_percent(100 * value) if value > 0 else '0'} %"

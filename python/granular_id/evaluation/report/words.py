"""The sentences of a report: headline, gap, what a reader has to know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from granular_id._words import counted
from granular_id.evaluation.describe import SEVERE
from granular_id.evaluation.protocol_names import protocol_name
from granular_id.evaluation.tables import SMALL_GAP, gap_lines, percent

if TYPE_CHECKING:
    from granular_id.evaluation.result import EvaluationResult

__all__ = ["Gap", "Side", "gap_of", "split_notes"]

_APART = {
    "held-out sessions": "different sessions",
    "blocks in time order": "different stretches of time",
    "halves in time order": "different halves in time",
}
_VERDICTS = {
    "lost": (
        "{points} points do not survive {apart}. Recordings made together resemble each other in more than their "
        "material, and random draws put them on both sides. For new recordings, count on the lower figure."
    ),
    "unsure": (
        "{points} points less with {apart}, which lies within the uncertainty of the figure for random draws: "
        "these recordings do not show a gap, and are too few to rule one out. For new recordings, count on the "
        "lower figure."
    ),
    "kept": (
        "Less than a point is lost between random draws and {apart}: these recordings give no sign that it is "
        "their session that is recognised instead of their material."
    ),
}


@dataclass(frozen=True)
class Side:
    """One of the two figures: what protocol, how accurate, how sure."""

    protocol: str
    name: str
    accuracy: str
    spread: str


@dataclass(frozen=True)
class Gap:
    """The two accuracies a reader must see together, and what they mean.

    Attributes
    ----------
    kind : {"lost", "unsure", "kept", "unknown"}
        Points are lost; so few that chance explains them; less than one; no strict protocol ran beside random
        draws.
    points : (str, str)
        How many more or fewer, and the unit; no difference where that rounds to none.
    """

    kind: str
    headline: str
    sides: tuple[Side, ...]
    points: tuple[str, str]
    verdict: str
    remarks: tuple[str, ...]


def gap_of(result: EvaluationResult, space: str) -> Gap:
    """Put the gap of one space into words."""
    shown = [name for name in (result.random, result.strictest) if name is not None]
    sides = tuple(_side(result, space, name) for name in shown or result.protocols[:1])
    gap = result.gap(space)
    if gap is None:
        headline = f"{space} names {sides[0].accuracy} of recordings rightly ({sides[0].name})"
        return Gap("unknown", headline, sides, ("", ""), _one_sided(result, sides[0]), _chosen(result))
    random, strict = sides
    apart = _APART.get(strict.name, strict.name)
    kind = _kind(result, space, gap)
    but = {"lost": "but only", "unsure": "and"}.get(kind, "and still")
    headline = (
        f"{space} names {random.accuracy} of recordings rightly when training and test are drawn at random, "
        f"{but} {strict.accuracy} when they come from {apart}"
    )
    verdict = _VERDICTS[kind].format(points=f"{100 * gap:.1f}", apart=apart)
    remarks = [line.strip("()") for line in gap_lines(result) if line.startswith("(")]
    best = result.best_space(strict.protocol)
    if best != space:
        remarks.append(
            f"best with {strict.name}: {best}, {percent(result.mean_accuracy(best, strict.protocol))}"
        )
    change = f"{-100 * gap:+.1f}".replace("-", "−")
    points = (change, "points") if change.strip("+−") != "0.0" else ("no", "difference")
    return Gap(kind, headline, sides, points, verdict, (*remarks, *_chosen(result)))


def split_notes(result: EvaluationResult) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the warnings and the other notes, without the word that marks them."""
    marked = [note for note in result.notes if note.startswith(SEVERE)]
    others = [note for note in result.notes if not note.startswith(SEVERE)]
    return tuple(note.partition(": ")[2] for note in marked), tuple(others)


def _chosen(result: EvaluationResult) -> tuple[str, ...]:
    n = len(result.spaces)
    if n == 1:
        return ()
    return (f"the best of {n} feature spaces, chosen by these same recordings: a little flattered by that",)


def _kind(result: EvaluationResult, space: str, gap: float) -> str:
    if gap < SMALL_GAP:
        return "kept"
    low, _ = result.interval(space, result.random)
    # Without an interval (all partitions alike) nothing excuses a gap.
    return "unsure" if result.mean_accuracy(space, result.strictest) >= low else "lost"


def _side(result: EvaluationResult, space: str, protocol: str) -> Side:
    partitions = result.partitions[protocol]
    values = result.accuracies(space, protocol)
    low, high = result.interval(space, protocol)
    if np.isfinite(low):
        spread = f"95 % interval {100 * low:.1f} to {100 * high:.1f} %, {counted(len(values), 'partition')}"
    elif len(values) == 1:
        spread = "one partition"
    else:
        each = " and ".join(f"{100 * value:.1f} %" for value in values.tolist())
        spread = each if len(values) == 2 else f"the same in each of {counted(len(values), 'partition')}"
    return Side(
        protocol, protocol_name(protocol, partitions), percent(result.mean_accuracy(space, protocol)), spread
    )


def _one_sided(result: EvaluationResult, side: Side) -> str:
    if result.strictest is not None:
        return f"Only {side.name} ran: nothing shows how much random draws would flatter these recordings."
    return (
        f"Only {side.name} ran: no protocol held out a session or a stretch of time. Recordings made together "
        "resemble each other in more than their material, so take this figure as the upper end of what to expect."
    )

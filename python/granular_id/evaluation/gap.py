"""The gap between the strictest protocol and as many recordings drawn at random, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granular_id._text import counted, listed, percent
from granular_id.evaluation.outcome import Outcome
from granular_id.statistics import MIN_PARTITIONS

_NO_GAP = 0.01  # less than a point is called no gap
_APART = {
    "held-out sessions": "different sessions",
    "blocks in time order": "different stretches of time",
    "halves in time order": "different halves in time",
}
_VERDICTS = {
    "lost": (
        "{points} points do not survive {apart}. {together} resemble each other in more than their "
        "material, and random draws put them on both sides. For {new}, count on the lower figure."
    ),
    "unsure": (
        "{points} points less with {apart}, which lies within the uncertainty of the figure for random draws: "
        "these recordings do not show a gap, and are too few to rule one out. For {new}, count on the "
        "lower figure."
    ),
    "kept": (
        "No point is lost with {apart} against as many recordings drawn at random: no sign that it is their {what} "
        "that is recognised instead of their material."
    ),
}


def _words(strict: str, condition: str | None) -> dict[str, str]:
    """Say what is held apart, for `_VERDICTS`; `condition` is that which was held out."""
    if condition is None:
        return {
            "apart": _APART[strict],
            "together": "Recordings made together",
            "new": "new recordings",
            "what": "session",
        }
    other = f"another {condition}"
    return {
        "apart": other,
        "together": f"Recordings of one {condition}, or session,",
        "new": other,
        "what": condition,
    }


@dataclass(frozen=True)
class Side:
    """One of the two accuracies of a gap: of what protocol, and how sure."""

    protocol: str
    name: str
    accuracy: str
    spread: str


@dataclass(frozen=True)
class Gap:
    """The headline, the accuracies that a reader must see together, the strictest first, and what they mean.

    `kind` is "lost" where accuracy is lost, "unsure" where chance explains it, "kept" where it is less than a point,
    "unknown" where no equal numbers were drawn at random beside a strict protocol. `points` holds the difference and
    its unit.
    """

    kind: str
    headline: str
    sides: tuple[Side, ...]
    points: tuple[str, str]
    verdict: str
    remarks: tuple[str, ...]


def gap_of(result: Outcome, space: str) -> Gap:
    """Put the headline of one space into words, and its gap where equals were compared."""
    shown = [result.headline]
    if result.random not in (None, result.headline):
        shown.append(result.random)
    sides = tuple(_side(result, space, name) for name in shown)
    chosen: tuple[str, ...] = ()
    if (n_spaces := len(result.spaces)) > 1:
        how = "chosen by these same recordings: a little flattered by that"
        chosen = (f"the best of {n_spaces} feature spaces, {how}",)
    headline = f"{space} names {sides[0].accuracy} of recordings rightly with {sides[0].name}"
    if result.exceptions:
        headline += f" (but for {listed(list(result.exceptions))}: one session only)"
    gap = result.gap(space)
    if gap is None:
        return Gap("unknown", headline, sides, ("", ""), _no_gap(result, sides), chosen)
    strict, random = sides
    low, _ = result.interval(space, random.protocol)
    # Without an interval as all partitions are alike nothing excuses a gap; as they are too few, nothing proves one.
    few = len(result.partitions[random.protocol]) < MIN_PARTITIONS
    excused = few or result.mean_accuracy(space, strict.protocol) >= low
    kind = "kept" if gap < _NO_GAP else "unsure" if excused else "lost"
    headline += f", {random.accuracy} with {random.name}"
    words = _words(strict.name, result.held_out)
    verdict = _VERDICTS[kind].format(points=f"{100 * gap:.1f}", **words)
    change = f"{100 * gap:+.1f}".replace("-", "−")
    points = (change, "points at random") if change[1:] != "0.0" else ("no", "difference")
    remarks = tuple(f"{label}: {what}" for label, what in result.exceptions.items())
    return Gap(kind, headline, sides, points, verdict, (*remarks, *chosen))


def _side(result: Outcome, space: str, protocol: str) -> Side:
    values = result.accuracies(space, protocol)
    low, high = result.interval(space, protocol)
    if np.isfinite(low):
        spread = f"95 % interval {100 * low:.1f} to {100 * high:.1f} %, {counted(len(values), 'partition')}"
    elif len(values) == 1:
        spread = "one partition"
    elif len(values) == 2:
        spread = " and ".join(f"{100 * value:.1f} %" for value in values.tolist())
    else:
        spread = f"the same in each of {counted(len(values), 'partition')}"
    return Side(
        protocol, result.protocol_name(protocol), percent(result.mean_accuracy(space, protocol)), spread
    )


def _no_gap(result: Outcome, sides: tuple[Side, ...]) -> str:
    if len(sides) > 1:
        sizes = [_sizes(result, side) for side in sides]
        return f"No gap is given, as the numbers differ: {' and '.join(sizes)}."
    if result.strictest is not None:
        return (
            f"Only {sides[0].name} ran: nothing shows how much random draws would flatter these recordings."
        )
    return (
        f"Only {sides[0].name} ran: no protocol held out a session or a stretch of time. Recordings made together "
        "resemble each other in more than their material, so take this figure as the upper end of what to expect."
    )


def _sizes(result: Outcome, side: Side) -> str:
    """Say how many recordings of a class train and are tested."""
    train, test = (_span(sizes) for sizes in result.class_sizes(side.protocol))
    return f"{side.name} train on {train} recordings of a class and test {test}"


def _span(sizes: NDArray[np.float64]) -> str:
    low, high = round(float(sizes.min())), round(float(sizes.max()))
    return str(low) if low == high else f"{low} to {high}"


def gap_lines(result: Outcome) -> tuple[str, ...]:
    """Return the headline of the best space, and why there is no gap where two protocols ran."""
    found = gap_of(result, result.best_space(result.headline))
    return (found.headline, *((found.verdict,) if found.kind == "unknown" and len(found.sides) > 1 else ()))

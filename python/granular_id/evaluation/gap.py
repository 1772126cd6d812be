"""The gap between random draws and the strictest protocol, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from granular_id._text import counted, percent
from granular_id.evaluation.outcome import Outcome

_NO_GAP = 0.01  # less than a point is called no gap
_MOST_SPACES = 3
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
    """One of the two accuracies of a gap: of what protocol, and how sure."""

    protocol: str
    name: str
    accuracy: str
    spread: str


@dataclass(frozen=True)
class Gap:
    """The two accuracies that a reader must see together, and what they mean.

    `kind` is "lost" where accuracy is lost, "unsure" where chance explains it, "kept" where it is less than a point,
    "unknown" without a strict protocol beside random draws. `points` holds the difference and its unit.
    """

    kind: str
    headline: str
    sides: tuple[Side, ...]
    points: tuple[str, str]
    verdict: str
    remarks: tuple[str, ...]


def gap_of(result: Outcome, space: str) -> Gap:
    """Put the gap of one space into words."""
    shown = [name for name in (result.random, result.strictest) if name is not None]
    sides = tuple(_side(result, space, name) for name in shown or result.protocols[:1])
    chosen: tuple[str, ...] = ()
    if (n_spaces := len(result.spaces)) > 1:
        how = "chosen by these same recordings: a little flattered by that"
        chosen = (f"the best of {n_spaces} feature spaces, {how}",)
    gap = result.gap(space)
    if gap is None:
        headline = f"{space} names {sides[0].accuracy} of recordings rightly ({sides[0].name})"
        return Gap("unknown", headline, sides, ("", ""), _one_sided(result, sides[0]), chosen)
    random, strict = sides
    apart = _APART[strict.name]
    low, _ = result.interval(space, random.protocol)
    # Without an interval (all partitions alike) nothing excuses a gap.
    excused = result.mean_accuracy(space, strict.protocol) >= low
    kind = "kept" if gap < _NO_GAP else "unsure" if excused else "lost"
    but = {"lost": "but only", "unsure": "and", "kept": "and still"}[kind]
    headline = (
        f"{space} names {random.accuracy} of recordings rightly when training and test are drawn at random, "
        f"{but} {strict.accuracy} when they come from {apart}"
    )
    verdict = _VERDICTS[kind].format(points=f"{100 * gap:.1f}", apart=apart)
    remarks = [*_unequal_sizes(result)]
    best = result.best_space(strict.protocol)
    if best != space:
        accuracy = percent(result.mean_accuracy(best, strict.protocol))
        remarks.append(f"best with {strict.name}: {best}, {accuracy}")
    change = f"{-100 * gap:+.1f}".replace("-", "−")
    points = (change, "points") if change[1:] != "0.0" else ("no", "difference")
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


def _one_sided(result: Outcome, side: Side) -> str:
    if result.strictest is not None:
        return f"Only {side.name} ran: nothing shows how much random draws would flatter these recordings."
    return (
        f"Only {side.name} ran: no protocol held out a session or a stretch of time. Recordings made together "
        "resemble each other in more than their material, so take this figure as the upper end of what to expect."
    )


def _unequal_sizes(result: Outcome) -> tuple[str, ...]:
    """Say so where the two protocols of a gap train on different numbers of recordings; else nothing."""
    sizes = {}
    for protocol in filter(None, (result.random, result.strictest)):
        counts = [
            np.bincount(result.truth[p.train], minlength=len(result.labels))
            for p in result.partitions[protocol]
        ]
        low, high = int(np.min(counts)), int(np.max(counts))
        sizes[result.protocol_name(protocol)] = str(low) if low == high else f"{low} to {high}"
    if len(set(sizes.values())) < 2:
        return ()
    (random, more), (strictest, fewer) = sizes.items()
    return (
        f"{random} train on {more} recordings of each class, {strictest} on {fewer}: part of a gap may be that",
    )


def gap_lines(result: Outcome) -> tuple[str, ...]:
    """Return the headline of each space, of more than three only of the best of either protocol."""
    if result.random is None or result.strictest is None:
        return ()
    names = [space.name for space in result.spaces]
    if len(names) > _MOST_SPACES:
        names = list(dict.fromkeys((result.best_space(result.random), result.best_space(result.strictest))))
    return (
        *(gap_of(result, name).headline for name in names),
        *(f"({line})" for line in _unequal_sizes(result)),
    )

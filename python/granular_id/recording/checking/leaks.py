"""Label leaks: what gives the label away without a look at the forces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from granular_id._words import verb
from granular_id.recording.checking.attributes import Attribute, attributes_of
from granular_id.recording.checking.finding import Finding, first_names, found
from granular_id.recording.checking.labels import by_label
from granular_id.recording.checking.nearest import LEAST_P, Naming, naming
from granular_id.recording.checking.rest import Rest
from granular_id.recording.checking.timing import Pace
from granular_id.recording.one import Recording

FEWEST = 10
"""Fewer recordings say nothing: a leak of two labels would not stand out from chance."""

MOST = 5000
"""Larger sets are judged by this many recordings, drawn once: leaks worth a warning show in fewer."""

STRONG = 0.2
"""A leak warns when it names this part of the labels that chance leaves open."""

GIVEN_AWAY = 0.9
"""A single label is given away when its recordings and those like them agree to this part."""

# A leak that another one explains is not repeated: whoever knows the session knows the clock.
_EXPLAINED_BY = {
    "leak-clock": ("leak-session",),
    "leak-hour": ("leak-session", "leak-clock"),
}


def check_leaks(
    recordings: Sequence[Recording],
    paces: Sequence[Pace],
    rests: Sequence[Rest | None],
    resolutions: Sequence[tuple[float | None, ...]],
    false_alarm_rate: float,
    *,
    sessions_are_labels: bool,
) -> Iterator[Finding]:
    """Ask of every attribute how well it names the label by itself.

    An attribute leaks when the recording nearest in it has the same label far more often than by chance
    (`STRONG`), with a permutation p-value, corrected for the number of attributes, of at most
    `false_alarm_rate` (or the least there is); or when it sets a single label apart (`GIVEN_AWAY`).

    Parameters
    ----------
    sessions_are_labels : bool
        The finding ``session-is-label`` was made: session and clock need no finding of their own.
    """
    groups = by_label(recordings)
    chosen = _chosen([i for group in groups.values() if len(group) > 1 for i in group])
    labels = list(dict.fromkeys(recordings[i].label for i in chosen))
    if len(groups) > 1 and len(chosen) < FEWEST:
        message = (
            f"fewer than {FEWEST} recordings whose label has others: whether clock, length or session give labels away "
            "is not judged"
        )
        yield found("info", "few", message)
    if len(chosen) < FEWEST or len(labels) < 2:
        return
    judged = [recordings[i] for i in chosen]
    numbers = np.array([labels.index(r.label) for r in judged], dtype=np.intp)
    attributes = attributes_of(
        judged, [paces[i] for i in chosen], [rests[i] for i in chosen], [resolutions[i] for i in chosen]
    )
    if not attributes:
        return
    alpha = false_alarm_rate / (len(attributes) * len(labels))
    sizes = np.bincount(numbers)
    leaks: dict[str, dict[str, _Leak]] = {}
    for attribute, named in zip(attributes, naming([a.neighbours for a in attributes], numbers), strict=True):
        lift = (named.share - named.chance) / max(1 - named.chance, 1e-12)
        strong = lift >= STRONG and named.p <= max(false_alarm_rate, LEAST_P)
        apart = []
        if not attribute.neighbours.reverse:
            apart = [str(labels[k]) for k in _apart(named, sizes, 1.0 if strong else alpha)]
        if strong or apart:
            some = not strong or len(apart) < len(labels) / 2  # these labels leak, not all of them
            leak = _Leak(attribute, named, lift, apart if some else [])
            same = leaks.setdefault(attribute.code, {})
            same[attribute.name] = max(same.get(attribute.name, leak), leak, key=_Leak.weight)
    known = {"leak-session", *leaks} if sessions_are_labels else set(leaks)
    for code, members in leaks.items():
        if (code == "leak-session" and sessions_are_labels) or known & set(_EXPLAINED_BY.get(code, ())):
            continue
        yield _report(code, sorted(members.values(), key=_Leak.weight, reverse=True), judged)


@dataclass(frozen=True)
class _Leak:
    attribute: Attribute
    named: Naming
    lift: float
    apart: list[str]  # labels that are given away; none: all are, more or less

    def weight(self) -> tuple[bool, float]:
        return bool(self.apart), float(self.named.agreement.max()) if self.apart else self.lift


def _report(code: str, leaks: Sequence[_Leak], recordings: Sequence[Recording]) -> Finding:
    worst, *others = leaks
    message = _words(worst, recordings)
    if others:
        also = first_names([leak.attribute.name for leak in others])
        message += f"; so {verb(len(others), 'does', 'do')} {also}"
    names = [leak.attribute.name for leak in leaks]
    named = worst.named
    return found(
        "warning", code, message, attributes=names, share=named.share, chance=named.chance, p=named.p
    )


def _words(leak: _Leak, recordings: Sequence[Recording]) -> str:
    attribute, named = leak.attribute, leak.named
    if leak.apart:
        return _about_labels(attribute, leak.apart, recordings)
    share, chance = f"{100 * named.share:.0f} %", f"(chance {100 * named.chance:.0f} %)"
    if not attribute.neighbours.reverse:
        return (
            f"{attribute.name} alone names {share} of the labels {chance}{_why(attribute.code, recordings)}"
        )
    if named.share == 1:
        how = f"each label has only one of its {int(attribute.neighbours.group.max()) + 1} values"
    else:
        how = f"two recordings of a label agree in {share} {chance}"
    return f"{attribute.name} goes with the label: {how}"


def _chosen(places: Sequence[int]) -> list[int]:
    ordered = sorted(places)
    if len(ordered) <= MOST:
        return ordered
    return sorted(np.random.default_rng(0).choice(ordered, MOST, replace=False).tolist())


def _apart(named: Naming, sizes: NDArray[np.intp], alpha: float) -> list[int]:
    # neighbours are often mutual, so hits come in pairs: half of them are counted as independent
    by_chance = ((sizes - 1) / (sizes.sum() - 1)) ** (GIVEN_AWAY * sizes / 2)
    return [int(k) for k in np.flatnonzero((named.agreement >= GIVEN_AWAY) & (by_chance <= alpha))]


def _about_labels(attribute: Attribute, apart: Sequence[str], recordings: Sequence[Recording]) -> str:
    quoted = first_names([repr(label) for label in apart])
    message = f"{attribute.name} gives {quoted} away"
    if attribute.shown is None or len(apart) > 1 or attribute.code == "leak-clock":
        return message
    own = np.array([r.label == apart[0] for r in recordings])
    spans = [_span(attribute.shown[mask]) for mask in (own, ~own)]
    return f"{message}: {spans[0]} {attribute.unit}".rstrip() + f", others {spans[1]}"


def _span(values: NDArray[np.float64]) -> str:
    known = values[~np.isnan(values)]
    if not len(known):
        return "none"
    low, high = f"{known.min():.3g}", f"{known.max():.3g}"
    return low if low == high else f"{low} to {high}"


def _why(code: str, recordings: Sequence[Recording]) -> str:
    if code == "leak-session":
        return ": no session holds several of them; keep sessions whole when you evaluate"
    if code == "leak-rest":
        return ", before the tool moves: subtract it"
    if code == "leak-clock":
        return _stretches(recordings)
    return ""


def _stretches(recordings: Sequence[Recording]) -> str:
    started = [r for r in recordings if r.start_time is not None]
    order = sorted(started, key=lambda r: r.start_time or 0.0)
    runs = 1 + sum(a.label != b.label for a, b in pairwise(order))
    labels = {r.label for r in order}
    if runs == len(labels):
        return (
            ": each was recorded in one stretch of its own. That is one session per label: what a classifier "
            "learns may be the session, and no evaluation can tell"
        )
    shares = [sum(r.label == label for r in order) / len(order) for label in labels]
    expected = 1 + len(order) * (1 - sum(share**2 for share in shares))
    return f": they were recorded in {runs} stretches, where random order would make about {expected:.0f}"

"""Label leaks: what gives the label away without a look at the forces."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granular_id._checks import FloatArray
from granular_id._text import counted, verb
from granular_id.recording.checks.level import Rest
from granular_id.recording.checks.report import Finding, by_label, first_names, found
from granular_id.recording.checks.timing import Pace, is_number
from granular_id.recording.recording import Recording, SampleFlag

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


# How well one attribute names the label: the label of the nearest other recording, against shuffled labels.

N_SHUFFLES = 199

LEAST_P = 1 / (N_SHUFFLES + 1)
"""Smallest p-value that so many shuffles can give: 0.005."""


@dataclass(frozen=True)
class Neighbours:
    """Which recordings are nearest to each one.

    Attributes
    ----------
    group : ndarray of int, shape (n,)
        Recordings of the same value share a number; all the others of the group are nearest, equally.
    nearest : ndarray of int, shape (n,)
        The nearest recording of another value, for those alone in their group; -1: none.
    reverse : bool
        Ask how well the label names the group instead: two sensors cannot name eleven labels, but when each label
        was recorded with one of them, the label names the sensor.
    """

    group: NDArray[np.intp]
    nearest: NDArray[np.intp]
    reverse: bool = False

    @cached_property
    def has_ties(self) -> bool:
        """Whether any two recordings share a value."""
        return int(self.group.max()) + 1 < len(self.group)


def by_number(values: FloatArray) -> Neighbours:
    """Return the neighbours along a line; NaN (not known) is a value of its own, far from all others."""
    _, group, counts = np.unique(values, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    gap = np.concatenate([[np.inf], np.diff(ordered), [np.inf]])
    gap = np.where(np.isnan(gap), np.inf, gap)
    left, right = gap[:-1], gap[1:]
    place = np.arange(len(values))
    towards = np.where(left < right, place - 1, place + 1)
    alone = np.isinf(np.minimum(left, right))
    neighbour = order[np.clip(towards, 0, len(values) - 1)]
    nearest = np.empty(len(values), dtype=np.intp)
    nearest[order] = np.where(alone, -1, neighbour)
    nearest[counts[group] > 1] = -1
    return Neighbours(group, nearest)


def by_kind(values: Sequence[Hashable], *, reverse: bool = False) -> Neighbours:
    """Return the neighbours among values that are equal or not, with no order between them."""
    numbers: dict[Hashable, int] = {}
    group = np.array([numbers.setdefault(value, len(numbers)) for value in values], dtype=np.intp)
    return Neighbours(group, np.full(len(values), -1, dtype=np.intp), reverse)


def by_place(points: FloatArray) -> Neighbours:
    """Return the neighbours in a space of several numbers, each divided by its spread, shape (n, d)."""
    spread = points.std(axis=0)
    scaled = points / np.where(spread > 0, spread, 1.0)
    _, found = cKDTree(scaled).query(scaled, k=2)
    own = np.arange(len(points))
    nearest = np.where(found[:, 0] == own, found[:, 1], found[:, 0])
    return Neighbours(own, nearest.astype(np.intp))


@dataclass(frozen=True)
class Naming:
    """What an attribute says about the labels.

    Attributes
    ----------
    share : float
        How often the nearest other recording has the same label (the mean over ties); in reverse, how often
        another recording of the same label has the same value.
    chance : float
        What that is for shuffled labels.
    p : float
        How often the best of all attributes does as well with shuffled labels, relative to its own spread: the
        p-value, corrected for the number of attributes (P. H. Westfall and S. S. Young, "Resampling-Based
        Multiple Testing", 1993).
    agreement : ndarray, shape (n_labels,)
        For each label the harmonic mean of how many of its recordings, and how many of those nearest to them,
        are its own.
    """

    share: float
    chance: float
    p: float
    agreement: FloatArray


def naming(neighbours: Sequence[Neighbours], labels: NDArray[np.intp], seed: int = 0) -> list[Naming]:
    """Measure each attribute, correcting for their number.

    Parameters
    ----------
    neighbours : sequence of Neighbours
        One for each attribute.
    labels : ndarray of int, shape (n,)
        From 0.
    seed : int
        Of the shuffles: the same data give the same verdict.
    """
    rng = np.random.default_rng(seed)
    n_labels = int(labels.max()) + 1
    sizes = np.bincount(labels)
    hits = [_hits(each, labels, n_labels) for each in neighbours]
    shares = np.array([each.mean() for each in hits])
    shuffled = np.empty((N_SHUFFLES, len(neighbours)))
    for row in shuffled:
        mixed = rng.permutation(labels)
        row[:] = [_hits(each, mixed, n_labels).mean() for each in neighbours]
    spread = np.maximum(shuffled.std(axis=0), 1e-12)
    best = ((shuffled - shuffled.mean(axis=0)) / spread).max(axis=1)
    scores = (shares - shuffled.mean(axis=0)) / spread
    return [
        Naming(
            share=float(share),
            chance=_chance(each, labels),
            p=(1 + int((best >= score).sum())) / (N_SHUFFLES + 1),
            agreement=_agreement(each, own_hits, labels, sizes),
        )
        for share, score, each, own_hits in zip(shares, scores, neighbours, hits, strict=True)
    ]


def _chance(neighbours: Neighbours, labels: NDArray[np.intp]) -> float:
    n = len(labels)
    sizes = np.bincount(neighbours.group if neighbours.reverse else labels)
    alone = (np.bincount(neighbours.group)[neighbours.group] == 1) & (neighbours.nearest < 0)
    has_neighbour = 1.0 if neighbours.reverse else 1 - float(alone.mean())
    return has_neighbour * float((sizes * (sizes - 1)).sum()) / (n * (n - 1))


def _hits(neighbours: Neighbours, labels: NDArray[np.intp], n_labels: int) -> FloatArray:
    nearest = neighbours.nearest
    by_nearest = (nearest >= 0) & (labels[nearest] == labels)
    if not neighbours.has_ties:
        return np.asarray(by_nearest, dtype=np.float64)
    group = neighbours.group
    if neighbours.reverse:
        group, labels, n_labels = labels, group, int(group.max()) + 1
    cell = group * n_labels + labels
    alike = np.bincount(cell)[cell] - 1
    others = np.bincount(group)[group] - 1
    return np.asarray(np.where(others > 0, alike / np.maximum(others, 1), by_nearest))


def _agreement(
    neighbours: Neighbours, hits: FloatArray, labels: NDArray[np.intp], sizes: NDArray[np.intp]
) -> FloatArray:
    # within a group of ties each label is named as often as it occurs there
    tied = np.bincount(neighbours.group)[neighbours.group] > 1
    alone = ~tied & (neighbours.nearest >= 0)
    named = np.bincount(labels[tied], minlength=len(sizes)) + np.bincount(
        labels[neighbours.nearest[alone]], minlength=len(sizes)
    )
    own = np.bincount(labels, weights=hits, minlength=len(sizes))
    return np.asarray(2 * own / np.maximum(sizes + named, 1))


# What is known of recordings besides their forces: anything that could give the label away.

DESCRIBES_MATERIAL = "material"
"""Entries of ``meta`` under this key describe the material, and may well name it."""

MOST_KINDS = 20
"""Attributes of more values than this are not asked whether the label names them."""

_REPAIRS = SampleFlag.GAP_FILLED | SampleFlag.BAD_STATUS | SampleFlag.TIME_REPAIRED


@dataclass(frozen=True)
class Attribute:
    """One thing that is known of every recording.

    Attributes
    ----------
    code : str
        Code of the finding.
    name : str
        In words.
    neighbours : Neighbours
        Which recordings are alike in it.
    shown : ndarray or None
        Numbers to show where a single label stands apart, shape (n,), in `unit`.
    unit : str
    """

    code: str
    name: str
    neighbours: Neighbours
    shown: FloatArray | None = None
    unit: str = ""


def attributes_of(
    recordings: Sequence[Recording],
    paces: Sequence[Pace],
    rests: Sequence[Rest | None],
    resolutions: Sequence[tuple[float | None, ...]],
) -> list[Attribute]:
    """Collect what varies between recordings, apart from their samples and labels.

    Attributes of few values come twice: as what may name the label, and (``neighbours.reverse``) as what the
    label may name.
    """
    starts = np.array([np.nan if r.start_time is None else r.start_time for r in recordings])
    kinds: list[tuple[str, str, Sequence[Any]]] = [
        ("leak-session", "the session", [r.session for r in recordings]),
        ("leak-format", "the file's ending", [PurePosixPath(r.name).suffix.lower() for r in recordings]),
        ("leak-resolution", "the resolution", resolutions),
        ("leak-hour", "the hour of the day (UTC)", [None if np.isnan(s) else s // 3600 % 24 for s in starts]),
        ("leak-flags", "what was repaired (flags)", [_repairs(r) for r in recordings]),
    ]
    numbers: list[tuple[str, str, FloatArray, str]] = [
        ("leak-clock", "the clock", starts, "s"),
        ("leak-length", "the duration", np.array([r.duration_s for r in recordings]), "s"),
        (
            "leak-length",
            "the number of samples",
            np.array([float(r.n_samples) for r in recordings]),
            "samples",
        ),
        ("leak-rate", "the median step", np.array([1e3 * p.median_s for p in paces]), "ms"),
        ("leak-jitter", "the jitter of the steps", np.array([p.spread for p in paces]), "of the median step"),
        ("leak-trigger", "the time of the trigger", np.array([_trigger_s(r) for r in recordings]), "s"),
    ]
    for key, entries in scalar_meta(recordings).items():
        if all(v is None or is_number(v) for v in entries):
            column = np.array([np.nan if v is None else float(v) for v in entries])
            numbers.append(("leak-meta", f"meta {key!r}", column, ""))
        else:
            kinds.append(("leak-meta", f"meta {key!r}", entries))
    found = []
    for code, name, values in kinds:
        if len(set(values)) > 1:
            found.append(Attribute(code, name, by_kind(values)))
            found += _named_by_label(code, name, values)
    for code, name, column, unit in numbers:
        if len(np.unique(column)) > 1:
            found.append(Attribute(code, name, by_number(column), column, unit))
            found += _named_by_label(code, name, np.nan_to_num(column, nan=np.inf).tolist())
    return found + _rest_levels(recordings, rests)


def _rest_levels(recordings: Sequence[Recording], rests: Sequence[Rest | None]) -> list[Attribute]:
    levels = [rest.level for rest in rests if rest is not None]
    if len(levels) < len(recordings) or len({r.axes for r in recordings}) > 1:
        return []
    table = np.array(levels)
    each = [
        Attribute("leak-rest", f"the rest level of {axis}", by_number(column), column)
        for axis, column in zip(recordings[0].axes, table.T, strict=True)
        if len(np.unique(column)) > 1
    ]
    return [Attribute("leak-rest", "the rest level of all axes", by_place(table)), *each]


def _named_by_label(code: str, name: str, values: Sequence[Any]) -> list[Attribute]:
    if len(set(values)) > min(MOST_KINDS, len(values) // 2):
        return []
    return [Attribute(code, name, by_kind(values, reverse=True))]


def scalar_meta(recordings: Sequence[Recording]) -> dict[str, list[Any]]:
    """Return the entries of ``meta`` that are a text, number or bool, nested keys joined by dots.

    Left out are entries that describe the material (`DESCRIBES_MATERIAL`, at any depth), or in which every recording
    repeats its name or mentions its label.
    """
    flat = [_flat(r.meta) for r in recordings]
    keys = dict.fromkeys(key for entries in flat for key in entries)
    columns = {key: [entries.get(key) for entries in flat] for key in keys}
    return {
        key: values
        for key, values in columns.items()
        if DESCRIBES_MATERIAL not in key.split(".")
        and not all(_names(value, r) for value, r in zip(values, recordings, strict=True))
    }


def _names(value: Any, recording: Recording) -> bool:
    label = recording.label
    return value == recording.name or (label is not None and isinstance(value, str) and label in value)


def _flat(meta: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    entries: dict[str, Any] = {}
    for key, value in meta.items():
        if isinstance(value, Mapping):
            entries.update(_flat(value, f"{prefix}{key}."))
        elif isinstance(value, (str, int, float)):
            entries[prefix + key] = value
    return entries


def _repairs(recording: Recording) -> int:
    return 0 if recording.flags is None else int(np.bitwise_or.reduce(recording.flags) & _REPAIRS)


def _trigger_s(recording: Recording) -> float:
    if recording.trigger_index is None:
        return float("nan")
    return float(recording.times()[recording.trigger_index])


# Sessions: whether they are known, and whether a label can be told from its session.


def check_sessions(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Find recordings without a session, and labels that have one session only, each its own."""
    without = [i for i, r in enumerate(recordings) if r.session is None]
    if len(without) == len(recordings):
        message = "no recording says which session it is from: keep together what was recorded together"
        yield found("warning", "no-session", message)
        return
    if without:
        message = f"{len(without)} of {len(recordings)} recordings do not say which session they are from"
        yield found("warning", "some-sessions", message, recordings, without)
    groups = {
        label: frozenset({recordings[i].session for i in group} - {None})
        for label, group in by_label(recordings).items()
    }
    alone = [label for label, sessions in groups.items() if len(sessions) == 1]
    if len(groups) > 1 and len({groups[label] for label in alone}) > 1:
        message = (
            f"{len(alone)} of {len(groups)} labels have one session each: what a classifier learns may be the "
            "session, and no evaluation can tell"
        )
        yield found("warning", "session-is-label", message, labels=alone)


# Labels: whether there are some, enough, and as many recordings of each.


def check_labels(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Find recordings without a label, sets with nothing to tell apart, and labels of unequal size."""
    without = [i for i, r in enumerate(recordings) if r.label is None]
    if without:
        message = f"{counted(len(without))} {verb(len(without), 'has', 'have')} no label"
        yield found("error", "no-label", message, recordings, without)
    groups = by_label(recordings)
    if len(groups) == 1:
        only = next(iter(groups))
        yield found("error", "one-label", f"all recordings are {only!r}: nothing to tell apart")
    single = [label for label, group in groups.items() if len(group) == 1]
    if single and len(groups) > 1:
        message = f"{counted(len(single), 'label')} with one recording only: nothing is left to test with"
        yield found("warning", "single", message, recordings, [groups[label][0] for label in single])
    sizes = [len(group) for group in groups.values()]
    if len(set(sizes)) > 1:
        message = f"between {min(sizes)} and {max(sizes)} recordings per label"
        yield found("info", "uneven", message, fewest=min(sizes), most=max(sizes))


def check_axes(recordings: Sequence[Recording]) -> Iterator[Finding]:
    """Find recordings whose axes are not those of most."""
    kinds: dict[tuple[str, ...], list[int]] = {}
    for i, r in enumerate(recordings):
        kinds.setdefault(r.axes, []).append(i)
    if len(kinds) > 1:
        usual = max(kinds, key=lambda axes: len(kinds[axes]))
        other = sorted(i for axes, group in kinds.items() if axes != usual for i in group)
        message = f"{counted(len(other))} {verb(len(other), 'has', 'have')} other axes than {' '.join(usual)}"
        yield found("error", "axes-differ", message, recordings, other)

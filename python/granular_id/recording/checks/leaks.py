"""Leaks: what gives the label away without a look at the forces, and recordings that hold each other's samples."""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granular_id._checks import FloatArray
from granular_id._text import counted, verb
from granular_id.recording.checks.measured import Measured, is_number
from granular_id.recording.checks.report import Finding
from granular_id.recording.recording import Recording, SampleFlag, places_of
from granular_id.recording.report import first_names, span, subject
from granular_id.recording.steps import cut_from

FEWEST = 10  # fewer recordings say nothing: a leak of two labels would not stand out from chance
MOST = 5000  # larger sets are judged by this many recordings, drawn once: leaks worth a warning show in fewer
STRONG = 0.2  # a leak warns when it names this part of the labels that chance leaves open
GIVEN_AWAY = 0.9  # a single label is given away when its recordings and those like them agree to this part
# A leak that another one explains is not repeated: whoever knows the session knows the clock.
_EXPLAINED_BY = {"leak-clock": {"leak-session"}, "leak-hour": {"leak-session", "leak-clock"}}
_WHY = {
    "leak-session": ": no session holds several of them; keep sessions whole when you evaluate",
    "leak-rest": ", before the tool moves: subtract it",
}


def check_leaks(data: Measured) -> Iterator[Finding]:
    """Find attributes that name the label by themselves, or set a single one apart."""
    # Windows of one recording are no witnesses of each other: its first one stands for them.
    first = set({_cut_from(r, i): i for i, r in reversed(list(enumerate(data.recordings)))}.values())
    groups = [first.intersection(group) for group in data.labels.values()]
    places = sorted(i for group in groups if len(group) > 1 for i in group)
    if len(places) > MOST:
        places = sorted(np.random.default_rng(0).choice(places, MOST, replace=False).tolist())
    if len(data.labels) > 1 and len(places) < FEWEST:
        message = (
            f"fewer than {FEWEST} recordings whose label has others: whether clock, length or session give labels away "
            "is not judged"
        )
        yield data.finding("info", "few", message)
    recordings = [data.recordings[i] for i in places]
    labels = list(dict.fromkeys(r.label for r in recordings))
    if len(places) < FEWEST or len(labels) < 2:
        return
    numbers = np.array([labels.index(r.label) for r in recordings])
    leaks: dict[str, list[_Leak]] = {}
    for leak in _leaks(_attributes(data, places), numbers, data.false_alarm_rate):
        leaks.setdefault(leak.attribute.code, []).append(leak)
    known = set(leaks)
    if data.labels_of_one_session:  # a finding of its own
        known.add("leak-session")
        leaks.pop("leak-session", None)
    for code, members in leaks.items():
        if known & _EXPLAINED_BY.get(code, set()):
            continue
        members.sort(key=_Leak.weight, reverse=True)
        worst, names = members[0], list(dict.fromkeys(leak.attribute.name for leak in members))
        message = _leak_in_words(worst, recordings, [str(labels[k]) for k in worst.apart])
        if len(names) > 1:
            message += f"; so {verb(len(names) - 1, 'does', 'do')} {first_names(names[1:])}"
        share, chance, p, _ = worst.naming
        yield data.finding("warning", code, message, attributes=names, share=share, chance=chance, p=p)


def _cut_from(recording: Recording, place: int) -> object:
    """Return the recording that a window was cut from; what is no window is its own."""
    window = cut_from(recording)
    return place if window is None else window[0]


class _Leak(NamedTuple):
    attribute: Attribute
    naming: Naming
    apart: list[int]  # labels that are given away; none: all are, more or less

    def weight(self) -> tuple[bool, float]:
        return bool(self.apart), float(self.naming.agreement.max()) if self.apart else self.naming.lift


def _leaks(
    attributes: Sequence[Attribute], labels: NDArray[np.intp], false_alarm_rate: float
) -> Iterator[_Leak]:
    sizes = np.bincount(labels)
    alpha = false_alarm_rate / max(len(attributes) * len(sizes), 1)
    named = naming([attribute.neighbours for attribute in attributes], labels)
    for attribute, each in zip(attributes, named, strict=True):
        strong = each.lift >= STRONG and each.p <= max(false_alarm_rate, LEAST_P)
        apart: list[int] = []
        if not attribute.neighbours.reverse:
            # neighbours are often mutual, so hits come in pairs: half of them are counted as independent
            by_chance = ((sizes - 1) / (sizes.sum() - 1)) ** (GIVEN_AWAY * sizes / 2)
            given_away = (each.agreement >= GIVEN_AWAY) & (by_chance <= (1.0 if strong else alpha))
            apart = np.flatnonzero(given_away).tolist()
        if strong and len(apart) >= len(sizes) / 2:  # all labels leak, not these
            apart = []
        if strong or apart:
            yield _Leak(attribute, each, apart)


def _leak_in_words(leak: _Leak, recordings: Sequence[Recording], apart: Sequence[str]) -> str:
    attribute, neighbours = leak.attribute, leak.attribute.neighbours
    name, code = attribute.name, attribute.code
    if apart:
        message = f"{name} gives {first_names([repr(label) for label in apart])} away"
        if attribute.shown is None or len(apart) > 1 or code == "leak-clock":
            return message
        own = np.array([r.label == apart[0] for r in recordings])
        spans = [_span(attribute.shown[mask]) for mask in (own, ~own)]
        return f"{message}: {spans[0]} {attribute.unit}".rstrip() + f", others {spans[1]}"
    share = f"{100 * leak.naming.share:.0f} %"
    chance = f"(chance {100 * leak.naming.chance:.0f} %)"
    if neighbours.reverse and leak.naming.share == 1:
        return (
            f"{name} goes with the label: each label has only one of its {neighbours.group.max() + 1} values"
        )
    if neighbours.reverse:
        return f"{name} goes with the label: two recordings of a label agree in {share} {chance}"
    why = _stretches(recordings) if code == "leak-clock" else _WHY.get(code, "")
    return f"{name} alone names {share} of the labels {chance}{why}"


def _span(values: FloatArray) -> str:
    known = values[~np.isnan(values)]
    return span(known.min(), known.max(), 3) if len(known) else "none"


def _stretches(recordings: Sequence[Recording]) -> str:
    started = [(r.start_time, r.label) for r in recordings if r.start_time is not None]
    order = [label for _, label in sorted(started, key=lambda start: start[0])]
    runs = 1 + sum(a != b for a, b in pairwise(order))
    labels = set(order)
    if runs == len(labels):
        return (
            ": each was recorded in one stretch of its own. That is one session per label: what a classifier "
            "learns may be the session, and no evaluation can tell"
        )
    expected = 1 + len(order) * (1 - sum((order.count(label) / len(order)) ** 2 for label in labels))
    return f": they were recorded in {runs} stretches, where random order would make about {expected:.0f}"


# How well one attribute names the label: the label of the nearest other recording, against shuffled labels.

N_SHUFFLES = 199
LEAST_P = 1 / (N_SHUFFLES + 1)  # smallest p-value that so many shuffles can give: 0.005


@dataclass(frozen=True)
class Neighbours:
    """Which recordings are nearest to each one, shape (n,).

    `reverse` asks how well the label names the group instead: two sensors cannot name eleven labels, but when each
    label was recorded with one of them, the label names the sensor.
    """

    group: NDArray[np.intp]  # a number per value; all the others of a group are nearest, equally
    nearest: NDArray[np.intp]  # of those alone in their group the nearest of another value; -1: none
    reverse: bool = False

    @cached_property
    def has_ties(self) -> bool:
        """Whether any two recordings share a value."""
        return int(self.group.max()) + 1 < len(self.group)


def by_number(values: FloatArray) -> Neighbours:
    """Return the neighbours along a line; NaN (not known) is a value of its own, far from all others."""
    _, group, counts = np.unique(values, return_inverse=True, return_counts=True)
    order = np.argsort(values, kind="stable")
    gap = np.concatenate([[np.inf], np.diff(values[order]), [np.inf]])
    gap = np.where(np.isnan(gap), np.inf, gap)
    left, right = gap[:-1], gap[1:]
    place = np.arange(len(values))
    towards = np.clip(np.where(left < right, place - 1, place + 1), 0, len(values) - 1)
    nearest = np.empty(len(values), dtype=np.intp)
    nearest[order] = np.where(np.isinf(np.minimum(left, right)), -1, order[towards])
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
    return Neighbours(own, np.where(found[:, 0] == own, found[:, 1], found[:, 0]))


class Naming(NamedTuple):
    """What an attribute says about the labels."""

    share: float  # of the nearest other recordings have the same label; in reverse, a label the same value
    chance: float  # what that is for shuffled labels
    p: float  # how often the best of all attributes does as well with shuffled labels
    agreement: FloatArray  # per label: harmonic mean of what its recordings, and their nearest, share with it

    @property
    def lift(self) -> float:
        """Share of the way from chance to certainty."""
        return (self.share - self.chance) / max(1 - self.chance, 1e-12)


def naming(neighbours: Sequence[Neighbours], labels: NDArray[np.intp]) -> list[Naming]:
    """Measure each attribute; labels are numbers from 0, shape (n,).

    A p-value compares with the best of all attributes, each relative to its own spread, and so is corrected for their
    number (P. H. Westfall and S. S. Young, "Resampling-Based Multiple Testing", 1993).
    """
    rng = np.random.default_rng(0)  # the same data give the same verdict
    sizes = np.bincount(labels)
    hits = [_hits(each, labels, len(sizes)) for each in neighbours]
    shares = np.array([each.mean() for each in hits])
    shuffled = np.empty((N_SHUFFLES, len(neighbours)))
    for row in shuffled:
        mixed = rng.permutation(labels)
        row[:] = [_hits(each, mixed, len(sizes)).mean() for each in neighbours]
    spread = np.maximum(shuffled.std(axis=0), 1e-12)
    best = ((shuffled - shuffled.mean(axis=0)) / spread).max(axis=1, initial=-np.inf)
    scores = (shares - shuffled.mean(axis=0)) / spread
    return [
        Naming(
            share=float(share),
            chance=_chance(each, sizes),
            p=(1 + int((best >= score).sum())) / (N_SHUFFLES + 1),
            agreement=_agreement(each, own_hits, labels, sizes),
        )
        for share, score, each, own_hits in zip(shares, scores, neighbours, hits, strict=True)
    ]


def _chance(neighbours: Neighbours, sizes: NDArray[np.intp]) -> float:
    n = len(neighbours.group)
    groups = np.bincount(neighbours.group)
    has_neighbour = 1.0
    if neighbours.reverse:
        sizes = groups
    else:
        has_neighbour -= float(((groups[neighbours.group] == 1) & (neighbours.nearest < 0)).mean())
    return has_neighbour * float((sizes * (sizes - 1)).sum()) / (n * (n - 1))


def _hits(neighbours: Neighbours, labels: NDArray[np.intp], n_labels: int) -> FloatArray:
    """Return how many of the nearest, of 1, have the label of each recording."""
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
    named = np.bincount(
        np.concatenate([labels[tied], labels[neighbours.nearest[alone]]]), minlength=len(sizes)
    )
    own = np.bincount(labels, weights=hits, minlength=len(sizes))
    return np.asarray(2 * own / np.maximum(sizes + named, 1))


# What is known of recordings besides their forces: anything that could give the label away.

OF_SAMPLES = (
    "answer."  # what was answered live stands below: it follows from the samples, and gives nothing else away
)
DESCRIBES_MATERIAL = "material"  # entries of ``meta`` under this key, at any depth, may well name it
MOST_KINDS = 20  # attributes of more values than this are not asked whether the label names them
_REPAIRS = SampleFlag.GAP_FILLED | SampleFlag.BAD_STATUS | SampleFlag.TIME_REPAIRED


class Attribute(NamedTuple):
    """One thing that is known of every recording, named by the code of its finding and in words."""

    code: str
    name: str
    neighbours: Neighbours
    shown: FloatArray | None = None  # numbers to show where a single label stands apart, in `unit`
    unit: str = ""


def _attributes(data: Measured, places: Sequence[int]) -> list[Attribute]:
    """Collect what varies between recordings; of few values, also as what the label may name."""
    recordings = [data.recordings[i] for i in places]
    paces = [data.paces[i] for i in places]
    starts = [_or_nan(r.start_time) for r in recordings]
    triggers = [np.nan if (t := r.trigger_index) is None else r.times()[t] for r in recordings]
    repairs = [0 if r.flags is None else int(np.bitwise_or.reduce(r.flags) & _REPAIRS) for r in recordings]
    hours = [None if np.isnan(start) else start // 3600 % 24 for start in starts]
    endings = [PurePosixPath(r.name).suffix.lower() for r in recordings]
    # code of the finding, name, values, and the unit of numbers; None: values that are equal or not
    known: list[tuple[str, str, Sequence[Any], str | None]] = [
        ("leak-session", "the session", [r.session for r in recordings], None),
        ("leak-format", "the file's ending", endings, None),
        ("leak-resolution", "the resolution", [data.resolutions[i] for i in places], None),
        ("leak-hour", "the hour of the day (UTC)", hours, None),
        ("leak-flags", "what was repaired (flags)", repairs, None),
        ("leak-clock", "the clock", starts, "s"),
        ("leak-length", "the duration", [r.duration_s for r in recordings], "s"),
        ("leak-length", "the number of samples", [r.n_samples for r in recordings], "samples"),
        ("leak-rate", "the median step", [1e3 * p.median_s for p in paces], "ms"),
        ("leak-jitter", "the jitter of the steps", [p.spread for p in paces], "of the median step"),
        ("leak-trigger", "the time of the trigger", triggers, "s"),
    ]
    for key, entries in _scalar_meta(recordings).items():
        if all(v is None or is_number(v) for v in entries):
            known.append(("leak-meta", f"meta {key!r}", [_or_nan(v) for v in entries], ""))
        else:
            known.append(("leak-meta", f"meta {key!r}", entries, None))
    known.sort(key=lambda row: row[3] is not None)  # of leaks as strong the plainer ones come first
    most = min(MOST_KINDS, len(recordings) // 2)
    found = []
    for code, name, values, unit in known:
        column = None if unit is None else np.array(values, dtype=np.float64)
        named = values if column is None else np.nan_to_num(column, nan=np.inf).tolist()
        n_values = len(set(named))
        if n_values > 1:
            neighbours = by_kind(named) if column is None else by_number(column)
            found.append(Attribute(code, name, neighbours, column, unit or ""))
        if 1 < n_values <= most:
            found.append(Attribute(code, name, by_kind(named, reverse=True)))
    levels = [rest.level for i in places if (rest := data.rests[i]) is not None]
    if len(levels) == len(places) and len({r.axes for r in recordings}) == 1:
        table = np.array(levels)
        found.append(Attribute("leak-rest", "the rest level of all axes", by_place(table)))
        for axis, column in zip(recordings[0].axes, table.T, strict=True):
            if len(np.unique(column)) > 1:
                found.append(Attribute("leak-rest", f"the rest level of {axis}", by_number(column), column))
    return found


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else float(value)


def _scalar_meta(recordings: Sequence[Recording]) -> dict[str, list[Any]]:
    """Return the plain entries of ``meta``; without answers, what describes the material, or repeats name or label."""
    flat = [dict(_flat(r.meta)) for r in recordings]
    keys = dict.fromkeys(key for entries in flat for key in entries)
    columns = {key: [entries.get(key) for entries in flat] for key in keys}
    return {
        key: values
        for key, values in columns.items()
        if DESCRIBES_MATERIAL not in key.split(".")
        and not key.startswith(OF_SAMPLES)
        and not all(
            value == r.name or (isinstance(value, str) and str(r.label) in value)
            for value, r in zip(values, recordings, strict=True)
        )
    }


def _flat(meta: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in meta.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        elif isinstance(value, (str, int, float)):
            yield prefix + key, value


# Recordings that hold the samples of another one: all of them, or a stretch.

LEAST_SHARE = 0.1
"""Pairs are reported where at least this part of the shorter recording's rows is in the other one."""

_RUN = 8
"""Rows that agree one behind the other count as shared; fewer of a coarse sensor agree by chance."""

_MOST_RUNS = 500_000
"""Of more runs some are compared, chosen by their values: recordings that share samples have the same ones."""

_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio: spreads the bits of a key


def check_duplicates(data: Measured) -> Iterator[Finding]:
    """Find equal recordings by a hash of their bytes, then shared stretches among the rest."""
    recordings = data.recordings
    equal = places_of(
        hashlib.blake2b(r.wrench.tobytes() + repr(r.wrench.shape).encode()).digest() for r in recordings
    ).values()
    pairs: list[list[Any]] = [[first, i] for first, *others in equal for i in others]
    pairs.sort(key=lambda pair: pair[1])
    if pairs:
        message = f"{subject(len(pairs), 'holds', 'hold')} exactly the samples of another one"
        yield _copies(data, "duplicates", message, pairs)
    distinct = [first for first, *_ in equal]
    overlaps = [
        overlap
        for overlap in find_overlaps([recordings[i] for i in distinct])
        if len({_cut_from(recordings[i], i) for i in (distinct[k] for k in overlap[:2])}) > 1
    ]
    if overlaps:
        most = max(overlaps, key=lambda o: o.share)
        message = (
            f"{counted(len(overlaps), 'pair')} of recordings {verb(len(overlaps), 'shares', 'share')} samples: "
            f"{_overlap_in_words(most, *(recordings[distinct[i]].name for i in most[:2]))}"
        )
        pairs = [[distinct[o.first], distinct[o.second], o.shift, round(o.share, 4)] for o in overlaps]
        yield _copies(data, "near-duplicates", message, pairs)


def _copies(data: Measured, code: str, message: str, pairs: Sequence[Sequence[Any]]) -> Finding:
    if any(data.recordings[i].label != data.recordings[j].label for i, j, *_ in pairs):
        message += ", some under a different label"
    return data.finding("error", code, message, sorted({i for pair in pairs for i in pair[:2]}), pairs=pairs)


class Overlap(NamedTuple):
    """Rows that two recordings share, to the bit."""

    first: int
    second: int
    shift: int  # row t of the second is row t + shift of the first
    share: float  # shared rows, of all rows of the shorter recording


def _overlap_in_words(overlap: Overlap, one: str, other: str) -> str:
    if overlap.shift < 0:
        one, other = other, one
    later = f", {counted(abs(overlap.shift), 'sample')} later" if overlap.shift else ""
    return f"{100 * overlap.share:.0f} % of the shorter of {one!r} and {other!r} are the same{later}"


def find_overlaps(recordings: Sequence[Recording]) -> list[Overlap]:
    """Find pairs of recordings of the same axes that share at least a tenth of their rows, in runs of 8 or more.

    Sorting all runs by their values brings shared ones together, so that time grows with the number of samples, not of
    pairs; of copies of copies every one is found, though not every pair.
    """
    best: dict[tuple[int, int], Overlap] = {}
    for group in places_of(r.axes for r in recordings).values():
        wrenches = [recordings[i].wrench for i in group]
        for a, b, shift in _same_runs(wrenches):
            share = _shared(wrenches[a], wrenches[b], shift)
            pair = (group[a], group[b])
            if share >= LEAST_SHARE and (pair not in best or share > best[pair].share):
                best[pair] = Overlap(*pair, shift, share)
    return list(best.values())


def _same_runs(wrenches: Sequence[FloatArray]) -> list[tuple[int, int, int]]:
    """Return pairs that agree in several runs at one shift: first, second, shift."""
    one_in = np.uint64(max(1, sum(map(len, wrenches)) // _MOST_RUNS))
    runs = [_runs(wrench, one_in) for wrench in wrenches]
    key, place = (np.concatenate(parts) for parts in zip(*runs, strict=True))
    owner = np.repeat(np.arange(len(wrenches)), [len(keys) for keys, _ in runs])
    order = np.lexsort((owner, key))
    key, owner, place = key[order], owner[order], place[order]
    same = np.flatnonzero((key[1:] == key[:-1]) & (owner[1:] != owner[:-1]))
    links = np.column_stack([owner[same], owner[same + 1], place[same] - place[same + 1]])
    kinds, counts = np.unique(links, axis=0, return_counts=True)
    return [(int(a), int(b), int(shift)) for a, b, shift in kinds[counts > 1]]


def _runs(wrench: FloatArray, one_in: np.uint64) -> tuple[NDArray[np.uint64], NDArray[np.intp]]:
    """Return a key of the values of each run in which they change, and the row at which it begins."""
    n_runs = max(len(wrench) - _RUN + 1, 0)
    bits = np.ascontiguousarray(wrench + 0.0).view(np.uint64)  # + 0.0: -0.0 is 0.0
    row = np.zeros(len(wrench), np.uint64)
    for column in bits.T:
        row = (row ^ column) * _MIX
        row ^= row >> np.uint64(32)
    key = np.zeros(n_runs, np.uint64)
    changes = np.zeros(n_runs, np.uint8)
    for j in range(_RUN):
        key = key * _MIX + row[j : j + n_runs]
        if j:
            changes += row[j : j + n_runs] != row[j - 1 : j - 1 + n_runs]
    at = np.flatnonzero((changes > 1) & ((key * _MIX >> np.uint64(32)) % one_in == 0))
    return key[at], at


def _shared(one: FloatArray, other: FloatArray, shift: int) -> float:
    """Return how many rows agree at a shift in runs, as a share of the shorter recording."""
    left, right = one[max(shift, 0) :], other[max(-shift, 0) :]
    n_rows = min(len(left), len(right))
    same = (left[:n_rows] == right[:n_rows]).all(axis=1)
    ends = np.flatnonzero(np.diff(same, prepend=False, append=False))
    lengths = ends[1::2] - ends[::2]
    return float(lengths[lengths >= _RUN].sum()) / min(len(one), len(other))

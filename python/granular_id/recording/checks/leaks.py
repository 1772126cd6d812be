"""Leaks: what gives the label away without a look at the forces."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from pathlib import PurePosixPath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granular_id._checks import FloatArray
from granular_id._text import verb
from granular_id.recording.checks.measured import Measured, is_number
from granular_id.recording.checks.report import Finding
from granular_id.recording.recording import Recording, SampleFlag, single_values
from granular_id.recording.report import first_names
from granular_id.recording.steps import recordings_cut

FEWEST = 10  # fewer recordings say nothing: a leak of two labels would not stand out from chance
MOST = 5000  # larger sets are judged by this many recordings, drawn once: leaks worth a warning show in fewer
STRONG = 0.2  # a leak warns when it names this part of the labels that chance leaves open
GIVEN_AWAY = 0.9  # a single label is given away when its recordings and those like them agree to this part
N_SHUFFLES = 999
LEAST_P = 1 / (N_SHUFFLES + 1)  # smallest p-value that so many shuffles can give: 0.001
# A leak that another one explains is not repeated: whoever knows the session knows the clock.
_EXPLAINED_BY = {"leak-clock": {"leak-session"}, "leak-hour": {"leak-session", "leak-clock"}}
_WHY = {
    "leak-session": ": no session holds several of them; keep sessions whole when you evaluate",
    "leak-clock": (
        ": what was recorded one after the other is like one session per label, and no evaluation can tell a label "
        "from its time; record the labels in turn"
    ),
    "leak-rest": ", before the tool moves: subtract it",
}


def check_leaks(data: Measured) -> Iterator[Finding]:
    """Find attributes that name the label by themselves, or that the label names.

    A recording is given the label of the one nearest to it in an attribute; how often that is right is compared with
    shuffled labels, and with the best of all attributes (P. H. Westfall and S. S. Young, "Resampling-Based Multiple
    Testing", 1993).
    """
    # Windows of one recording are no witnesses of each other: its first one stands for them.
    first = set(np.unique(recordings_cut(data.recordings), return_index=True)[1].tolist())
    groups = [first.intersection(group) for group in data.labels.values()]
    places = sorted(i for group in groups if len(group) > 1 for i in group)
    rng = np.random.default_rng(0)  # the same data give the same verdict
    if len(places) > MOST:
        places = sorted(rng.choice(places, MOST, replace=False).tolist())
    if len(data.labels) > 1 and len(places) < FEWEST:
        message = (
            f"fewer than {FEWEST} recordings whose label has others: whether clock, length or session give labels away "
            "is not judged"
        )
        yield data.finding("info", "few", message)
    names = [data.recordings[i].label for i in places]
    labels = _numbers(names)
    if len(places) < FEWEST or labels.max() < 1:
        return
    leaks: dict[str, list[_Leak]] = {}
    attributes = list(_attributes(data, places, labels, rng))
    alpha = data.false_alarm_rate / max(1, len(attributes) * len(data.labels))
    for leak in _leaks(attributes, rng):
        is_strong = leak.lift >= STRONG and leak.p <= max(data.false_alarm_rate, LEAST_P)
        apart = [] if is_strong else _given_away(leak.attribute, alpha)
        if is_strong or apart:
            shown = [str(names[labels.tolist().index(k)]) for k in apart]
            leaks.setdefault(leak.attribute.code, []).append(leak._replace(apart=shown))
    known = set(leaks)
    if data.labels_of_one_session:  # a finding of its own
        known.add("leak-session")
        leaks.pop("leak-session", None)
    for code, members in leaks.items():
        if known & _EXPLAINED_BY.get(code, set()):
            continue
        members.sort(key=lambda leak: leak.lift, reverse=True)
        worst, also = members[0], list(dict.fromkeys(leak.attribute.name for leak in members))
        message = worst.message()
        if len(also) > 1:
            message += f"; so {verb(len(also) - 1, 'does', 'do')} {first_names(also[1:])}"
        yield data.finding(
            "warning", code, message, attributes=also, share=worst.share, chance=worst.chance, p=worst.p
        )


class _Attribute(NamedTuple):
    """One thing that is known of every recording, named by the code of its finding and in words."""

    code: str
    name: str
    nearest: NDArray[np.intp]  # place of the recording that is nearest in it; -1: none
    target: NDArray[np.intp]  # what that recording should share: the label
    n_values: int = (
        0  # two sensors cannot name eleven labels: nearest is one of the label, and shares this attribute
    )


class _Leak(NamedTuple):
    attribute: _Attribute
    share: float  # of the nearest have the same label, or the label's recordings the same value
    chance: float  # what that is for shuffled ones
    p: float  # how often the best of all attributes does as well with shuffled ones
    apart: Sequence[str] = ()  # labels that are given away, though not all are

    @property
    def lift(self) -> float:
        """Share of the way from chance to certainty."""
        return (self.share - self.chance) / max(1 - self.chance, 1e-12)

    def message(self) -> str:
        """Say in words what gives what away."""
        code, name, *_, n_values = self.attribute
        if self.apart:
            return f"{name} gives {first_names([repr(label) for label in self.apart])} away"
        share, chance = f"{100 * self.share:.0f} %", f"(chance {100 * self.chance:.0f} %)"
        if not n_values:
            return f"{name} alone names {share} of the labels {chance}{_WHY.get(code, '')}"
        if self.share == 1:
            return f"{name} goes with the label: each label has only one of its {n_values} values"
        return f"{name} goes with the label: two recordings of a label agree in {share} {chance}"


def _leaks(attributes: Sequence[_Attribute], rng: np.random.Generator) -> Iterator[_Leak]:
    if not attributes:
        return
    n = len(attributes[0].target)
    orders = [np.arange(n), *(rng.permutation(n) for _ in range(N_SHUFFLES))]
    shares = np.array([[_share(one, order) for one in attributes] for order in orders])
    shuffled = shares[1:]
    chance, spread = shuffled.mean(axis=0), np.maximum(shuffled.std(axis=0), 1e-12)
    scores = (shares - chance) / spread
    best = scores[1:].max(axis=1)
    for k, attribute in enumerate(attributes):
        p = (1 + int((best >= scores[0, k]).sum())) / (N_SHUFFLES + 1)
        yield _Leak(attribute, float(shares[0, k]), float(chance[k]), p)


def _given_away(attribute: _Attribute, alpha: float) -> list[int]:
    """Return the labels whose recordings are nearest to each other, and to no other."""
    if attribute.n_values:
        return []
    labels, sizes = attribute.target, np.bincount(attribute.target)
    nearest = np.where(attribute.nearest < 0, len(labels), attribute.nearest)
    named = np.append(labels, len(sizes))[nearest]
    hits = np.bincount(labels[named == labels], minlength=len(sizes))
    agreement = 2 * hits / (sizes + np.bincount(named, minlength=len(sizes) + 1)[:-1])
    # neighbours are often mutual, so hits come in pairs: half of them are counted as independent
    by_chance = ((sizes - 1) / (sizes.sum() - 1)) ** (GIVEN_AWAY * sizes / 2)
    apart: list[int] = np.flatnonzero((agreement >= GIVEN_AWAY) & (by_chance <= alpha)).tolist()
    return apart


def _share(attribute: _Attribute, order: NDArray[np.intp]) -> float:
    target, nearest = attribute.target[order], attribute.nearest
    return float(((target[nearest] == target) & (nearest >= 0)).mean())


def nearest_on_a_line(values: FloatArray, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return the place of the nearest other value, ties drawn; NaN (not known) is far from all but NaN; -1: none."""
    order = np.lexsort((rng.random(len(values)), values))
    ascending = values[order]
    unknown = np.isnan(ascending)
    gap = np.where(unknown[1:] & unknown[:-1], 0.0, np.diff(ascending))
    gap = np.concatenate([[np.inf], np.where(np.isnan(gap), np.inf, gap), [np.inf]])
    left, right = gap[:-1], gap[1:]
    before = np.where(left == right, rng.random(len(values)) < 0.5, left < right)
    towards = np.arange(len(values)) + np.where(before, -1, 1)
    nearest = np.empty(len(values), np.intp)
    nearest[order] = np.where(np.isinf(np.minimum(left, right)), -1, order[towards.clip(0, len(values) - 1)])
    return nearest


def _nearest_alike(kinds: NDArray[np.intp], rng: np.random.Generator) -> NDArray[np.intp]:
    """Return the place of another recording of the same kind, drawn; -1: none."""
    nearest = nearest_on_a_line(kinds.astype(np.float64), rng)
    return np.where(kinds[nearest] == kinds, nearest, -1)


def _nearest_in_space(points: FloatArray) -> NDArray[np.intp]:
    """Return the place of the nearest other point, each number divided by its spread, shape (n, d)."""
    spread = points.std(axis=0)
    scaled = points / np.where(spread > 0, spread, 1.0)
    _, found = cKDTree(scaled).query(scaled, k=2)
    return np.asarray(np.where(found[:, 0] == np.arange(len(points)), found[:, 1], found[:, 0]))


def _numbers(values: Sequence[Hashable]) -> NDArray[np.intp]:
    """Return a number per value, equal ones the same."""
    numbers: dict[Hashable, int] = {}
    return np.array([numbers.setdefault(value, len(numbers)) for value in values], dtype=np.intp)


# What is known of recordings besides their forces: anything that could give the label away.

OF_SAMPLES = (
    "answer."  # what was answered live stands below: it follows from the samples, and gives nothing else away
)
DESCRIBES_MATERIAL = "material"  # entries of ``meta`` under this key, at any depth, may well name it
MOST_KINDS = 20  # attributes of more values than this are not asked whether the label names them
_REPAIRS = SampleFlag.GAP_FILLED | SampleFlag.BAD_STATUS | SampleFlag.TIME_REPAIRED


def _attributes(
    data: Measured, places: Sequence[int], labels: NDArray[np.intp], rng: np.random.Generator
) -> Iterator[_Attribute]:
    """Collect what varies between recordings; of few values, also as what the label may name."""
    recordings = [data.recordings[i] for i in places]
    paces = [data.paces[i] for i in places]
    starts = [_or_nan(r.start_time) for r in recordings]
    triggers = [np.nan if (t := r.trigger_index) is None else r.times()[t] for r in recordings]
    repairs = [0 if r.flags is None else int(np.bitwise_or.reduce(r.flags) & _REPAIRS) for r in recordings]
    hours = [None if np.isnan(start) else start // 3600 % 24 for start in starts]
    endings = [PurePosixPath(r.name).suffix.lower() for r in recordings]
    # code of the finding, name, values, and whether they lie on a line or are equal or not
    known: list[tuple[str, str, Sequence[Any], bool]] = [
        ("leak-session", "the session", [r.session for r in recordings], False),
        ("leak-format", "the file's ending", endings, False),
        ("leak-hour", "the hour of the day (UTC)", hours, False),
        ("leak-flags", "what was repaired (flags)", repairs, False),
        ("leak-clock", "the clock", starts, True),
        ("leak-length", "the duration", [r.duration_s for r in recordings], True),
        ("leak-length", "the number of samples", [r.n_samples for r in recordings], True),
        ("leak-rate", "the median step", [p.median_s for p in paces], True),
        ("leak-jitter", "the jitter of the steps", [p.spread for p in paces], True),
        ("leak-trigger", "the time of the trigger", triggers, True),
    ]
    for key, entries in _scalar_meta(recordings).items():
        numbers = all(v is None or is_number(v) for v in entries)
        known.append(
            ("leak-meta", f"meta {key!r}", [_or_nan(v) for v in entries] if numbers else entries, numbers)
        )
    for code, name, values, on_a_line in known:
        column = np.array(values, dtype=np.float64) if on_a_line else None
        kinds = _numbers(values if column is None else np.nan_to_num(column, nan=np.inf).tolist())
        n_values = int(kinds.max()) + 1
        if n_values == 1:
            continue
        nearest = _nearest_alike(kinds, rng) if column is None else nearest_on_a_line(column, rng)
        yield _Attribute(code, name, nearest, labels)
        if n_values <= min(MOST_KINDS, len(recordings) // 2):
            yield _Attribute(code, name, _nearest_alike(labels, rng), kinds, n_values)
    levels = [rest.level for i in places if (rest := data.rests[i]) is not None]
    if len(levels) == len(places) and len({r.axes for r in recordings}) == 1:
        yield _Attribute(
            "leak-rest", "the rest level of all axes", _nearest_in_space(np.array(levels)), labels
        )


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else float(value)


def _scalar_meta(recordings: Sequence[Recording]) -> dict[str, list[Any]]:
    """Return the plain entries of ``meta``; without answers, what describes the material, or repeats name or label."""
    flat = [dict(single_values(r.meta)) for r in recordings]
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

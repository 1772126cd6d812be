"""Leaks: what gives the label away without a look at the forces."""

from __future__ import annotations

import sys
from collections.abc import Hashable, Iterator, Sequence
from pathlib import PurePosixPath
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id._text import verb
from granular_id.recording.checks.measured import Measured
from granular_id.recording.checks.report import Finding
from granular_id.recording.recording import Recording, SampleFlag, single_values
from granular_id.recording.report import first_names
from granular_id.recording.steps import recordings_cut

FEWEST = 10  # fewer recordings say nothing: a leak of two labels would not stand out from chance
MOST = 5000  # larger sets are judged by this many recordings, drawn once: leaks worth a warning show in fewer
STRONG = 0.2  # a leak warns when it names this part of the labels that chance leaves open
MOST_KINDS = 20  # attributes of more values than this are not asked whether the label names them
N_SHUFFLES = 999
LEAST_P = 1 / (N_SHUFFLES + 1)  # smallest p-value that so many shuffles can give: 0.001
_WHY = {
    "leak-session": ": no session holds several of them; keep sessions whole when you evaluate",
    "leak-clock": ": what was recorded one after the other is like one session per label, and no evaluation can tell a "
    "label from its time; record the labels in turn",
}


class _Attribute(NamedTuple):
    """One thing that is known of every recording, named by the code of its finding and in words."""

    code: str
    name: str
    nearest: NDArray[np.intp]  # place of the recording that is nearest in it; -1: none
    target: NDArray[np.intp]  # what that recording should share: the label
    n_values: int = 0  # above it: whether one of the same label shares this attribute of few values

    def share(self, order: NDArray[np.intp]) -> float:
        """Return how often the nearest shares the target, with targets in another order."""
        target = self.target[order]
        return float(((target[self.nearest] == target) & (self.nearest >= 0)).mean())


class _Leak(NamedTuple):
    attribute: _Attribute
    share: float  # of the nearest have the same label, or the label's recordings the same value
    chance: float  # what that is for shuffled ones
    p: float  # how often the best of all attributes does as well with shuffled ones

    @property
    def lift(self) -> float:
        """Share of the way from chance to certainty."""
        return (self.share - self.chance) / max(1 - self.chance, 1e-12)

    def message(self) -> str:
        """Say in words what gives what away."""
        code, name, *_, n_values = self.attribute
        share, chance = f"{100 * self.share:.0f} %", f"(chance {100 * self.chance:.0f} %)"
        if not n_values:
            return f"{name} alone names {share} of the labels {chance}{_WHY.get(code, '')}"
        if self.share == 1:
            return f"{name} goes with the label: each label has only one of its {n_values} values"
        return f"{name} goes with the label: two recordings of a label agree in {share} {chance}"


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
    rng = np.random.default_rng(0)  # the same data give the same findings
    if len(places) > MOST:
        places = sorted(rng.choice(places, MOST, replace=False).tolist())
    if len(data.labels) > 1 and len(places) < FEWEST:
        few = f"fewer than {FEWEST} recordings whose label has others"
        message = f"{few}: whether clock, length or session give labels away is not judged"
        yield data.finding("info", "few", message)
    labels = _numbers([data.recordings[i].label for i in places])
    if len(places) < FEWEST or labels.max() < 1:
        return
    leaks: dict[str, list[_Leak]] = {}
    for leak in _leaks(list(_attributes(data, places, labels, rng)), rng):
        if leak.lift >= STRONG and leak.p <= max(data.false_alarm_rate, LEAST_P):
            leaks.setdefault(leak.attribute.code, []).append(leak)
    # Whoever knows the session knows the clock; a session each is a finding of its own.
    if data.labels_of_one_session or "leak-session" in leaks:
        leaks.pop("leak-clock", None)
    if data.labels_of_one_session:
        leaks.pop("leak-session", None)
    for code, members in leaks.items():
        members.sort(key=lambda leak: leak.lift, reverse=True)
        worst, also = members[0], list(dict.fromkeys(leak.attribute.name for leak in members))
        message = worst.message()
        if len(also) > 1:
            message += f"; so {verb(len(also) - 1, 'does', 'do')} {first_names(also[1:])}"
        yield data.finding(
            "warning", code, message, attributes=also, share=worst.share, chance=worst.chance, p=worst.p
        )


def _leaks(attributes: Sequence[_Attribute], rng: np.random.Generator) -> Iterator[_Leak]:
    if not attributes:
        return
    n = len(attributes[0].target)
    orders = [np.arange(n), *(rng.permutation(n) for _ in range(N_SHUFFLES))]
    shares = np.array([[one.share(order) for one in attributes] for order in orders])
    chance, spread = shares[1:].mean(axis=0), np.maximum(shares[1:].std(axis=0), 1e-12)
    scores = (shares - chance) / spread
    best = scores[1:].max(axis=1)
    for k, attribute in enumerate(attributes):
        p = (1 + int((best >= scores[0, k]).sum())) / (N_SHUFFLES + 1)
        yield _Leak(attribute, float(shares[0, k]), float(chance[k]), p)


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


def _numbers(values: Sequence[Hashable]) -> NDArray[np.intp]:
    """Return a number per value, equal ones the same."""
    numbers: dict[Hashable, int] = {}
    return np.array([numbers.setdefault(value, len(numbers)) for value in values], dtype=np.intp)


# What is known of recordings besides their forces: anything that could give the label away.

# What was answered live stands below the first: it follows from the samples, and gives nothing else away. Entries of
# ``meta`` under the second, at any depth, may well name the material.
_ANSWER, _MATERIAL = "answer.", "material"
_REPAIRS = SampleFlag.GAP_FILLED | SampleFlag.BAD_STATUS | SampleFlag.TIME_REPAIRED


def _attributes(
    data: Measured, places: Sequence[int], labels: NDArray[np.intp], rng: np.random.Generator
) -> Iterator[_Attribute]:
    """Collect what varies between recordings; of few values, also as what the label may name."""
    recordings = [data.recordings[i] for i in places]
    paces = [data.paces[i] for i in places]
    triggers = [None if (t := r.trigger_index) is None else r.times()[t] for r in recordings]
    repairs = [0 if r.flags is None else int(np.bitwise_or.reduce(r.flags) & _REPAIRS) for r in recordings]
    # code of the finding, name, values, and whether they lie on a line or are equal or not
    known: list[tuple[str, str, Sequence[Any], bool]] = [
        ("leak-session", "the session", [r.session for r in recordings], False),
        (
            "leak-format",
            "the file's ending",
            [PurePosixPath(r.name).suffix.lower() for r in recordings],
            False,
        ),
        ("leak-flags", "what was repaired (flags)", repairs, False),
        ("leak-clock", "the clock", [r.start_time for r in recordings], True),
        ("leak-length", "the duration", [r.duration_s for r in recordings], True),
        ("leak-length", "the number of samples", [r.n_samples for r in recordings], True),
        ("leak-rate", "the median step", [p.median_s for p in paces], True),
        ("leak-jitter", "the jitter of the steps", [p.spread for p in paces], True),
        ("leak-trigger", "the time of the trigger", triggers, True),
    ]
    for key, entries in _scalar_meta(recordings).items():
        are_numbers = all(value is None or _is_number(value) for value in entries)
        known.append(("leak-meta", f"meta {key!r}", entries, are_numbers))
    for code, name, values, on_a_line in known:
        column = np.array(values, dtype=np.float64) if on_a_line else None  # None becomes NaN
        kinds = _numbers(values if column is None else np.nan_to_num(column, nan=np.inf).tolist())
        n_values = int(kinds.max()) + 1
        if n_values == 1:
            continue
        nearest = _nearest_alike(kinds, rng) if column is None else nearest_on_a_line(column, rng)
        yield _Attribute(code, name, nearest, labels)
        if n_values <= min(MOST_KINDS, len(recordings) // 2):
            yield _Attribute(code, name, _nearest_alike(labels, rng), kinds, n_values)


def _is_number(value: object) -> TypeGuard[int | float]:
    """Whether an entry of ``meta`` is a number that a float can hold."""
    return (
        isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
    )


def _scalar_meta(recordings: Sequence[Recording]) -> dict[str, list[Any]]:
    """Return the plain entries of ``meta``; without answers, what describes the material, or repeats name or label."""
    flat = [dict(single_values(r.meta)) for r in recordings]
    keys = dict.fromkeys(key for entries in flat for key in entries)
    columns = {key: [entries.get(key) for entries in flat] for key in keys}
    return {
        key: values
        for key, values in columns.items()
        if _MATERIAL not in key.split(".")
        and not key.startswith(_ANSWER)
        and not all(
            value == r.name or (isinstance(value, str) and str(r.label) in value)
            for value, r in zip(values, recordings, strict=True)
        )
    }

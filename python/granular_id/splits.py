"""Who may train and who is held out: nowhere else is this decided.

Recordings made minutes apart share tool, fill, zero offset and temperature, so random partitions flatter a method that
has learned the session instead of the material. The strictest partitions that recordings allow hold out whole sessions,
else halves in time; the difference to random ones shows how much was the session.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._checks import argument_error, whole_number
from granular_id._estimators import routed
from granular_id._text import counted, verb
from granular_id.partitions import (
    CONDITION,
    MATCHED,
    MAX_SESSION_FOLDS,
    PROTOCOLS,
    Partition,
    Rows,
    Sessions,
    block_partitions,
    chronological_partitions,
    condition_partitions,
    kfold_partitions,
    lone_session,
    matched_partitions,
    paper_partitions,
    rows_of_class,
    session_partitions,
    splittable_rows,
    why_no_sessions,
)
from granular_id.recording import Dataset, overlapping_windows

AUTO = "auto"
"""The strictest protocol that the data allow and, beside it, as many at random."""

N_FOLDS = 5
MANY_RECORDINGS, FOLDS_OF_MANY = 2000, 3  # fewer folds: time grows faster than the number of recordings

SESSIONS, BLOCKS, RANDOM = "sessions", "blocks in time", "random recordings"
CONDITIONS = "conditions"
"""What a fold is, for those who take the strictest folds that there are."""

NONE = "nothing"

# Random folds that choose are drawn again until so many rows were held out in all: with 50 rows one in a hundred is
# less than a row, and which rows share a fold decides. Not more often than 10 times: draws of the same rows are alike.
_ENOUGH_ROWS = 500
_MOST_REPEATS = 10


@dataclass(frozen=True, eq=False)
class Groups:
    """Sessions of recordings and their order in time: what must not lie on both sides of a split."""

    sessions: NDArray[np.object_]  # (n,), None where a session is not known
    rank: Rows | None  # place of each recording in time, None where no order is known
    basis: str = ""  # what the order goes by, or why there is none
    names: NDArray[np.object_] | None = None  # of the recordings, for errors
    conditions: NDArray[np.object_] | None = None  # (n,) what new recordings do not share, where it is known

    @property
    def order(self) -> Rows | None:
        """Row numbers from the earliest to the latest; None where no order is known."""
        return None if self.rank is None else np.argsort(self.rank, kind="stable")

    def take(self, rows: Rows) -> Groups:
        """Return the groups of some rows."""
        rank = None if self.rank is None else self.rank[rows]
        names, conditions = (None if own is None else own[rows] for own in (self.names, self.conditions))
        return Groups(self.sessions[rows], rank, self.basis, names, conditions)

    def fit_arguments(self, estimator: Any, rows: Rows) -> dict[str, Any]:
        """Return those of ``sessions``, ``order`` and ``groups`` that `fit` takes, in a pipeline that of its last step.

        They are those of the training rows, None where none is known; ``order`` holds places in `rows`, ``groups`` are
        conditions.
        """
        own = self.take(rows)
        known = any(session is not None for session in own.sessions)
        groups = {} if own.conditions is None else {"groups": own.conditions}
        return routed(estimator, {"sessions": own.sessions if known else None, "order": own.order, **groups})


def groups_of(data: Dataset) -> Groups:
    """Gather sessions and the order in time of a data set; an order that contradicts itself counts as none."""
    names = np.array(data.names, dtype=object)
    try:
        basis = describe_order(data.start_times, data.y, data.names)
    except ValueError as why:
        return Groups(data.sessions, None, str(why), names)
    return Groups(data.sessions, np.argsort(data.chronological_order()[0], kind="stable"), basis, names)


def _checked_names(name: str, given: Any, n_rows: int) -> NDArray[np.object_]:
    """Return the session, or group, of each row as text; None where it is not known."""
    known = np.full(n_rows, None, dtype=object)
    if given is not None:
        what = name.removesuffix("s")
        if isinstance(given, (str, bytes)) or not hasattr(given, "__len__"):
            raise TypeError(f"{name} must be a sequence with one {what} per row, got {given!r:.60}")
        if len(given) != n_rows:
            raise ValueError(f"{name} must name one {what} per row of X, {n_rows}, got {len(given)}")
        known[:] = [None if one is None or one != one else str(one) or None for one in list(given)]  # noqa: PLR0124 - NaN
    return known


def checked_groups(n_rows: int, sessions: Any, order: Any) -> Groups:
    """Check the sessions and the order, or None, that come with `n_rows` rows of features."""
    known = _checked_names("sessions", sessions, n_rows)
    if order is None:
        return Groups(known, None, "no order in time is known")
    rows = np.asarray(order)
    if (
        rows.shape != (n_rows,)
        or rows.dtype.kind not in "iu"
        or not np.array_equal(np.sort(rows), np.arange(n_rows))
    ):
        raise argument_error(
            ValueError,
            "order",
            f"must hold the row numbers 0 to {n_rows - 1}, each once, from the earliest to the latest",
        )
    return Groups(known, np.argsort(rows, kind="stable"))


def describe_order(start_times: ArrayLike, labels: ArrayLike, names: Sequence[str]) -> str:
    """Say where the order of recordings in time comes from, or raise ValueError where there is none.

    Start times (n,) decide when every recording has one, and no two of a class share theirs. When none has (NaN), or
    all share one, as clocks that start at zero do, the order of the data set stands in: for a folder the natural order
    of its files.
    """
    times = np.asarray(start_times, dtype=np.float64)
    known = np.isfinite(times)
    if not known.any():
        return "by file order: the recordings carry no start time"
    if not known.all():
        row = int(np.flatnonzero(~known)[0])
        raise ValueError(
            f"recording {names[row]!r} has no start time but {int(known.sum())} of {times.size} recordings "
            "have one: no order in time"
        )
    if times.size > 1 and (times == times[0]).all():
        return "by file order: all recordings start at the same time, so their clocks say nothing"
    seen: dict[tuple[str, float], int] = {}
    for row, (label, time) in enumerate(zip(np.asarray(labels).tolist(), times.tolist(), strict=True)):
        twin = seen.setdefault((label, time), row)
        if twin != row:
            raise ValueError(
                f"recordings {names[twin]!r} and {names[row]!r} of class {label!r} start at the same time: "
                "no order in time"
            )
    return "by start time"


def strict_partitions(
    y: ArrayLike,
    groups: Groups,
    *,
    max_folds: int = MAX_SESSION_FOLDS,
    in_time: Callable[[ArrayLike, Rows], list[Partition]] = chronological_partitions,
) -> tuple[list[Partition], str]:
    """Draw the strictest partitions that recordings allow, and say what was left out and why.

    Whole sessions where every class has two or more, at most `max_folds` at a time; else halves, or `in_time`, where an
    order is known; else none: what stands in, random folds or nothing, is the caller's choice. Halves, and not more
    blocks: a short block lies between neighbours that trained. Nothing is said of sessions that are held out.
    """
    max_folds = whole_number("max_folds", max_folds, least=2)
    rows_of_class(y)  # what no protocol can do without is an error, not a reason to leave one out
    try:
        return session_partitions(y, groups.sessions, max_folds=max_folds, names=groups.names), ""
    except ValueError as reason:
        why = f"session protocol left out: {reason}"
    if groups.order is None:
        return [], f"{why}; chronological protocol left out: {groups.basis}"
    try:
        return in_time(y, groups.order), why
    except ValueError as reason:
        return [], f"{why}; chronological protocol left out: {reason}"


def strictest(data: Dataset) -> tuple[str | None, str]:
    """Name the strictest protocol that a data set allows, None for none, and say what keeps stricter ones out."""
    drawn, why = strict_partitions(data.y, groups_of(data))
    return (drawn[0].protocol if drawn else None), why


def plan_protocols(
    data: Dataset, protocol: str | Sequence[str], *, n_folds: int | None = None, seed: int = 0, **counts: Any
) -> tuple[dict[str, tuple[Partition, ...]], list[str]]:
    """Draw the partitions of the `protocol` argument of `evaluate`, by name, with lines on how they were drawn.

    `counts` are those of `plan_partitions`; `n_folds` as there, of ``"auto"`` the most folds of sessions.
    """
    if n_folds is not None:
        n_folds = whole_number("n_folds", n_folds, least=2)
    if protocol == AUTO:
        return _auto_partitions(data, n_folds, seed)
    names = [protocol] if isinstance(protocol, str) else list(protocol)
    choices = [name for name in PROTOCOLS if name not in (CONDITION, MATCHED)]
    known = ", ".join(map(repr, choices))
    for name in names:
        if name not in choices:
            raise argument_error(ValueError, "protocol", f"must be {AUTO!r} or among {known}, got {name!r}")
    if not names or len(set(names)) < len(names):
        raise argument_error(
            ValueError, "protocol", f"must name one or more of {known}, each once, got {names!r}"
        )
    drawn, notes = {}, []
    for name in names:
        parts, note = plan_partitions(
            data, name, n_folds=N_FOLDS if n_folds is None else n_folds, seed=seed, **counts
        )
        drawn[name] = tuple(parts)
        notes.append(note)
    return drawn, notes


def plan_held_out(
    data: Dataset, name: str, values: NDArray[np.object_], *, seed: int
) -> tuple[dict[str, tuple[Partition, ...]], list[str]]:
    """Hold out one value (n,) of a condition after the other, and as many recordings at random; lines on how."""
    drawn, notes = condition_partitions(data.y, name, values)
    drawn, n_left_out = _without_overlaps(drawn, data.y, data)
    if n_left_out:
        notes.append(f"{counted(n_left_out, 'window')} that share samples with tested ones do not train")
    sessions, every = data.sessions, set(data.sessions.tolist()) - {None}
    both = {s for s in every if len(set(values[sessions == s].tolist())) > 1}
    if both:
        notes.append(
            f"{len(both)} of {counted(len(every), 'session')} {verb(len(both), 'has', 'have')} several values of "
            f"{name}: what recordings of a session share is on both sides"
        )
    beside = f"as many at random: the same number of each class, value by value, seed {seed}"
    partitions = {CONDITION: tuple(drawn), MATCHED: tuple(matched_partitions(data.y, drawn, seed=seed))}
    return partitions, [*notes, beside]


def _auto_partitions(
    data: Dataset, n_folds: int | None, seed: int
) -> tuple[dict[str, tuple[Partition, ...]], list[str]]:
    """Draw the strictest partitions that a data set allows, and as many at random beside them.

    Whole sessions where possible, else halves in time; else random folds, and nothing beside them.
    """
    if n_folds is None:
        n_folds = N_FOLDS if len(data) <= MANY_RECORDINGS else FOLDS_OF_MANY
    y, groups = data.y, groups_of(data)
    drawn, notes = sessions_where_possible(y, groups, max_folds=n_folds)
    if not drawn and groups.order is not None:
        try:
            drawn = chronological_partitions(y, groups.order)
            notes.append(f"halves in time order, {groups.basis}")
        except ValueError as reason:
            notes.append(f"halves in time left out: {reason}")
    elif not drawn:
        notes.append(f"halves in time left out: {groups.basis}")
    if not drawn:
        largest = max(own.size for own in splittable_rows(y, "random").values())
        drawn = kfold_partitions(y, n_folds=min(n_folds, largest), seed=seed)
        return {"kfold": tuple(drawn)}, [*notes, f"{len(drawn)} random folds, seed {seed}"]
    drawn, n_left_out = _without_overlaps(drawn, y, data)
    if n_left_out:
        notes.append(f"{counted(n_left_out, 'window')} that share samples with tested ones do not train")
    beside = f"as many at random: the same number of each class, fold by fold, seed {seed}"
    partitions = {drawn[0].protocol: tuple(drawn), MATCHED: tuple(matched_partitions(y, drawn, seed=seed))}
    return partitions, [*notes, beside]


def _without_overlaps(
    drawn: list[Partition], y: NDArray[np.str_], data: Dataset
) -> tuple[list[Partition], int]:
    """Leave windows out of the training that share samples with tested ones, if every class keeps some; count them."""
    pairs = list(overlapping_windows(data.recordings))
    apart, left_out = [], set[int]()
    for part in drawn:
        tested = set(part.test.tolist())
        spoiled = {one for pair in pairs for one, other in (pair, pair[::-1]) if other in tested}
        train = np.setdiff1d(part.train, list(spoiled))
        if np.unique(y[train]).size < np.unique(y[part.train]).size:
            return drawn, 0
        left_out |= spoiled.intersection(part.train.tolist())
        apart.append(replace(part, train=train))
    return apart, len(left_out)


def sessions_where_possible(
    y: ArrayLike, groups: Groups, *, max_folds: int = MAX_SESSION_FOLDS
) -> tuple[list[Partition], list[str]]:
    """Hold out whole sessions of every class that has several, and say what becomes of the others, one line each.

    Another class is split into blocks in time, one a fold, where an order is known and it has two recordings; else it
    stays in training. No partition where fewer than two classes have several sessions.
    """
    labels, sessions = np.asarray(y), groups.sessions
    of_class = rows_of_class(labels)
    several, why = [], {}
    for label, own in of_class.items():
        if why_not := why_no_sessions(labels[own], sessions[own]):
            why[label] = "one session only" if why_not.startswith("class") else why_not
        else:
            several.append(label)
    if len(several) < 2:
        if not any(session for session in sessions):
            return [], ["held-out sessions left out: no recording says which session it is from"]
        return [], ["held-out sessions left out: fewer than two classes have several sessions"]
    inside = np.flatnonzero(np.isin(labels, several))
    names = None if groups.names is None else groups.names[inside]
    drawn = session_partitions(labels[inside], sessions[inside], max_folds=max_folds, names=names)
    tests = [inside[part.test] for part in drawn]
    n_sessions = np.unique(sessions[inside].astype(str)).size
    notes = [f"{counted(n_sessions, 'session')} held out whole, in {len(drawn)} folds"]
    for label, reason in why.items():
        own = of_class[label]
        if groups.rank is None or own.size < 2:
            notes.append(f"{label}: {reason}; stays in training and is never tested")
            continue
        blocks = np.array_split(own[np.argsort(groups.rank[own])], len(drawn))
        tests = [np.concatenate(both) for both in zip(tests, blocks, strict=True)]
        notes.append(f"{label}: {reason}; split in time, {groups.basis}")
    rows = np.arange(labels.size)
    folds = [
        replace(part, train=np.setdiff1d(rows, test), test=np.sort(test))
        for part, test in zip(drawn, tests, strict=True)
    ]
    return folds, notes


def plan_partitions(
    data: Dataset,
    protocol: str,
    *,
    n_partitions: int = 20,
    train_per_class: int = 50,
    test_per_class: int = 12,
    n_folds: int = 5,
    seed: int = 0,
) -> tuple[list[Partition], str]:
    """Draw the partitions of one of `PROTOCOLS`, with a line on how they were drawn.

    `n_folds` is of ``"kfold"``, and of ``"session"`` where blocks in time stand in for sessions. ValueError where
    the data cannot be split this way.
    """
    y = data.y
    if protocol == "paper":
        drawn = paper_partitions(
            y,
            n_partitions=n_partitions,
            train_per_class=train_per_class,
            test_per_class=test_per_class,
            seed=seed,
        )
        counts = f"{train_per_class} recordings of each class train, {test_per_class} are tested"
        return drawn, f"random: {counts}, seed {seed}"
    if protocol == "kfold":
        return kfold_partitions(y, n_folds=n_folds, seed=seed), f"kfold: {n_folds} folds, seed {seed}"
    groups = groups_of(data)
    if protocol == "chronological":
        return chronological_partitions(y, _order_in_time(groups)), f"chronological: {groups.basis}"
    sessions = groups.sessions.tolist()
    known, alone = set(sessions) - {None}, lone_session(y, sessions)
    if known and (alone is None or None in sessions):  # a recording without session is refused by its name
        drawn = session_partitions(y, sessions, names=groups.names)
        return drawn, f"session: {len(known)} sessions held out whole, in {len(drawn)} folds"
    why = f"class {alone!r} has one session only" if known else "no recording says which session it is from"
    drawn = block_partitions(y, _order_in_time(groups), n_folds=n_folds)
    instead = f"{n_folds} contiguous blocks of each class held out instead, {groups.basis}"
    return drawn, f"session: {why}; {instead}"


def strictest_partitions(data: Dataset, *, n_folds: int = 5, seed: int = 0) -> tuple[list[Partition], str]:
    """Draw the strictest partitions that a data set allows, random folds at the least; say how, and why no stricter.

    A ValueError where a class has a single recording.
    """
    largest = max(own.size for own in splittable_rows(data.y, "held-out").values())
    name, why = strictest(data)
    partitions, note = plan_partitions(data, name or "kfold", n_folds=min(n_folds, largest), seed=seed)
    return partitions, f"{note} ({why})" if why else note


def _order_in_time(groups: Groups) -> Rows:
    if groups.order is None:
        raise ValueError(groups.basis)
    return groups.order


def pair_partition(data: Dataset, first: str, second: str) -> tuple[Partition, str]:
    """Hold out about half of the recordings of two materials, as strictly as these allow, and say what was held out.

    The rule is that of `strict_partitions`, with at least two sessions of the two materials instead of all; random
    halves where it gives none. No recording of a held-out session trains, whatever its material; where halves in time
    are taken, the later half of no material does. Tested rows are of the two materials alone.
    """
    y, groups = data.y, groups_of(data)
    pair = np.flatnonzero((y == first) | (y == second))
    drawn, why = strict_partitions(y[pair], groups.take(pair), max_folds=2)
    drawn = drawn or kfold_partitions(y[pair], n_folds=2)
    if drawn[0].protocol == "session":  # of unequal folds the larger trains; halves: the earlier
        drawn.sort(key=lambda part: part.test.size)
    part = next(part for part in drawn if np.unique(y[pair[part.test]]).size == 2)
    test = pair[part.test]
    trains = ~np.isin(np.arange(len(y)), test)
    note = f"a random half ({why})"
    if part.protocol == "session":
        held = set(groups.sessions[test].tolist())
        trains &= [session not in held for session in groups.sessions.tolist()]
        note = f"whole sessions: {', '.join(sorted(held))}"
    elif groups.rank is not None:
        for label in set(data.labels) - {first, second}:
            own = np.flatnonzero(y == label)
            trains[own[np.argsort(groups.rank[own])][max(1, own.size // 2) :]] = False
        note = f"the later half in time, {groups.basis} ({why})"
    return Partition(part.protocol, 0, part.description, np.flatnonzero(trains), test), note


# Folds of training rows, for estimators that choose by holding rows out.


class ChoiceFolds(NamedTuple):
    """Folds (train, test) that make a choice, what they hold out, and the same with numbers and reasons as a line."""

    folds: tuple[tuple[Rows, Rows], ...]
    held_out: str
    note: str


def choice_folds(
    codes: Rows,
    sessions: Sessions | None,
    order: ArrayLike | None,
    *,
    n_folds: Any,
    seed: int,
    conditions: Sessions | None = None,
) -> ChoiceFolds:
    """Split training rows, with the class, the session and the order in time of each, into folds that make a choice.

    Whole conditions where each class has two; else the rule of `strict_partitions`; else stratified random folds, drawn
    anew until 500 rows were held out, at most 10
    times. The single row of a class always trains. Where fewer than two classes have two rows there are no folds.
    Sessions and random folds are `n_folds`, at least 2, and fewer where the largest class has fewer.
    """
    wanted = whole_number("n_folds", n_folds, least=2)
    groups = checked_groups(len(codes), sessions, order)
    apart = _checked_names("groups", conditions, len(codes))
    counts = np.bincount(codes)
    several = np.flatnonzero(counts[codes] > 1)
    if np.unique(codes[several]).size < 2:
        return ChoiceFolds((), NONE, "no folds: fewer than two classes have more than one recording")
    y, groups = codes[several], groups.take(several)
    by_condition = not why_no_sessions(y, apart[several])
    if by_condition:
        groups = replace(groups, sessions=apart[several])
    parts, left_out = strict_partitions(
        y, groups, max_folds=wanted, in_time=partial(block_partitions, n_folds=2)
    )
    why = why_no_sessions(y, groups.sessions)
    if not left_out:
        held_out = CONDITIONS if by_condition else SESSIONS
        note = f"{len(parts)} folds of whole {held_out}"
    elif parts:
        held_out, note = BLOCKS, f"the earlier and the later half of each class in time ({why})"
    else:
        n_used = min(wanted, int(counts.max()))
        repeats = min(_MOST_REPEATS, -(-_ENOUGH_ROWS // len(several)))
        seeds = np.random.SeedSequence(seed, spawn_key=(7,)).generate_state(repeats).tolist()
        parts = [part for draw in seeds for part in kfold_partitions(y, n_folds=n_used, seed=draw)]
        times = f", drawn {repeats} times" if repeats > 1 else ""
        held_out, note = RANDOM, f"{n_used} random folds{times} ({why}, and no order in time)"
    if several.size < len(codes):
        n_alone = len(codes) - several.size
        alone = f"{counted(n_alone)} that {verb(n_alone, 'is', 'are')} alone in {verb(n_alone, 'its', 'their')} class"
        note += f"; {alone} always {verb(n_alone, 'trains', 'train')}"
    tested = [several[part.test] for part in parts]
    folds = tuple((np.setdiff1d(np.arange(len(codes)), test), test) for test in tested)
    return ChoiceFolds(folds, held_out, note)

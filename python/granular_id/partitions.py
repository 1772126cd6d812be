"""How partitions are drawn: at random, in random folds, halves and blocks in time, whole sessions and conditions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._checks import argument_error, whole_number
from granular_id._text import counted, listed, verb

Rows = NDArray[np.intp]
Sessions = Sequence[str | None] | NDArray[Any]
"""Session of each recording; None or "" where it is not known."""

PROTOCOLS = {
    "paper": "random partitions",  # with fixed counts per class
    "session": "held-out sessions",  # or blocks in time order, where a class has one session only
    "chronological": "halves in time order",
    "kfold": "random folds",
    "condition": "another condition",  # one value of it after the other, see `condition_partitions`
    "matched": "as many at random",  # in the sizes of the strict partitions beside them, see `matched_partitions`
}
"""Each protocol, and what it is called in words."""

MATCHED = "matched"
"""The protocol that only comes with a strict one."""

CONDITION = "condition"
"""The protocol that holds out one condition of the recordings, which must be named."""

MAX_SESSION_FOLDS = 10
"""Up to this many sessions per class one is left out at a time; more are held out in groups."""

RANDOM_TEST_SHARE = 0.3
"""Rows that `random_partition` tests: enough to see a point, and the model keeps most of its training."""


@dataclass(frozen=True, eq=False)
class Partition:
    """One split of recordings into rows that train and rows that are tested, both ascending, none in both."""

    protocol: str  # that made it, a key of `PROTOCOLS`
    index: int  # within its protocol, from 0
    description: str  # for a table: "partition 3" or "1st->2nd half"
    train: Rows
    test: Rows
    condition: str = ""  # whose value is held out, where that is what is


def rows_of_class(y: ArrayLike) -> dict[Any, Rows]:
    """Return the rows (ascending) of each label (sorted), or refuse fewer than two classes."""
    labels, codes = np.unique(np.asarray(y), return_inverse=True)
    if labels.size < 2:
        have = f"only {labels[0].item()!r}" if labels.size else "none"
        raise ValueError(f"training needs recordings of at least 2 classes, got {have}")
    return {label: np.flatnonzero(codes == k) for k, label in enumerate(labels.tolist())}


def splittable_rows(y: ArrayLike, protocol: str) -> dict[Any, Rows]:
    """Return `rows_of_class`, or refuse a class that cannot both train and be tested."""
    rows = rows_of_class(y)
    for label, own in rows.items():
        if own.size < 2:
            raise ValueError(
                f"class {label!r} has 1 recording; the {protocol} protocol splits each class "
                "and needs at least 2"
            )
    return rows


def paper_partitions(
    y: ArrayLike,
    *,
    n_partitions: int = 20,
    train_per_class: int = 50,
    test_per_class: int = 12,
    seed: int = 0,
) -> list[Partition]:
    """Draw random partitions with the same number of recordings of each class, by default those of the paper.

    Partition ``j`` depends on `seed` and ``j`` alone: asking for more partitions keeps the earlier ones. Source:
    Hynninen, Nguyen Le, Kyrki, arXiv 2403.17606, section "Evaluation".
    """
    n_partitions = whole_number("n_partitions", n_partitions)
    train_per_class = whole_number("train_per_class", train_per_class)
    test_per_class = whole_number("test_per_class", test_per_class)
    of_class = rows_of_class(y)
    wanted = train_per_class + test_per_class
    short = {label: rows.size for label, rows in of_class.items() if rows.size < wanted}
    if short:
        raise ValueError(_too_few(short, train_per_class, test_per_class))
    partitions = []
    for j in range(n_partitions):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(j,)))
        drawn = [rng.permutation(rows)[:wanted] for rows in of_class.values()]
        train = np.sort(np.concatenate([rows[:train_per_class] for rows in drawn]))
        test = np.sort(np.concatenate([rows[train_per_class:] for rows in drawn]))
        partitions.append(Partition("paper", j, f"partition {j + 1}", train, test))
    return partitions


def _too_few(short: dict[Any, int], train: int, test: int) -> str:
    label, has = min(short.items(), key=lambda item: item[1])
    more = len(short) - 1
    others = f", and {more} more {'class has' if more == 1 else 'classes have'} too few" if more else ""
    hint = ""
    if has >= 2:
        fits = min(has - 1, max(1, round(has * train / (train + test))))
        hint = f": pass train_per_class={fits}, test_per_class={has - fits}"
    return (
        f"class {label!r} has {counted(has)}, wanted {train + test} "
        f"({train} to train, {test} to test){others}{hint}"
    )


def random_partition(y: ArrayLike, seed: int) -> Partition:
    """Draw `RANDOM_TEST_SHARE` of each class for testing, at least one row; two train where there are three."""
    rng = np.random.default_rng(seed)
    test = []
    for own in splittable_rows(y, "random").values():
        n_test = max(1, min(round(RANDOM_TEST_SHARE * own.size), own.size - 2))
        test.append(rng.permutation(own)[:n_test])
    tested = np.sort(np.concatenate(test))
    train = np.setdiff1d(np.arange(np.size(y)), tested)
    return Partition("paper", seed, f"random partition {seed}", train, tested)


def kfold_partitions(y: ArrayLike, *, n_folds: int = 5, seed: int = 0) -> list[Partition]:
    """Draw stratified random folds: sizes differ by at most one recording, in all and within each class."""
    rows = splittable_rows(y, "kfold")
    n_folds = _checked_folds(n_folds, rows)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2, n_folds)))
    # Dealt like cards, class after class: no fold gets two of a class before each other has one.
    dealt = np.concatenate([rng.permutation(own) for own in rows.values()])
    fold_of = np.empty(dealt.size, dtype=np.intp)
    fold_of[dealt] = np.arange(dealt.size) % n_folds
    return _from_folds("kfold", fold_of, [f"fold {j + 1} of {n_folds}" for j in range(n_folds)])


def chronological_partitions(y: ArrayLike, order: ArrayLike) -> list[Partition]:
    """Train on one half of each class in time order and test on the other, then the reverse.

    `order` holds row numbers from the earliest to the latest. The middle one of an odd count is in the second half.
    """
    rank = np.argsort(np.asarray(order, dtype=np.intp), kind="stable")
    firsts, seconds = [], []
    for rows in splittable_rows(y, "chronological").values():
        in_time = rows[np.argsort(rank[rows])]
        firsts.append(in_time[: rows.size // 2])
        seconds.append(in_time[rows.size // 2 :])
    first, second = np.sort(np.concatenate(firsts)), np.sort(np.concatenate(seconds))
    return [
        Partition("chronological", 0, "1st->2nd half", first, second),
        Partition("chronological", 1, "2nd->1st half", second, first),
    ]


def block_partitions(y: ArrayLike, order: ArrayLike, *, n_folds: int = 5) -> list[Partition]:
    """Hold out contiguous blocks in time: partition j tests the j-th block of each class; all are of like size."""
    rows = splittable_rows(y, "session")
    n_folds = _checked_folds(n_folds, rows)
    rank = np.argsort(np.asarray(order, dtype=np.intp), kind="stable")
    fold_of = np.empty(rank.size, dtype=np.intp)
    for own in rows.values():
        in_time = own[np.argsort(rank[own])]
        for j, block in enumerate(np.array_split(in_time, n_folds)):
            fold_of[block] = j
    return _from_folds("session", fold_of, [block_name(j, n_folds) for j in range(n_folds)])


def matched_partitions(y: ArrayLike, strict: Sequence[Partition], *, seed: int = 0) -> list[Partition]:
    """Draw at random partitions of the sizes of strict ones: fold by fold as many of each class train and are tested.

    They are the strict ones with the rows of each class exchanged at random, so that a recording is tested as often.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(8,)))
    exchanged = np.empty(np.size(y), dtype=np.intp)
    for own in rows_of_class(y).values():
        exchanged[own] = rng.permutation(own)
    return [
        Partition(
            MATCHED,
            part.index,
            f"as many as {part.description}",
            np.sort(exchanged[part.train]),
            np.sort(exchanged[part.test]),
        )
        for part in strict
    ]


def session_partitions(
    y: ArrayLike,
    sessions: Sessions,
    *,
    max_folds: int = MAX_SESSION_FOLDS,
    names: Sequence[str] | NDArray[Any] | None = None,
) -> list[Partition]:
    """Hold out whole sessions, so that nothing recorded beside a tested recording has trained.

    A session may hold one class or many; the same name under two classes counts as the same session. There are as many
    folds as the class with most sessions has, up to `max_folds`: one session of each class is left out at a time, or a
    group where there are more. Every class keeps training rows in every fold. Needs no randomness: the largest
    sessions are placed first, each where its classes have fewest rows. `names` of recordings are for errors.
    """
    rows = splittable_rows(y, "session")
    without = _without_session(sessions)
    if len(without) == len(sessions):
        raise ValueError("no recording says which session it is from")
    if without:
        which = f"recording {without[0]}" if names is None else f"recording {names[without[0]]!r}"
        raise ValueError(
            f"{which} has no session but {len(sessions) - len(without)} of {len(sessions)} recordings have "
            "one: a session cannot be held out when it is not known who belongs to it"
        )
    known = np.array(list(sessions), dtype=np.str_)
    alone = lone_session(y, known)
    if alone is not None:
        raise ValueError(
            f"class {alone!r} has recordings of one session only; "
            "holding it out would leave the class nothing to train on"
        )
    held, session_of = np.unique(known, return_inverse=True)
    counts = np.zeros((held.size, len(rows)), dtype=np.intp)  # recordings of each class in each session
    for k, own in enumerate(rows.values()):
        counts[:, k] = np.bincount(session_of[own], minlength=held.size)
    n_folds = min(max_folds, int(np.count_nonzero(counts, axis=0).max()))
    placed = _placed(counts, n_folds)
    while not _all_train(counts, placed):  # ends: with a fold for each session none is alone in its class
        n_folds += 1
        placed = _placed(counts, n_folds)
    # Folds in the order of their first recording, so that what is listed first was recorded first.
    fold_of_row = placed[session_of]
    used, first = np.unique(fold_of_row, return_index=True)
    ranked = used[np.argsort(first)]
    fold_of = np.argsort(ranked)[np.searchsorted(used, fold_of_row)]
    descriptions = []
    for fold in ranked.tolist():
        inside = held[placed == fold]
        descriptions.append(
            str(inside[0]) if inside.size == 1 else f"{inside.size} sessions: {inside[0]}, ..."
        )
    return _from_folds("session", fold_of.astype(np.intp), descriptions)


def condition_partitions(
    y: ArrayLike, name: str, values: NDArray[np.object_]
) -> tuple[list[Partition], list[str]]:
    """Hold out one value (n,) of a condition after the other, whole; say what cannot be trained or tested.

    A material without recordings of another value is not tested there: what never trained is never named.
    """
    labels = np.asarray(y)
    rows_of_class(labels)
    drawn: list[Partition] = []
    notes: list[str] = []
    for value in dict.fromkeys(values.tolist()):
        held = values == value
        trains = np.unique(labels[~held])
        tested = held & np.isin(labels, trains)
        lost = np.unique(labels[held & ~tested]).tolist()
        place = f"{name} {value!r}"
        if trains.size < 2:
            only = f"only {trains[0]} is" if trains.size else "nothing is"
            notes.append(f"{place} is not held out: {only} left to train on")
        elif not tested.any():
            notes.append(
                f"{place} is not held out: {listed(lost)} {verb(len(lost), 'has', 'have')} no other value"
            )
        else:
            if lost:
                n_left = int(held.sum() - tested.sum())
                notes.append(
                    f"{place}: {listed(lost)} {verb(len(lost), 'has', 'have')} no other value to train on; "
                    f"{counted(n_left)} not tested there"
                )
            drawn.append(
                Partition(
                    CONDITION,
                    len(drawn),
                    f"{name}: {value}",
                    np.flatnonzero(~held),
                    np.flatnonzero(tested),
                    name,
                )
            )
    return drawn, notes


def _checked_folds(n_folds: int, rows: dict[Any, Rows]) -> int:
    """Return a number of random folds or blocks, or refuse one below 2 or above the size of the largest class."""
    n_folds = whole_number("n_folds", n_folds, least=2)
    label, own = max(rows.items(), key=lambda item: item[1].size)
    if n_folds > own.size:
        largest = f"the {own.size} recordings of the largest class, {label!r}"
        raise argument_error(ValueError, "n_folds", f"must not exceed {largest}, got {n_folds}")
    return n_folds


def _placed(counts: Rows, n_folds: int) -> Rows:
    """Fold of each session: largest first, each where the rows of its own classes are fewest."""
    load = np.zeros((n_folds, counts.shape[1]), dtype=np.intp)
    placed = np.empty(len(counts), dtype=np.intp)
    for session in np.argsort(-counts.sum(axis=1), kind="stable").tolist():
        costs = zip((load @ counts[session]).tolist(), load.sum(axis=1).tolist(), range(n_folds), strict=True)
        fold = min(costs)[-1]
        placed[session] = fold
        load[fold] += counts[session]
    return placed


def _all_train(counts: Rows, placed: Rows) -> bool:
    """Whether no class has all its recordings in one fold."""
    return all(np.unique(placed[column > 0]).size > 1 for column in counts.T)


def _from_folds(protocol: str, fold_of: Rows, descriptions: Sequence[str]) -> list[Partition]:
    return [
        Partition(protocol, j, description, np.flatnonzero(fold_of != j), np.flatnonzero(fold_of == j))
        for j, description in enumerate(descriptions)
    ]


def lone_session(y: ArrayLike, sessions: Sessions) -> Any | None:
    """Label of a class whose recordings all are of one session, or None when there is no such class."""
    seen: dict[Any, set[Any]] = {}
    for label, session in zip(np.asarray(y).tolist(), list(sessions), strict=True):
        seen.setdefault(label, set()).add(session)
    return next((label for label in sorted(seen) if len(seen[label]) == 1), None)


def why_no_sessions(y: ArrayLike, sessions: Sessions) -> str:
    """Say in a few words why whole sessions cannot be held out, nothing where they can; only texts name a class."""
    unknown = _without_session(sessions)
    if len(unknown) == len(sessions):
        return "sessions are not known"
    if unknown:
        return f"the session of {len(unknown)} of {len(sessions)} recordings is not known"
    alone = lone_session(y, sessions)
    named = f"class {alone!r}" if isinstance(alone, str) else "a class"
    return "" if alone is None else f"{named} has one session only"


def _without_session(sessions: Sessions) -> list[int]:
    return [row for row, session in enumerate(sessions) if session is None or session == ""]


def block_name(block: int, n_blocks: int) -> str:
    """Describe the partition that holds out a block in time, `block` counted from 0."""
    return f"block {block + 1} of {n_blocks}"


def are_blocks(partitions: Sequence[Partition]) -> bool:
    """Whether the partitions of a protocol hold out blocks in time, and not sessions, whatever those are called."""
    return [partition.description for partition in partitions] == [
        block_name(block, len(partitions)) for block in range(len(partitions))
    ]


def protocol_name(protocol: str, partitions: Sequence[Partition]) -> str:
    """Name a protocol in words; blocks in time that stand in for sessions are called blocks."""
    if protocol == CONDITION:
        return f"another {partitions[0].condition}"
    if protocol == "session" and are_blocks(partitions):
        return "blocks in time order"
    return PROTOCOLS[protocol]

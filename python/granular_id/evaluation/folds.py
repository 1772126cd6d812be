"""Folds: each recording is tested once, by a classifier that trained on the other folds.

Three ways to form them, from strict to lenient: whole sessions, contiguous blocks in time, random draws.
Whatever was the same for a whole session (tool, fill, zero offset, temperature) cannot help with a session
that was held out; blocks in time leave the neighbours at their edges only; random folds leave everything.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._numbers import whole_number
from granular_id.evaluation.partition import Partition, splittable_rows
from granular_id.evaluation.protocol_names import block_name

__all__ = [
    "BLOCKS",
    "HALVES",
    "MAX_SESSION_FOLDS",
    "RANDOM",
    "SESSIONS",
    "block_partitions",
    "kfold_partitions",
    "lone_session",
    "session_partitions",
    "why_no_sessions",
]

Codes = NDArray[np.intp]

SESSIONS, HALVES, BLOCKS, RANDOM = "sessions", "halves in time", "blocks in time", "random recordings"
"""What a fold is, for those who take the strictest folds that there are."""

MAX_SESSION_FOLDS = 10
"""Up to this many sessions per class one is left out at a time; more are held out in groups."""


def kfold_partitions(y: ArrayLike, *, n_folds: int = 5, seed: int = 0) -> list[Partition]:
    """Draw stratified random folds: for sets too small for fixed counts per class.

    Parameters
    ----------
    y : (n,) array
        Label of each recording. Classes may differ in size.
    n_folds : int
        At least 2, at most the size of the largest class. A smaller class is tested in as many folds as it has
        recordings, and trains in all.
    seed : int
        Not negative. Same seed, same folds.

    Returns
    -------
    list of Partition
        Folds differ by at most one recording, in all and within each class.

    Raises
    ------
    ValueError
        Fewer than two classes, a class with a single recording, or too many folds.

    Examples
    --------
    >>> folds = kfold_partitions(["oat"] * 5 + ["rice"] * 3, n_folds=3)
    >>> [len(fold.test) for fold in folds]
    [3, 3, 2]
    """
    rows = splittable_rows(y, "kfold")
    n_folds = _checked_folds(n_folds, rows)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2, n_folds)))
    # Dealt like cards, class after class: no fold gets two of a class before each other has one.
    dealt = np.concatenate([rng.permutation(own) for own in rows.values()])
    fold_of = np.empty(dealt.size, dtype=np.intp)
    fold_of[dealt] = np.arange(dealt.size) % n_folds
    return _from_folds("kfold", fold_of, [f"fold {j + 1} of {n_folds}" for j in range(n_folds)])


def block_partitions(
    y: ArrayLike, order: ArrayLike, *, n_folds: int = 5, protocol: str = "session"
) -> list[Partition]:
    """Hold out contiguous blocks in time, for data without sessions or with one session per class.

    Parameters
    ----------
    y : (n,) array
        Label of each recording.
    order : (n,) int array
        Row numbers from the earliest to the latest recording, see `Dataset.chronological_order`.
    n_folds : int
        At least 2, at most the size of the largest class.
    protocol : str
        Name that the partitions carry.

    Returns
    -------
    list of Partition
        Partition j tests the j-th block of each class; sizes within a class differ by at most one.

    Raises
    ------
    ValueError
        Fewer than two classes, a class with a single recording, or too many folds.

    Examples
    --------
    >>> first, second = block_partitions(["a", "b"] * 4, range(8), n_folds=2)
    >>> first.test.tolist(), second.test.tolist()
    ([0, 1, 2, 3], [4, 5, 6, 7])
    """
    rows = splittable_rows(y, protocol)
    n_folds = _checked_folds(n_folds, rows)
    rank = np.argsort(np.asarray(order, dtype=np.intp), kind="stable")
    fold_of = np.empty(rank.size, dtype=np.intp)
    for own in rows.values():
        in_time = own[np.argsort(rank[own])]
        for j, block in enumerate(np.array_split(in_time, n_folds)):
            fold_of[block] = j
    return _from_folds(protocol, fold_of, [block_name(j, n_folds) for j in range(n_folds)])


def session_partitions(
    y: ArrayLike,
    sessions: Sequence[str | None] | NDArray[Any],
    *,
    max_folds: int = MAX_SESSION_FOLDS,
    names: Sequence[str] | None = None,
) -> list[Partition]:
    """Hold out whole sessions, so that nothing recorded beside a tested recording has trained.

    A session may hold one class or many; the same name under two classes counts as the same session. There
    are as many folds as the class with most sessions has, up to `max_folds`: one session of each class is
    left out at a time, or a group where there are more sessions. Sessions are spread so that the recordings
    of each class are tested as evenly as their sessions allow, and every class keeps training rows in every
    fold.

    Parameters
    ----------
    y : (n,) array
        Label of each recording.
    sessions : sequence of n str
        Session of each recording; None or ``""`` where unknown.
    max_folds : int
        At least 2.
    names : sequence of n str, optional
        Names of the recordings, for the message of an error.

    Returns
    -------
    list of Partition
        No session has rows in both parts of a partition; each recording is tested once.

    Raises
    ------
    ValueError
        Fewer than two classes, a recording without session, or a class with a single session.

    Notes
    -----
    Needs no randomness: the largest sessions are placed first, each where its classes have fewest rows.

    Examples
    --------
    >>> y = ["oat", "oat", "rice", "rice", "oat", "rice"]
    >>> for fold in session_partitions(y, ["mon", "tue", "mon", "tue", "wed", "wed"]):
    ...     print(fold.description, fold.test.tolist())
    mon [0, 2]
    tue [1, 3]
    wed [4, 5]
    """
    max_folds = whole_number("max_folds", max_folds, least=2)
    rows = splittable_rows(y, "session")
    known = _checked_sessions(sessions, names)
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


def lone_session(y: ArrayLike, sessions: Sequence[str | None] | NDArray[Any]) -> Any | None:
    """Label of a class whose recordings all are of one session, or None when there is no such class."""
    seen: dict[Any, set[Any]] = {}
    for label, session in zip(np.asarray(y).tolist(), list(sessions), strict=True):
        seen.setdefault(label, set()).add(session)
    return next((label for label in sorted(seen) if len(seen[label]) == 1), None)


def why_no_sessions(y: ArrayLike, sessions: Sequence[str | None] | NDArray[Any] | None) -> str:
    """Say why whole sessions cannot be held out of these rows; nothing where they can.

    Parameters
    ----------
    y : (n,) array
        Labels, or numbers of classes, which are not named.
    sessions : sequence of n, or None
        Session of each row; None or "" where it is not known.

    Examples
    --------
    >>> why_no_sessions(["oat", "rice"] * 2, ["mon", "mon", "tue", "tue"])
    ''
    >>> why_no_sessions(["oat", "rice"] * 2, ["mon", "mon", "tue", "mon"])
    "class 'rice' has one session only"
    """
    unknown = 0 if sessions is None else sum(one is None or one == "" for one in list(sessions))
    if sessions is None or unknown == len(sessions):
        return "sessions are not known"
    if unknown:
        return f"the session of {unknown} of {len(sessions)} recordings is not known"
    alone = lone_session(y, sessions)
    named = f"class {alone!r}" if isinstance(alone, str) else "a class"
    return "" if alone is None else f"{named} has one session only"


def _checked_folds(n_folds: int, rows: dict[Any, Codes]) -> int:
    n_folds = whole_number("n_folds", n_folds, least=2)
    label, own = max(rows.items(), key=lambda item: item[1].size)
    if n_folds > own.size:
        raise ValueError(
            f"n_folds must not exceed the {own.size} recordings of the largest class, {label!r}, got {n_folds}"
        )
    return n_folds


def _checked_sessions(
    sessions: Sequence[str | None] | NDArray[Any], names: Sequence[str] | None
) -> NDArray[np.str_]:
    without = [row for row, session in enumerate(sessions) if session is None or session == ""]
    if len(without) == len(sessions):
        raise ValueError("no recording says which session it is from")
    if without:
        which = f"recording {without[0]}" if names is None else f"recording {names[without[0]]!r}"
        raise ValueError(
            f"{which} has no session but {len(sessions) - len(without)} of {len(sessions)} recordings have "
            "one: a session cannot be held out when it is not known who belongs to it"
        )
    return np.array(list(sessions), dtype=np.str_)


def _placed(counts: Codes, n_folds: int) -> Codes:
    """Fold of each session: largest first, each where the rows of its own classes are fewest."""
    load = np.zeros((n_folds, counts.shape[1]), dtype=np.intp)
    placed = np.empty(len(counts), dtype=np.intp)
    for session in np.argsort(-counts.sum(axis=1), kind="stable").tolist():
        costs = zip((load @ counts[session]).tolist(), load.sum(axis=1).tolist(), range(n_folds), strict=True)
        fold = min(costs)[-1]
        placed[session] = fold
        load[fold] += counts[session]
    return placed


def _all_train(counts: Codes, placed: Codes) -> bool:
    """Whether no class has all its recordings in one fold."""
    return all(np.unique(placed[column > 0]).size > 1 for column in counts.T)


def _from_folds(protocol: str, fold_of: Codes, descriptions: Sequence[str]) -> list[Partition]:
    return [
        Partition(protocol, j, description, np.flatnonzero(fold_of != j), np.flatnonzero(fold_of == j))
        for j, description in enumerate(descriptions)
    ]

"""Which recordings train and which are tested: the partitions of every protocol.

``paper`` draws random partitions with a fixed number of recordings of each class; it is what the paper reports.
``chronological`` trains on the first half of each class and tests on the second, then the reverse; it asks
whether what was learned survives the passing of time. ``session`` holds out whole sessions, ``kfold`` random
folds (`granular_id.splits`). Recordings made minutes apart share tool, fill, zero offset and
temperature, so random partitions flatter a method that has learned the session instead of the material. The
difference between the protocols shows whether that may be so; it also holds whatever else changed with time,
and the smaller training half.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike, NDArray

from granular_id._checks import whole_number
from granular_id._estimators import asked_for
from granular_id._text import counted, verb
from granular_id.recording import Dataset

# One split of a data set, and the checks that all protocols share.

PROTOCOLS = {
    "paper": "random partitions, fixed counts per class",
    "session": "whole sessions held out; blocks in time order where a class has one session only",
    "chronological": "one half of each class in time order trains, the other is tested",
    "kfold": "stratified random folds, each recording tested once",
}


@dataclass(frozen=True, eq=False)
class Partition:
    """One split of a data set into rows that train and rows that are tested.

    Parameters
    ----------
    protocol : str
        Name of the protocol that made it, a key of `PROTOCOLS`.
    index : int
        Position within its protocol, from 0.
    description : str
        What this split is, for a table: ``"partition 3"`` or ``"1st->2nd half"``.
    train, test : (n_train,) and (n_test,) int arrays
        Row numbers, ascending, without a row in both.
    """

    protocol: str
    index: int
    description: str
    train: NDArray[np.intp]
    test: NDArray[np.intp]


def rows_of_class(y: ArrayLike) -> dict[Any, NDArray[np.intp]]:
    """Return the rows (ascending) of each label (sorted), or refuse fewer than two classes."""
    labels, codes = np.unique(np.asarray(y), return_inverse=True)
    if labels.size < 2:
        have = f"only {labels[0].item()!r}" if labels.size else "none"
        raise ValueError(f"training needs recordings of at least 2 classes, got {have}")
    return {label: np.flatnonzero(codes == k) for k, label in enumerate(labels.tolist())}


def splittable_rows(y: ArrayLike, protocol: str) -> dict[Any, NDArray[np.intp]]:
    """Return `rows_of_class`, or refuse a class that cannot both train and be tested."""
    rows = rows_of_class(y)
    for label, own in rows.items():
        if own.size < 2:
            raise ValueError(
                f"class {label!r} has 1 recording; the {protocol} protocol splits each class "
                "and needs at least 2"
            )
    return rows


# Folds: each recording is tested once, by a classifier that trained on the other folds.
#
# Three ways to form them, from strict to lenient: whole sessions, contiguous blocks in time, random draws.
# Whatever was the same for a whole session (tool, fill, zero offset, temperature) cannot help with a session
# that was held out; blocks in time leave the neighbours at their edges only; random folds leave everything.

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


FORWARD = "1st->2nd half"
BACKWARD = "2nd->1st half"


def paper_partitions(
    y: ArrayLike,
    *,
    n_partitions: int = 20,
    train_per_class: int = 50,
    test_per_class: int = 12,
    seed: int = 0,
) -> list[Partition]:
    """Draw random partitions with the same number of recordings of each class.

    Partition ``j`` depends on `seed` and ``j`` alone: asking for more partitions keeps the earlier ones.

    Parameters
    ----------
    y : (n,) array
        Label of each recording.
    n_partitions : int
        How many partitions; the paper uses 20.
    train_per_class, test_per_class : int
        Recordings of each class that train and that are tested; the paper uses 50 and 12 of its 62.
    seed : int
        Not negative. Same seed, same partitions.

    Returns
    -------
    list of Partition

    Raises
    ------
    ValueError
        Fewer than two classes, a count below 1, or a class with fewer recordings than are asked for.

    Notes
    -----
    Hynninen, Nguyen Le, Kyrki, arXiv 2403.17606, section "Evaluation".

    Examples
    --------
    >>> y = ["oat", "rice"] * 5
    >>> first, second = paper_partitions(y, n_partitions=2, train_per_class=3, test_per_class=2)
    >>> len(first.train), len(first.test)
    (6, 4)
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


def chronological_partitions(y: ArrayLike, order: ArrayLike) -> list[Partition]:
    """Train on one half of each class in time order and test on the other, in both directions.

    Parameters
    ----------
    y : (n,) array
        Label of each recording.
    order : (n,) int array
        Row numbers from the earliest to the latest recording, see `Dataset.chronological_order`.

    Returns
    -------
    list of Partition
        First half to second half, then second half to first half. With an odd count the middle recording
        belongs to the second half.

    Raises
    ------
    ValueError
        Fewer than two classes, or a class with a single recording.

    Examples
    --------
    >>> forward, backward = chronological_partitions(["oat", "oat", "rice", "rice"], [3, 2, 1, 0])
    >>> forward.train.tolist(), forward.test.tolist()
    ([1, 3], [0, 2])
    """
    rank = np.argsort(np.asarray(order, dtype=np.intp), kind="stable")
    firsts, seconds = [], []
    for rows in splittable_rows(y, "chronological").values():
        in_time = rows[np.argsort(rank[rows])]
        firsts.append(in_time[: rows.size // 2])
        seconds.append(in_time[rows.size // 2 :])
    first, second = np.sort(np.concatenate(firsts)), np.sort(np.concatenate(seconds))
    return [
        Partition("chronological", 0, FORWARD, first, second),
        Partition("chronological", 1, BACKWARD, second, first),
    ]


def strict_partitions(
    y: ArrayLike,
    sessions: Sequence[str | None] | NDArray[Any],
    order: ArrayLike | None,
    *,
    no_order: str = "",
    max_folds: int = MAX_SESSION_FOLDS,
    names: Sequence[str] | None = None,
) -> tuple[list[Partition], str]:
    """Draw the strictest partitions that recordings allow: the rule of `evaluate`, `train`, `select` and `explain`.

    Whole sessions where every class has two or more; else halves in time order, both ways, where an order is known;
    else none. Halves, and not more blocks: a short block lies between neighbours that trained.

    Parameters
    ----------
    y, sessions, max_folds, names
        As `session_partitions`.
    order : (n,) int array or None
        Row numbers from the earliest to the latest recording; None where no order is known.
    no_order : str
        Why there is none.

    Returns
    -------
    partitions : list of Partition
        Empty where neither can be: what stands in, random folds or nothing, is the caller's choice.
    why : str
        One line on what was left out and why; empty for sessions.

    Raises
    ------
    ValueError
        Fewer than two classes.

    Examples
    --------
    >>> y = ["oat", "rice", "oat", "rice"]
    >>> halves, why = strict_partitions(y, ["mon"] * 4, range(4))
    >>> halves[0].description, why.partition(";")[0]
    ('1st->2nd half', "session protocol left out: class 'oat' has recordings of one session only")
    """
    rows_of_class(y)  # what no protocol can do without is an error, not a reason to leave one out
    try:
        return session_partitions(y, sessions, max_folds=max_folds, names=names), ""
    except ValueError as reason:
        why = f"session protocol left out: {reason}"
    if order is not None:
        try:
            return chronological_partitions(y, order), why
        except ValueError as reason:
            no_order = str(reason)
    return [], f"{why}; chronological protocol left out: {no_order}"


def describe_order(start_times: ArrayLike, labels: ArrayLike, names: Sequence[str]) -> str:
    """Say where the order of recordings in time comes from, and refuse when there is none.

    Start times decide when every recording has one. When none has (or all share one, as clocks that start at
    zero do) the order of the data set stands in, which for a folder is the natural order of its files.

    Parameters
    ----------
    start_times : (n,) float array
        Seconds since 1970; NaN where unknown.
    labels : (n,) array
        Label of each recording: times must differ within a class, since only order within a class is used.
    names : sequence of n str
        Names of the recordings, for the message of an error.

    Returns
    -------
    str
        ``"by start time"`` or ``"by file order ..."`` with the reason.

    Raises
    ------
    ValueError
        Some recordings have a start time and others have none, or two of one class share theirs.

    Examples
    --------
    >>> describe_order([30.0, 10.0, 20.0], ["a", "a", "b"], ["x", "y", "z"])
    'by start time'
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


# From the protocols asked for to partitions of a data set, with a line on how each was drawn.

AUTO = "auto"
"""The paper's protocol and, beside it, the strictest that the data allow."""


def plan_protocols(protocol: str | Sequence[str], data: Dataset) -> tuple[list[str], list[str]]:
    """Turn the `protocol` argument of `evaluate` into known names.

    Parameters
    ----------
    protocol : str or sequence of str
        `AUTO`, or keys of `PROTOCOLS`.
    data : Dataset
        What `AUTO` has to look at.

    Returns
    -------
    names, notes : list of str
        Protocols to run, and lines for the reader of the result on what was left out.

    Raises
    ------
    ValueError
        An unknown name, none, or one twice.
    """
    if protocol == AUTO:
        name, why = strictest(data)
        return ["paper"] + ([] if name is None else [name]), [why] if why else []
    names = [protocol] if isinstance(protocol, str) else list(protocol)
    known = ", ".join(map(repr, PROTOCOLS))
    for name in names:
        if name not in PROTOCOLS:
            raise ValueError(f"protocol must be {AUTO!r} or among {known}, got {name!r}")
    if not names or len(set(names)) < len(names):
        raise ValueError(f"protocol must name one or more of {known}, each once, got {names!r}")
    return names, []


def strictest(data: Dataset) -> tuple[str | None, str]:
    """Name the strictest protocol that a data set allows, and say what keeps stricter ones out.

    Parameters
    ----------
    data : Dataset
        Only labels, sessions, names and start times are read.

    Returns
    -------
    protocol : {"session", "chronological"} or None
        ``"session"`` where every class has at least two sessions, else ``"chronological"`` where there is an
        order in time; None where neither can be.
    why : str
        One line on what was left out and why; empty for ``"session"``.

    Raises
    ------
    ValueError
        A recording without label, or fewer than two classes.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording import Dataset, Recording
    >>> wrench = np.zeros((4, 6))
    >>> data = Dataset([Recording(wrench, rate_hz=500, label=m) for m in ("oat", "rice") for _ in range(2)])
    >>> strictest(data)
    ('chronological', 'session protocol left out: no recording says which session it is from')
    """
    order, basis = _known_order(data)
    drawn, why = strict_partitions(data.y, data.sessions, order, no_order=basis, names=data.names)
    return (drawn[0].protocol if drawn else None), why


def pair_partition(data: Dataset, first: str, second: str) -> tuple[Partition, str]:
    """Hold out about half of the recordings of two materials, as strictly as these allow, to look at them alone.

    The rule is that of `strict_partitions`, with at least two sessions of the two materials instead of all; random
    halves where it gives none. No recording of a held-out session trains, whatever its material; where halves in
    time are taken, the later half of no material does.

    Parameters
    ----------
    data : Dataset
        Labels, sessions, names and start times are read.
    first, second : str
        Two labels, with two recordings or more each.

    Returns
    -------
    partition : Partition
        Its tested rows are of the two materials alone.
    note : str
        What was held out, and why nothing stricter.
    """
    y, sessions = data.y, data.sessions
    order, basis = _known_order(data)
    rank = np.argsort(np.arange(len(y)) if order is None else order, kind="stable")
    pair = np.flatnonzero((y == first) | (y == second))
    drawn, why = strict_partitions(
        y[pair],
        sessions[pair],
        None if order is None else np.argsort(rank[pair], kind="stable"),
        no_order=basis,
        max_folds=2,
        names=[data.names[row] for row in pair.tolist()],
    )
    drawn = drawn or kfold_partitions(y[pair], n_folds=2)
    if drawn[0].protocol == "session":  # of unequal folds the larger trains; halves: the earlier
        drawn.sort(key=lambda part: part.test.size)
    part = next(part for part in drawn if np.unique(y[pair[part.test]]).size == 2)
    test = pair[part.test]
    trains = ~np.isin(np.arange(len(y)), test)
    if part.protocol == "session":
        held = set(sessions[test].tolist())
        trains &= [session not in held for session in sessions.tolist()]
        note = f"whole sessions: {', '.join(sorted(held))}"
    elif part.protocol == "chronological":
        for label in set(data.labels) - {first, second}:
            own = np.flatnonzero(y == label)
            trains[own[np.argsort(rank[own])][max(1, own.size // 2) :]] = False
        note = f"the later half in time, {basis} ({why})"
    else:
        note = f"a random half ({why})"
    return Partition(part.protocol, 0, part.description, np.flatnonzero(trains), test), note


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
    """Draw the partitions of one protocol, with a line on how they were drawn.

    Parameters
    ----------
    data : Dataset
        The recordings; only labels, sessions, names and start times are read.
    protocol : str
        A key of `PROTOCOLS`.
    n_partitions, train_per_class, test_per_class : int
        Of ``"paper"``, see `paper_partitions`.
    n_folds : int
        Of ``"kfold"``, and of ``"session"`` where blocks in time stand in for sessions.
    seed : int
        Of ``"paper"`` and ``"kfold"``.

    Returns
    -------
    partitions : list of Partition
    note : str
        For the reader of the result.

    Raises
    ------
    ValueError
        The data cannot be split this way; the message says why.
    """
    if protocol == "paper":
        drawn = paper_partitions(
            data.y,
            n_partitions=n_partitions,
            train_per_class=train_per_class,
            test_per_class=test_per_class,
            seed=seed,
        )
        counts = f"{train_per_class} recordings of each class train, {test_per_class} are tested"
        return drawn, f"random: {counts}, seed {seed}"
    if protocol == "kfold":
        return kfold_partitions(data.y, n_folds=n_folds, seed=seed), f"kfold: {n_folds} folds, seed {seed}"
    if protocol == "session":
        return _by_session(data, n_folds)
    order, basis = _time_order(data)
    return chronological_partitions(data.y, order), f"chronological: {basis}"


def _by_session(data: Dataset, n_folds: int) -> tuple[list[Partition], str]:
    sessions = data.sessions
    known = {session for session in sessions.tolist() if session is not None}
    if not known:
        why = "no recording says which session it is from"
    elif None in sessions.tolist() or (alone := lone_session(data.y, sessions)) is None:
        drawn = session_partitions(data.y, sessions, names=data.names)
        return drawn, f"session: {len(known)} sessions held out whole, in {len(drawn)} folds"
    else:
        why = f"class {alone!r} has one session only"
    order, basis = _time_order(data)
    drawn = block_partitions(data.y, order, n_folds=n_folds)
    return drawn, f"session: {why}; {n_folds} contiguous blocks of each class held out instead, {basis}"


def _known_order(data: Dataset) -> tuple[list[int] | None, str]:
    """Return the order in time and what it goes by, or None and why there is none."""
    try:
        return _time_order(data)
    except ValueError as why:
        return None, str(why)


def _time_order(data: Dataset) -> tuple[list[int], str]:
    basis = describe_order(data.start_times, data.y, data.names)
    order, _ = data.chronological_order()
    return order.tolist(), basis


# What protocols and their partitions are called in front of a reader.

_NAMES = {
    "paper": "random partitions",
    "session": "held-out sessions",
    "chronological": "halves in time order",
    "kfold": "random folds",
}


def block_name(block: int, n_blocks: int) -> str:
    """Describe the partition that holds out a block in time, `block` counted from 0."""
    return f"block {block + 1} of {n_blocks}"


def are_blocks(partitions: Sequence[Partition]) -> bool:
    """Whether the partitions of a protocol hold out blocks in time, and not sessions, whatever those are called."""
    return [partition.description for partition in partitions] == [
        block_name(block, len(partitions)) for block in range(len(partitions))
    ]


def protocol_name(protocol: str, partitions: Sequence[Partition]) -> str:
    """Name a protocol in words; blocks in time that stand in for sessions are called blocks.

    Examples
    --------
    >>> from granular_id.splits import block_partitions, session_partitions
    >>> y = ["oat", "rice", "oat", "rice"]
    >>> protocol_name("session", session_partitions(y, ["block 1", "block 1", "block 2", "block 2"]))
    'held-out sessions'
    >>> protocol_name("session", block_partitions(y, range(4), n_folds=2))
    'blocks in time order'
    """
    if protocol == "session" and are_blocks(partitions):
        return "blocks in time order"
    return _NAMES.get(protocol, protocol)


# Where recordings come from: sessions, and an order in time; for classifiers that choose by holding rows out.

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Origins:
    """What is known about where the recordings of a data set come from.

    Attributes
    ----------
    sessions : (n,) object array
        Session of each recording; None where it is not known.
    rank : (n,) int array or None
        Place of each recording in time; None where no order is known.
    """

    sessions: NDArray[np.object_]
    rank: Rows | None

    def fit_arguments(self, estimator: Any, rows: Rows) -> dict[str, Any]:
        """Return what `fit` of an estimator takes of it, for training rows.

        Parameters
        ----------
        estimator : estimator
            Its `fit`, or that of the last step of a pipeline, may have the parameters ``sessions`` and ``order``, as
            that of `granular_id.BestClassifier` has.
        rows : (m,) int array
            Of the data set.

        Returns
        -------
        dict
            ``sessions`` (m,), and ``order`` (m,): places in `rows`, the earliest first, or None.

        Examples
        --------
        >>> import numpy as np
        >>> from granular_id.spaces.best import BestClassifier
        >>> origins = Origins(np.array(["mon", "mon", "tue"], dtype=object), np.array([2, 0, 1]))
        >>> known = origins.fit_arguments(BestClassifier(), np.array([0, 2]))
        >>> known["sessions"].tolist(), known["order"].tolist()
        (['mon', 'tue'], [1, 0])
        """
        known = {
            "sessions": self.sessions[rows],
            "order": None if self.rank is None else np.argsort(self.rank[rows], kind="stable"),
        }
        return asked_for(estimator, known)


def origins_of(data: Dataset) -> Origins:
    """Gather sessions and the order in time of a data set; an order that contradicts itself counts as none."""
    sessions = np.empty(len(data), dtype=object)
    sessions[:] = data.sessions
    try:
        describe_order(data.start_times, data.y, data.names)
    except ValueError:
        return Origins(sessions, None)
    return Origins(sessions, np.argsort(data.chronological_order()[0], kind="stable"))


# Folds that make the choice: the strictest that labels, sessions and order allow.

Rows_folds = npt.NDArray[np.intp]

NONE = "nothing"

# Halves, and not more blocks: a short block lies between neighbours in time that trained, and everything looks good
# on it. What comes next lies as far away as it can here.
_BLOCKS = 2

# Random folds are drawn again until so many rows were held out in all: with 50 rows one in a hundred is less than a
# row, and which rows share a fold decides. Not more often than 10 times: draws of the same rows are alike.
_ENOUGH_ROWS = 500
_MOST_REPEATS = 10


@dataclass(frozen=True, eq=False)
class ChoiceFolds:
    """Folds of training rows.

    Attributes
    ----------
    folds : tuple of (train, test)
        Row numbers.
    held_out : {"sessions", "blocks in time", "random recordings", "nothing"}
        What a fold is.
    note : str
        The same with numbers and reasons, as a line to read.
    """

    folds: tuple[tuple[Rows_folds, Rows_folds], ...]
    held_out: str
    note: str


def choice_folds(
    codes: Rows_folds,
    sessions: Sequence[Any] | npt.NDArray[Any] | None,
    order: npt.ArrayLike | None,
    *,
    n_folds: Any,
    seed: int,
) -> ChoiceFolds:
    """Split training rows.

    Whole sessions are held out where every class has two or more; else the earlier and the later half of each class,
    where the order is known; else stratified random folds, drawn anew until 500 rows were held out, at most 10
    times. The single row of a class always trains. Where fewer than two classes have two rows there are no folds.

    Parameters
    ----------
    codes : ndarray of int, shape (n,)
        Class of each row.
    sessions : sequence of n, or None
        Session of each row; None or "" among them where it is not known.
    order : array-like of int, shape (n,), or None
        Row numbers from the earliest to the latest.
    n_folds : int
        Of sessions and random folds: at least 2, and fewer where the largest class has fewer rows, or sessions.
    seed : int
        Of random folds.

    Returns
    -------
    ChoiceFolds

    Raises
    ------
    TypeError, ValueError
        A number of folds that is none, sessions or an order that do not fit the rows.
    """
    wanted = whole_number("n_folds", n_folds, least=2)
    known = _checked_sessions_folds(sessions, len(codes))
    rank = _checked_rank(order, len(codes))
    counts = np.bincount(codes)
    several = np.flatnonzero(counts[codes] > 1)
    if np.unique(codes[several]).size < 2:
        return ChoiceFolds((), NONE, "no folds: fewer than two classes have more than one recording")
    y = codes[several]
    n_used = min(wanted, int(counts.max()))
    why = why_no_sessions(y, None if known is None else known[several])
    if known is not None and not why:
        parts = session_partitions(y, known[several], max_folds=wanted)
        held_out, note = SESSIONS, f"{len(parts)} folds of whole sessions"
    elif rank is not None:
        parts = block_partitions(y, np.argsort(rank[several], kind="stable"), n_folds=_BLOCKS)
        held_out, note = BLOCKS, f"the earlier and the later half of each class in time ({why})"
    else:
        repeats = min(_MOST_REPEATS, -(-_ENOUGH_ROWS // len(several)))
        seeds = np.random.SeedSequence(seed, spawn_key=(7,)).generate_state(repeats).tolist()
        parts = [part for draw in seeds for part in kfold_partitions(y, n_folds=n_used, seed=draw)]
        times = f", drawn {repeats} times" if repeats > 1 else ""
        held_out, note = RANDOM, f"{n_used} random folds{times} ({why}, and no order in time)"
    if several.size < len(codes):
        n_alone = len(codes) - several.size
        alone = f"{counted(n_alone)} that {verb(n_alone, 'is', 'are')} alone in {verb(n_alone, 'its', 'their')} class"
        note += f"; {alone} always {verb(n_alone, 'trains', 'train')}"
    folds = []
    for part in parts:
        test = several[part.test]
        folds.append((np.setdiff1d(np.arange(len(codes)), test), test))
    return ChoiceFolds(tuple(folds), held_out, note)


def _checked_sessions_folds(sessions: Any, n_rows: int) -> npt.NDArray[Any] | None:
    if sessions is None:
        return None
    if isinstance(sessions, (str, bytes)) or not hasattr(sessions, "__len__"):
        raise TypeError(f"sessions must be a sequence with one session per row, got {sessions!r:.60}")
    if len(sessions) != n_rows:
        raise ValueError(f"sessions must name one session per row of X, {n_rows}, got {len(sessions)}")
    texts = ["" if one is None or one != one else str(one) for one in list(sessions)]  # noqa: PLR0124 - NaN
    return np.array(texts, dtype=np.str_)


def _checked_rank(order: Any, n_rows: int) -> Rows_folds | None:
    if order is None:
        return None
    rows = np.asarray(order)
    if (
        rows.shape != (n_rows,)
        or rows.dtype.kind not in "iu"
        or not np.array_equal(np.sort(rows), np.arange(n_rows))
    ):
        raise ValueError(
            f"order must hold the row numbers 0 to {n_rows - 1}, each once, from the earliest to the latest"
        )
    return np.argsort(rows, kind="stable")


# Folds within folds: the strictest that the recordings allow, at both levels.


@dataclass(frozen=True, eq=False)
class NestedFold:
    """One outer fold, and the inner folds of its training rows.

    Attributes
    ----------
    outer : Partition
        Its tested rows are never seen by the choice that they judge.
    inner : tuple of Partition
        Of ``outer.train``; the rows are those of the data set.
    """

    outer: Partition
    inner: tuple[Partition, ...]


@dataclass(frozen=True, eq=False)
class Folds:
    """All folds of a selection.

    Attributes
    ----------
    nested : tuple of NestedFold
    held_out : {"sessions", "halves in time", "random recordings"}
        What an outer fold is.
    notes : tuple of str
        What kind of folds were used at each level, and why no stricter kind.
    """

    nested: tuple[NestedFold, ...]
    held_out: str
    notes: tuple[str, ...]


def nested_folds(data: Dataset, n_outer: int, n_inner: int, seed: int) -> Folds:
    """Split recordings into outer folds, and the training rows of each into inner folds.

    The rule of `granular_id.splits.strict_partitions` at both levels, among the rows to be split: whole
    sessions where every class has at least two; else halves in time order, both ways; else, without an order in time,
    stratified random folds. Inner folds are halves of the half that trains: a choice that was made on blocks between
    their neighbours in time would be made by another question than the one that judges it.

    Parameters
    ----------
    data : Dataset
        Labels, sessions, start times and names are read.
    n_outer, n_inner : int
        Random folds, at least 2; of sessions at most so many. Halves in time are two.
    seed : int
        Of random folds.

    Returns
    -------
    Folds

    Raises
    ------
    TypeError, ValueError
        Too many folds, a recording without label, one class only, or a class with too few recordings to be held
        out twice.
    """
    splitter = _Splitter(data)
    outer, held_out, outer_note = splitter.split(np.arange(len(data)), "n_outer", n_outer, seed)
    nested, kinds = [], []
    for fold in outer:
        splitter.refuse_single_rows(fold)
        inner, _, note = splitter.split(fold.train, "n_inner", n_inner, seed)
        nested.append(NestedFold(fold, tuple(inner)))
        kinds.append(note)
    notes = [f"outer folds (judge the choice): {outer_note}"]
    notes += [f"inner folds (make the choice): {note}" for note in dict.fromkeys(kinds)]
    return Folds(tuple(nested), held_out, tuple(notes))


class _Splitter:
    """Splits any rows of a data set."""

    def __init__(self, data: Dataset) -> None:
        self._y = data.y
        for label, rows in rows_of_class(self._y).items():
            if rows.size < 3:
                raise ValueError(
                    f"class {label!r} has {counted(rows.size)}; choosing holds out "
                    "twice, one fold inside the other, and needs at least 3 of each class"
                )
        self._sessions, self._names = data.sessions, data.names
        order, _ = data.chronological_order()
        self._rank = np.argsort(order, kind="stable")
        try:
            self._order_note = describe_order(data.start_times, self._y, data.names)
            self._no_order = ""
        except ValueError as why:
            self._no_order = str(why)

    def split(self, rows: Rows, argument: str, n_folds: int, seed: int) -> tuple[list[Partition], str, str]:
        """Return folds of some rows, what they hold out, and a line on why."""
        n_folds = whole_number(argument, n_folds, least=2)
        y = self._y[rows]
        folds, why_not = strict_partitions(
            y,
            self._sessions[rows],
            None if self._no_order else np.argsort(self._rank[rows], kind="stable"),
            no_order=self._no_order,
            max_folds=n_folds,
            names=[self._names[row] for row in rows.tolist()],
        )
        if folds and not why_not:
            return _of_rows(folds, rows), SESSIONS, f"{len(folds)} folds of whole sessions"
        if folds:
            note = f"the earlier and the later half of each class in time, {self._order_note} ({why_not})"
            return _of_rows(folds, rows), HALVES, note
        label, own = max(rows_of_class(y).items(), key=lambda item: item[1].size)
        if n_folds > own.size:
            where = "" if argument == "n_outer" else " that an outer fold leaves,"
            raise ValueError(
                f"{argument} must not exceed the {own.size} recordings of the largest class, {label!r},{where} "
                f"got {n_folds}"
            )
        folds = kfold_partitions(y, n_folds=n_folds, seed=seed)
        return _of_rows(folds, rows), RANDOM, f"{n_folds} random folds ({why_not})"

    def refuse_single_rows(self, fold: Partition) -> None:
        """Refuse an outer fold that leaves a class one training row: it could not be held out again."""
        for label, rows in rows_of_class(self._y[fold.train]).items():
            if rows.size < 2:
                raise ValueError(
                    f"class {label!r} keeps 1 recording to train on in the outer fold {fold.description!r}; "
                    "choosing holds out once more inside it, and needs at least 2"
                )


def _of_rows(folds: list[Partition], rows: Rows) -> list[Partition]:
    return [replace(fold, train=rows[fold.train], test=rows[fold.test]) for fold in folds]

"""Which recordings train and which are tested: the partitions of every protocol.

``paper`` draws random partitions with a fixed number of recordings of each class; it is what the paper reports.
``chronological`` trains on the first half of each class and tests on the second, then the reverse; it asks
whether what was learned survives the passing of time. ``session`` holds out whole sessions, ``kfold`` random
folds (`granular_id.evaluation.folds`). Recordings made minutes apart share tool, fill, zero offset and
temperature, so random partitions flatter a method that has learned the session instead of the material. The
difference between the protocols shows whether that may be so; it also holds whatever else changed with time,
and the smaller training half.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_id._numbers import whole_number
from granular_id._words import counted
from granular_id.evaluation.folds import (
    MAX_SESSION_FOLDS,
    block_partitions,
    kfold_partitions,
    session_partitions,
)
from granular_id.evaluation.partition import (
    PROTOCOLS,
    Partition,
    rows_of_class,
    splittable_rows,
)

__all__ = [
    "PROTOCOLS",
    "Partition",
    "block_partitions",
    "chronological_partitions",
    "describe_order",
    "kfold_partitions",
    "paper_partitions",
    "session_partitions",
    "strict_partitions",
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

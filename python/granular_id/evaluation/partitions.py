"""Which recordings train and which are tested: the partitions of a protocol.

Two protocols exist. ``paper`` draws random partitions with a fixed number of recordings of each class; it is
what the paper reports. ``chronological`` trains on the first half of each class and tests on the second, then
the reverse; it asks whether what was learned survives the passing of time. Recordings made minutes apart
share tool, fill, zero offset and temperature, so random partitions flatter a method that has learned the
session instead of the material. The difference between the two protocols shows whether that may be so; it
also holds whatever else changed with time, and the smaller training half.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "PROTOCOLS",
    "Partition",
    "chronological_partitions",
    "describe_order",
    "paper_partitions",
]

PROTOCOLS = {
    "paper": "random partitions, fixed counts per class",
    "chronological": "one half of each class in time order trains, the other is tested",
}

FORWARD = "1st->2nd half"
BACKWARD = "2nd->1st half"


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
    n_partitions = positive_int("n_partitions", n_partitions)
    train_per_class = positive_int("train_per_class", train_per_class)
    test_per_class = positive_int("test_per_class", test_per_class)
    rows_of_class = _rows_of_class(y)
    wanted = train_per_class + test_per_class
    short = {label: rows.size for label, rows in rows_of_class.items() if rows.size < wanted}
    if short:
        raise ValueError(_too_few(short, train_per_class, test_per_class))
    partitions = []
    for j in range(n_partitions):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(j,)))
        drawn = [rng.permutation(rows)[:wanted] for rows in rows_of_class.values()]
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
    for label, rows in _rows_of_class(y).items():
        if rows.size < 2:
            raise ValueError(
                f"class {label!r} has 1 recording; the chronological protocol halves each class "
                "and needs at least 2"
            )
        in_time = rows[np.argsort(rank[rows])]
        firsts.append(in_time[: rows.size // 2])
        seconds.append(in_time[rows.size // 2 :])
    first, second = np.sort(np.concatenate(firsts)), np.sort(np.concatenate(seconds))
    return [
        Partition("chronological", 0, FORWARD, first, second),
        Partition("chronological", 1, BACKWARD, second, first),
    ]


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


def positive_int(name: str, value: Any) -> int:
    """Return `value` as an int, or say which argument is no whole number of at least 1."""
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise TypeError(f"{name} must be a whole number, got {type(value).__name__} {value!r}")
    if value < 1:
        raise ValueError(f"{name} must be at least 1, got {value}")
    return int(value)


def _rows_of_class(y: ArrayLike) -> dict[Any, NDArray[np.intp]]:
    labels, codes = np.unique(np.asarray(y), return_inverse=True)
    if labels.size < 2:
        have = f"only {labels[0].item()!r}" if labels.size else "none"
        raise ValueError(f"an evaluation needs recordings of at least 2 classes, got {have}")
    return {label: np.flatnonzero(codes == k) for k, label in enumerate(labels.tolist())}


def _too_few(short: dict[Any, int], train: int, test: int) -> str:
    label, has = min(short.items(), key=lambda item: item[1])
    more = len(short) - 1
    others = f", and {more} more {'class has' if more == 1 else 'classes have'} too few" if more else ""
    hint = ""
    if has >= 2:
        fits = min(has - 1, max(1, round(has * train / (train + test))))
        hint = f": pass train_per_class={fits}, test_per_class={has - fits}"
    return (
        f"class {label!r} has {has} recording{'' if has == 1 else 's'}, wanted {train + test} "
        f"({train} to train, {test} to test){others}{hint}"
    )

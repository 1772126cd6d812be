"""From the protocols asked for to partitions of a data set, with a line on how each was drawn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granular_id.evaluation.folds import (
    block_partitions,
    kfold_partitions,
    lone_session,
    session_partitions,
)
from granular_id.evaluation.partition import PROTOCOLS, Partition
from granular_id.evaluation.partitions import (
    chronological_partitions,
    describe_order,
    paper_partitions,
    strict_partitions,
)
from granular_id.recording import Dataset

__all__ = ["AUTO", "pair_partition", "plan_partitions", "plan_protocols", "strictest"]

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

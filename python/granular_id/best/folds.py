"""Folds that make the choice: the strictest that labels, sessions and order allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id._numbers import whole_number
from granular_id._words import counted, verb
from granular_id.evaluation.folds import (
    BLOCKS,
    RANDOM,
    SESSIONS,
    block_partitions,
    kfold_partitions,
    session_partitions,
    why_no_sessions,
)

__all__ = ["NONE", "ChoiceFolds", "choice_folds"]

Rows = npt.NDArray[np.intp]

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

    folds: tuple[tuple[Rows, Rows], ...]
    held_out: str
    note: str


def choice_folds(
    codes: Rows,
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
    known = _checked_sessions(sessions, len(codes))
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


def _checked_sessions(sessions: Any, n_rows: int) -> npt.NDArray[Any] | None:
    if sessions is None:
        return None
    if isinstance(sessions, (str, bytes)) or not hasattr(sessions, "__len__"):
        raise TypeError(f"sessions must be a sequence with one session per row, got {sessions!r:.60}")
    if len(sessions) != n_rows:
        raise ValueError(f"sessions must name one session per row of X, {n_rows}, got {len(sessions)}")
    texts = ["" if one is None or one != one else str(one) for one in list(sessions)]  # noqa: PLR0124 - NaN
    return np.array(texts, dtype=np.str_)


def _checked_rank(order: Any, n_rows: int) -> Rows | None:
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

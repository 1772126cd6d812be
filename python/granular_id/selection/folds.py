"""Folds within folds: the strictest that the recordings allow, at both levels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from granular_id._numbers import whole_number
from granular_id._words import counted
from granular_id.evaluation.folds import HALVES, RANDOM, SESSIONS, kfold_partitions
from granular_id.evaluation.partition import Partition, rows_of_class
from granular_id.evaluation.partitions import describe_order, strict_partitions
from granular_id.recording import Dataset

__all__ = ["Folds", "NestedFold", "nested_folds"]

Rows = NDArray[np.intp]


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

    The rule of `granular_id.evaluation.partitions.strict_partitions` at both levels, among the rows to be split: whole
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

"""One split of a data set, and the checks that all protocols share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["PROTOCOLS", "Partition", "rows_of_class", "splittable_rows"]

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

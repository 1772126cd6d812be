"""Labels of recordings: texts, or numbers that count in a list of names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from granular_id.io.arrays.names import role_of
from granular_id.io.arrays.tree import Origin, n_values, numbers, texts


def labels_of(
    entries: Mapping[str, Any], n: int, origin: Origin, notes: list[str]
) -> list[str | None] | None:
    """Find one label for each of n recordings.

    Parameters
    ----------
    entries : mapping
        Arrays that are called like labels, or like names of classes.
    n : int
        How many recordings (or groups of them) there are.
    notes : list of str
        What was guessed is added.

    Returns
    -------
    list of (str or None), or None
        A label per recording, None for an empty text; None in all when there are no entries.

    Raises
    ------
    RecordingFileError
        Not one per recording, two different lists of labels, numbers that do not fit the names, no labels at all.
    """
    if not entries:
        return None
    words = {name: found for name, node in entries.items() if (found := texts(node)) is not None}
    coded = {
        name: whole_numbers(node, name, origin)
        for name, node in entries.items()
        if name not in words and n_values(node) in (n, None)  # None: refused with its shape
    }
    # a list of names that happens to be as long as the labels is still no list of labels
    named = {k: v for k, v in words.items() if len(v) == n and not (coded and role_of(k) == "class_names")}
    if len({tuple(labels) for labels in named.values()}) > 1 or len(coded) > 1:
        both = ", ".join(named if len(named) > 1 else coded)
        raise origin.unclear(f"{both}: more than one list of labels for {n} recordings; pass label= with one")
    if named:
        return [label or None for label in next(iter(named.values()))]
    if not coded:
        name, node = next(iter(entries.items()))
        raise origin.fault(
            name, f"has {n_values(node)} values for {n} recordings; wanted one label per recording"
        )
    name, code = next(iter(coded.items()))
    lists = {key: names for key, names in words.items() if key not in named}
    if not lists:
        notes.append(f"labels are the numbers in {name}, as texts: no names of classes were found")
        return [str(number) for number in code]
    if len(lists) > 1:
        raise origin.unclear(f"{', '.join(lists)}: more than one list of names for the numbers in {name}")
    key, names = next(iter(lists.items()))
    first = _first_number(code, names, name, key, origin)
    notes.append(f"labels are the numbers in {name}, counted from {first} in {key}")
    return [names[number - first] for number in code]


def whole_numbers(node: Any, name: str, origin: Origin) -> list[int]:
    """Return a list of whole numbers, or refuse what is none; MATLAB keeps them as floating point."""
    array = numbers(node)
    if array is None:
        what = (
            f"has the shape {tuple(node.shape)} and type {node.dtype}"
            if hasattr(node, "shape")
            else "is no list"
        )
        raise origin.fault(name, f"{what}; wanted a text or a whole number per recording")
    if not np.all(np.isfinite(array) & (array == np.floor(array)) & (np.abs(array) < 2**53)):
        raise origin.fault(
            name, "holds numbers that are not whole; wanted a text or a whole number per recording"
        )
    return [int(number) for number in array.tolist()]


def _first_number(code: list[int], names: list[str], name: str, key: str, origin: Origin) -> int:
    """Tell whether numbers count from 0 or 1, as only one of the two fits."""
    low, high = min(code), max(code)
    from_0, from_1 = low >= 0 and high < len(names), low >= 1 and high <= len(names)
    if from_0 and from_1:
        problem = (
            f"runs from {low} to {high}, and {key} has {len(names)} names: whether it counts from 0 or 1"
        )
        raise origin.fault(name, f"{problem} cannot be told; wanted labels as texts")
    if not from_0 and not from_1:
        raise origin.fault(name, f"runs from {low} to {high}, but {key} has {len(names)} names")
    return 0 if from_0 else 1

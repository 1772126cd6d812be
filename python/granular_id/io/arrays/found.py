"""The recordings that were found in a file, as columns; and their labels: texts, or numbers in a list of names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from granular_id._checks import FloatArray
from granular_id.io.arrays.names import role_of
from granular_id.io.arrays.tree import Origin, n_values, numbers, texts


@dataclass
class Found:
    """Some recordings, in order.

    `wrench` holds n recordings (T, C) of finite samples, as an array (n, T, C) where they lie so; `axes` the names of
    their columns; `places` the names of the arrays that they are from; `n_padded` their samples with those that were
    left out as padding; `sizes` how many stood in each array, cell or struct, n in all. `about` has columns of what
    is known, None where it is not: label, session, name, rate, start, trigger, stamps, time_unit, flags, meta, group
    (a label that the name of a group gave).
    """

    wrench: Sequence[FloatArray] | FloatArray
    axes: list[tuple[str, ...]]
    places: list[str]
    n_padded: list[int]
    sizes: list[int]
    about: dict[str, list[Any]] = field(default_factory=dict)

    @classmethod
    def block(
        cls,
        wrench: Sequence[FloatArray] | FloatArray,
        axes: tuple[str, ...],
        place: str,
        n_padded: int | None = None,
    ) -> Found:
        """Return the recordings of one array; `n_padded`: its samples, where some recordings are shorter."""
        n = len(wrench)
        padded = [len(recording) for recording in wrench] if n_padded is None else [n_padded] * n
        return cls(wrench, [axes] * n, [place] * n, padded, [n])

    @classmethod
    def joined(cls, parts: Sequence[Found]) -> Found:
        """Put some behind others."""
        if len(parts) == 1:
            return parts[0]
        columns: dict[str, list[Any]] = {
            name: [item for part in parts for item in getattr(part, name)]
            for name in ("wrench", "axes", "places", "n_padded", "sizes")
        }
        known = dict.fromkeys(name for part in parts for name in part.about)
        about = {name: [value for part in parts for value in part.get(name)] for name in known}
        return cls(**columns, about=about)

    def as_one(self) -> Found:
        """Return them as if all had stood in one array."""
        return replace(self, sizes=[len(self)])

    def __len__(self) -> int:
        return len(self.wrench)

    @property
    def lengths(self) -> list[int]:
        """Samples of each."""
        if isinstance(self.wrench, np.ndarray):
            return [self.wrench.shape[1]] * len(self)
        return [len(wrench) for wrench in self.wrench]

    def cut(self, lengths: Sequence[int]) -> None:
        """Keep the first samples of each."""
        self.wrench = [wrench[:n] for wrench, n in zip(self.wrench, lengths, strict=True)]
        for name in ("stamps", "flags"):
            if name in self.about:
                rows = zip(self.about[name], lengths, strict=True)
                self.about[name] = [None if row is None else row[:n] for row, n in rows]

    def split(self, lengths: Sequence[int]) -> None:
        """Make several recordings of one, in which they lie one behind the other."""
        n, ends = len(lengths), np.cumsum(lengths)[:-1]
        each = {name: column * n for name, column in self.about.items()}
        for name in ("stamps", "flags"):
            if self.about.get(name, [None])[0] is not None:
                each[name] = np.split(self.about[name][0], ends)
        self.wrench, self.n_padded, self.about = np.split(self.wrench[0], ends), list(lengths), each
        self.axes, self.places, self.sizes = self.axes * n, self.places * n, [n]

    def fill(self, attribute: str, column: Sequence[Any]) -> None:
        """Put down what is now known, where nothing was known before."""
        known = self.get(attribute)
        self.about[attribute] = [new if old is None else old for old, new in zip(known, column, strict=True)]

    def get(self, attribute: str) -> list[Any]:
        """Return what is known, None per recording where it is not."""
        return self.about.get(attribute, [None] * len(self))

    def one(self, i: int) -> dict[str, Any]:
        """Return what is known of one recording."""
        return {name: column[i] for name, column in self.about.items() if column[i] is not None}


def labels_of(entries: Mapping[str, Any], n: int, origin: Origin, notes: list[str]) -> list[str | None]:
    """Find one label for each of n recordings (or groups of them), None for an empty text.

    `entries` are called like labels, or like names of classes, by which numbers are labels. Refused are lists that are
    not one per recording, two that differ, and numbers that do not fit the names.
    """
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
        problem = f"has {n_values(node)} values for {n} recordings; wanted one label per recording"
        raise origin.fault(name, problem)
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
    wanted = "wanted a text or a whole number per recording"
    if array is None:
        is_list = hasattr(node, "shape")
        what = f"has the shape {tuple(node.shape)} and type {node.dtype}" if is_list else "is no list"
        raise origin.fault(name, f"{what}; {wanted}")
    if not np.all(np.isfinite(array) & (array == np.floor(array)) & (np.abs(array) < 2**53)):
        raise origin.fault(name, f"holds numbers that are not whole; {wanted}")
    return [int(number) for number in array.tolist()]


def _first_number(code: list[int], names: list[str], name: str, key: str, origin: Origin) -> int:
    """Tell whether numbers count from 0 or 1, as only one of the two fits."""
    low, high = min(code), max(code)
    from_0, from_1 = low >= 0 and high < len(names), low >= 1 and high <= len(names)
    if from_0 and from_1:
        problem = f"runs from {low} to {high}, and {key} has {len(names)} names"
        raise origin.fault(
            name, f"{problem}: whether it counts from 0 or 1 cannot be told; wanted labels as texts"
        )
    if not from_0 and not from_1:
        raise origin.fault(name, f"runs from {low} to {high}, but {key} has {len(names)} names")
    return 0 if from_0 else 1

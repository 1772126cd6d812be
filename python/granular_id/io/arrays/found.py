"""The recordings that were found in a file, and their labels: texts, or numbers in a list of names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from granular_id._checks import FloatArray
from granular_id.io.arrays.names import role_of
from granular_id.io.arrays.tree import Origin, n_values, numbers, texts


@dataclass
class Push:
    """One recording (T, C) of finite samples, the names of its columns, and the array that it is from.

    `n_padded` counts its samples with those that were left out as padding. `about` is what is known: label, session,
    name, rate, start, trigger, stamps, time_unit, flags, meta, group (a label that the name of a group gave).
    """

    wrench: FloatArray
    axes: tuple[str, ...]
    place: str
    n_padded: int
    about: dict[str, Any] = field(default_factory=dict)

    def cut(self, start: int, end: int) -> Push:
        """Return some samples of it, as a recording without padding."""
        per_sample = {k: v[start:end] for k, v in self.about.items() if k in ("stamps", "flags")}
        return Push(self.wrench[start:end], self.axes, self.place, end - start, {**self.about, **per_sample})


@dataclass
class Found:
    """Some recordings, in order; `sizes`: how many stood in each array, cell or struct."""

    pushes: list[Push]
    sizes: list[int]

    @classmethod
    def joined(cls, parts: Sequence[Found]) -> Found:
        """Put some behind others."""
        return cls(
            [push for part in parts for push in part.pushes], [n for part in parts for n in part.sizes]
        )

    def as_one(self) -> Found:
        """Return them as if all had stood in one array."""
        return Found(self.pushes, [len(self)])

    def __len__(self) -> int:
        return len(self.pushes)

    def fill(self, attribute: str, column: Sequence[Any]) -> None:
        """Put down what is now known, where nothing was known before."""
        for push, value in zip(self.pushes, column, strict=True):
            if value is not None:
                push.about.setdefault(attribute, value)

    def get(self, attribute: str) -> list[Any]:
        """Return what is known, None per recording where it is not."""
        return [push.about.get(attribute) for push in self.pushes]


def labels_of(entries: Mapping[str, Any], n: int, origin: Origin) -> list[str | None]:
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
        origin.note(f"labels are the numbers in {name}, as texts: no names of classes were found")
        return [str(number) for number in code]
    if len(lists) > 1:
        raise origin.unclear(f"{', '.join(lists)}: more than one list of names for the numbers in {name}")
    key, names = next(iter(lists.items()))
    # numbers count from 0 or from 1 where only one of the two fits
    fits = [first for first in (0, 1) if min(code) >= first and max(code) < len(names) + first]
    if len(fits) != 1:
        problem = f"runs from {min(code)} to {max(code)}, but {key} has {len(names)} names"
        both = ": whether it counts from 0 or 1 cannot be told; wanted labels as texts"
        raise origin.fault(name, problem + (both if fits else ""))
    origin.note(f"labels are the numbers in {name}, counted from {fits[0]} in {key}")
    return [names[number - fits[0]] for number in code]


def whole_numbers(node: Any, name: str, origin: Origin) -> list[int]:
    """Return a list of whole numbers, or refuse what is none; MATLAB keeps them as floating point."""
    array = numbers(node)
    wanted = "wanted a text or a whole number per recording"
    if array is None:
        is_array = hasattr(node, "shape")
        what = f"has the shape {tuple(node.shape)} and type {node.dtype}" if is_array else "is no list"
        raise origin.fault(name, f"{what}; {wanted}")
    if not np.all(np.isfinite(array) & (array == np.floor(array)) & (np.abs(array) < 2**53)):
        raise origin.fault(name, f"holds numbers that are not whole; {wanted}")
    return [int(number) for number in array.tolist()]

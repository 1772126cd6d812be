"""What stands beside recordings in a file, put onto each: labels, sessions, rates, stamps, flags, metadata."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.arrays.labels import labels_of, whole_numbers
from granular_id.io.arrays.names import Role
from granular_id.io.arrays.tree import Origin, contents, is_leaf, is_numbers, n_values, numbers, texts, values
from granular_id.io.flat_checks import NO_TRIGGER
from granular_id.recording._values import FloatArray

Entries = dict[Role, dict[str, Any]]
"""What the entries of a level are for, by their names: role, then name to node."""

_LONGEST_TEXT = 1000
"""Characters of a text that is kept in ``meta``."""


@dataclass
class Found:
    """One recording of a file.

    Attributes
    ----------
    wrench : ndarray, shape (T, C)
        Finite samples.
    axes : tuple of str
        Names of its columns.
    place : str
        Name of the array.
    n_padded : int
        Samples with those that were left out as padding.
    about : dict
        What is known: label, session, name, rate, start, trigger, stamps, flags, meta; what is not is missing.
    """

    wrench: FloatArray
    axes: tuple[str, ...]
    place: str
    n_padded: int
    about: dict[str, Any] = field(default_factory=dict)


def add_details(
    groups: list[list[Found]], entries: Entries, rest: Mapping[str, Any], origin: Origin, notes: list[str]
) -> None:
    """Put onto recordings what their level of the file says, where no inner level said it already.

    Parameters
    ----------
    groups : list of lists of Found
        The recordings below that level, by array or cell.
    entries : dict
        What is known by name.
    rest : mapping
        Everything else: single values go into ``meta``, what is not used is said.
    """
    every = [found for group in groups for found in group]
    if not every:
        return
    _add_labels(groups, every, entries, origin, notes)
    for role, (attribute, read) in _READERS.items():
        for name, node in entries.get(role, {}).items():
            if n_values(node) == 1 and len(every) > 1 and role in _NEVER_SHARED:
                rest = {**rest, name: node}  # it is about the file
            else:
                _set(every, attribute, _spread(read(node, name, origin), len(every), name, origin))
    for name, node in entries.get("rate", {}).items():
        rates = numbers(node)
        if rates is None or not len(rates):
            raise origin.fault(name, "is no sampling rate; wanted a number in Hz, or one per recording")
        _set(every, "rate", _spread([float(rate) for rate in rates], len(every), name, origin))
    for name, node in entries.get("time", {}).items():
        _set(every, "stamps", _rows(node, every, name, origin))
    for name, node in entries.get("flags", {}).items():
        _set(every, "flags", _rows(node, every, name, origin))
    _add_meta(every, rest, notes)


def _add_labels(
    groups: list[list[Found]], every: list[Found], entries: Entries, origin: Origin, notes: list[str]
) -> None:
    lists = {**entries.get("labels", {}), **entries.get("class_names", {})}
    if all("label" in found.about for found in every):
        return
    lengths = {n_values(node) for node in lists.values()}
    if len(groups) > 1 and len(groups) in lengths and len(every) not in lengths:
        labels = labels_of(lists, len(groups), origin, notes) or []
        for group, label in zip(groups, labels, strict=True):
            _set(group, "label", [label] * len(group))
    elif lists:
        if lengths == {1}:  # one label for all, as in a file per material
            lists = {name: node if len(every) == 1 else [node] * len(every) for name, node in lists.items()}
        _set(every, "label", labels_of(lists, len(every), origin, notes) or [])


def _set(every: list[Found], attribute: str, column: list[Any]) -> None:
    for found, value in zip(every, column, strict=True):
        if value is not None:
            found.about.setdefault(attribute, value)


def _spread(column: list[Any], n: int, name: str, origin: Origin) -> list[Any]:
    if len(column) == n:
        return column
    if len(column) == 1:
        return column * n
    raise origin.fault(
        name, f"has {len(column)} values for {n} recordings; wanted one per recording, or one for all"
    )


def _words(node: Any, name: str, origin: Origin) -> list[Any]:
    words = texts(node)
    if words is None:
        words = [str(number) for number in whole_numbers(node, name, origin)]
    return [word or None for word in words]


def _start_times(node: Any, name: str, origin: Origin) -> list[Any]:
    array = numbers(node)
    if array is None:
        raise origin.fault(name, "does not hold numbers; wanted seconds since 1970 per recording")
    return [None if math.isnan(value) else float(value) for value in array.tolist()]


def _triggers(node: Any, name: str, origin: Origin) -> list[Any]:
    return [None if index == NO_TRIGGER else index for index in whole_numbers(node, name, origin)]


_READERS: dict[Role, tuple[str, Callable[[Any, str, Origin], list[Any]]]] = {
    "sessions": ("session", _words),
    "names": ("name", _words),
    "start": ("start", _start_times),
    "trigger": ("trigger", _triggers),
}

_NEVER_SHARED: tuple[Role, ...] = ("names", "start")
"""What two recordings do not have in common."""


def _rows(node: Any, every: list[Found], name: str, origin: Origin) -> list[NDArray[Any]]:
    """Return a list of values per recording: one for all, the rows or columns of a matrix, or a cell for each."""
    n = len(every)
    if isinstance(node, list):
        cells = [numbers(item) for item in node]
        rows = [cell for cell in cells if cell is not None]
        if len(rows) != n or len(cells) != n:
            raise origin.fault(name, f"holds {len(cells)} lists for {n} recordings; wanted numbers for each")
    elif not is_numbers(node):
        raise origin.fault(name, "does not hold numbers")
    elif n_values(node) is not None:
        rows = [values(node).reshape(-1)] * n
    else:
        matrix = values(node)
        if matrix.ndim == 2 and matrix.shape[0] != n and matrix.shape[1] == n:
            matrix = matrix.T
        if matrix.ndim != 2 or len(matrix) != n:
            raise origin.fault(
                name, f"has the shape {matrix.shape} for {n} recordings; wanted a row for each"
            )
        rows = list(matrix)
    for i, (row, found) in enumerate(zip(rows, every, strict=True)):
        n_samples = len(found.wrench)
        if len(row) not in (n_samples, found.n_padded):
            problem = f"has {len(row)} values for the {n_samples} samples of recording {i} in {found.place}"
            raise origin.fault(name, problem)
    return [row[: len(found.wrench)] for row, found in zip(rows, every, strict=True)]


def _add_meta(every: list[Found], rest: Mapping[str, Any], notes: list[str]) -> None:
    kept: dict[str, Any] = {}
    unread: dict[str, Any] = {}
    for name, node in rest.items():
        value = _single(node)
        (unread if value is None else kept)[name] = node if value is None else value
    for found in every if kept else ():
        found.about["meta"] = {
            **{name.rpartition("/")[2]: kept[name] for name in kept},
            **found.about.get("meta", {}),
        }
    if kept:
        notes.append(f"kept in meta: {', '.join(kept)}")
    if unread:
        notes.append(f"not used: {contents(unread)}")
    for name, node in unread.items():
        if len(texts(node) or ()) == len(every) > 1 and not any("label" in found.about for found in every):
            notes.append(f"{name} holds a text per recording: if it names the materials, save it as labels")


def _single(node: Any) -> str | float | int | None:
    if isinstance(node, str):
        return node if len(node) <= _LONGEST_TEXT else None
    if not is_leaf(node) or math.prod(node.shape) != 1 or np.dtype(node.dtype).kind not in "iufU":
        return None
    value = values(node).reshape(-1)[0].item()
    if isinstance(value, str):
        return _single(value)
    return value if math.isfinite(value) else None

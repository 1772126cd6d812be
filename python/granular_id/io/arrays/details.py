"""What stands beside recordings in a file, put onto each: labels, sessions, rates, stamps, flags, metadata."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.arrays.found import Found
from granular_id.io.arrays.labels import labels_of, whole_numbers
from granular_id.io.arrays.names import Role
from granular_id.io.arrays.tree import Origin, contents, is_leaf, is_numbers, n_values, numbers, texts, values
from granular_id.io.flat_checks import NO_TRIGGER

Entries = dict[Role, dict[str, Any]]
"""What the entries of a level are for, by their names: role, then name to node."""

_LONGEST_TEXT = 1000
"""Characters of a text that is kept in ``meta``."""


def add_details(
    found: Found, entries: Entries, rest: Mapping[str, Any], origin: Origin, notes: list[str]
) -> None:
    """Put onto recordings what their level of the file says, where no inner level said it already.

    Parameters
    ----------
    found : Found
        The recordings below that level.
    entries : dict
        What is known by name.
    rest : mapping
        Everything else: single values go into ``meta``, what is not used is said.
    """
    n = len(found)
    if not n:
        return
    _add_labels(found, entries, origin, notes)
    for role, (attribute, read) in _READERS.items():
        for name, node in entries.get(role, {}).items():
            if n_values(node) == 1 and n > 1 and role in _NEVER_SHARED:
                rest = {**rest, name: node}  # it is about the file
            else:
                found.fill(attribute, _spread(read(node, name, origin), n, name, origin))
    for name, node in entries.get("rate", {}).items():
        rates = numbers(node)
        if rates is None or not len(rates):
            raise origin.fault(name, "is no sampling rate; wanted a number in Hz, or one per recording")
        found.fill("rate", _spread([float(rate) for rate in rates], n, name, origin))
    for name, node in entries.get("time", {}).items():
        found.fill("stamps", _rows(node, found, name, origin))
    for name, node in entries.get("flags", {}).items():
        found.fill("flags", _rows(node, found, name, origin))
    _add_meta(found, rest, notes)


def _add_labels(found: Found, entries: Entries, origin: Origin, notes: list[str]) -> None:
    lists = {**entries.get("labels", {}), **entries.get("class_names", {})}
    n = len(found)
    if not lists or None not in found.get("label"):
        return
    lengths = {n_values(node) for node in lists.values()}
    n_groups = len(found.sizes)
    if n_groups > 1 and n_groups in lengths and n not in lengths:
        labels = labels_of(lists, n_groups, origin, notes) or []
        found.fill(
            "label",
            [label for label, size in zip(labels, found.sizes, strict=True) for _ in range(size)],
        )
        return
    if lengths == {1}:  # one label for all, as in a file per material
        lists = {name: node if n == 1 else [node] * n for name, node in lists.items()}
    found.fill("label", labels_of(lists, n, origin, notes) or [])


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


def _rows(node: Any, found: Found, name: str, origin: Origin) -> list[NDArray[Any]]:
    """Return a list of values per recording: one for all, the rows or columns of a matrix, or a cell for each."""
    n = len(found)
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
    lengths = found.lengths
    for i, (row, n_samples) in enumerate(zip(rows, lengths, strict=True)):
        if len(row) not in (n_samples, found.n_padded[i]):
            problem = (
                f"has {len(row)} values for the {n_samples} samples of recording {i} in {found.places[i]}"
            )
            raise origin.fault(name, problem)
    return [row[:n_samples] for row, n_samples in zip(rows, lengths, strict=True)]


def _add_meta(found: Found, rest: Mapping[str, Any], notes: list[str]) -> None:
    kept: dict[str, Any] = {}
    unread: dict[str, Any] = {}
    for name, node in rest.items():
        value = _single(node)
        (unread if value is None else kept)[name] = node if value is None else value
    if kept:
        shared = {name.rpartition("/")[2]: kept[name] for name in kept}
        found.about["meta"] = [{**shared, **inner} if inner else shared for inner in found.get("meta")]
        notes.append(f"kept in meta: {', '.join(kept)}")
    if unread:
        notes.append(f"not used: {contents(unread)}")
    for name, node in unread.items():
        if len(texts(node) or ()) == len(found) > 1 and not any(found.get("label")):
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

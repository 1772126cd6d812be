"""Find the recordings in a tree of named arrays, and what stands beside them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from granular_id.io.arrays.axes import (
    Known,
    cut_padding,
    recordings_samples_axes,
    refuse_gaps,
    samples_axes,
)
from granular_id.io.arrays.details import Entries, add_details
from granular_id.io.arrays.found import Found
from granular_id.io.arrays.names import Role, is_general, label_of_name, role_of, without_tables
from granular_id.io.arrays.parts import THREE, Halves, axis_arrays, halves_of, in_parts, only_halves
from granular_id.io.arrays.tree import MAX_DEPTH, Origin, as_tree, has_axis, is_leaf, n_values, texts, values
from granular_id.io.bulk import row_major
from granular_id.recording._values import FloatArray

_ONE_PER_RECORDING: tuple[Role, ...] = (
    "labels",
    "class_names",
    "sessions",
    "names",
    "rate",
    "start",
    "trigger",
)

_MEANINGS = ("recordings", "samples", "axes")

_FIRST = 3
"""Items of a list that are looked at to tell what it holds."""


@dataclass
class Search:
    """A search through one tree.

    Attributes
    ----------
    origin : Origin
    notes : list of str
        What was guessed.
    """

    origin: Origin
    notes: list[str] = field(default_factory=list)

    def level(self, tree: Mapping[str, Any], name: str, known: Known, outer: Entries, depth: int) -> Found:
        """Return the recordings of a struct, group or archive, with what it says about them.

        Parameters
        ----------
        tree : mapping
        name : str
            Its path; empty for the whole file.
        known : Known
            What enclosing levels say about shapes.
        outer : dict
            Names of classes that an enclosing level has.
        depth : int
            Levels around this one.
        """
        entries, others = self._entries(tree, name)
        if "class_names" not in entries and "class_names" in outer:
            entries["class_names"] = outer["class_names"]
        known = self._known(entries, known)
        vectors = axis_arrays(others, self.origin)
        samples = without_tables(
            {k: node for k, node in others.items() if k not in vectors and self._holds(node, known, depth)},
            len(known.axes),
            beside_parts=in_parts(others),
        )
        if only_halves(samples):
            samples = {}
        halves = None if samples or vectors else halves_of(others, self.origin)
        used: Collection[str] = samples
        if vectors and not samples:
            wrench, used = self._stacked(vectors, name), vectors
            found = self._array(wrench, _path(name, "fx ... tz"), known, sensor_last=True)
        elif halves is not None:
            found, used = self._joined(halves, name, known), (halves.force, halves.torque)
        else:
            found = self._several(samples, name, known, entries, depth)
        rest = {_path(name, key): node for key, node in others.items() if key not in used}
        add_details(found, entries, rest, self.origin, self.notes)
        return found

    def _entries(self, tree: Mapping[str, Any], name: str) -> tuple[Entries, dict[str, Any]]:
        entries: Entries = {}
        others: dict[str, Any] = {}
        for key, raw in tree.items():
            node, role = as_tree(raw), role_of(key)
            if role is None or isinstance(node, Mapping):
                others[key] = node
            else:
                entries.setdefault(role, {})[_path(name, key)] = node
        return entries, others

    def _known(self, entries: Entries, outer: Known) -> Known:
        axes = outer.axes
        for key, node in entries.get("axes", {}).items():
            named = texts(node)
            if named is None:
                raise self.origin.fault(key, "does not hold names of axes; wanted a text per axis")
            axes = tuple(named)
        each = {n_values(node) for role in _ONE_PER_RECORDING for node in entries.get(role, {}).values()}
        times = {n_values(node) for node in entries.get("time", {}).values() if is_leaf(node)}
        each |= {len(node) for node in entries.get("time", {}).values() if isinstance(node, list)}
        several = frozenset(n for n in each if n is not None and n > 1)
        stamps = frozenset(n for n in times if n is not None and n > 1)
        return Known(axes, outer.n_recordings | several, outer.n_samples | stamps)

    def _holds(self, node: Any, known: Known, depth: int) -> bool:
        """Tell whether a node holds recordings, going by shapes alone."""
        if depth > MAX_DEPTH:
            raise self.origin.unclear(f"structs or lists lie more than {MAX_DEPTH} deep in each other")
        node = as_tree(node)
        if isinstance(node, Mapping):
            items = {key: as_tree(item) for key, item in node.items()}
            return in_parts(items) or any(
                self._holds(item, known, depth + 1) for key, item in items.items() if role_of(key) is None
            )
        if isinstance(node, list):
            return any(self._holds(item, known, depth + 1) for item in node[:_FIRST])
        return has_axis(node, len(known.axes))

    def _several(
        self, samples: Mapping[str, Any], name: str, known: Known, entries: Entries, depth: int
    ) -> Found:
        if len(samples) == 1:
            key, node = next(iter(samples.items()))
            found = self._node(node, _path(name, key), known, entries, depth)
            if name and not isinstance(node, list) and found.sizes == [1] and not is_general(key):
                # rice/1, which others would be called that have rice/2 beside them
                found.fill("name", [_path(name, key)])
            return found
        groups = []
        for key, node in samples.items():
            if is_general(key):
                raise self.origin.unclear(
                    f"{' and '.join(map(repr, list(samples)[:5]))} may all be the recordings"
                )
            inner = self._node(node, _path(name, key), known, {}, depth)
            groups.append((key, inner.as_one()))
        single = all(len(found) == 1 for _, found in groups)
        if not single and "labels" in entries:
            both = f"labels in {next(iter(entries['labels']))}, and recordings under names of their own"
            raise self.origin.unclear(f"{both} ({', '.join(list(samples)[:5])})")
        alone = single and "labels" not in entries and all(_numbered_in(name, *group) for group in groups)
        self._name(groups, name, single and not alone)
        return Found.joined([found for _, found in groups])

    def _name(self, groups: list[tuple[str, Found]], level: str, single: bool) -> None:
        """Take the names of several arrays as names of recordings, or as labels of what they hold."""
        numbered = all(label_of_name(key) is not None for key, _ in groups)
        for key, found in groups:
            if single:
                found.fill("name", [_path(level, key)])
            if not single or numbered:
                found.fill("label", [label_of_name(key) if single else key] * len(found))
        if not groups:
            return
        keys = ", ".join(key for key, _ in groups[:3]) + (", ..." if len(groups) > 3 else "")
        what = "labels" if not single else "names"
        part = ", and the part before the number as label" if single and numbered else ""
        self.notes.append(f"{keys} taken as {what} of the recordings in them{part}")

    def _node(self, node: Any, name: str, known: Known, entries: Entries, depth: int) -> Found:
        if isinstance(node, Mapping):
            inherited: Entries = {role: found for role, found in entries.items() if role == "class_names"}
            return self.level(node, name, known, inherited, depth + 1)
        if isinstance(node, list):
            return self._list(node, name, known, entries, depth)
        array = values(node)
        finite = getattr(node, "finite", False)  # some are looked at while they are read
        return self._array(array, name, known, finite=finite)

    def _list(self, items: list[Any], name: str, known: Known, entries: Entries, depth: int) -> Found:
        items = [as_tree(item) for item in self._turned(items, known)]
        cells: list[Found] = []
        for i, item in enumerate(items):
            place = f"{name}[{i}]"
            if not self._holds(item, known, depth + 1):
                raise self.origin.fault(place, f"is no recording: wanted (samples, {len(known.axes)})")
            inner = self._node(item, place, known, entries if isinstance(item, Mapping) else {}, depth + 1)
            cells.append(inner.as_one())
        return _cells(cells)

    def _turned(self, items: list[Any], known: Known) -> list[Any]:
        """Turn a table of cells whose columns, not rows, there is one label for."""
        widths = {len(item) if isinstance(item, list) else 0 for item in items}
        if (
            len(widths) != 1
            or 0 in widths
            or len(items) in known.n_recordings
            or not widths <= known.n_recordings
        ):
            return items
        return [list(column) for column in zip(*items, strict=True)]

    def _stacked(self, vectors: Mapping[str, Any], name: str) -> FloatArray:
        arrays = [self._floats(values(node), _path(name, key)) for key, node in vectors.items()]
        flat = [array.reshape(-1) if n_values(array) is not None else array for array in arrays]
        if len({array.shape for array in flat}) > 1:
            shapes = ", ".join(f"{key} {array.shape}" for key, array in zip(vectors, flat, strict=True))
            raise self.origin.unclear(f"the axes differ in shape: {shapes}")
        return np.stack(flat, axis=-1)

    def _joined(self, halves: Halves, level: str, known: Known) -> Found:
        """Put torques behind forces, of one array or of each item of two lists."""
        three = replace(known, axes=THREE)
        listed = isinstance(halves.pair[0], list)
        cells: list[Found] = []
        for i, pair in enumerate(halves.items(self.origin)):
            place = _path(level, halves.name) + (f"[{i}]" if listed else "")
            sides = [
                self._ordered(self._floats(values(node), _path(level, key)), place, three)
                for node, key in zip(pair, (halves.force, halves.torque), strict=True)
            ]
            cells.append(self._found(np.concatenate(sides, axis=-1), place, known))
        self._note(f"{halves.name} joined: forces, then torques")
        return _cells(cells) if listed else Found.joined(cells)

    def _array(
        self, raw: Any, name: str, known: Known, *, sensor_last: bool = False, finite: bool = False
    ) -> Found:
        array = self._floats(raw, name)
        ordered = self._ordered(array, name, known, sensor_last=sensor_last)
        return self._found(ordered, name, known, finite=finite and array is raw)

    def _ordered(
        self, array: FloatArray, name: str, known: Known, *, sensor_last: bool = False
    ) -> FloatArray:
        """Return an array as (samples, axes) or (recordings, samples, axes), and note what it was taken for."""
        order: tuple[int, ...] = (1, 0)
        if array.ndim == 2:
            if sensor_last or not samples_axes(array.shape, known, name, self.origin):
                return array
        elif array.ndim == 3:
            order = recordings_samples_axes(array.shape, known, name, self.origin, sensor_last=sensor_last)
        else:
            raise self.origin.unclear(f"{self.origin.describe} {name} has the shape {array.shape}")
        meaning = ", ".join(_MEANINGS[-array.ndim :][order.index(axis)] for axis in range(array.ndim))
        self._note(f"{name} {array.shape} taken as {meaning}")
        ordered: FloatArray = array.transpose(order)
        return ordered

    def _found(self, array: FloatArray, name: str, known: Known, *, finite: bool = False) -> Found:
        if array.ndim == 2:
            refuse_gaps(array, known.axes, name, self.origin)
            return Found.block([array], known.axes, name)
        block = row_major(array)
        recordings = block if finite else cut_padding(block, known.axes, name, self.origin)
        if recordings is not block:
            cut = sum(len(recording) < block.shape[1] for recording in recordings)
            self._note(f"{name}: NaN at the end of {cut} recordings taken as padding and left out")
        return Found.block(recordings, known.axes, name, block.shape[1])

    def _floats(self, raw: Any, name: str) -> FloatArray:
        array = np.asarray(raw)
        if array.dtype.kind not in "iuf":
            raise self.origin.fault(name, f"has dtype {array.dtype}; wanted real numbers")
        with np.errstate(over="ignore", invalid="ignore"):  # what is no number is refused as such
            return array.astype(np.float64, copy=False)  # as it lies in memory, to be copied once

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _cells(cells: Sequence[Found]) -> Found:
    """Put the recordings of cells one behind the other: as one list, where each cell holds one."""
    joined = Found.joined(cells)
    return joined.as_one() if all(len(cell) == 1 for cell in cells) else joined


def _numbered_in(level: str, key: str, found: Found) -> bool:
    """Tell whether a group without a number holds one recording with one: ``rice/rice_1``, the only one of rice."""
    named = str(found.get("name")[0] or "")
    return named.startswith(f"{_path(level, key)}/") and named[-1].isdecimal() and not key[-1:].isdecimal()


def _path(level: str, key: str) -> str:
    return f"{level}/{key}" if level else key

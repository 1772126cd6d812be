"""Find the recordings in a tree of named arrays, and what stands beside them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from granular_id.io.arrays.axes import (
    Known,
    cut_padding,
    recordings_samples_axes,
    refuse_gaps,
    row_major,
    samples_axes,
)
from granular_id.io.arrays.details import Entries, Found, add_details
from granular_id.io.arrays.names import Role, is_general, label_of_name, role_of
from granular_id.io.arrays.tree import MAX_DEPTH, Origin, as_tree, is_leaf, n_values, texts, values
from granular_id.io.columns import axis_of
from granular_id.recording import AXES
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

Groups = list[list[Found]]
"""Recordings, in one list for each array, cell or struct that they stood in."""


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

    def level(self, tree: Mapping[str, Any], name: str, known: Known, outer: Entries, depth: int) -> Groups:
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
        samples = _without_tables(
            {key: node for key, node in others.items() if self._holds(node, known, depth)}, len(known.axes)
        )
        columns = self._columns(others, name)
        if columns is not None and not samples:
            groups = [self._array(columns, _path(name, "fx ... tz"), known, sensor_last=True)]
            others = {key: node for key, node in others.items() if axis_of(key) not in AXES}
        else:
            groups = self._groups(samples, name, known, entries, depth)
        rest = {_path(name, key): node for key, node in others.items() if key not in samples}
        add_details(groups, entries, rest, self.origin, self.notes)
        return groups

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
            if set(AXES) <= {axis_of(key) for key in items}:
                return True
            return any(
                self._holds(item, known, depth + 1) for key, item in items.items() if role_of(key) is None
            )
        if isinstance(node, list):
            return any(self._holds(item, known, depth + 1) for item in node[:_FIRST])
        if not is_leaf(node) or np.dtype(node.dtype).kind not in "iufc" or n_values(node) is not None:
            return False
        return len(node.shape) in (2, 3) and len(known.axes) in node.shape and 0 not in node.shape

    def _groups(
        self, samples: Mapping[str, Any], name: str, known: Known, entries: Entries, depth: int
    ) -> Groups:
        if len(samples) == 1:
            key, node = next(iter(samples.items()))
            found = self._node(node, _path(name, key), known, entries, depth)
            if name and is_leaf(node) and len(node.shape) == 2 and not is_general(key):
                # rice/1, which others would be called that have rice/2 beside them
                found[0][0].about["name"] = _path(name, key)
            return found
        groups = []
        for key, node in samples.items():
            if is_general(key):
                raise self.origin.unclear(
                    f"{' and '.join(map(repr, list(samples)[:5]))} may all be the recordings"
                )
            inner = [
                found for group in self._node(node, _path(name, key), known, {}, depth) for found in group
            ]
            groups.append((key, inner))
        single = all(len(found) == 1 for _, found in groups)
        if not single and "labels" in entries:
            both = f"labels in {next(iter(entries['labels']))}, and recordings under names of their own"
            raise self.origin.unclear(f"{both} ({', '.join(list(samples)[:5])})")
        self._name(groups, name, single)
        return [found for _, found in groups]

    def _name(self, groups: list[tuple[str, list[Found]]], level: str, single: bool) -> None:
        """Take the names of several arrays as names of recordings, or as labels of what they hold."""
        numbered = all(label_of_name(key) is not None for key, _ in groups)
        for key, group in groups:
            for found in group:
                if single:
                    found.about.setdefault("name", _path(level, key))
                if not single or numbered:
                    found.about.setdefault("label", label_of_name(key) if single else key)
        if not groups:
            return
        keys = ", ".join(key for key, _ in groups[:3]) + (", ..." if len(groups) > 3 else "")
        what = "labels" if not single else "names"
        part = ", and the part before the number as label" if single and numbered else ""
        self.notes.append(f"{keys} taken as {what} of the recordings in them{part}")

    def _node(self, node: Any, name: str, known: Known, entries: Entries, depth: int) -> Groups:
        if isinstance(node, Mapping):
            inherited: Entries = {role: found for role, found in entries.items() if role == "class_names"}
            return self.level(node, name, known, inherited, depth + 1)
        if isinstance(node, list):
            return self._list(node, name, known, entries, depth)
        return [self._array(values(node), name, known)]

    def _list(self, items: list[Any], name: str, known: Known, entries: Entries, depth: int) -> Groups:
        items = [as_tree(item) for item in self._turned(items, known)]
        groups: Groups = []
        for i, item in enumerate(items):
            place = f"{name}[{i}]"
            if not self._holds(item, known, depth + 1):
                raise self.origin.fault(place, f"is no recording: wanted (samples, {len(known.axes)})")
            inner = self._node(item, place, known, entries if isinstance(item, Mapping) else {}, depth + 1)
            groups.append([found for group in inner for found in group])
        single = all(len(group) == 1 for group in groups)
        return [[found for group in groups for found in group]] if single else groups

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

    def _columns(self, others: Mapping[str, Any], name: str) -> FloatArray | None:
        """Stack six arrays called fx ... tz, where they are there."""
        found: dict[str, tuple[str, Any]] = {}
        for key, node in others.items():
            axis = axis_of(key)
            if axis in AXES and is_leaf(node) and axis is not None:
                if axis in found:
                    raise self.origin.unclear(f"{found[axis][0]!r} and {key!r} both mean {axis}")
                found[axis] = (key, node)
        if len(found) < len(AXES):
            return None
        arrays = {axis: self._floats(values(found[axis][1]), _path(name, found[axis][0])) for axis in AXES}
        flat = [array.reshape(-1) if n_values(array) is not None else array for array in arrays.values()]
        if len({array.shape for array in flat}) > 1:
            shapes = ", ".join(
                f"{found[axis][0]} {array.shape}" for axis, array in zip(AXES, flat, strict=True)
            )
            raise self.origin.unclear(f"the axes differ in shape: {shapes}")
        return np.stack(flat, axis=-1)

    def _array(self, raw: Any, name: str, known: Known, *, sensor_last: bool = False) -> list[Found]:
        array = self._floats(raw, name)
        if array.ndim == 2:
            turned = not sensor_last and samples_axes(array.shape, known, name, self.origin)
            if turned:
                self._note(f"{name} {array.shape} taken as axes, samples")
            wrench = array.T if turned else array
            refuse_gaps(wrench, known.axes, name, self.origin)
            return [Found(wrench, known.axes, name, len(wrench))]
        if array.ndim != 3:
            raise self.origin.unclear(f"{self.origin.describe} {name} has the shape {array.shape}")
        order = recordings_samples_axes(array.shape, known, name, self.origin)
        meaning = ", ".join(_MEANINGS[order.index(axis)] for axis in range(3))
        self._note(f"{name} {array.shape} taken as {meaning}")
        block = row_major(array.transpose(order))
        recordings = cut_padding(block, known.axes, name, self.origin)
        cut = sum(len(recording) < block.shape[1] for recording in recordings)
        if cut:
            self._note(f"{name}: NaN at the end of {cut} recordings taken as padding and left out")
        return [Found(recording, known.axes, name, block.shape[1]) for recording in recordings]

    def _floats(self, raw: Any, name: str) -> FloatArray:
        array = np.asarray(raw)
        if array.dtype.kind not in "iuf":
            raise self.origin.fault(name, f"has dtype {array.dtype}; wanted real numbers")
        with np.errstate(over="ignore", invalid="ignore"):  # what is no number is refused as such
            return array.astype(np.float64, copy=False)  # as it lies in memory, to be copied once

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _without_tables(samples: dict[str, Any], n_axes: int) -> dict[str, Any]:
    """Leave out what only looks like samples beside the recordings: calibration matrices, ranges, means per sample.

    Square matrices are left out wherever there is anything else; others of two dimensions where an array or list of
    recordings has a general name (``X``, ``data``) and they have names of their own.
    """
    flat = {key for key, node in samples.items() if is_leaf(node) and len(node.shape) == 2}
    square = {key for key in flat if tuple(samples[key].shape) == (n_axes, n_axes)}
    kept = {key: node for key, node in samples.items() if key not in square} or samples
    if any(is_general(key) and key not in flat for key in kept):
        return {key: node for key, node in kept.items() if is_general(key) or key not in flat}
    return kept


def _path(level: str, key: str) -> str:
    return f"{level}/{key}" if level else key

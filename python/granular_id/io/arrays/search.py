"""Find the recordings in a tree of named arrays, and what stands beside them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from granular_id._checks import FloatArray
from granular_id.io.arrays import names, shapes, stated
from granular_id.io.arrays.details import Entries, add_details
from granular_id.io.arrays.found import Found, Push
from granular_id.io.arrays.names import Role, plain_name, role_of
from granular_id.io.arrays.shapes import Known
from granular_id.io.arrays.stated import ALL, FORCE, TORQUE, Columns, orders_axes, what_has_unit
from granular_id.io.arrays.tree import (
    MAX_DEPTH,
    Origin,
    as_tree,
    has_axis,
    is_leaf,
    n_values,
    numbers,
    texts,
    values,
)
from granular_id.io.columns import axis_of, split_unit
from granular_id.io.options import LoadOptions
from granular_id.recording import AXES

_OF_ONE: tuple[Role, ...] = ("labels", "names", "start", "trigger")
"""What says of a struct or group, where it has one value, that it is one recording."""

_ONE_PER_RECORDING: tuple[Role, ...] = (*_OF_ONE, "class_names", "sessions", "rate", "lengths")

_INDEX = re.compile(r"\[[0-9]+\]")
_MEANINGS = ("recordings", "samples", "axes")
_PARTS = (FORCE, TORQUE, *AXES)

_FIRST = 3
"""Items of a list that are looked at to tell what it holds."""


@dataclass
class Search:
    """A search through one tree.

    Of `options`, `array` names the only samples that count, `label` the only labels; `label_found` tells whether the
    entry that it names was met.
    """

    origin: Origin
    options: LoadOptions
    label_found: bool = False

    def level(
        self,
        tree: Mapping[str, Any],
        name: str,
        known: Known,
        class_names: Mapping[str, Any] | None = None,
        depth: int = 0,
    ) -> Found:
        """Return the recordings of a struct, group or archive, with what it says about them.

        `name` is its path, empty for the whole file; `known` and `class_names` are what enclosing levels say.
        """
        entries, others = self._entries(tree, name)
        if class_names:
            entries.setdefault("class_names", dict(class_names))
        known = self._known(entries, others, known)
        chosen = self._is_chosen(name)
        vectors = shapes.axis_arrays(others, self.origin, self.options.axes) if chosen else {}
        samples = self._samples({k: n for k, n in others.items() if k not in vectors}, name, known, depth)
        lone = len(samples) == 1 and self.options.array is None and all(map(is_leaf, samples.values()))
        n_notes = len(self.origin.notes)
        parts = self._in_parts(others, vectors, name, known) if chosen and (lone or not samples) else None
        if parts is not None and not samples:
            _, found, used = parts
        else:
            del self.origin.notes[n_notes:]
            self._refuse_rivals(samples, name, entries)
            found, used = self._several(samples, name, known, entries, depth), samples
            if parts is not None:
                self._refuse_other(found, next(iter(samples)), parts[1], parts[0])
        rest = {_path(name, key): node for key, node in others.items() if key not in used}
        add_details(found, entries, rest, known.units, self.origin, self.options)
        return found

    # -- what the entries of a level are

    def _entries(self, tree: Mapping[str, Any], name: str) -> tuple[Entries, dict[str, Any]]:
        """Part a level in what is known by name, by its role and path, and what is not."""
        entries: Entries = {}
        others: dict[str, Any] = {}
        for key, raw in tree.items():
            node, path = as_tree(raw), _path(name, key)
            role = self._role(key, node, tree)
            if self.options.label is not None and role != "units":
                named = _is_at(path, self.options.label)
                self.label_found |= named
                is_list = named and not isinstance(node, Mapping)
                role = "labels" if is_list else None if role == "labels" else role
            if role is None:
                others[key] = node
            else:
                entries.setdefault(role, {})[path] = node
        return entries, others

    def _role(self, key: str, node: Any, tree: Mapping[str, Any]) -> Role | None:
        """Tell what an entry is for; None for what may be samples, or something else."""
        is_group = isinstance(node, Mapping)
        role = "axes" if orders_axes(node) else role_of(key)
        if what_has_unit(key, tree) is not None and (is_group or texts(node) is not None):
            return "units"
        if plain_name(key) == "ts":  # a step or stamps, as its shape tells
            role = "step" if n_values(node) == 1 else "time"
        # a unit without texts is the number of a sensor, say
        nothing = is_group or role == "units" or (role == "axes" and self._names_no_axes(node, tree))
        return None if nothing else role

    def _names_no_axes(self, node: Any, tree: Mapping[str, Any]) -> bool:
        """Tell whether names of columns are how many there are, or those of another array: of features, say."""
        listed = stated.names_of(node)
        if len(listed) <= len(AXES) or set(AXES) <= {split_unit(name)[0] for name in listed}:
            return numbers(node) is not None
        six = any(has_axis(item, len(AXES)) for item in tree.values())
        return six and any(has_axis(item, len(listed)) for item in tree.values())

    def _known(self, entries: Entries, others: Mapping[str, Any], outer: Known) -> Known:
        axes, dimensions, units = outer.axes, outer.dimensions, dict(outer.units)
        orders: dict[tuple[str | None, ...], str] = {}
        for key, node in entries.get("axes", {}).items():
            axes = stated.names_of(node)
            if not axes:
                raise self.origin.fault(key, "does not hold names of axes; wanted a text per axis")
            if orders_axes(node):
                orders[tuple(split_unit(axis)[0] for axis in axes)] = key
        if len(orders) > 1:
            both = " and ".join(orders.values())
            raise self.origin.unclear(f"{both} name the axes in different orders; save the one that is true")
        for key, node in entries.get("dimensions", {}).items():
            dimensions = stated.dimensions_of(key, node, self.origin) or outer.dimensions
        for key, node in entries.get("units", {}).items():
            whose = what_has_unit(key.rpartition("/")[2], others) or ALL
            units |= stated.units_of(node, whose, key, others, self.origin)
        clocks = list(entries.get("time", {}).values())
        each = [n_values(node) for role in _ONE_PER_RECORDING for node in entries.get(role, {}).values()]
        each += [len(node) for node in clocks if isinstance(node, list)]
        several, stamps = (
            frozenset(n for n in counts if n is not None and n > 1)
            for counts in (each, [n_values(node) for node in clocks if is_leaf(node)])
        )
        return Known(axes, outer.n_recordings | several, outer.n_samples | stamps, units, dimensions)

    def _known_of(self, key: str, known: Known) -> Known:
        """Return what is known of one array: also the units that it has of its own."""
        own = known.units.get(f"/{key}") or (key, stated.unit_in_name(key))
        units = {ALL: own} if own[1] else {}
        units |= {what: known.units[f"/{key}:{what}"] for what in _PARTS if f"/{key}:{what}" in known.units}
        return replace(known, units={**known.units, **units}) if units else known

    # -- which of them are the recordings

    def _samples(self, others: Mapping[str, Any], level: str, known: Known, depth: int) -> dict[str, Any]:
        """Return what holds recordings, going by names, shapes and the option `array`."""
        samples = {
            key: node
            for key, node in others.items()
            if self._counts(key, node, level) and self._holds(node, known, depth)
        }
        if self.options.array is None:
            samples = _without_tables(
                samples, len(known.axes), beside_parts=shapes.in_parts(others, self.options.axes)
            )
        return {} if shapes.only_halves(samples) else samples

    def _is_chosen(self, path: str) -> bool:
        """Tell whether what stands at a path, or around it, is what the option `array` names."""
        return self.options.array is None or _is_at(path, self.options.array, within=True)

    def _counts(self, key: str, node: Any, level: str) -> bool:
        """Tell whether an array may be the recordings, going by its name and the option `array`."""
        if self.options.array is None:  # the name of a group says nothing of the arrays in it
            return (
                self.options.other_sensor
                or not names.is_other_thing(key)
                or (isinstance(node, Mapping) and "samples" not in node)
            )
        path = _path(level, key)
        return self._is_chosen(path) or any(map(self._is_chosen, _paths(node, path, 0)))

    def _holds(self, node: Any, known: Known, depth: int) -> bool:
        """Tell whether a node holds recordings, going by shapes alone."""
        if depth > MAX_DEPTH:
            raise self.origin.unclear(f"structs or lists lie more than {MAX_DEPTH} deep in each other")
        node = as_tree(node)
        if isinstance(node, Mapping):
            items = {key: as_tree(item) for key, item in node.items()}
            return shapes.in_parts(items, self.options.axes) or any(
                self._holds(item, known, depth + 1)
                for key, item in items.items()
                if role_of(key) is None and (self.options.array is not None or self._counts(key, item, ""))
            )
        if isinstance(node, list):
            return any(self._holds(item, known, depth + 1) for item in node[:_FIRST])
        return has_axis(node, len(known.axes))

    def _refuse_rivals(self, samples: Mapping[str, Any], name: str, entries: Entries) -> None:
        """Refuse several arrays of which only one can be the wrench."""
        way_out = "; pass array= with the name of the one that is, or save them under other names"
        torques = [key for key in samples if plain_name(key) in names.TORQUES]
        if torques and len(torques) == len(samples) and self.options.array is None:
            raise self.origin.unclear(f"{torques[0]} has six axes: they may be joints' torques{way_out}")
        if len(samples) < 2:
            return
        numbered = all(key[-1:].isdecimal() for key in samples)
        of_one = (
            names.is_counted_group(name)
            or any(n_values(node) == 1 for role in _OF_ONE for node in entries.get(role, {}).values())
            or any(is_leaf(node) for node in entries.get("time", {}).values())
        )
        several = any(not is_leaf(node) or len(node.shape) > 2 for node in samples.values())
        alike = not several and len({tuple(node.shape) for node in samples.values()}) == 1
        signals = any(
            names.is_signal(key) or (self.options.other_sensor and names.is_other_thing(key))
            for key in samples
        )
        if (signals and (of_one or several or not numbered)) or (name and of_one and alike and not numbered):
            rivals = " and ".join(map(repr, list(samples)[:5]))
            raise self.origin.unclear(f"{rivals} may all be the recordings{way_out}")

    def _refuse_other(self, found: Found, key: str, other: Found, what: str) -> None:
        """Refuse parts of a wrench beside an array of wrenches, unless they hold the same."""
        pairs = zip(other.pushes, found.pushes, strict=False)
        if len(other) != len(found) or not all(np.array_equal(a.wrench, b.wrench) for a, b in pairs):
            problem = f"{key} and {what} hold different wrenches; pass array={key!r}, or leave it out"
            raise self.origin.unclear(problem)

    # -- recordings of several arrays, structs or cells

    def _several(
        self, samples: Mapping[str, Any], name: str, known: Known, entries: Entries, depth: int
    ) -> Found:
        if len(samples) == 1:
            key, node = next(iter(samples.items()))
            found = self._node(node, _path(name, key), self._known_of(key, known), entries, depth)
            if name and not isinstance(node, list) and found.sizes == [1] and not names.is_general(key):
                # rice/1, which others would be called that have rice/2 beside them
                found.fill("name", [_path(name, key)])
            return found
        groups = [
            (key, self._node(node, _path(name, key), self._known_of(key, known), {}, depth).as_one())
            for key, node in samples.items()
        ]
        single = all(len(found) == 1 for _, found in groups)
        if not single and "labels" in entries:
            both = f"labels in {next(iter(entries['labels']))}, and recordings under names of their own"
            raise self.origin.unclear(f"{both} ({', '.join(list(samples)[:5])})")
        alone = single and "labels" not in entries and all(_numbered_in(name, *group) for group in groups)
        if groups:
            self._name(groups, name, single and not alone)
        return Found.joined([found for _, found in groups])

    def _name(self, groups: list[tuple[str, Found]], level: str, single: bool) -> None:
        """Take the names of several arrays as names of recordings, or as labels of what they hold."""
        for key, found in groups:
            if single:
                found.fill("name", [_path(level, key)])
            label = names.label_of_name(key) if single else None if names.is_no_label(key) else key
            if label is not None and not single:
                self._as_sessions(found, label)
            found.fill("label", [label] * len(found))
        keys = ", ".join(key for key, _ in groups[:3]) + (", ..." if len(groups) > 3 else "")
        numbered = single and all(names.label_of_name(key) is not None for key, _ in groups)
        part = ", and the part before the number as label" if numbered else ""
        what = "names" if single else "labels"
        self.origin.note(f"{keys} taken as {what} of the recordings in them{part}")

    def _as_sessions(self, found: Found, label: str) -> None:
        """Take labels that only names of inner groups gave as sessions: the outer name is the label, as of folders."""
        inner = found.get("group")
        found.fill("session", inner)
        for push, group in zip(found.pushes, inner, strict=True):
            if group is not None:
                del push.about["label"], push.about["group"]
            if "label" not in push.about:
                push.about["group"] = label
        for i, note in enumerate(self.origin.notes):
            if note.partition(" taken as labels")[0].partition(", ")[0] in inner:
                self.origin.notes[i] = note.replace("taken as labels", "taken as sessions")

    def _node(self, node: Any, name: str, known: Known, entries: Entries, depth: int) -> Found:
        if isinstance(node, Mapping):
            return self.level(node, name, known, entries.get("class_names"), depth + 1)
        if isinstance(node, list):
            return self._list(node, name, known, entries, depth)
        return self._found(self._ordered(self._floats(node, name), name, known), name, known)

    def _list(self, items: list[Any], name: str, known: Known, entries: Entries, depth: int) -> Found:
        self._refuse_table(items, known)
        cells: list[Found] = []
        for i, item in enumerate(map(as_tree, items)):
            place = f"{name}[{i}]"
            if not self._holds(item, known, depth + 1):
                raise self.origin.fault(place, f"is no recording: wanted (samples, {len(known.axes)})")
            inner = self._node(item, place, known, entries if isinstance(item, Mapping) else {}, depth + 1)
            cells.append(inner.as_one())
        return _cells(cells)

    def _refuse_table(self, items: list[Any], known: Known) -> None:
        """Refuse a table of cells whose labels may go along its rows or its columns."""
        rows, widths = len(items), {len(item) if isinstance(item, list) else 0 for item in items}
        if rows < 2 or len(widths) > 1 or max(widths) < 2:
            return
        columns = max(widths)
        along_columns = columns in known.n_recordings and rows not in known.n_recordings
        if along_columns or {rows * columns, *([rows] if rows == columns else [])} & known.n_recordings:
            unclear = (
                "labels go along the columns" if along_columns else "labels may go along rows or columns"
            )
            problem = f"{rows} x {columns} cells: {unclear}"
            way_out = "save a struct or variable per material, or a vector of cells"
            raise self.origin.unclear(f"{problem}; {way_out}")

    # -- recordings of one array, or of its parts

    def _in_parts(
        self, others: Mapping[str, Any], vectors: Mapping[str, Any], level: str, known: Known
    ) -> tuple[str, Found, Mapping[str, Any]] | None:
        """Return the wrenches that six vectors, or forces and torques, are the parts of: name, recordings, arrays."""
        halves = None if vectors else shapes.halves_of(others, self.origin)
        if not vectors and halves is None:
            return None
        usual = (AXES, shapes.THREE, self.options.axes)
        if known.axes not in usual and tuple(axis_of(axis) or axis for axis in known.axes) not in usual:
            named = ", ".join(known.axes)[:80]
            raise self.origin.unclear(f"{level or 'the file'} names the axes {named}, and arrays others")
        if halves is None:
            name = "fx ... tz" if self.options.axes is None else ", ".join(vectors)
            return name, self._stacked(vectors, level, _path(level, name), known), vectors
        found = self._joined(halves, others, level, replace(known, axes=AXES))
        return " and ".join(halves), found, dict.fromkeys(halves)

    def _stacked(self, vectors: Mapping[str, Any], level: str, name: str, known: Known) -> Found:
        """Put six vectors or matrices side by side."""
        known = replace(known, axes=tuple(vectors))
        arrays = [self._floats(node, _path(level, key)) for key, node in vectors.items()]
        flat = [array.reshape(-1) if n_values(array) is not None else array for array in arrays]
        if len({array.shape for array in flat}) > 1:
            listed = ", ".join(f"{key} {array.shape}" for key, array in zip(vectors, flat, strict=True))
            raise self.origin.unclear(f"the axes differ in shape: {listed}")
        stacked = self._ordered(np.stack(flat, axis=-1), name, known, sensor_last=True)
        return self._found(stacked, name, known)

    def _joined(self, halves: tuple[str, str], others: Mapping[str, Any], level: str, known: Known) -> Found:
        """Put torques behind forces, of one array or of each item of two lists."""
        own = {
            what: known.units[whose]
            for what, key in zip((FORCE, TORQUE), halves, strict=True)
            for whose in (f"/{key}", f"/{key}:{what}")
            if whose in known.units
        }
        known = replace(known, units={**known.units, **own})
        three = replace(known, axes=shapes.THREE)
        name, listed = " and ".join(halves), isinstance(others[halves[0]], list)
        cells: list[Found] = []
        for i, pair in enumerate(shapes.pairs_of(halves, others, self.origin)):
            place = _path(level, name) + (f"[{i}]" if listed else "")
            sides = [
                self._ordered(self._floats(node, _path(level, key)), place, three)
                for node, key in zip(pair, halves, strict=True)
            ]
            cells.append(self._found(np.concatenate(sides, axis=-1), place, known))
        self.origin.note(f"{name} joined: forces, then torques")
        return _cells(cells)

    def _floats(self, node: Any, name: str) -> FloatArray:
        array = values(node)
        if array.dtype.kind not in "iuf":
            raise self.origin.fault(name, f"has dtype {array.dtype}; wanted real numbers")
        with np.errstate(over="ignore", invalid="ignore"):  # what is no number is refused as such
            return array.astype(np.float64, copy=False)  # as it lies in memory, to be copied once

    def _ordered(
        self, array: FloatArray, name: str, known: Known, *, sensor_last: bool = False
    ) -> FloatArray:
        """Return an array as (samples, axes) or (recordings, samples, axes), and note what it was taken for."""
        n = array.ndim
        order = shapes.order_of(array.shape, known, name, self.origin, sensor_last=sensor_last)
        if order != tuple(range(n)) or (n == 3 and len(known.dimensions) != n):
            meaning = ", ".join(_MEANINGS[-n:][order.index(axis)] for axis in range(n))
            self.origin.note(f"{name} {array.shape} taken as {meaning}")
        ordered: FloatArray = array.transpose(order)
        return ordered

    def _found(self, array: FloatArray, name: str, known: Known) -> Found:
        """Return the recordings of an array whose axes are in order."""
        columns = Columns.named(known.axes, known.units, name, self.origin, self.options)
        wrench = columns.wrench(array)
        if columns.order is not None or columns.scales is not None:
            self.origin.note(f"{name}: {columns.said(known.axes)}")
        if wrench.ndim == 2:
            shapes.refuse_gaps(wrench, columns.axes, name, self.origin)
            array, each = array[None], [wrench]
        else:
            each = shapes.without_padding(shapes.row_major(wrench), columns.axes, name, self.origin)
        pushes = [Push(recording, columns.axes, name, array.shape[1]) for recording in each]
        found = Found(pushes, [len(pushes)])
        if columns.time is not None:
            rows = zip(pushes, array[..., columns.time], strict=True)
            found.fill("stamps", [stamps[: len(push.wrench)] for push, stamps in rows])
            found.fill("time_unit", [columns.time_unit] * len(found))
        if columns.meta_units:
            found.fill("meta", [{"units": columns.meta_units}] * len(found))
        return found


def _cells(cells: Sequence[Found]) -> Found:
    """Put the recordings of cells one behind the other: as one list, where each cell holds one."""
    joined = Found.joined(cells)
    return joined.as_one() if all(len(cell) == 1 for cell in cells) else joined


def _without_tables(samples: dict[str, Any], n_axes: int, *, beside_parts: bool) -> dict[str, Any]:
    """Leave out what only looks like samples beside the recordings: calibration matrices, ranges, means per sample.

    Square matrices are left out wherever there is anything else; others of two dimensions where an array or list of
    recordings has a general name (``X``, ``data``) and they have names of their own.
    """
    flat = {key for key, node in samples.items() if is_leaf(node) and len(node.shape) == 2}
    kept = {k: n for k, n in samples.items() if k not in flat or tuple(n.shape) != (n_axes, n_axes)}
    if not kept and not beside_parts:
        kept = samples
    if any(names.is_general(key) and key not in flat for key in kept):
        return {key: node for key, node in kept.items() if names.is_general(key) or key not in flat}
    return kept


def _is_at(path: str, wanted: str, *, within: bool = False) -> bool:
    """Tell whether a path ends with the names that are wanted, or (`within`) has them anywhere."""
    plain = f"/{_INDEX.sub('', path)}/"
    return f"/{wanted}/" in plain if within else plain.endswith(f"/{wanted}/")


def _paths(node: Any, path: str, depth: int) -> Iterator[str]:
    """Yield the paths of what lies in a struct, or in the first structs of a list."""
    node = as_tree(node)
    if depth > MAX_DEPTH:
        return
    if isinstance(node, list):
        for item in node[:_FIRST]:
            yield from _paths(item, path, depth + 1)
    elif isinstance(node, Mapping):
        for key, item in node.items():
            yield _path(path, key)
            yield from _paths(item, _path(path, key), depth + 1)


def _numbered_in(level: str, key: str, found: Found) -> bool:
    """Tell whether a group without a number holds one recording with one: ``rice/rice_1``, the only one of rice."""
    named = str(found.get("name")[0] or "")
    return named.startswith(f"{_path(level, key)}/") and named[-1].isdecimal() and not key[-1:].isdecimal()


def _path(level: str, key: str) -> str:
    return f"{level}/{key}" if level else key

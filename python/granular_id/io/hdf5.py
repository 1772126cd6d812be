"""HDF5: files of groups and arrays that other programs wrote."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.arrays.layouts import recordings_of
from granular_id.io.arrays.names import ROLES, role_of
from granular_id.io.arrays.stated import orders_axes, what_has_unit
from granular_id.io.arrays.tree import MAX_DEPTH
from granular_id.io.errors import RecordingFileError, naming, need
from granular_id.io.files import Expansion, open_bounded
from granular_id.io.flat import Leaf
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource

_LISTED = 3
_ROOT = "root"

_BESIDE_SAMPLES = ROLES - {"units", "scaling"}
_CHANGES_VALUES = ("units", "scaling", "axes", "dimensions")
"""What attributes say of the values themselves: one that cannot be read is not left out."""


def read_hdf5(source: FileSource, options: LoadOptions) -> FileContent:
    """Read the groups and arrays of an HDF5 file, whose layout is guessed and said.

    Links, and values kept in other files, are refused.
    """
    with open_bounded(source.path, source.root, options.max_binary_bytes) as (_, n_bytes):
        expansion = Expansion(source.path, n_bytes)
        with opened(expansion, "to read .h5 files") as file:
            tree = _Tree(expansion)
            content = recordings_of(tree.group(file, "", 0), source, options, "data set")
    if tree.left_out:
        more = len(tree.left_out) - _LISTED
        listed = "; ".join(tree.left_out[:_LISTED]) + (f"; and {more} more" if more > 0 else "")
        content.notes.append(f"left out: {listed}")
    return content


@dataclass
class _Tree:
    """Walks through the groups of a file; `left_out` says what cannot be read as numbers or texts, and why."""

    expansion: Expansion
    left_out: list[str] = field(default_factory=list)
    _groups: set[Any] = field(default_factory=set)

    def group(self, group: Any, place: str, depth: int) -> dict[str, Any]:
        """Return a mapping per group, a leaf per data set."""
        if depth > MAX_DEPTH:
            raise self.expansion.fault(place[:200], f"groups lie in each other deeper than {MAX_DEPTH}")
        if group in self._groups:  # it may lie within itself
            raise self.expansion.fault(place, "is a group that lies at two places of the file")
        self._groups.add(group)
        found = self._attributes(group, place or _ROOT)
        for key in group:
            name = key.decode("utf-8", "backslashreplace") if isinstance(key, bytes) else key
            inner = f"{place}/{name}" if place else name
            item = member(group, key, inner, self.expansion)
            if is_group(item):
                found[name] = self.group(item, inner, depth + 1)
            else:
                self._put(found, name, item, inner)
        return found

    def _put(self, found: dict[str, Any], name: str, item: Any, place: str) -> None:
        """Put a data set, and beside it what its attributes say."""
        dtype, shape = item.dtype, getattr(item, "shape", None)
        if shape is None or (dtype.kind not in "iufbSV" and not is_text(dtype)):
            self.left_out.append(f"{place} ({'nothing' if shape is None else dtype})")
            return
        leaf = _leaf(item, place, self.expansion)
        about = self._attributes(item, place)
        inside = {
            key: value
            for key, value in about.items()
            if role_of(key) in _BESIDE_SAMPLES or orders_axes(value)
        }
        found[name] = {"samples": leaf, **inside} if inside and len(shape) > 1 else leaf
        beside = {key: value for key, value in about.items() if key not in inside}
        found.update({key: beside.pop(key) for key in list(beside) if role_of(key) == "scaling"})
        if beside:  # as for vectors, which have one unit
            found[f"{name}_units"] = beside if len(shape) > 1 else next(iter(beside.values()))

    def _attributes(self, item: Any, place: str) -> dict[str, Any]:
        """Return the attributes that say by name what they mean (label, rate, units ...), and orders of axes."""
        found: dict[str, Any] = {}
        for name in item.attrs:
            if not isinstance(name, str) or name == "CLASS":  # h5py gives names that are no UTF-8 as bytes
                continue
            role = role_of(name) or ("units" if what_has_unit(name, {}) is not None else None)
            try:
                value = attribute(item, name, place, self.expansion)
            except RecordingFileError as error:
                if role in _CHANGES_VALUES:
                    raise
                if role is not None:
                    self.left_out.append(f"{place}: {error.problem}")
                continue
            if role is not None or orders_axes(value):
                found[name] = value
        return found


def _leaf(item: Any, place: str, expansion: Expansion) -> Leaf:
    def read() -> NDArray[Any]:
        found = values(item, place, expansion)
        return found.astype(np.uint8) if found.dtype.kind == "b" else found

    return Leaf(place, item.shape, np.dtype("U1") if is_text(item.dtype) else item.dtype, read)


# HDF5 files by h5py; what would make the library read other files is refused before.

_HARD_LINK = 0


@contextmanager
def opened(expansion: Expansion, why: str) -> Iterator[Any]:
    """Open a file; `why` ends the sentence about a missing h5py."""
    h5py = need("h5py", extra="hdf5", why=why)
    # a lock would make files on read-only and network drives unreadable; nothing is written
    with naming(expansion.path, "reading it by h5py"), h5py.File(expansion.path, "r", locking=False) as file:
        yield file


def is_group(item: Any) -> bool:
    """Tell a group from a data set."""
    return hasattr(item, "keys")


def is_text(dtype: np.dtype[Any]) -> bool:
    """Tell whether values are texts of changing length."""
    about: Any = dtype.metadata or {}
    return about.get("vlen") in (str, bytes)


def member(group: Any, name: str | bytes, place: str, expansion: Expansion) -> Any:
    """Return a group or data set that is itself in the group, with values in this file."""
    with naming(expansion.path, f"looking at {place}"):
        key = name if isinstance(name, bytes) else name.encode()
        if group.id.links.get_info(key).type != _HARD_LINK:  # ``in`` and ``get`` would open what it leads to
            raise expansion.fault(place, "is a link, which is not followed; wanted the data set itself")
        item = group[name]
        _refuse_elsewhere(item, place, expansion)
    return item


def _refuse_elsewhere(item: Any, place: str, expansion: Expansion) -> None:
    if getattr(item, "external", None) or getattr(item, "is_virtual", False):
        raise expansion.fault(place, "keeps its values in other files, which are not opened")


def attribute(item: Any, name: str, place: str, expansion: Expansion) -> Any:
    """Return an attribute, texts as str or an array of them; None where there is none."""
    with naming(expansion.path, f"reading the attribute {name} of {place}"):
        value = item.attrs.get(name)
        if isinstance(value, bytes):
            return value.decode("utf-8", "backslashreplace")
        if isinstance(value, np.ndarray) and is_text(item.attrs.get_id(name).dtype):
            return value.astype(np.str_)
    is_number = getattr(value, "dtype", np.dtype("O")).kind in "iufbSU" and value.shape is not None
    if value is None or isinstance(value, str) or is_number:
        return value
    raise RecordingFileError(expansion.path, f"the attribute {name} is no number or text", place=place)


def values(item: Any, place: str, expansion: Expansion) -> NDArray[Any]:
    """Return all values of a data set; texts of changing length as texts of one width."""
    with naming(expansion.path, f"reading {place}"):
        _refuse_elsewhere(item, place, expansion)
        expansion.spend(item.size * max(item.dtype.itemsize, 8), place)  # numbers become float64
        if is_text(item.dtype):
            return np.asarray(item.asstr(errors="backslashreplace")[()], np.str_)
        return np.asarray(item[()])

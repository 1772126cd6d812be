"""What an HDF5 file holds, as a tree of groups and of values that are read when they are asked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.arrays.names import ROLES, role_of
from granular_id.io.arrays.stated import orders_axes, what_has_unit
from granular_id.io.arrays.tree import MAX_DEPTH
from granular_id.io.errors import RecordingFileError
from granular_id.io.extras import need
from granular_id.io.hdf5.guard import GuardedFile, translated

__all__ = ["Hdf5Tree"]

_MOST_MEMBERS = 50_000
_FREE_MEMBERS = 2_000
_MEMBER_BYTES = 1024
"""A file of more than 2,000 members has at least this many bytes for each: a member takes a third of a millisecond."""

_MOST_ATTRIBUTES = 200
_ROOT = "root"

_BESIDE_SAMPLES = ROLES - {"units", "scaling"}
_CHANGES_VALUES = ("units", "scaling", "axes", "dimensions")
"""What attributes say of the values themselves: one that cannot be read is not left out."""


class Hdf5Tree:
    """Walks through the groups of a file; attributes that say what a recording is stand beside its samples.

    Attributes
    ----------
    left_out : list of str
        What cannot be read as numbers or texts, and why.
    """

    def __init__(self, file: GuardedFile) -> None:
        self._file = file
        self._h5py = need("h5py", extra="hdf5", why="to read .h5 files")
        room = file.expansion.n_bytes // _MEMBER_BYTES
        self._most_members = max(_FREE_MEMBERS, min(_MOST_MEMBERS, room))
        self._met = 0
        self._groups: set[int] = {file.address(file.root, _ROOT)}
        self.left_out: list[str] = []

    def whole(self) -> dict[str, Any]:
        """Return the tree of everything: a mapping per group, a leaf per data set.

        Raises
        ------
        RecordingFileError
            Links, groups within each other without end, or far more members than recordings need.
        """
        return self._group(self._file.root, "", 0)

    def _group(self, group: Any, place: str, depth: int) -> dict[str, Any]:
        if depth > MAX_DEPTH:
            raise self._file.expansion.fault(place[:200], f"groups lie in each other deeper than {MAX_DEPTH}")
        found = self._attributes(group, place or _ROOT)
        names = self._file.names(group, place or _ROOT)
        self._met += len(names)
        if self._met > self._most_members:
            came = (
                f"the file of {self._file.expansion.n_bytes} bytes has more than {self._most_members} members"
            )
            raise self._file.expansion.fault(place or _ROOT, came)
        for name in names:
            inner = f"{place}/{name}" if place else name
            item = self._file.member(group, name, inner)
            if self._file.is_group(item):
                self._met_first(item, inner)
                found[name] = self._group(item, inner, depth + 1)
                continue
            leaf = self._dataset(item, inner)
            if leaf is None:
                continue
            about = self._attributes(item, inner)
            inside = {
                key: value
                for key, value in about.items()
                if role_of(key) in _BESIDE_SAMPLES or orders_axes(value)
            }
            found[name] = {"samples": leaf, **inside} if inside and len(leaf.shape) > 1 else leaf
            beside = {key: value for key, value in about.items() if key not in inside}
            found.update({key: beside.pop(key) for key in list(beside) if role_of(key) == "scaling"})
            if beside:  # as for vectors, which have one unit
                found[f"{name}_units"] = beside if len(leaf.shape) > 1 else next(iter(beside.values()))
        return found

    def _met_first(self, group: Any, place: str) -> None:
        """Refuse a group that lies at two places of the file: it may lie within itself."""
        address = self._file.address(group, place)
        if address in self._groups:
            raise self._file.expansion.fault(place, "is a group that lies at two places of the file")
        self._groups.add(address)

    def _dataset(self, item: Any, place: str) -> _Leaf | None:
        with translated(self._file.expansion, place):
            dtype, shape = item.dtype, item.shape
            is_text = self._h5py.check_string_dtype(dtype) is not None
        if shape is None or (dtype.hasobject and not is_text) or dtype.kind not in "iufbSOV":
            self.left_out.append(f"{place} ({'nothing' if shape is None else dtype})")
            return None
        return _Leaf(self._file, item, place, shape, np.dtype("U1") if dtype.hasobject else dtype)

    def _attributes(self, item: Any, place: str) -> dict[str, Any]:
        """Return the attributes that say by name what they mean (label, rate, units ...), and orders of axes."""
        with translated(self._file.expansion, place):
            names = list(item.attrs) if len(item.attrs) <= _MOST_ATTRIBUTES else []
        found: dict[str, Any] = {}
        for name in names:
            if not isinstance(name, str) or name == "CLASS":  # h5py gives names that are no UTF-8 as bytes
                continue
            role = role_of(name) or ("units" if what_has_unit(name, {}) is not None else None)
            try:
                value = self._file.attribute(item, name, place)
            except RecordingFileError as error:
                if role in _CHANGES_VALUES:
                    raise
                if role is not None:
                    self.left_out.append(f"{place}: {error.problem}")
                continue
            if role is not None or orders_axes(value):
                found[name] = value
        return found


@dataclass
class _Leaf:
    """A data set that is read when it is asked for."""

    file: GuardedFile
    item: Any
    place: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    _values: NDArray[Any] | None = field(default=None, repr=False)

    def read(self) -> NDArray[Any]:
        if self._values is None:
            values = self.file.values(self.item, self.place)
            self._values = values.astype(np.uint8) if values.dtype.kind == "b" else values
        return self._values

    @property
    def finite(self) -> bool:
        """Whether values that were read are known to be finite."""
        return self.file.known_finite(self.item)

"""MAT files of version 7.3 (``save -v7.3``), which are HDF5 files with MATLAB's classes as attributes.

MATLAB documents that they are HDF5, not how; what is read here is what it writes. Sizes stand in reverse: HDF5
lists the last index first. Cells and the fields of struct arrays are datasets of references into ``#refs#``.
"""

from __future__ import annotations

import math
from types import NoneType
from typing import Any

import numpy as np

from granular_id.io.hdf5.guard import GuardedFile, translated
from granular_id.io.matlab.tree import (
    COMPLEX,
    FUNCTION,
    LEFT_OUT,
    MAX_DIMENSIONS,
    MAX_NAME,
    SPARSE,
    VARIABLE_PARTS,
    MatReading,
    holds,
    in_class,
    nested,
    text_of,
)

_NUMBERS: dict[str, np.dtype[Any]] = {
    "double": np.dtype(np.float64),
    "single": np.dtype(np.float32),
    "logical": np.dtype(np.bool_),
    **{f"{sign}int{bits}": np.dtype(f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)},
}
_DECODED = "MATLAB_object_decode"  # beside int_decode: the values stand for an object kept elsewhere

_OBJECT_BYTES = 64
"""What anything that a reference leads to takes in the file, at least."""

_SHARED = 1000
"""References that may lead to what others lead to: MATLAB keeps one empty array for all."""


def read_v73(reading: MatReading) -> dict[str, Any]:
    """Read all variables of a version 7.3 file, as `read_v5` does."""
    with GuardedFile(reading, "to read .mat files of version 7.3") as file:
        walk = _Walk(file, reading)
        variables = {}
        for name in file.names(file.root, "list of variables"):
            if name.startswith("#"):  # where MATLAB keeps the contents of cells and objects
                continue
            place = f"variable {name[:MAX_NAME]}"
            reading.count(VARIABLE_PARTS - 1, place)
            value = walk.value(file.member(file.root, name, place), place, 0)
            if value is not LEFT_OUT:
                variables[name] = value
        return variables


class _Walk:
    """Goes from variables through structs and references to the values."""

    def __init__(self, file: GuardedFile, reading: MatReading) -> None:
        self._file = file
        self._reading = reading
        self._n_references = 0
        self._known: dict[Any, Any] = {}  # by address: what two references share is read once

    def value(self, item: Any, place: str, depth: int) -> Any:
        """Return one value, whatever class it is of."""
        self._reading.count(1, place)
        file = self._file
        class_name = file.attribute(item, "MATLAB_class", place)
        if not isinstance(class_name, (str, NoneType)):
            raise self._no_class(class_name, place)
        if class_name == "function_handle":
            return self._reading.leave_out(place, *FUNCTION)
        if file.has_attribute(item, _DECODED, place):
            return self._reading.leave_out_object(place, str(class_name))
        if self._file.is_group(item):
            return self._struct(item, class_name, place, depth)
        if class_name not in (*_NUMBERS, "char", "cell", "struct"):
            raise self._no_class(class_name, place)
        return self._dataset(item, class_name, place, depth)

    def _dataset(self, item: Any, class_name: str, place: str, depth: int) -> Any:
        if np.any(self._file.attribute(item, "MATLAB_empty", place)):
            return self._empty(item, class_name, place)
        if class_name == "cell":
            return self._cell(item, place, depth)
        return self._plain(item, class_name, place)

    def _no_class(self, class_name: object, place: str) -> Exception:
        if class_name is not None:
            return self._reading.fault(
                place, f"is of the class {str(class_name)[:80]!r}, which cannot be read"
            )
        problem = "has no attribute MATLAB_class: the file is HDF5, but not as MATLAB writes it"
        return self._reading.fault(place, f"{problem}; save it with -v7 or -v7.3, or name it .h5")

    def _plain(self, item: Any, class_name: str, place: str) -> Any:
        with translated(self._reading, place):
            dtype, dims = item.id.dtype, _dims(item)
        if dtype.names is not None:
            return self._reading.leave_out(place, *COMPLEX)
        self._reading.checked_dims(dims, place)
        is_text = class_name == "char"
        if is_text:
            wanted = dtype.kind == "u" and dtype.itemsize <= 4
        else:
            wanted = class_name in _NUMBERS and dtype.kind in "iuf" and holds(_NUMBERS[class_name], dtype)
        if not wanted:
            raise self._reading.fault(place, f"is called {class_name}, but holds {dtype}")
        if is_text:
            self._reading.count(max(dims[0] - 1, 0), place)
            return text_of(self._file.values(item, place).ravel(), dims)
        return in_class(self._file.values(item, place), _NUMBERS[class_name]).reshape(dims[::-1]).T

    def _empty(self, item: Any, class_name: str, place: str) -> Any:
        """Return an empty array: its values are its size."""
        with translated(self._reading, place):
            n_sizes = math.prod(item.id.shape)
        if n_sizes > MAX_DIMENSIONS:
            raise self._reading.fault(place, f"is called empty, but holds {n_sizes} values")
        if class_name == "char":
            return ""
        if class_name in ("cell", "struct"):
            return []
        sizes = self._file.values(item, place)
        dims = [int(n) for n in sizes.ravel()] if sizes.dtype.kind in "iu" else [1]
        if self._reading.checked_dims(dims, place):
            raise self._reading.fault(place, f"is called empty, but its size is {dims}")
        return np.empty(dims, _NUMBERS[class_name])

    def _cell(self, item: Any, place: str, depth: int) -> Any:
        depth = self._reading.deeper(depth, place)
        references = self._references(item, place)
        items = [self._target(ref, f"{place}{{{i + 1}}}", depth) for i, ref in enumerate(references)]
        if any(value is LEFT_OUT for value in items):  # without one, the others would count wrongly
            return LEFT_OUT
        return nested(items, _dims(item))

    def _struct(self, group: Any, class_name: str | None, place: str, depth: int) -> Any:
        if self._file.has_attribute(group, "MATLAB_sparse", place):
            return self._reading.leave_out(place, *SPARSE)
        if class_name is None and self._file.has_attribute(group, "OCTAVE_NEW_FORMAT", place):
            raise self._reading.fault(place, "was written by Octave's save -hdf5; wanted save -v7")
        if class_name != "struct":
            raise self._no_class(class_name, place)
        depth = self._reading.deeper(depth, place)
        names = self._file.names(group, place)
        members = {name: self._file.member(group, name, f"{place}.{name}") for name in names}
        if members and all(self._is_column(item, f"{place}.{name}") for name, item in members.items()):
            return self._struct_array(members, place, depth)
        record = {name: self.value(item, f"{place}.{name}", depth) for name, item in members.items()}
        return {name: value for name, value in record.items() if value is not LEFT_OUT}

    def _is_column(self, item: Any, place: str) -> bool:
        """Tell whether a field holds one reference per element of a struct array (a cell has a class)."""
        if self._file.is_group(item) or self._file.has_attribute(item, "MATLAB_class", place):
            return False
        with translated(self._reading, place):
            return self._file.is_reference(item.id.dtype)

    def _struct_array(self, members: dict[str, Any], place: str, depth: int) -> Any:
        columns = {name: self._references(item, f"{place}.{name}") for name, item in members.items()}
        dims = {_dims(item) for item in members.values()}
        if len(dims) > 1:
            raise self._reading.fault(place, "has fields of different sizes")
        (size,) = dims
        records: list[dict[str, Any]] = [{} for _ in next(iter(columns.values()))]
        for name, references in columns.items():
            for i, (record, reference) in enumerate(zip(records, references, strict=True)):
                value = self._target(reference, f"{place}({i + 1}).{name}", depth)
                if value is not LEFT_OUT:
                    record[name] = value
        return records[0] if len(records) == 1 else nested(records, size)

    def _references(self, item: Any, place: str) -> list[Any]:
        with translated(self._reading, place):
            dtype, dims = item.id.dtype, _dims(item)
        if not self._file.is_reference(dtype):
            raise self._reading.fault(place, f"is called a cell, but holds {dtype}")
        n_references = self._reading.checked_dims(dims, place)
        self._reading.count(n_references, place)
        self._n_references += n_references
        if self._n_references > _SHARED + self._reading.n_bytes // _OBJECT_BYTES:
            problem = f"{self._n_references} values in a file of {self._reading.n_bytes} bytes"
            raise self._reading.fault(place, f"{problem}: most are the same few, which recordings are not")
        return list(self._file.values(item, place).ravel())

    def _target(self, reference: Any, place: str, depth: int) -> Any:
        item = self._file.target(reference, place)
        address = self._file.address(item, place)
        if address in self._known:
            if isinstance(self._known[address], (dict, list)) and self._known[address]:
                # cells in each other's cells would unfold without end
                raise self._reading.fault(place, "is a struct or cell that lies at two places of the file")
            return self._known[address]
        self._known[address] = [None]  # on the way: met again below itself, it is refused
        value = self.value(item, place, depth)
        self._known[address] = value
        return value


def _dims(item: Any) -> tuple[int, ...]:
    """Return the size of a dataset as MATLAB counts, at least two numbers."""
    dims = tuple(reversed(item.id.shape or ()))
    return (*dims, *(1,) * (2 - len(dims)))

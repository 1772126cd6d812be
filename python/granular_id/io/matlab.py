"""MATLAB files of every version, as a tree of plain values.

scipy reads versions 4 to 7, h5py version 7.3. What the variables hold is told as for any other file of named arrays
(see ``arrays.layouts.recordings_of``), and what was guessed or could not be read is said.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from granular_id.io.arrays.layouts import recordings_of
from granular_id.io.errors import RecordingFileError, naming
from granular_id.io.files import Expansion, open_bounded
from granular_id.io.hdf5 import attribute, is_group, member, opened, values
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource

_HDF5_MARK = b"\x89HDF\r\n\x1a\n"
_HEADER_BYTES = 128
_HDF5_AT = 512  # behind MATLAB's own header

_SPARSE = ("a sparse matrix", "save full(...) of it")
_COMPLEX = ("an array of complex numbers", "a wrench is real: save real(...) of it")
_FUNCTION = ("a function handle", "it holds no samples")
_REMEDIES = {
    "string": "save cellstr(...) of it",
    "categorical": "save cellstr(...) of it",
    "table": "save table2struct(..., 'ToScalar', true), with cellstr(...) of text columns",
    "timetable": "save table2struct(timetable2table(...), 'ToScalar', true), with seconds(...) of its times",
    "containers.Map": "save its keys and values as cells",
    "datetime": "save posixtime(...) of it",
    "duration": "save seconds(...) of it",
}
_NO_LABELS = ("datetime", "duration")
_LOSSES = (np.exceptions.ComplexWarning, UserWarning)
"""How scipy warns where it goes on without something."""

_NUMBERS = {
    "double": np.dtype(np.float64),
    "single": np.dtype(np.float32),
    "logical": np.dtype(np.bool_),
    **{f"{sign}int{bits}": np.dtype(f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)},
}


@dataclass
class MatReading(Expansion):
    """The file being read; what of it could not be read, and how to save it instead, some of which may be labels."""

    left_out: list[str] = field(default_factory=list)
    may_be_labels: list[str] = field(default_factory=list)

    def leave_out(self, place: str, what: str, remedy: str, *, may_be_labels: bool = False) -> None:
        """Note that a value cannot be read."""
        said = f"{place} is {what} and was left out; {remedy}"
        self.left_out.append(said)
        self.may_be_labels += [said] if may_be_labels else []

    def leave_out_object(self, place: str, class_name: str) -> None:
        """Leave out an object of a MATLAB class, which only MATLAB itself can read."""
        remedy = _REMEDIES.get(class_name, "save its values as plain arrays")
        may_be_labels = class_name in _REMEDIES and class_name not in _NO_LABELS
        self.leave_out(place, f"a MATLAB {class_name}", remedy, may_be_labels=may_be_labels)


def read_mat(source: FileSource, options: LoadOptions) -> FileContent:
    """Read one MATLAB file; without labels it is refused where a variable that may hold them cannot be read."""
    variables, reading = read_variables(source, options)
    try:
        content = recordings_of(variables, source, options, "variable")
    except RecordingFileError as error:
        if not reading.left_out:
            raise
        problem = f"{error.problem}; {'; '.join(reading.left_out)}"
        raise RecordingFileError(error.path, problem, place=error.place) from error
    stated = source.label or source.folder_label
    if reading.may_be_labels and not stated and any(r.label is None for r in content.recordings):
        problem = f"has recordings without a label, but {'; '.join(reading.may_be_labels)}"
        raise RecordingFileError(source.path, problem)
    content.notes.extend(reading.left_out)
    return content


def read_variables(source: FileSource, options: LoadOptions) -> tuple[dict[str, Any], MatReading]:
    """Read all variables of a MATLAB file as plain Python values, by name; and say what was left out.

    These are numpy arrays of at least two dimensions, shaped as MATLAB shows them; str, or list of str for char arrays
    of several rows; dict for a struct; list for cells and struct arrays, of lists where these have rows and columns.
    """
    with open_bounded(source.path, source.root, options.max_binary_bytes) as (file, n_bytes):
        reading = MatReading(source.path, n_bytes)
        variables = _read_v73(reading) if _is_v73(file, reading) else _read_scipy(file, reading)
    if not variables:
        left_out = f": {'; '.join(reading.left_out)}" if reading.left_out else ""
        raise RecordingFileError(source.path, f"holds no variable that can be read{left_out}")
    return variables, reading


def _is_v73(file: BinaryIO, reading: MatReading) -> bool:
    """Tell version 7.3, which is HDF5, from the older ones."""
    head = file.read(_HDF5_AT + len(_HDF5_MARK))
    file.seek(0)
    if head.startswith(_HDF5_MARK) or head[_HDF5_AT:] == _HDF5_MARK:
        return True
    if head.startswith(b"# Created by Octave"):
        raise reading.fault("header", "is text as Octave's save writes it by default; save it with -v7")
    if head.startswith(b"MATLAB 7.3"):
        raise reading.fault("header", "says MATLAB 7.3, but no HDF5 file follows: it is cut off or damaged")
    return False


# -- versions 4 to 7


def _read_scipy(file: BinaryIO, reading: MatReading) -> dict[str, Any]:
    from scipy.io.matlab import MatlabOpaque  # here: it takes 0.1 s to import

    variables: dict[str, Any] = {}
    with naming(reading.path, "reading its variables"):
        found = _by_scipy(file, reading)
    for key, raw in found:
        if key in variables:
            raise reading.fault(f"variable {key}", "occurs twice")
        called = _object_texts(raw)[0] or key if isinstance(raw, MatlabOpaque) else key
        value = _plain(raw, f"variable {called}", reading)
        if value is not None:
            variables[key] = value
    return variables


def _by_scipy(file: BinaryIO, reading: MatReading) -> list[tuple[str, Any]]:
    """Return names and values as scipy has them."""
    from scipy.io.matlab import loadmat, varmats_from_mat

    found: list[tuple[str, Any]] = []
    settings: dict[str, Any] = {"appendmat": False}
    order = file.read(_HEADER_BYTES)[-2:]
    if order in (b"IM", b"MI"):
        # MATLAB writes text as UTF-16; by default scipy keeps one byte of each character
        settings["uint16_codec"] = "utf-16-le" if order == b"IM" else "utf-16-be"
    with warnings.catch_warnings():
        for loss in _LOSSES:
            warnings.simplefilter("error", loss)
        warnings.simplefilter("ignore", DeprecationWarning)  # what sparse matrices will be: they are left out
        whole = _loaded(file, reading, settings)
        if whole is not None:
            found += whole.items()
        else:  # one by one: scipy before 1.18 gives all objects one name
            for _, part in varmats_from_mat(file):
                alone = _loaded(part, reading, settings)
                found += (loadmat(part, **settings) if alone is None else alone).items()
    return [(name, raw) for name, raw in found if not name.startswith("__")]


def _loaded(file: Any, reading: MatReading, settings: dict[str, Any]) -> dict[str, Any] | None:
    """Read in MATLAB's classes; None where scipy would lose something: an imaginary part, one of two of a name.

    None also where there is an object, which has no shape.
    """
    from scipy.io.matlab import loadmat, whosmat

    try:
        known = whosmat(file, appendmat=False)
    except TypeError:
        return None
    for name, shape, _ in known:
        reading.spend(8 * math.prod(shape), f"variable {name}")
    try:
        return dict(loadmat(file, mat_dtype=True, **settings))
    except _LOSSES:
        return None


def _object_texts(raw: Any) -> tuple[str, str]:
    """Return name and class of an object; no name where scipy has it elsewhere (from 1.18 on)."""
    if "s0" not in raw.dtype.names:
        return "", str(raw["_Class"].item())
    name, kind = (bytes(raw[part].item()).decode("utf-8", "backslashreplace") for part in ("s0", "s2"))
    return name, kind


def _plain(raw: Any, place: str, reading: MatReading) -> Any:
    """Return what scipy read as plain values, None where it was left out."""
    from scipy.io.matlab import MatlabFunction, MatlabOpaque
    from scipy.sparse import issparse

    if raw is None:  # an element of a struct array without fields
        return {}
    if isinstance(raw, MatlabOpaque):
        return reading.leave_out_object(place, _object_texts(raw)[1])
    if isinstance(raw, str):  # scipy's word on a variable that it gave up
        raise reading.fault(place, f"cannot be read ({raw[:200]})")
    is_function = isinstance(raw, MatlabFunction)
    if is_function or issparse(raw) or np.iscomplexobj(raw):
        return reading.leave_out(place, *_FUNCTION if is_function else _SPARSE if issparse(raw) else _COMPLEX)
    return _plain_array(raw, place, reading)


def _plain_array(raw: NDArray[Any], place: str, reading: MatReading) -> Any:
    items = raw.ravel(order="F")
    if raw.dtype.names is not None:
        columns = {name: list(items[name]) for name in raw.dtype.names}
        return _structs(columns, raw.shape, place, reading, _plain)
    if raw.dtype.kind == "O":
        return _cells(
            [_plain(item, f"{place}{{{i}}}", reading) for i, item in enumerate(items, 1)], raw.shape
        )
    if raw.dtype.kind == "U":
        return _texts(items.tolist())
    return raw.astype(raw.dtype.newbyteorder("="), copy=False)


# -- version 7.3: sizes in reverse, MATLAB's classes as attributes, cells as references into ``#refs#``


def _read_v73(reading: MatReading) -> dict[str, Any]:
    variables: dict[str, Any] = {}
    with opened(reading, "to read .mat files of version 7.3") as file:
        for name in file:
            if name.startswith("#"):  # where MATLAB keeps the contents of cells and objects
                continue
            place = f"variable {name}"
            with naming(reading.path, f"reading {place}"):
                value = _Node(file, reading).value(member(file, name, place, reading), place)
            if value is not None:
                variables[name] = value
    return variables


@dataclass
class _Node:
    """Goes from variables through structs and references to the values."""

    file: Any
    reading: MatReading

    def value(self, item: Any, place: str) -> Any:
        """Return one value of whatever class, None where it was left out."""
        class_name = attribute(item, "MATLAB_class", place, self.reading)
        if class_name == "function_handle":
            return self.reading.leave_out(place, *_FUNCTION)
        if "MATLAB_object_decode" in item.attrs:
            return self.reading.leave_out_object(place, str(class_name))
        if "MATLAB_sparse" in item.attrs:
            return self.reading.leave_out(place, *_SPARSE)
        if "OCTAVE_NEW_FORMAT" in item.attrs:
            raise self.reading.fault(place, "was written by Octave's save -hdf5; wanted save -v7")
        if class_name is None:
            problem = "has no attribute MATLAB_class: the file is HDF5, but not as MATLAB writes it"
            raise self.reading.fault(place, f"{problem}; save it with -v7 or -v7.3, or name it .h5")
        if is_group(item) and class_name == "struct":
            return self._struct(item, place)
        if is_group(item) or class_name not in (*_NUMBERS, "char", "cell", "struct"):
            raise self.reading.fault(place, f"is of the class {str(class_name)[:80]!r}, which cannot be read")
        return self._dataset(item, class_name, place)

    def _dataset(self, item: Any, class_name: str, place: str) -> Any:
        raw = values(item, place, self.reading)
        if item.attrs.get("MATLAB_empty"):  # the values are its size
            if class_name not in _NUMBERS:
                return "" if class_name == "char" else []
            return np.empty([int(n) for n in raw.ravel()], _NUMBERS[class_name])
        if raw.dtype.names is not None:
            return self.reading.leave_out(place, *_COMPLEX)
        if class_name == "cell":
            return self._cell(raw, place)
        array = raw.reshape((1,) * (2 - raw.ndim) + raw.shape).T
        if class_name == "char":
            wide = np.ascontiguousarray(array).astype(f"<u{max(array.dtype.itemsize, 2)}")
            codec = f"utf-{8 * wide.itemsize}-le"
            return _texts([row.tobytes().decode(codec, "replace") for row in wide])
        return array.astype(_NUMBERS[class_name], copy=False)

    def _cell(self, references: Any, place: str) -> Any:
        targets = [self._target(ref, f"{place}{{{i}}}") for i, ref in enumerate(references.ravel(), 1)]
        return _cells(targets, references.shape[::-1])

    def _target(self, reference: Any, place: str) -> Any:
        return self.value(self.file[reference], place)

    def _struct(self, group: Any, place: str) -> Any:
        members = {name: member(group, name, f"{place}.{name}", self.reading) for name in group}
        if members and all(map(_is_column, members.values())):
            columns = {name: values(item, place, self.reading) for name, item in members.items()}
            shape = next(iter(columns.values())).shape[::-1]
            listed = {name: list(column.ravel()) for name, column in columns.items()}
            return _structs(
                listed, shape, place, self.reading, lambda ref, where, _: self._target(ref, where)
            )
        record = {name: self.value(item, f"{place}.{name}") for name, item in members.items()}
        return {name: value for name, value in record.items() if value is not None}


def _is_column(item: Any) -> bool:
    """Tell whether a field holds one reference per element of a struct array (a cell has a class)."""
    return not is_group(item) and item.dtype.kind == "O" and "MATLAB_class" not in item.attrs


# -- what both have in common


def _texts(rows: list[str]) -> str | list[str]:
    """Return a char array as a str; several rows as a list, without the blanks that pad them to one width."""
    return "" if not rows else rows[0] if len(rows) == 1 else [row.rstrip(" \0") for row in rows]


def _cells(items: list[Any], dims: Sequence[int]) -> Any:
    if any(item is None for item in items):  # without one, the others would count wrongly
        return None
    return nested(items, dims)


def _structs(
    columns: Mapping[str, list[Any]], dims: Sequence[int], place: str, reading: MatReading, plain: Any
) -> Any:
    """Return a struct as a dict, a struct array as a list of them; fields that cannot be read are missing."""
    n = math.prod(dims)
    records: list[dict[str, Any]] = []
    for i in range(n):
        where = place if n == 1 else f"{place}({i + 1})"
        record = {name: plain(column[i], f"{where}.{name}", reading) for name, column in columns.items()}
        records.append({name: value for name, value in record.items() if value is not None})
    return records[0] if n == 1 else nested(records, dims)


def nested(items: list[Any], dims: Sequence[int]) -> list[Any]:
    """Arrange what a file lists column by column: vectors as a list, matrices as lists of their rows."""
    long = [n for n in dims if n != 1]
    if not items or len(long) <= 1:
        return items
    rows = long[0]
    return [nested(items[i::rows], long[1:]) for i in range(rows)]

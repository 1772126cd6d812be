"""MATLAB files: versions 4 to 7 by scipy, 7.3, which is HDF5, by h5py; no format to write."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from granular_id.io.arrays import content_of
from granular_id.io.files import RecordingFileError
from granular_id.io.hdf5 import opened
from granular_id.io.leaves import MOST_DEEP, Leaf, Opening
from granular_id.io.source import FileContent, FileSource, LoadOptions

_V73 = Opening(
    "variable",
    "h5py.File({})",
    "[()].T",
    "[''.join(map(chr, f[one][()].ravel())) for one in {}[()].ravel()]",
    by_reference=True,
)
_HDF5 = b"\x89HDF\r\n\x1a\n"
_OBJECTS = (
    "MATLAB's own objects (string, table, datetime, function) cannot be read: save cellstr(...) of texts, "
    "table2struct(T, 'ToScalar', true) of tables, seconds(...) of times"
)


def read_mat(source: FileSource, options: LoadOptions) -> FileContent:
    """Read one MATLAB file by the convention for arrays; objects of MATLAB's classes are left out, with a note."""
    with source.path.open("rb") as file:
        head = file.read(512 + len(_HDF5))
    left_out: list[str] = []
    if head.startswith(_HDF5) or head[512:] == _HDF5:
        tree = _read_v73(source, left_out)
        opening = _V73
    else:
        if head.startswith(b"# Created by Octave"):
            raise RecordingFileError(
                source.path, "is text as Octave's save writes it by default; save it with -v7"
            )
        tree = _read_scipy(source, left_out)
        opening = Opening("variable", "scipy.io.loadmat({}, simplify_cells=True)")
    try:
        content = content_of(tree, source, options, opening)
    except RecordingFileError as error:
        if not left_out:
            raise
        problem = (*error.parts, f"; {', '.join(left_out)[:200]}: {_OBJECTS}")
        raise RecordingFileError(source.path, problem, place=error.place) from error
    if left_out:
        content.notes.append(f"{', '.join(left_out)[:200]} left out: {_OBJECTS}")
    return content


def _read_scipy(source: FileSource, left_out: list[str]) -> dict[str, Any]:
    from scipy.io import loadmat  # here: it takes 0.1 s to import

    with warnings.catch_warnings():
        warnings.simplefilter("error", np.exceptions.ComplexWarning)
        warnings.simplefilter("error", UserWarning)  # scipy goes on without something
        warnings.simplefilter("ignore", DeprecationWarning)
        found = loadmat(source.path, simplify_cells=True, appendmat=False)
    return _there((name, _node(found[name], name, left_out)) for name in found if not name.startswith("__"))


def _there(nodes: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Return nodes by their names without those that are no data."""
    return {name: node for name, node in nodes if node is not None}


def _node(value: Any, name: str, left_out: list[str]) -> Any:
    """Return what scipy read as a node of a tree: a mapping, a list of nodes, or an array; None for what is no data."""
    from scipy.sparse import issparse

    if isinstance(value, Mapping):
        return _there((key, _node(item, f"{name}.{key}", left_out)) for key, item in value.items())
    if isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        items = value.ravel().tolist() if isinstance(value, np.ndarray) else value
        if items and all(isinstance(item, str) for item in items):
            return Leaf(np.array(items, np.str_))
        return [_node(item, f"{name}({i + 1})", left_out) for i, item in enumerate(items)]
    array = np.asarray(value)
    if issparse(value) or array.dtype.kind not in "biufUS":
        left_out.append(name)
        return None
    if array.dtype.kind == "U" and array.ndim:  # rows of a char array are padded
        array = np.char.rstrip(array, " \0")
    return Leaf(array.astype(np.uint8) if array.dtype.kind == "b" else array)


# Version 7.3: sizes in reverse, MATLAB's classes as attributes, cells as references.


def _read_v73(source: FileSource, left_out: list[str]) -> dict[str, Any]:
    with opened(source, "to read .mat files of version 7.3") as file:
        names = [name for name in file if not name.startswith("#")]
        return _there((name, _node73(file, file[name], name, left_out)) for name in names)


def _node73(file: Any, item: Any, name: str, left_out: list[str], depth: int = 0) -> Any:
    kind = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)
    is_group = hasattr(item, "keys")
    is_object = depth > MOST_DEEP or "MATLAB_object_decode" in item.attrs or kind == "function_handle"
    if is_object or (not is_group and item.dtype.kind not in "iufO"):
        left_out.append(name)
        return None
    if is_group:
        return _struct73(file, item, name, left_out, depth)
    values = item[()]
    if item.attrs.get("MATLAB_empty"):  # the values are its size
        return Leaf(np.array("") if kind == "char" else np.empty([int(n) for n in np.ravel(values)]))
    if values.dtype.kind == "O":
        refs = enumerate(values.T.ravel(order="F"))
        nodes = [_node73(file, file[ref], f"{name}({i + 1})", left_out, depth + 1) for i, ref in refs]
        texts = [node.values for node in nodes if isinstance(node, Leaf) and node.values.dtype.kind == "U"]
        return Leaf(np.array(texts)) if texts and len(texts) == len(nodes) else nodes
    if kind == "char":
        values = np.array(["".join(map(chr, row)).rstrip(" \0") for row in np.atleast_2d(values.T).tolist()])
    flat = 1 in values.shape and len(values.shape) < 3
    return Leaf(np.squeeze(values) if flat else values.T)


def _struct73(file: Any, group: Any, name: str, left_out: list[str], depth: int) -> Any:
    fields = {key: group[key] for key in group}
    listed = bool(fields) and all(
        not hasattr(item, "keys") and item.dtype.kind == "O" and "MATLAB_class" not in item.attrs
        for item in fields.values()
    )
    if not listed:
        return _there(
            (key, _node73(file, item, f"{name}.{key}", left_out, depth + 1)) for key, item in fields.items()
        )
    columns = [
        (key, item[()].ravel()) for key, item in fields.items()
    ]  # a struct array: a reference an element
    n = min(len(refs) for _, refs in columns)
    return [
        _there(
            (key, _node73(file, file[refs[i]], f"{name}({i + 1}).{key}", left_out, depth + 1))
            for key, refs in columns
        )
        for i in range(n)
    ]

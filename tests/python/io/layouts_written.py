"""Trees of named arrays, written as each format keeps them: what the tables of layouts and metadata are read from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

h5py = pytest.importorskip("h5py")

_RNG = np.random.default_rng(5)
X = _RNG.normal(size=(4, 50, 6))
W = X[0]
RAGGED = [_RNG.normal(size=(n, 6)) for n in (50, 40, 60, 50)]
LABELS = ["rice", "peas", "rice", "oats"]
AXES = ["fx", "fy", "fz", "tx", "ty", "tz"]
T = np.arange(50) / 500

Tree = Mapping[str, Any]


def is_list(value: Any) -> bool:
    """Tell cells and struct arrays from texts."""
    return isinstance(value, list) and not all(isinstance(item, str) for item in value)


def has_lists(tree: Any) -> bool:
    inner = tree.values() if isinstance(tree, Mapping) else ()
    return is_list(tree) or any(map(has_lists, inner))


def to_npz(tree: Tree, path: Path) -> None:
    def flat(node: Tree, prefix: str) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in node.items():
            inner = isinstance(value, Mapping)
            found |= flat(value, f"{prefix}{key}/") if inner else {f"{prefix}{key}": value}
        return found

    np.savez(path, **flat(tree, ""))


def to_h5(tree: Tree, path: Path) -> None:
    def put(group: Any, node: Tree) -> None:
        for key, value in node.items():
            if isinstance(value, Mapping):
                put(group.create_group(key), value)
            else:
                is_text = np.asarray(value).dtype.kind == "U"
                group[key] = np.asarray(value).tolist() if is_text else value

    with h5py.File(path, "w") as file:
        put(file, tree)


def cells(values: Any) -> np.ndarray:
    array = np.empty(len(values), object)
    for i, value in enumerate(values):
        array[i] = _for_matlab(value)
    return array


def _for_matlab(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _for_matlab(inner) for key, inner in value.items()}
    return cells(value) if isinstance(value, list) else value


def to_mat(tree: Tree, path: Path) -> None:
    scipy.io.savemat(path, _for_matlab(tree), long_field_names=True)


def to_mat73(tree: Tree, path: Path) -> None:
    """Write as MATLAB's save -v7.3 does."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for key, value in tree.items():
            _put73(file, key, value, file.require_group("#refs#"))


def _put73(group: Any, key: str, value: Any, hidden: Any) -> None:
    class_name = "double"
    if isinstance(value, Mapping):
        class_name = "struct"
        inner = group.create_group(key)
        for name, item in value.items():
            _put73(inner, name, item, hidden)
    elif isinstance(value, list) and isinstance(
        value[0], Mapping
    ):  # a struct array: references in each field
        class_name = "struct"
        inner = group.create_group(key)
        for field in value[0]:
            references = np.empty((len(value), 1), h5py.ref_dtype)
            for i, struct in enumerate(value):
                _put73(hidden, f"{key}_{field}_{i}", struct[field], hidden)
                references[i, 0] = hidden[f"{key}_{field}_{i}"].ref
            inner.create_dataset(field, data=references, dtype=h5py.ref_dtype)
    elif isinstance(value, list):
        class_name = "cell"
        references = np.empty((1, len(value)), h5py.ref_dtype)
        for i, item in enumerate(value):
            _put73(hidden, f"{key}_{i}", item, hidden)
            references[0, i] = hidden[f"{key}_{i}"].ref
        group.create_dataset(key, data=references, dtype=h5py.ref_dtype)
    elif isinstance(value, str):
        class_name = "char"
        group[key] = np.array([[ord(c)] for c in value], np.uint16)
    elif np.asarray(value).dtype.kind == "U":
        _put73(group, key, np.asarray(value).tolist(), hidden)
        return
    else:
        array = np.atleast_2d(value)
        class_name = {"bool": "logical", "float64": "double", "float32": "single"}.get(
            array.dtype.name, array.dtype.name
        )
        group[key] = (array.astype(np.uint8) if class_name == "logical" else array).transpose()
    group[key].attrs["MATLAB_class"] = np.bytes_(class_name)


WRITERS = {"npz": to_npz, "h5": to_h5, "mat": to_mat, "v73.mat": to_mat73}
"""By the ending of what they write."""

FLAT = ("npz", "h5")
"""Formats without lists of arrays."""


def formats_of(tree: Tree) -> list[str]:
    """Return the formats that can hold a tree."""
    return [form for form in WRITERS if not (has_lists(tree) and form in FLAT)]


def written(tree: Tree, form: str, folder: Path, name: str = "set") -> Path:
    path = folder / f"{name}.{form.removeprefix('v73.')}"
    path.parent.mkdir(parents=True, exist_ok=True)
    WRITERS[form](tree, path)
    return path

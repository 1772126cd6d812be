"""HDF5: a data set that ``save_hdf5`` wrote, or a file of arrays that somebody else wrote."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.arrays.layouts import recordings_of
from granular_id.io.errors import RecordingFileError
from granular_id.io.expansion import Expansion
from granular_id.io.files import check_file
from granular_id.io.flat import FORMAT, NUMBERS, RECORDING_BYTES, TEXTS, VERSION, FlatRecordings, unflatten
from granular_id.io.hdf5.guard import GuardedFile
from granular_id.io.hdf5.save import SAMPLES, UNITS
from granular_id.io.hdf5.tree import Hdf5Tree
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource
from granular_id.io.units import factor
from granular_id.recording import unit_of

__all__ = ["read_hdf5"]

_LISTED = 3


def read_hdf5(source: FileSource, options: LoadOptions) -> FileContent:
    """Read an HDF5 file: one of ``save_hdf5``, or groups and arrays whose layout is guessed and said.

    Links, values kept in other files and filters other than gzip, lzf and shuffle are refused.

    Raises
    ------
    RecordingFileError
        With the dataset: damaged, cut off, too large, or not what is wanted.
    ImportError
        h5py is missing.
    """
    n_bytes = check_file(source.path, source.root, options.max_binary_bytes)
    expansion = Expansion(source.path, n_bytes)
    with GuardedFile(expansion, "to read .h5 files") as file:
        if _is_own(file):
            return _read_own(file, source)
        tree = Hdf5Tree(file)
        content = recordings_of(tree.whole(), source, options, "data set")
    if tree.left_out:
        more = len(tree.left_out) - _LISTED
        listed = "; ".join(tree.left_out[:_LISTED]) + (f"; and {more} more" if more > 0 else "")
        content.notes.append(f"left out: {listed}")
    return content


def _is_own(file: GuardedFile) -> bool:
    try:
        return bool(file.attribute(file.root, "format", "header") == FORMAT)
    except RecordingFileError:  # an attribute of that name that is somebody else's
        return False


def _read_own(file: GuardedFile, source: FileSource) -> FileContent:
    path = source.path
    version = file.attribute(file.root, "version", "header")
    if not isinstance(version, np.integer) or version != VERSION:
        problem = f"is of version {version!s:.40}; this granular_id reads version {VERSION}"
        raise RecordingFileError(path, problem, place="header")
    top = set(file.names(file.root, "header"))
    group = _member(file, file.root, "recordings", "group recordings")
    columns = {name: _values(file, group, name, f"recordings/{name}") for name in NUMBERS}
    file.expansion.spend(columns["n_samples"].size * RECORDING_BYTES, "recordings/n_samples")
    texts = {name: _texts(_values(file, group, name, f"recordings/{name}"), name, path) for name in TEXTS}
    (meta,) = _texts(_values(file, group, "meta", "recordings/meta"), "meta", path)
    (history,) = _texts(_values(file, file.root, "history", "history"), "history", path)
    columns |= {
        name: _values(file, file.root, name, name) for name in SAMPLES if name in top or name == "wrench"
    }
    wrench = _member(file, file.root, "wrench", "wrench")
    axes = _axes(file, wrench, path)
    _refuse_other_units(file, columns)
    scales = _scales(file, wrench, axes)
    if scales is not None:
        columns["wrench"] = columns["wrench"] * scales
    flat = FlatRecordings.of_texts(axes, texts, meta, history, columns)
    content = unflatten(flat, path, source, finite=file.known_finite(wrench) and scales is None)
    unknown = sorted(top - {*SAMPLES, "recordings", "history"})
    if unknown:
        content.notes.append(
            f"members that are no part of the format were not read: {', '.join(unknown)[:200]}"
        )
    return content


def _axes(file: GuardedFile, wrench: Any, path: Any) -> tuple[str, ...]:
    axes = file.attribute(wrench, "axes", "wrench")
    return tuple(_texts(np.asarray(axes), "attribute axes of wrench", path))


def _scales(file: GuardedFile, wrench: Any, axes: tuple[str, ...]) -> tuple[float, ...] | None:
    """Return what samples must be multiplied with to be in the units of the axes; None: nothing."""
    if not file.has_attribute(wrench, "units", "wrench"):
        return None
    place = "wrench, attribute units"
    said = _texts(np.asarray(file.attribute(wrench, "units", "wrench")), place, file.expansion.path)
    scales = [factor(unit, unit_of(axis)) for unit, axis in zip(said, axes, strict=False)]
    if len(said) != len(axes) or None in scales:
        wanted = ", ".join(unit_of(axis) for axis in axes)
        raise file.expansion.fault(place, f"names {', '.join(said)[:80]}; wanted {wanted}, or mN, mN m ...")
    known = tuple(scale for scale in scales if scale is not None)
    return known if any(scale != 1 for scale in known) else None


def _refuse_other_units(file: GuardedFile, columns: Mapping[str, Any]) -> None:
    for name, unit in UNITS.items():
        member = name.rpartition("/")[2]
        if member not in columns:
            continue
        item = file.root
        for part in name.split("/"):
            item = _member(file, item, part, name)
        said = file.attribute(item, "units", name)
        if said is not None and factor(str(said), unit) != 1:
            raise file.expansion.fault(
                name, f"is in {said!s:.40}, as its attribute units says; wanted {unit}"
            )


def _member(file: GuardedFile, group: Any, name: str, place: str) -> Any:
    if not file.is_group(group) or name not in file.names(group, place):
        raise file.expansion.fault(place, f"is missing; wanted what '{FORMAT} {VERSION}' has")
    return file.member(group, name, place)


def _values(file: GuardedFile, group: Any, name: str, place: str) -> NDArray[Any]:
    item = _member(file, group, name, place)
    if file.is_group(item):
        raise file.expansion.fault(place, "is a group; wanted values")
    return file.values(item, place)


def _texts(values: NDArray[Any], place: str, path: Any) -> list[str]:
    if values.dtype.kind not in "SU" or values.ndim > 1:
        raise RecordingFileError(
            path, f"has shape {values.shape} and type {values.dtype}; wanted texts", place=place
        )
    try:
        return [text if isinstance(text, str) else text.decode("utf-8") for text in values.ravel().tolist()]
    except UnicodeDecodeError as error:
        raise RecordingFileError(path, f"is not UTF-8 text: {error}", place=place) from error

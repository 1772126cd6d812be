"""NPZ files: a whole data set in one file that numpy alone can read; and archives of arrays that others made.

``save_npz`` stores the columns of :class:`FlatRecordings` under their names; texts that are unknown are empty.
``docs/formats/npz.md`` describes each array. Python objects (pickle) are neither written nor read.
"""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._files import new_file
from granular_id._progress import ProgressCallback, Ticker
from granular_id.io.arrays.layouts import recordings_of
from granular_id.io.arrays.tree import texts
from granular_id.io.errors import RecordingFileError, naming
from granular_id.io.files import Expansion, open_bounded
from granular_id.io.flat import (
    NUMBERS,
    OPTIONAL,
    SAMPLES,
    TEXTS,
    FlatRecordings,
    Leaf,
    flatten,
    plain_texts,
    unflatten,
)
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import Dataset

FORMAT = "granular_id recordings"
MARK = f"{FORMAT} 1"
"""What files of flat columns call themselves, with their version."""

_MARK = "format"
"""Array that says what the file is: `MARK`."""

_WHOLE_TEXTS = ("meta", "history")
_REQUIRED = ("wrench", "axes", *NUMBERS, *TEXTS, *_WHOLE_TEXTS)

_RECORDING_BYTES = 1024
"""What a recording costs in memory beside its samples; counted before a file of a million empty ones is read."""

_SUFFIX = ".npy"


def save_npz(
    dataset: Dataset, path: str | os.PathLike[str], *, progress: ProgressCallback | None = None
) -> Path:
    """Write a data set as one NPZ file that ``load`` gives back bit for bit; `progress` is called after each array.

    Nothing is compressed: float64 samples of a real sensor shrink little, and reading takes five times as long.
    """
    target = Path(path)
    arrays = _arrays(flatten(dataset))
    ticker = Ticker(len(arrays), progress)
    with new_file(target) as draft, zipfile.ZipFile(draft, "w") as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)
            ticker.tick(name)
    return target


def read_npz(source: FileSource, options: LoadOptions) -> FileContent:
    """Read an NPZ file: one of ``save_npz``, or an archive of arrays whose layout is guessed and said."""
    with open_bounded(source.path, source.root, options.max_binary_bytes) as (file, n_bytes):
        with naming(source.path, "listing its arrays"):
            archive = zipfile.ZipFile(file)
        with archive:
            return _read(archive, Expansion(source.path, n_bytes), source, options)


def _read(
    archive: zipfile.ZipFile, expansion: Expansion, source: FileSource, options: LoadOptions
) -> FileContent:
    names = [name for name in archive.namelist() if name.endswith(_SUFFIX)]
    others = [name for name in archive.namelist() if not name.endswith(_SUFFIX)]
    arrays = {name[: -len(_SUFFIX)]: _member(archive, name, expansion) for name in names}
    if len(arrays) < len(names):
        raise RecordingFileError(source.path, "holds two arrays of one name; wanted a name for each")
    said = texts(arrays[_MARK]) if _MARK in arrays else None
    if said and said[0].startswith(FORMAT):
        if said[0] != MARK:
            problem = f"is of the format {said[0]!r:.80}; this version of granular-id reads {MARK!r}"
            raise RecordingFileError(source.path, problem)
        known = {_MARK, *_REQUIRED, *OPTIONAL}
        return _read_own(arrays, [*sorted(set(arrays) - known), *others], expansion, source)
    content = recordings_of(_tree(arrays, source.path), source, options, "array")
    if others:
        content.notes.append(f"members that are no arrays were not read: {', '.join(others[:10])}")
    return content


def _read_own(
    arrays: Mapping[str, Leaf], others: Sequence[str], expansion: Expansion, source: FileSource
) -> FileContent:
    """Read what `save_npz` wrote; `others` are the names of what the file holds besides."""
    missing = next((name for name in _REQUIRED if name not in arrays), None)
    if missing is not None:
        raise expansion.fault(missing, f"is missing; wanted all of {MARK!r}")
    columns = {name: arrays[name].read() for name in NUMBERS}
    expansion.spend(columns["n_samples"].size * _RECORDING_BYTES, "n_samples")
    listed = {name: _texts(arrays[name], expansion) for name in ("axes", *TEXTS)}
    meta, history = (_whole_text(arrays[name], expansion) for name in _WHOLE_TEXTS)
    flat = FlatRecordings(
        axes=tuple(listed["axes"]),
        label=[text or None for text in listed["label"]],
        session=[text or None for text in listed["session"]],
        name=listed["name"],
        meta_json=[None if line == "{}" else line for line in meta.split("\n")],
        history_json=history,
        **columns,
        **{name: arrays[name].read() for name in SAMPLES if name in arrays},
    )
    content = unflatten(flat, source.path, source)
    if others:
        unread = ", ".join(others)[:200]
        content.notes.append(f"members that are no part of the format were not read: {unread}")
    return content


def _texts(column: Leaf, expansion: Expansion) -> list[str]:
    """Return the texts of a column, one per recording or axis."""
    array = column.read()
    words = plain_texts(array.reshape(-1)) if array.dtype.kind == "U" and array.ndim < 2 else None
    if words is None:
        raise _no_text(column, expansion)
    return words


def _whole_text(column: Leaf, expansion: Expansion) -> str:
    """Return the one text whose bytes a column holds."""
    array = column.read()
    try:
        if array.dtype == np.uint8:
            return array.tobytes().decode("utf-8")
    except UnicodeDecodeError:
        pass
    raise _no_text(column, expansion)


def _no_text(column: Leaf, expansion: Expansion) -> RecordingFileError:
    problem = f"has shape {column.shape} and type {column.dtype}; wanted texts in UTF-8"
    return expansion.fault(column.place, problem)


def _member(archive: zipfile.ZipFile, name: str, expansion: Expansion) -> Leaf:
    place = f"array {name[: -len(_SUFFIX)]}"

    def read() -> NDArray[Any]:
        with naming(expansion.path, f"reading {place}"), archive.open(name) as stream:
            values = np.lib.format.read_array(stream, allow_pickle=False)
            if stream.read(1):  # the checksum is compared where the end is met
                raise expansion.fault(place, "is longer than it claims")
        return np.asarray(values)

    with naming(expansion.path, f"reading {place}"), archive.open(name) as stream:
        return Leaf(place, *header_of(stream, place, expansion), read)


def _arrays(flat: FlatRecordings) -> dict[str, NDArray[Any]]:
    arrays: dict[str, Any] = {_MARK: np.array(MARK), "axes": np.array(flat.axes, dtype=np.str_)}
    arrays |= {name: getattr(flat, name) for name in ("wrench", *NUMBERS, *OPTIONAL)}
    arrays |= {name: np.array(words, dtype=np.str_) for name, words in flat.texts.items()}
    for name, text in (("meta", flat.meta_lines), ("history", flat.history_json)):
        arrays[name] = np.frombuffer(text.encode("utf-8"), np.uint8)
    return {name: array for name, array in arrays.items() if array is not None}


def _tree(arrays: Mapping[str, Any], path: Path) -> Mapping[str, Any]:
    """Arrange arrays called ``rice/1`` as HDF5 would: a group ``rice`` with ``1`` in it."""
    tree: dict[str, Any] = {}
    for key, member in arrays.items():
        *groups, name = key.split("/")
        place = tree
        for group in groups:
            place = place.setdefault(group, {})
            if not isinstance(place, dict):
                raise RecordingFileError(path, f"holds both an array {group!r} and arrays within it")
        if name in place:
            raise RecordingFileError(path, f"holds both an array {key!r} and arrays within it")
        place[name] = member
    return tree


# NumPy's arrays: what their header says, and files of one (``.npy``), which say nothing about rate or labels.


def header_of(stream: IO[bytes], place: str, expansion: Expansion) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return shape and type of an array, whose values may be read: no objects, and not beyond all measure."""
    with naming(expansion.path, f"reading the header of {place}"):
        version = np.lib.format.read_magic(stream)
        # version 3.0 differs from 2.0 in the encoding of field names only
        of_version = (
            np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        )
        shape, _, dtype = of_version(stream)
    if dtype.hasobject:
        problem = (
            "holds Python objects (pickled), which could run code; save texts as numpy.array(texts, dtype=str), "
            "recordings of several lengths as numpy.savez(file, rice_01=first, rice_02=second), or as one array "
            "with NaN behind the shorter ones"
        )
        raise expansion.fault(place, problem)
    expansion.spend(math.prod(shape) * max(dtype.itemsize, 8), place)  # numbers become float64
    return shape, dtype


def read_npy(source: FileSource, options: LoadOptions) -> FileContent:
    """Read an array of one or several recordings, or a structured array with the fields fx ... tz, and perhaps time."""
    with open_bounded(source.path, source.root, options.max_binary_bytes) as (file, n_bytes):
        header = header_of(file, "the array", Expansion(source.path, n_bytes))
        file.seek(0)
        leaf = Leaf("values", *header, lambda: np.asarray(np.load(file, allow_pickle=False)))
        if leaf.dtype.names is None:
            return recordings_of({"values": leaf}, source, options, "array", single=True)
        array = leaf.read()
    return recordings_of({field: array[field] for field in leaf.dtype.names}, source, options, "field")

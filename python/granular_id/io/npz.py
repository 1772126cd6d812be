"""NumPy: a whole data set in one NPZ file; NPZ archives and NPY arrays of others.

``save_npz`` stores the columns of ``io/flat.py`` under their names, `meta` and `history` as the bytes of their texts.
``docs/formats/npz.md`` describes each array. Python objects (pickle) are neither written nor read.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._files import new_file
from granular_id._progress import ProgressCallback, Ticker
from granular_id.io.arrays import content_of
from granular_id.io.files import RecordingFileError
from granular_id.io.flat import NUMBERS, OPTIONAL, TEXTS, flatten, unflatten
from granular_id.io.leaves import Leaf, Opening
from granular_id.io.source import FileContent, FileSource, LoadOptions
from granular_id.io.ways_out import frames_line, in_python
from granular_id.recording import Dataset, Table

FORMAT = "granular_id recordings"
MARK = f"{FORMAT} 1"
"""What files of flat columns call themselves, with their version."""

_MARK = "format"
_WHOLE_TEXTS = ("meta", "history")
_REQUIRED = ("wrench", "axes", *NUMBERS, *TEXTS, *_WHOLE_TEXTS)
_PICKLED = (
    "holds Python objects (pickled), which could run code; save texts as numpy.array(texts, dtype=str), recordings of "
    "several lengths as numpy.savez(file, rice_1=first, rice_2=second); if nobody else can have written it"
)


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


def _arrays(columns: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    arrays = {_MARK: np.array(MARK)}
    for name, values in columns.items():
        if name in _WHOLE_TEXTS:
            arrays[name] = np.frombuffer(values.encode("utf-8"), np.uint8)
        else:
            arrays[name] = np.array(values, np.str_) if name in ("axes", *TEXTS) else values
    return arrays


def read_npz(source: FileSource, options: LoadOptions) -> FileContent:
    """Read an NPZ file: one of ``save_npz``, or arrays of others."""
    if not zipfile.is_zipfile(source.path):
        raise RecordingFileError(source.path, "is no NPZ archive: it may be cut off, or of another format")
    with source.path.open("rb") as file:
        archive = np.load(file, allow_pickle=False)
        arrays = {name: _member(archive, name, source) for name in archive.files}
    mark = str(arrays[_MARK]) if _MARK in arrays and arrays[_MARK].dtype.kind == "U" else ""
    if not mark.startswith(FORMAT):
        opening = Opening("array", "numpy.load({})", is_flat=True)
        return content_of(_tree(arrays, source.path), source, options, opening)
    if mark != MARK:
        problem = f"is of the format {mark!r:.80}; this version of granular-id reads {MARK!r}"
        raise RecordingFileError(source.path, problem)
    return _read_own(arrays, source)


def _member(archive: Any, name: str, source: FileSource) -> NDArray[Any]:
    try:
        return np.asarray(archive[name])
    except ValueError as error:
        if "pickle" not in str(error):
            raise
        y = ", list(f['y'])" * ("y" in archive.files)
        raise _pickled(source, f"list(f[{name!r}]){y}", place=f"array {name}") from error


def _pickled(source: FileSource, X: str, place: str | None = None) -> RecordingFileError:
    opened = f"f = numpy.load({str(source.path)!r}, allow_pickle=True)"
    line = in_python(opened, f"Dataset.from_arrays({X}, rate_hz=RATE)")
    return RecordingFileError(source.path, (_PICKLED, line), place=place)


def _read_own(arrays: Mapping[str, NDArray[Any]], source: FileSource) -> FileContent:
    """Read what `save_npz` wrote."""
    missing = next((name for name in _REQUIRED if name not in arrays), None)
    if missing is not None:
        raise RecordingFileError(source.path, f"is missing; wanted all of {MARK!r}", place=f"array {missing}")
    listed = {name: _words(arrays[name], name, source) for name in ("axes", *TEXTS)}
    whole = {name: _whole_text(arrays[name], name, source) for name in _WHOLE_TEXTS}
    content = unflatten({**arrays, **listed, **whole}, source.path)
    others = sorted(set(arrays) - {_MARK, *_REQUIRED, *OPTIONAL})
    if others:
        content.notes.append(
            f"members that are no part of the format were not read: {', '.join(others)[:200]}"
        )
    return content


def _words(array: NDArray[Any], name: str, source: FileSource) -> list[str]:
    if array.dtype.kind != "U" or array.ndim > 1:
        problem = f"is {array.dtype} of shape {array.shape}; wanted texts"
        raise RecordingFileError(source.path, problem, place=f"array {name}")
    return [str(word) for word in array.reshape(-1).tolist()]


def _whole_text(array: NDArray[Any], name: str, source: FileSource) -> str:
    """Return the one text whose bytes a column holds."""
    try:
        if array.dtype == np.uint8:
            return array.tobytes().decode("utf-8")
    except UnicodeDecodeError:
        pass
    raise RecordingFileError(
        source.path, f"is {array.dtype}; wanted the bytes of a text in UTF-8", place=f"array {name}"
    )


def _tree(arrays: Mapping[str, Any], path: Path) -> Mapping[str, Any]:
    """Arrange arrays called ``rice/1`` as HDF5 would: a group ``rice`` with ``1`` in it."""
    tree: dict[str, Any] = {}
    for key, array in arrays.items():
        *groups, name = key.split("/")
        place = tree
        for group in groups:
            place = place.setdefault(group, {})
            if not isinstance(place, dict):
                raise RecordingFileError(path, f"holds both an array {group!r} and arrays within it")
        if name in place:
            raise RecordingFileError(path, f"holds both an array {key!r} and arrays within it")
        place[name] = Leaf(array)
    return tree


def read_npy(source: FileSource, options: LoadOptions) -> FileContent:
    """Read an array of one recording, (samples, axes), or of several, (recordings, samples, axes)."""
    with source.path.open("rb") as file:
        if file.read(6) != np.lib.format.MAGIC_PREFIX:
            raise RecordingFileError(
                source.path, "is no NumPy array: it may be cut off, or of another format"
            )
    try:
        array = np.load(source.path, allow_pickle=False)
    except ValueError as error:
        if "pickle" not in str(error):
            raise
        raise _pickled(source, "list(f)") from error
    if array.dtype.names is not None:
        table = Table(name=source.name, columns={name: array[name] for name in array.dtype.names})
        lines = frames_line("pandas.DataFrame(numpy.load({}))", source, table, "")
        raise RecordingFileError(source.path, (f"has the fields {', '.join(array.dtype.names)}", *lines))
    return content_of({"X": Leaf(array)}, source, options, Opening("array", "{{'X': numpy.load({})}}"))

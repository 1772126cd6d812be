"""NPZ files: a whole data set in one file that numpy alone can read; and archives of arrays that others made.

``save_npz`` stores the columns of :class:`FlatRecordings` under their names; texts that are unknown are empty.
``docs/formats/npz.md`` describes each array. Python objects (pickle) are neither written nor read.
"""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._files import new_file
from granular_id._progress import ProgressCallback, Ticker
from granular_id.io.arrays.layouts import recordings_of
from granular_id.io.arrays.tree import plain_texts, texts
from granular_id.io.errors import RecordingFileError
from granular_id.io.flat import (
    FORMAT,
    NUMBERS,
    OPTIONAL,
    RECORDING_BYTES,
    TEXTS,
    VERSION,
    FlatRecordings,
    flatten,
    unflatten,
)
from granular_id.io.npz.archive import NpzArchive, NpzMember, open_npz
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import Dataset

_MARK = "format"
"""Array that says what the file is: `FORMAT` and `VERSION`."""

_JSON_BYTES = 20
"""What a byte of JSON may cost in memory: lists of empty lists are the worst."""

_BYTES = ("meta", "history")
_NUMBERS = ("wrench", *NUMBERS)


def save_npz(
    dataset: Dataset, path: str | os.PathLike[str], *, progress: ProgressCallback | None = None
) -> Path:
    """Write a data set as one NPZ file that ``load`` gives back bit for bit.

    Nothing is compressed: float64 samples of a real sensor shrink little, and reading takes five times as long.

    Parameters
    ----------
    dataset : Dataset
        Recordings of the same axes.
    path : str or path
        File to write, as a rule with the ending ``.npz``; it must not exist.
    progress : callable, optional
        Called after each array, see ``ProgressCallback``.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileExistsError
        There is something at `path` already.
    ValueError
        Recordings differ in their axes, naming the method that helps.
    OSError
        The file cannot be written.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.io import load, save
    >>> from granular_id.recording import Dataset, Recording
    >>> data = Dataset([Recording(np.ones((3, 6)) / 3, rate_hz=500, label="oat flakes")])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = save(data, folder + "/oats.npz")
    ...     np.load(file)["wrench"].shape, load(file) == data
    ((3, 6), True)
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
    """Read an NPZ file: one of ``save_npz``, or an archive of arrays whose layout is guessed and said.

    Raises
    ------
    RecordingFileError
        The file, and the array in it, that cannot be read or understood.
    """
    with open_npz(source.path, source.root, options.max_binary_bytes) as archive:
        mark = archive.arrays.get(_MARK)
        said = None if mark is None else texts(mark)
        if said and said[0].startswith(FORMAT):
            return _read_own(archive, said[0], source)
        content = recordings_of(_tree(archive), source, options, "array")
    if archive.others:
        content.notes.append(f"members that are no arrays were not read: {', '.join(archive.others[:10])}")
    return content


def _arrays(flat: FlatRecordings) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {
        _MARK: np.array(f"{FORMAT} {VERSION}"),
        "axes": np.array(flat.axes, dtype=np.str_),
    }
    for name in (*_NUMBERS, *OPTIONAL):
        if getattr(flat, name) is not None:
            arrays[name] = getattr(flat, name)
    arrays |= {name: np.array(words, dtype=np.str_) for name, words in flat.texts.items()}
    arrays["meta"] = _bytes(flat.meta_lines)
    arrays["history"] = _bytes(flat.history_json)
    return arrays


def _bytes(text: str) -> NDArray[np.uint8]:
    return np.frombuffer(text.encode("utf-8"), np.uint8)


def _read_own(archive: NpzArchive, mark: str, source: FileSource) -> FileContent:
    path = source.path
    if mark != f"{FORMAT} {VERSION}":
        problem = f"is of the format {mark[:60]!r}; this version of granular-id reads '{FORMAT} {VERSION}'"
        raise RecordingFileError(path, problem)
    known = {_MARK, "axes", *_NUMBERS, *OPTIONAL, *TEXTS, *_BYTES}
    missing = known - set(OPTIONAL) - set(archive.arrays)
    if missing:
        raise RecordingFileError(path, f"the array {min(missing)!r} is missing; wanted all of '{mark}'")
    n_recordings = math.prod(archive.arrays["n_samples"].shape)
    archive.expansion.spend(n_recordings * RECORDING_BYTES, "array n_samples")
    for name in _BYTES:
        archive.expansion.spend(math.prod(archive.arrays[name].shape) * _JSON_BYTES, f"array {name}")
    columns: dict[str, Any] = {name: archive.arrays[name].read() for name in _NUMBERS}
    columns |= {name: archive.arrays[name].read() for name in OPTIONAL if name in archive.arrays}
    words = {name: _texts(archive.arrays[name], path) for name in ("axes", *TEXTS)}
    meta, history = (_text(archive.arrays[name], path) for name in _BYTES)
    flat = FlatRecordings.of_texts(words["axes"], words, meta, history, columns)
    content = unflatten(flat, path, source)
    unknown = sorted(set(archive.arrays) - known) + archive.others
    if unknown:
        content.notes.append(
            f"arrays that are no part of the format were not read: {', '.join(unknown[:10])}"
        )
    return content


def _texts(member: NpzMember, path: Path) -> list[str]:
    if member.dtype.kind != "U" or len(member.shape) != 1:
        problem = f"has shape {member.shape} and dtype {member.dtype}; wanted a list of texts"
        raise RecordingFileError(path, problem, place=member.place)
    words = plain_texts(member.read())
    if words is None:
        raise RecordingFileError(path, "holds numbers that no character has", place=member.place)
    return words


def _text(member: NpzMember, path: Path) -> str:
    if member.dtype != np.uint8 or len(member.shape) != 1:
        problem = f"has shape {member.shape} and dtype {member.dtype}; wanted the bytes of a UTF-8 text"
        raise RecordingFileError(path, problem, place=member.place)
    try:
        return member.read().tobytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise RecordingFileError(path, f"is not UTF-8 text: {error}", place=member.place) from error


def _tree(archive: NpzArchive) -> Mapping[str, Any]:
    """Arrange arrays called ``rice/1`` as HDF5 would: a group ``rice`` with ``1`` in it."""
    tree: dict[str, Any] = {}
    for key, member in archive.arrays.items():
        *groups, name = key.split("/")
        place = tree
        for group in groups:
            place = place.setdefault(group, {})
            if not isinstance(place, dict):
                raise RecordingFileError(archive.path, f"holds both an array {group!r} and arrays within it")
        if name in place:
            raise RecordingFileError(archive.path, f"holds both an array {key!r} and arrays within it")
        place[name] = member
    return tree

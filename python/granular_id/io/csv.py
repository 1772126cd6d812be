"""A CSV file, one recording or many told apart by a column, and the folder of such files that is written.

Line 1 names the columns, in any order: the six axes of a wrench (N, N m) or those that the options name, and optionally
a time (seconds), ``flags`` (bits of ``SampleFlag``), and what tells recordings apart and names them. ``columns`` lists
the names that are known. Forces and torques with other units (``fx_mN``) are converted, or refused; units of other
axes (``wx [rad/s]``) are kept as they stand. Other columns are not read, and a note names them.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import thaw
from granular_id._core import write_number_table
from granular_id._progress import ProgressCallback
from granular_id.io.columns import (
    FLAGS,
    LABEL,
    MASK,
    RATE,
    RECORDING,
    RESERVED,
    SESSION,
    TIME,
    ColumnError,
    axes_among,
    axes_shown,
    columns_of,
    split_unit,
    without_unit,
)
from granular_id.io.errors import RecordingFileError
from granular_id.io.files import read_text_bounded
from granular_id.io.folder_save import (
    INDEX_COLUMNS,
    INDEX_NAME,
    IRREGULAR,
    checked_dataset,
    new_folder,
    safe_name,
    write_history,
)
from granular_id.io.long_table import Coded, LongTable, Stated, recordings_of, refuse_mask
from granular_id.io.numbers import (
    Header,
    parse_numbers,
    picked_columns,
    plain_number,
    split_header,
)
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import AXES, Dataset, Recording

_TEXTS = (RECORDING, LABEL, SESSION, MASK)


def read_csv(source: FileSource, options: LoadOptions) -> FileContent:
    """Read one file; see ``stamped_recording`` for what its stamps mean."""
    path = source.path
    data = read_text_bounded(path, source.root, options.max_text_bytes)
    header = split_header(data, path, options.axes or AXES)
    names = header.names
    axes = options.axes or AXES
    try:
        columns = columns_of(
            names, label=options.label, session=source.session_column(options), axes=options.axes
        )
    except ColumnError as error:
        raise _refused(error, data, header, path, options) from error
    called = {meaning: names[i] for meaning, i in columns.items()}
    stated = Stated.of(called, path, options)
    notes = list(stated.notes)
    texts: dict[str, Coded] = {}
    if header.separator == "," and len(columns) == len(names) and not set(columns) & set(_TEXTS):
        values, numbers = parse_numbers(data, header.end, names, path), columns
    else:
        values, numbers, texts = _picked(data, header, columns, path)
        unread = [repr(name) for i, name in enumerate(names) if i not in columns.values()]
        notes += [f"columns that are not read: {', '.join(unread)[:200]}"] if unread else []
    if MASK in texts:
        refuse_mask(texts[MASK][1], called[MASK], path)
    time_name = called.get(TIME)

    def place(_: str, row: int | None) -> dict[str, Any]:
        if row is None:
            return {"column": time_name} if time_name else {"line": 1}
        return {"line": row + 2, "column": time_name}

    keys, key_names = texts.get(RECORDING, (None, []))
    table = LongTable(
        _wrench(values, [numbers[axis] for axis in axes]),
        axes,
        called,
        stated,
        place,
        stamps=np.ascontiguousarray(values[:, numbers[TIME]]) if TIME in columns else None,
        flags=values[:, numbers[FLAGS]] if FLAGS in columns else None,
        rates=values[:, numbers[RATE]] if RATE in columns else None,
        keys=keys,
        names=[f"{source.name}[{key}]" if key.isdecimal() else key for key in map(str, key_names)],
        texts=texts,
    )
    recordings, remarked = recordings_of(table, source, options, clock="time column")
    if not data.endswith(b"\n"):
        last = {"name": recordings[-1].name, "remark": "no line end after the last line: it may be cut off"}
        if remarked and remarked[-1]["name"] == last["name"]:
            last = remarked.pop() | last
        remarked.append(last)
    return FileContent(recordings, remarked, notes + _renamed(called, stated), obeyed=("axes", "session"))


def _refused(
    error: ColumnError, data: bytes, header: Header, path: Path, options: LoadOptions
) -> RecordingFileError:
    """Return the error about line 1; it names columns of numbers, which may be the axes of another sensor."""
    line = data[header.end : data.find(b"\n", header.end) % (len(data) + 1)].decode("utf-8", "replace")
    cells = line.split(header.separator)
    others = [i for i in error.others if i < len(cells) and plain_number(cells[i].strip()) is not None]
    names = [header.names[i] for i in others]
    of_a_wrench = set(AXES) & {split_unit(name)[0] for name in header.names}
    if not names or not all(names) or any(plain_number(name) is not None for name in names):
        no_names = "" if options.axes or of_a_wrench else "; line 1 names the columns"
        column = None if error.index is None else str(error.index + 1)
        return RecordingFileError(path, error.problem + no_names, line=1, column=column)
    problem = error.problem
    if not of_a_wrench:
        problem = f"names none of {', '.join(AXES)} (also force_x, wrench.force.x, 'Fx [N]'; mx, torque_x, moment_x)"
    return RecordingFileError(path, f"{problem}; {axes_shown(names)}", line=1)


def _picked(
    data: bytes, header: Header, columns: Mapping[str, int], path: Path
) -> tuple[NDArray[np.float64], dict[str, int], dict[str, Coded]]:
    """Return the numbers of the columns that are read, where each is among them, and texts."""
    numbers = {meaning: i for meaning, i in columns.items() if meaning not in _TEXTS}
    unnamed = [
        i
        for i, name in enumerate(header.names)
        if i not in columns.values() and (not name or name.lower().startswith("unnamed:"))
    ]
    others = [i for i in (*columns.values(), *unnamed) if i not in numbers.values()]
    table, cells = picked_columns(data, header, list(numbers.values()), others, path)
    for i in unnamed:
        if i == len(header.names) - 1 and not header.names[i] and not any(cells[i]):
            continue  # a separator at the end of every line
        _check_index(cells[i], i, path)
    texts = {meaning: _coded(cells[columns[meaning]]) for meaning in _TEXTS if meaning in columns}
    if RECORDING in texts and None in texts[RECORDING][1]:
        row_of_none = cells[columns[RECORDING]].index("")
        name = header.names[columns[RECORDING]]
        raise RecordingFileError(path, "the cell is empty", line=row_of_none + 2, column=name)
    return table, {meaning: i for i, meaning in enumerate(numbers)}, texts


def _coded(cells: Sequence[str]) -> Coded:
    known: dict[str | None, int] = {}
    codes = [known.setdefault(cell or None, len(known)) for cell in cells]
    return np.array(codes, np.int64), list(known)


def _check_index(cells: Sequence[str], column: int, path: Path) -> None:
    """Refuse a column without a name unless it numbers rows, as the index does that pandas writes."""
    counts = all(cell.isdecimal() for cell in cells)
    if not counts or any(int(after) not in (0, int(before) + 1) for before, after in pairwise(cells)):
        problem = f"the column has no name and does not number the rows (0, 1, 2 ...): it begins {cells[:3]}"
        way_out = (
            "name it if it is the time (pandas: frame.index.name = 'time'), or write the file without it"
        )
        raise RecordingFileError(path, f"{problem}; {way_out}", line=1, column=str(column + 1))


def _wrench(values: NDArray[np.float64], columns: Sequence[int]) -> NDArray[np.float64]:
    """Return the axes, in memory of their own that nobody can write to."""
    wrench = np.ascontiguousarray(values[:, columns])
    wrench.flags.writeable = False
    return wrench


def _renamed(called: Mapping[str, str], stated: Stated) -> list[str]:
    names = {
        name: meaning
        for meaning, name in called.items()
        if name.lower() not in (meaning.lower(), "timestamp")
        and not (stated.notes and meaning in AXES)
        and not (meaning in stated.meta_units and without_unit(name).lower() == meaning.lower())
    }
    if not names:
        return []
    return [f"columns {', '.join(map(repr, names))} taken as {', '.join(names.values())}"]


def save_csv(
    dataset: Dataset, folder: str | os.PathLike[str], *, progress: ProgressCallback | None = None
) -> Path:
    """Write a folder of CSV files with an ``index.csv``, which names the axes where they are no wrench's.

    Samples are written with as many digits as float64 needs; ``load(folder) == dataset`` holds. Everything is
    written under a temporary name beside `folder` and renamed when complete: no half-written folder is ever seen
    under the final name.

    Parameters
    ----------
    dataset : Dataset
        Of any axes; their units in ``meta["units"]`` stand in line 1, ``wx [rad/s]``.
    folder : str or path
        New or empty folder.
    progress : callable, optional
        Called as ``progress(files_done, files_in_all, file)``.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileExistsError
        `folder` is a file, a link or a folder with something in it.
    FileNotFoundError
        The folder to put it in does not exist.
    ValueError
        The name of an axis has a comma in it, or is that of another column, like time or label.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.io import load, save_csv
    >>> from granular_id import Dataset, Recording
    >>> data = Dataset([Recording(np.ones((3, 6)) / 3, rate_hz=500, label="oat flakes")])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     load(save_csv(data, folder + "/oats")) == data
    True
    """
    usual = all(recording.axes == AXES for recording in checked_dataset(dataset))
    digits = len(str(len(dataset)))
    with new_folder(folder) as partial:
        with (partial / INDEX_NAME).open("w", encoding="utf-8", newline="") as file:
            index = csv.writer(file, lineterminator="\n")
            index.writerow(INDEX_COLUMNS[: -1 if usual else None])
            for number, recording in enumerate(dataset, start=1):
                part = safe_name(recording.label)
                (partial / part).mkdir(exist_ok=True)
                name = f"{part}/{part}_{number:0{digits}d}.csv"
                _write(recording, partial / name)
                row = _index_row(name, recording)
                index.writerow(row if usual else [*row, json.dumps(recording.axes, ensure_ascii=False)])
                if progress is not None:
                    progress(number, len(dataset), name)
        write_history(dataset, partial)
    return Path(folder)


def _index_row(file: str, recording: Recording) -> list[str]:
    return [
        file,
        recording.label or "",
        recording.session or "",
        "" if recording.start_time is None else repr(recording.start_time),
        IRREGULAR if recording.rate_hz is None else repr(recording.rate_hz),
        "" if recording.trigger_index is None else str(recording.trigger_index),
        recording.name,
        json.dumps(thaw(recording.meta)) if recording.meta else "",
    ]


def _heads(recording: Recording) -> Sequence[str]:
    """Name the columns of the axes, with their units where these are stated and are not those of a wrench."""
    axes, units = recording.axes, recording.meta.get("units")
    wrong = next(
        (axis for axis in axes if "," in axis or axis[0] == axis[-1] == '"' or axis in RESERVED), None
    )
    if wrong is not None:
        problem = (
            f"recording {recording.name!r} has the axis {wrong!r}, which cannot stand in line 1 of a CSV file"
        )
        raise ValueError(f"{problem}; name it otherwise, or save npz")
    stated = units if isinstance(units, Mapping) else {}
    heads = [
        f"{axis} [{unit}]" if axis not in AXES and isinstance(unit := stated.get(axis), str) else axis
        for axis in axes
    ]
    try:
        found = [(i, unit or None) for i, unit in axes_among(heads, axes)]
    except ColumnError:
        return axes
    told = [
        (i, None if head == axis else stated[axis])
        for i, (axis, head) in enumerate(zip(axes, heads, strict=True))
    ]
    return heads if found == told and "," not in "".join(heads) else axes


def _write(recording: Recording, path: Path) -> None:
    header = [TIME, *_heads(recording)]
    columns: list[NDArray[np.float64] | NDArray[np.uint8]] = [recording.times(), *recording.wrench.T]
    if recording.flags is not None:
        header.append(FLAGS)
        columns.append(recording.flags)
    with path.open("wb") as file:
        file.write(",".join(header).encode() + b"\n")
        file.write(write_number_table(columns))

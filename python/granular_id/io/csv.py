"""Text tables: one recording or many in a file, read by pandas; and the folder of such files that is written.

One row a sample. The names of the columns stand in line 1, or where options of ``pandas.read_csv`` say; ``names`` lists
those that are known. A line 2 whose cells are all units states them.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import json
import os
import re
import sys
import warnings
import zlib
from collections.abc import Mapping, Sequence
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import thaw
from granular_id._core import GranularIdError
from granular_id._progress import ProgressCallback
from granular_id.io.files import RecordingFileError, need, new_folder, safe_name
from granular_id.io.flat import checked_dataset
from granular_id.io.index import INDEX_COLUMNS, INDEX_NAME, IRREGULAR, write_history
from granular_id.io.source import FileContent, FileSource, LoadOptions
from granular_id.recording import (
    ABOUT,
    AXES,
    FLAGS,
    Dataset,
    Recording,
    Stated,
    Table,
    TableError,
    columns_of,
    is_unit,
    meaning_of,
)

_SEPARATORS = (",", ";", "\t", "|")
_FEW = 20
"""Rows that are enough to see what a table without axes holds."""

_HEAD_LINES = 60
"""Lines in which names of columns are looked for, for an error."""

_MARKS = {
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
    codecs.BOM_UTF8: "utf-8-sig",
}
_SEP_LINE = re.compile(r'"?sep=(.)"?')
_UNITS_ABOVE = re.compile(r'(force|torque|moment)s?\s+units?\W+(\w[^;,"\t]*)', re.IGNORECASE)
_SOME_UNITS = re.compile(r"\W*units?\b[^:=,;\t]*[:=,;\t](.*)", re.IGNORECASE)
_UNNAMED = re.compile(r"Unnamed: (\d+)")
_COMMA = re.compile(r"-?\d+,\d+")


class _Head(NamedTuple):
    """How a table begins: options for pandas, the lines above the names, the names, and the line that they are in."""

    options: dict[str, Any]
    above: list[str]
    names: list[str]
    line: int


def read_csv(source: FileSource, options: LoadOptions) -> FileContent:
    """Read one file; ``csv`` of the options is passed to ``pandas.read_csv`` as it is."""
    pandas = need("pandas", extra="app", why="to read text tables")
    given = dict(options.csv or {})
    head = _head(source.path, given)
    doubtful = not given.keys() & {"names", "header", "usecols"} and _names_no_axes(source.path, head, source)
    columns, notes = _columns(_read(pandas, source.path, head, _FEW if doubtful else None), source.path, head)
    try:
        columns_of(tuple(columns), source.axes, source.columns)
    except TableError as error:
        raise _no_columns(source.path, error, head, columns) from error
    if doubtful:
        columns, notes = _columns(_read(pandas, source.path, head, None), source.path, head)
    units, n_units = _units(columns, head)
    _refuse_other_units(source.path, head, columns, units, n_units, options)
    if n_units:
        decimal = str(given.get("decimal", "."))
        columns = {name: _numbers_again(cells[n_units:], decimal) for name, cells in columns.items()}
        notes = [f"line {head.line + 1} is read as units", *notes]
    first_line = head.line + 1 + n_units
    if not any(len(cells) for cells in columns.values()):
        raise RecordingFileError(source.path, "has names of columns, but no samples", line=head.line)
    table = Table(name=source.name, columns=columns, units=units, clock="time column", is_text=True)
    cut = {"name": source.name, "remark": "no line end after the last line: it may be cut off"}

    def place(_: int, row: int | None) -> dict[str, Any]:
        return {} if row is None else {"line": _line_of_row(source.path, head, first_line, row)}

    return FileContent([table], rows=[cut] if _is_cut_off(source.path) else [], notes=notes, place=place)


def _refuse_other_units(
    path: Path,
    head: _Head,
    columns: Mapping[str, NDArray[Any]],
    units: Mapping[str, str],
    n_units: int,
    options: LoadOptions,
) -> None:
    """Refuse units above the names, or below them, that are not understood."""
    named = [name for name in columns if meaning_of(name).what in AXES]
    silent = options.units is None and not units and any(meaning_of(name).unit is None for name in named)
    for i, line in enumerate(head.above, 1):
        said = _SOME_UNITS.fullmatch(line.strip()) if silent else None
        words = [] if said is None else re.findall(r"[^\s,;/\"':=]+", said[1])
        if any(map(is_unit, words)):
            problem = f"states units for all axes together ({line.strip()[:60]!r}); pass units= with these"
            raise RecordingFileError(path, problem, line=i)
    below = [str(cells[0]).strip() for cells in columns.values() if len(cells) and isinstance(cells[0], str)]
    of_axes = [columns[name][0] for name in named if len(columns[name])]
    texts = [cell.strip() for cell in of_axes if isinstance(cell, str)]
    if n_units or not any(text.isascii() and text[:1].isalpha() and is_unit(text) for text in texts):
        return
    other = next((cell for cell in below if not is_unit(cell)), None)
    if other is None:
        return
    problem = f"may hold units, of which {other!r:.40} is none that is known; convert the values, and name their unit"
    raise RecordingFileError(path, problem, line=head.line + 1)


def _line_of_row(path: Path, head: _Head, first_line: int, row: int) -> int:
    """Return the line of a row; pandas passes over empty ones, and those that are comments."""
    comment = str(head.options.get("comment", "\n"))
    lines = _lines(path, head.options.get("encoding"), sys.maxsize)
    rows = (
        i
        for i, line in enumerate(lines, 1)
        if i >= first_line and line.strip() and not line.startswith(comment)
    )
    return next(islice(rows, row, None), first_line + row)


def _names_no_axes(path: Path, head: _Head, stated: Stated) -> bool:
    """Return True if a line seems to name none of the axes; refuse it where a later one does, or names occur twice."""
    twice = next((name for i, name in enumerate(head.names) if name and name in head.names[:i]), None)
    named = [name for name in dict.fromkeys(head.names) if name]
    try:
        columns_of(tuple(named), stated.axes, stated.columns)
    except TableError as error:
        found = None if "skiprows" in head.options else _line_of_names(path, head, stated.axes)
        if found is not None and found + 1 != head.line:
            way_out = f"line {found + 1} names the axes: pass csv={{'skiprows': {found}}}"
            raise RecordingFileError(path, f"{error}; {way_out}", line=head.line) from error
        if twice is not None and error.no_wrench:
            raise RecordingFileError(path, str(error), line=head.line, no_wrench=True) from error
        return error.no_wrench
    if twice is not None:
        raise RecordingFileError(path, f"column {twice!r:.60} occurs twice", line=head.line)
    return False


def _no_columns(
    path: Path, error: TableError, head: _Head, columns: Mapping[str, NDArray[Any]]
) -> RecordingFileError:
    """Say which columns of numbers may be other axes."""
    numbers = [
        name
        for name, cells in columns.items()
        if cells.dtype.kind in "iuf" and not _is_number(name) and meaning_of(name).what is None
    ]
    way_out = f"; line {head.line} names the columns" if error.no_wrench else ""
    unnamed = _way_without_names(path, head)
    if error.no_wrench and unnamed is not None:
        way_out = unnamed
    elif error.no_wrench and numbers:
        short = [meaning_of(name).base for name in numbers]
        way_out = (
            f"; for other axes pass axes={','.join(numbers if len(set(short)) < len(short) else short)!r}"
        )
    return RecordingFileError(path, f"{error}{way_out}", line=head.line, no_wrench=error.no_wrench)


def _way_without_names(path: Path, head: _Head) -> str | None:
    """Return how to name six or seven columns of numbers, where no line has a name for each."""
    separator = str(head.options.get("sep", ","))
    for i, line in enumerate(_lines(path, head.options.get("encoding"), _HEAD_LINES)):
        cells = [
            cell.strip()
            for cell in re.split(re.escape(separator) if len(separator) == 1 else separator, line)
        ]
        cells = cells[:-1] if cells and not cells[-1] else cells
        names = {len(AXES): list(AXES), len(AXES) + 1: ["time", *AXES]}.get(len(cells))
        if names is None or not all(map(_is_number, cells)):
            continue
        own = [name for name in dict.fromkeys(head.names) if name and not _is_number(name)]
        if len(own) >= len(cells):
            return None
        skipped = f"'skiprows': {i}, " if i else ""
        return f"; if its columns are these, pass csv={{'header': None, {skipped}'names': {names}}}"
    return None


def _line_of_names(path: Path, head: _Head, axes: Sequence[str] | None) -> int | None:
    """Return how many lines stand above one that names all axes."""
    for i, line in enumerate(_lines(path, head.options.get("encoding"), _HEAD_LINES)):
        for separator in _SEPARATORS:
            try:
                columns_of(tuple(name.strip(' "') for name in line.split(separator)), axes)
            except TableError:
                continue
            return i
    return None


def _head(path: Path, given: Mapping[str, Any]) -> _Head:
    """Find encoding, separator and names, as far as the options leave them open."""
    opened = gzip.open if path.suffix.lower() == ".gz" else open
    try:
        with opened(path, "rb") as file:
            begins = file.read(4)
    except (OSError, EOFError, zlib.error) as error:
        raise RecordingFileError(path, f"cannot be read: {error}") from error
    if not begins and path.suffix.lower() != ".gz":
        raise RecordingFileError(path, "is empty (0 bytes)")
    options: dict[str, Any] = dict(given)
    mark = next((name for mark, name in _MARKS.items() if begins.startswith(mark)), None)
    if mark is not None:
        options.setdefault("encoding", mark)
    elif (
        "encoding" not in given
        and path.suffix.lower() != ".gz"
        and b"\0" in begins[:2]
        and begins[:2] != b"\0\0"
    ):
        encoding = "utf-16-le" if begins[1] == 0 else "utf-16-be"
        raise RecordingFileError(path, f"may be UTF-16 text: pass csv={{'encoding': {encoding!r}}}", line=1)
    skipped = given.get("skiprows", 0)
    n_skipped = skipped if isinstance(skipped, int) else 0
    lines = _lines(path, options.get("encoding"), n_skipped + _HEAD_LINES)
    if any("\0" in line for line in lines):
        raise RecordingFileError(path, "is binary (holds NUL bytes); wanted text", line=1)
    comment = given.get("comment")
    if n_skipped == 0 and lines and (said := _SEP_LINE.fullmatch(lines[0].strip(" \r\n"))):
        options.setdefault("sep", said[1])
        options["skiprows"] = n_skipped = 1
    rest = list(enumerate(lines))[n_skipped:]
    named = next(
        ((i, line) for i, line in rest if line.strip() and not (comment and line.startswith(str(comment)))),
        None,
    )
    if named is None:
        raise RecordingFileError(path, "is empty: no line names the columns")
    i, line = named
    if "sep" not in given and "delimiter" not in given:
        options.setdefault("sep", max(_SEPARATORS, key=lambda one: len(line.split(one))))
        if len(line.split(options["sep"])) < 2 and len(line.split()) > 1:
            options["sep"] = r"\s+"
    separator = str(options.get("sep", options.get("delimiter")))
    if len(separator) > 1:
        cells = re.split(separator, line.strip())
    else:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    if len(cells) > 1 and line.startswith("#") and comment is None and "names" not in given:
        cells[0] = cells[0].lstrip("#")  # as numpy.savetxt writes names
    cells[0] = cells[0].lstrip("%")  # as rostopic does
    return _Head(options, lines[:i], [cell.strip().strip('"').strip() for cell in cells], i + 1)


def _lines(path: Path, encoding: object, n: int) -> list[str]:
    """Return the first lines of a file, whatever their encoding."""
    opened = gzip.open if path.suffix.lower() == ".gz" else open
    try:
        with opened(path, "rt", encoding=str(encoding or "utf-8"), errors="replace", newline="") as file:
            return [line.rstrip("\r\n") for _, line in zip(range(n), file, strict=False)]
    except (OSError, EOFError, LookupError, UnicodeError) as error:
        raise RecordingFileError(path, f"cannot be read: {error}") from error


def _read(pandas: Any, path: Path, head: _Head, n_rows: int | None) -> Any:
    """Call ``pandas.read_csv``; its errors name the line, and the option that helps where one does."""
    settings = {
        "float_precision": "round_trip",
        "index_col": False,
        "skipinitialspace": True,
        "low_memory": False,
    }
    with_footer = "skipfooter" in head.options
    if with_footer or (len(str(head.options.get("sep", ","))) > 1 and head.options.get("sep") != r"\s+"):
        settings.pop("low_memory")
        settings.pop("float_precision")
    if with_footer:
        n_rows = None
        settings["engine"] = "python"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return pandas.read_csv(path, **{"nrows": n_rows, **settings, **head.options})
    except UnicodeDecodeError as error:
        way_out = "pass csv={'encoding': 'cp1252'}, or what it was written in"
        byte = error.object[error.start]
        raise RecordingFileError(path, f"byte 0x{byte:02x} is not UTF-8 text; {way_out}") from error
    except pandas.errors.EmptyDataError as error:
        raise RecordingFileError(path, "is empty: no line names the columns") from error
    except (Warning, Exception) as error:
        said = str(error).strip().splitlines()[0][:200] if str(error).strip() else type(error).__name__
        if re.search(r"Expected \d+ fields in line \d+, saw", said):
            said += "; lines with more cells than names are left out by csv={'on_bad_lines': 'skip'}"
        problem = f"is no table that pandas.read_csv reads: {said}"
        no_wrench = not any(meaning_of(name).what in AXES for name in head.names)
        raise RecordingFileError(path, problem, no_wrench=no_wrench) from error


def _columns(frame: Any, path: Path, head: _Head) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Return the columns under their names; those without a name number the rows, are a clock, or are refused."""
    columns: dict[str, NDArray[Any]] = {}
    notes: list[str] = []
    for i, label in enumerate(frame.columns):
        name = str(label).strip()
        name = name.lstrip("#% ") if i == 0 else name
        cells = frame.iloc[:, i].to_numpy()
        unnamed = _UNNAMED.fullmatch(name)
        if unnamed is None:
            columns[name] = cells
            continue
        if frame.iloc[:, i].isna().all():  # a separator at the end of each line
            continue
        is_clock = i == 0 and "time" not in head.names and cells.dtype.kind == "O"
        if is_clock and any(c in str(cells[0]) for c in "-:"):
            columns["time"] = cells  # an index of dates that pandas wrote
            notes.append("the first column has no name and holds dates: it is the time")
        elif not _counts(cells):
            unnamed_table = _way_without_names(path, head)
            if unnamed_table is not None:
                raise RecordingFileError(path, f"columns have no names{unnamed_table}", line=head.line)
            came = f"it begins {cells[:3].tolist()}"
            problem = f"the column has no name and does not number the rows (0, 1, 2 ...): {came}"
            way_out = (
                "name it if it is the time (pandas: frame.index.name = 'time'), or write the file without it"
            )
            raise RecordingFileError(path, f"{problem}; {way_out}", line=head.line, column=str(i + 1))
    return columns, notes


def _counts(cells: NDArray[Any]) -> bool:
    if cells.dtype.kind not in "iu":
        return False
    return all(after in (0, before + 1) for before, after in pairwise(cells.tolist()))


def _units(columns: Mapping[str, NDArray[Any]], head: _Head) -> tuple[dict[str, str], int]:
    """Return units that stand in a line below the names, or above them; and how many lines of them there are."""
    units: dict[str, str] = {}
    for line in head.above:
        for said in _UNITS_ABOVE.finditer(line):
            alike = AXES[:3] if said[1][0].lower() == "f" else AXES[3:]
            units |= dict.fromkeys(alike, said[2].strip())
    first = {name: cells[0] for name, cells in columns.items() if len(cells)}
    texts = {name: str(cell).strip() for name, cell in first.items() if isinstance(cell, str)}
    empty = [name for name, cell in first.items() if not isinstance(cell, str)]
    all_empty = all(first[name] is None or first[name] != first[name] for name in empty)
    if not texts or not all_empty or not all(map(is_unit, texts.values())):
        return units, 0
    return units | {name: text.strip("[]()") for name, text in texts.items() if text}, 1


def _numbers_again(cells: NDArray[Any], decimal: str) -> NDArray[Any]:
    """Turn a column that pandas took for text, for its line of units, into numbers."""
    if cells.dtype.kind != "O":
        return cells
    try:
        texts = [np.nan if cell is None else str(cell).replace(decimal, ".") for cell in cells.tolist()]
        return np.array(list(map(float, texts)))  # rounded as round_trip
    except (TypeError, ValueError):
        return cells


def _is_number(name: str) -> bool:
    try:
        float(name)
    except ValueError:
        return False
    return True


def _is_cut_off(path: Path) -> bool:
    """Return True if the last line has no end."""
    if path.suffix.lower() == ".gz":
        return False
    with path.open("rb") as file:
        file.seek(-min(4, path.stat().st_size), os.SEEK_END)
        return not file.read().rstrip(b"\0").endswith((b"\n", b"\r"))


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
        (
            axis
            for axis in axes
            if any(c in axis for c in ',"\n#') or axis in ABOUT or _UNNAMED.fullmatch(axis)
        ),
        None,
    )
    if wrong is not None:
        problem = (
            f"recording {recording.name!r} has the axis {wrong!r}, which cannot stand in line 1 of a CSV file"
        )
        raise GranularIdError(f"{problem}; name it otherwise, or save npz")
    stated = units if isinstance(units, Mapping) else {}
    heads = [
        f"{axis} [{unit}]" if axis not in AXES and isinstance(unit := stated.get(axis), str) else axis
        for axis in axes
    ]
    try:
        found = [columns_of(tuple(heads), axes)[axis] for axis in axes]
        units_back = [meaning_of(head).unit for head in heads]
    except TableError:
        return axes
    told = [None if head == axis else stated[axis] for axis, head in zip(axes, heads, strict=True)]
    return heads if found == heads and units_back == told and "," not in "".join(heads) else axes


def _write(recording: Recording, path: Path) -> None:
    header = ["time", *_heads(recording)]
    columns = [recording.times(), *recording.wrench.T]
    cells = [list(map(repr, column.tolist())) for column in columns]
    if recording.flags is not None:
        header.append(FLAGS)
        cells.append(list(map(str, recording.flags.tolist())))
    lines = map(",".join, zip(*cells, strict=True))
    path.write_text("\n".join([",".join(header), *lines, ""]), encoding="utf-8", newline="\n")

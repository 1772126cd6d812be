"""Text tables: one recording or many in a file, read by pandas.

One row a sample. The names of the columns stand in line 1, or where options of ``pandas.read_csv`` say; those that are
known stand in ``recording/columns.py``. A line 2 whose cells are all units states them.
"""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._text import UNITS, counted, in_both
from granular_id.io.csv_head import (
    NUMERIC,
    SEPARATORS,
    Head,
    cells_of,
    encoding_of,
    head_of,
    lines_of,
    refuse_half_row,
)
from granular_id.io.files import RecordingFileError, need
from granular_id.io.source import FileContent, FileSource, LoadOptions
from granular_id.io.ways_out import frames_line, is_clock, reshaped
from granular_id.recording import (
    AXES,
    LABEL,
    RECORDING,
    SCALED_UNITS,
    SESSION,
    TIME,
    Table,
    TableError,
    columns_of,
    factor,
    is_unit,
    meaning_of,
)

_BY_WIDTH = {len(AXES): list(AXES), len(AXES) + 1: ["time", *AXES]}
_FEW, _MOST_NAMED = 20, 20
"""Rows that are enough to see what a table without axes holds."""

_KINDS = r"\b(force|kraft|torque|moment|drehmoment)e?s?"
_UNITS_ABOVE = re.compile(
    rf'(?:{_KINDS}[\s-]*(?:units?|einheit)\W+|\beinheit\s+{_KINDS}\s*"?[:;=,\t]\W*)(\w[^;,"\t]*)',
    re.IGNORECASE,
)
_KIND_WORDS = re.compile(r"force|torque|kraft|moment|units?\b|einheit|\[|\b[FMT][xyz]\b", re.IGNORECASE)
_SOME_UNITS = re.compile(r"\W*(?:units?|einheit(?:en)?)\b[^:=,;\t]*[:=,;\t](.*)", re.IGNORECASE)
_RATE_ABOVE = re.compile(
    r"\W*(?:(?:sampl\w*|scan|acquisition|data)[\s_-]*(?:rate|freq(?:uency)?)|rate|abtast(?:rate|frequenz)|fs)\b"
    r"[^\w-]*(?:(?:in )?hz[^\w-]*)?(\d+(?:\.\d+)?)[^\w.]*(k?hz)?\W*",
    re.IGNORECASE,
)
"""A line that states the rate of sampling, not that of a filter."""

_COMMENTS = ("#", "%", "!", "/")
UNNAMED = re.compile(r"Unnamed: (\d+)")
"""What pandas calls a column without a name."""

_NO_AXIS = re.compile(
    r"(id|no|nr|num(ber)?|index|idx|count(er)?|seq|rows?|line|step|frame|sample|trial|run|push|rep|versuch|lauf|ensayo|"
    r"pos(e|ition)?|dist(ance)?|depth|vel(ocity)?|speed|joints?|quat(ernion)?|angle|q|[xyz]|"
    r"t|temp(erature?)?|humidity|time|zeit|date|stamp|clock|status|valid|flags?)([\s_.\-]?(id|no|nr|[xyzw]|\d+))?",
    re.IGNORECASE,
)
"""Names of numbers beside axes: ids, positions, temperatures, clocks."""

_NO_AXIS_UNITS = frozenset(
    ("degc", "\N{DEGREE SIGN}c", "k", "mm", "m", "mm/s", "m/s", "s", "ms", "us", "ns", "%")
)

_TEXTS = (RECORDING, LABEL, SESSION)

Columns = dict[str, NDArray[Any]]


def read_csv(source: FileSource, options: LoadOptions) -> FileContent:
    """Read one file; ``csv`` of the options is passed to ``pandas.read_csv`` as it is."""
    pandas = need("pandas", extra="app", why="to read text tables")
    given = dict(options.csv or {})
    head = head_of(source.path, given)
    if not given.keys() & {"usecols", "converters", "dtype"}:
        of_texts = {name for what, name in source.columns if what in _TEXTS}
        names = [str(name) for name in given.get("names") or head.names]
        head.texts.extend(
            i for i, one in enumerate(names) if one in of_texts or meaning_of(one).what in _TEXTS
        )
    units, notes = _units(head, options)
    try:
        is_plain = not given.keys() & {"names", "header", "usecols"} and isinstance(
            given.get("skiprows", 0), int
        )
        if is_plain and not any("\N{REPLACEMENT CHARACTER}" in name for name in head.names):
            # before all of it is read
            columns_of(tuple(filter(None, head.names)), source.axes, source.columns)
        refuse_half_row(head)
        columns, named = _columns(_read(pandas, head), head)
        columns_of(tuple(columns), source.axes, source.columns)
    except TableError as error:
        raise _other_names(pandas, head, error, source) from error
    no_samples = _text_rows(columns)
    sample_rows: Sequence[int] = range(len(next(iter(columns.values()), ())))
    if no_samples:
        sample_rows = [row for row in sample_rows if row not in no_samples]
        columns = {name: cells[sample_rows] for name, cells in columns.items()}
    if not any(len(cells) for cells in columns.values()):
        raise RecordingFileError(source.path, "has names of columns, but no samples", line=head.line)
    table = Table(source.name, columns, units=units, clock="time column", csv=given)
    if not is_clock(list(columns)) and not any(what == TIME for what, _ in source.columns):
        table = replace(table, rate_hint=_rate_above(head))

    def line_of(row: int) -> int:
        """Return the line of a row; pandas passes over empty ones, and those that are comments."""
        first, comment = head.below + bool(notes), str(head.options.get("comment", "\n"))
        lines = enumerate(lines_of(source.path, head.options.get("encoding"), sys.maxsize))
        rows = (i + 1 for i, line in lines if i >= first and line.strip() and not line.startswith(comment))
        return next(islice(rows, row, None), first + row)

    def place(_: int, row: int | None) -> dict[str, Any]:
        return {} if row is None else {"line": line_of(sample_rows[row])}

    if no_samples:
        is_silent = options.units is None and not units and _lacks_units(columns)
        notes = [*notes, _text_left_out(source, no_samples, sample_rows, line_of, is_silent=is_silent)]

    cut = {"name": source.name, "remark": "no line end after the last line: it may be cut off"}
    whole = [] if head.is_whole else [cut]
    return FileContent(
        [table],
        rows=whole,
        notes=[*notes, *named, *_other_encoding(head, given)],
        place=place,
        in_python=lambda mend: frames_line(_opening(head), source, table, mend),
    )


def _other_encoding(head: Head, given: Mapping[str, Any]) -> list[str]:
    """Note that a file is read in its own encoding, which is not the one that is stated for all."""
    own, stated = head.options.get("encoding"), given.get("encoding")
    return [] if stated in (None, own) else [f"is {own} text, and read as such, not as {stated}"]


def _lacks_units(names: Collection[str]) -> bool:
    """Whether an axis is named without a unit."""
    return any(meaning_of(name).unit is None for name in names if meaning_of(name).what in AXES)


def _text_left_out(
    source: FileSource,
    texts: Mapping[int, tuple[str, bool]],
    sample_rows: Sequence[int],
    line_of: Callable[[int], int],
    *,
    is_silent: bool,
) -> str:
    """Note lines of text that are left out; refuse those that may be samples, or state units."""
    for row, (text, has_figures) in texts.items():
        if is_silent and _states_units(text):
            way = in_both(units=UNITS)
            problem = (f"{text[:60]!r} states units; pass ", way, ", those of the axes")
            raise RecordingFileError(source.path, problem, line=line_of(row))
        if has_figures:
            below = row > max(sample_rows, default=0)
            csv: dict[str, Any] = {"skiprows": [line_of(row) - 1]}
            csv = {"skipfooter": len(sample_rows) + len(texts) - row} if below else csv
            csv = {"comment": text.strip()[0]} if text.strip().startswith(_COMMENTS) else csv
            why = f"{text[:40]!r} is text where others of its column are numbers; if the line is no sample, pass "
            raise RecordingFileError(source.path, (why, in_both(csv=csv)), line=line_of(row))
    row, (text, _) = next(iter(texts.items()))
    return f"{counted(len(texts), 'line')} of text left out, the first is line {line_of(row)}: {text[:40]!r}"


def _opening(head: Head) -> str:
    """Return how people read this table in Python."""
    options = head.options.items()
    words = "".join(f", {name}={value!r}" for name, value in options if (name, value) != ("sep", ","))
    texts = [f"{str((head.options.get('names') or head.names)[i])!r}: str" for i in head.texts]
    words += f", converters={{{', '.join(texts)}}}" * bool(texts)
    return f"pandas.read_csv({{}}, index_col=False, skipinitialspace=True{words.replace('{', '{{').replace('}', '}}')})"


def _read(pandas: Any, head: Head, n_rows: int | None = None) -> Any:
    """Call ``pandas.read_csv``; its errors name the line, and the option that helps where one does."""
    settings: dict[str, Any] = {"index_col": False, "skipinitialspace": True, "nrows": n_rows}
    if head.texts:  # 007 and NA are texts
        settings["converters"] = dict.fromkeys(head.texts, str)
    separator = head.options.get("sep", ",")
    if "skipfooter" in head.options:
        settings |= {"engine": "python", "nrows": None}
    elif len(str(separator)) == 1 or separator == r"\s+":
        settings |= {"float_precision": "round_trip", "low_memory": False}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return pandas.read_csv(head.path, **{**settings, **head.options})
    except UnicodeDecodeError as error:
        encoding = in_both(csv={"encoding": encoding_of(head.path)})
        byte = f"byte 0x{error.object[error.start]:02x} is not UTF-8 text; pass "
        raise RecordingFileError(head.path, (byte, encoding, ", or what it was written in")) from error
    except (Warning, Exception) as error:
        if "Calling read(nbytes) on source failed" in str(error):
            # what pandas makes of an exception without a value: below Python 3.12 that of Ctrl-C alone is one
            raise KeyboardInterrupt from error
        reason = str(error).strip().splitlines()[0][:200] if str(error).strip() else type(error).__name__
        way_out: list[str] = []
        if re.search(r"Expected \d+ fields in line \d+, saw", reason):
            way_out = [
                "; lines with more cells than names are left out: pass ",
                in_both(csv={"on_bad_lines": "skip"}),
            ]
        if reason.startswith("Length of header or names does not match"):
            reason = f"rows have more cells than line {head.line} has names"
            n, width = len(head.names), len(cells_of("".join(head.lines[head.below :][:1]), head.options))
            first = in_both(csv={"usecols": list(range(n))})
            way_out = ["; if the first cells are these pass ", first]
            if width == 2 * n and head.options.get("sep") == ",":
                way_out = [
                    ", twice as many: commas stand between cells and for the point; wanted another separator"
                ]
        no_wrench = not any(meaning_of(name).what in AXES for name in head.names)
        problem = [f"is no table that pandas.read_csv reads: {reason}", *way_out]
        raise RecordingFileError(head.path, problem, no_wrench=no_wrench) from error


def _columns(frame: Any, head: Head) -> tuple[Columns, list[str]]:
    """Return the columns under their names; those without a name number the rows, are a clock, or are refused."""
    columns: Columns = {}
    notes: list[str] = []
    for i, (label, series) in enumerate(frame.items()):
        name = str(label).strip()
        name = name.lstrip("#% ") if i == 0 else name
        cells = series.to_numpy()
        if UNNAMED.fullmatch(name) is None:
            columns[name] = cells
        elif (
            i == 0
            and "time" not in head.names
            and cells.dtype.kind == "O"
            and re.search("[-:]", str(cells[0]))
        ):
            columns["time"] = cells  # an index of dates that pandas wrote
            notes.append("the first column has no name and holds dates: it is the time")
        elif not series.isna().all() and not _counts(cells):  # else it is empty, or an index
            if way_out := _names_given(head):
                raise RecordingFileError(head.path, ("columns have no names", *way_out), line=head.line)
            problem = (
                "the column has no name and does not number the rows (0, 1, 2 ...): it begins "
                f"{cells[:3].tolist()}; name it if it is the time (pandas: frame.index.name = 'time'), or write the "
                "file without it"
            )
            raise RecordingFileError(head.path, problem, line=head.line, column=str(i + 1))
    return columns, notes


def _text_rows(columns: Columns) -> dict[int, tuple[str, bool]]:
    """Find lines that are no samples: text where the first column has numbers, or dates; and whether figures follow."""
    names = list(columns)
    cells = columns[names[0]] if names else np.array([])
    if cells.dtype.kind != "O":
        return {}
    texts = {row: cell for row, cell in enumerate(cells.tolist()) if isinstance(cell, str)}
    odd = {row: text for row, text in texts.items() if not re.match(r"\s*[-+.]?\d", text)}
    if 2 * len(odd) > len(cells):
        return {}
    empty = np.all([columns[name] != columns[name] for name in names[1:]], axis=0)
    is_read = meaning_of(names[0]).what is not None  # what its cells hold is checked by whoever reads them
    return {
        row: (text, not empty[row])
        for row, text in odd.items()
        if empty[row] or not is_read or text.strip().startswith(_COMMENTS)
    }


def _counts(cells: NDArray[Any]) -> bool:
    return cells.dtype.kind in "iu" and all(b in (0, a + 1) for a, b in pairwise(cells.tolist()))


def _units(head: Head, options: LoadOptions) -> tuple[dict[str, str], list[str]]:
    """Return units that stand in a line below the names, which is then left out, or above them; and a note on the line.

    Those that are not understood are refused.
    """
    units: dict[str, str] = {}
    for found in (one for line in head.lines[: head.line - 1] for one in _UNITS_ABOVE.finditer(line)):
        alike = AXES[:3] if (found[1] or found[2])[0].lower() in "fk" else AXES[3:]
        units |= dict.fromkeys(alike, found[3].strip())
    names = [str(name) for name in head.options.get("names") or head.names]
    line = "".join(head.lines[head.below : head.below + 1])
    texts = {name: cell for name, cell in zip(names, cells_of(line, head.options), strict=False) if cell}
    above = head.options.get("skiprows", 0)
    words = [text for text in texts.values() if not NUMERIC.fullmatch(text)]
    if words and len(words) == len(texts) and all(map(is_unit, words)) and not callable(above):
        head.options["skiprows"] = [*(range(above) if isinstance(above, int) else above), head.below]
        own = {name: text.strip("[]()") for name, text in texts.items()}
        return units | own, [f"line {head.below + 1} is read as units"]
    of_labview = next((one for one in head.lines[: head.line - 1] if one.startswith("Y_Unit_Label")), None)
    if of_labview is not None:  # a cell for each column behind the clock
        channels = [name for name in names[1:] if name != "Comment"]
        stated = list(filter(None, cells_of(of_labview, head.options)[1:]))
        if len(stated) == len(channels):
            units |= dict(zip(channels, stated, strict=True))
    named = [name for name in names if meaning_of(name).what in AXES]
    silent = options.units is None and not units and _lacks_units(named)
    for i, before in enumerate(head.lines[: head.line - 1], 1):
        some = _SOME_UNITS.fullmatch(before.strip())
        states = some is not None and any(map(is_unit, re.findall(r"[^\s,;/\"':=]+", some[1])))
        if silent and (states or _states_units(before)):
            problem = f"states units for all axes together ({before.strip()[:60]!r})"
            raise RecordingFileError(
                head.path, (f"{problem}; pass ", in_both(units=UNITS), ", these"), line=i
            )
    of_axes = [texts[name] for name in named if name in texts]
    other = next((text for text in words if not is_unit(text)), None)
    known = any(text.isascii() and text[:1].isalpha() and is_unit(text) for text in of_axes)
    if other is not None and known and "\N{REPLACEMENT CHARACTER}" not in line:
        problem = (
            f"may hold units, of which {other!r:.40} is none that is known; if these are others, pass them, "
        )
        way_out = in_both(csv={"skiprows": [head.below]}, units=UNITS)
        raise RecordingFileError(head.path, (problem, way_out), line=head.below + 1)
    return units, []


def _rate_above(head: Head) -> tuple[str, float] | None:
    """Return a line above the names that states the rate, and that in Hz; 1.000 may be one or a thousand."""
    for line in head.lines[: head.line - 1]:
        found = _RATE_ABOVE.fullmatch(line)
        if found is not None and float(found[1]) > 0 and not re.fullmatch(r"\d{1,3}\.\d{3}", found[1]):
            return line.strip(), float(found[1]) * (factor(found[2] or "Hz", "Hz") or 1.0)
    return None


def _states_units(text: str) -> bool:
    """Whether a line says that forces or torques are in other units than N and N m: not that a bag weighs 2 lb."""
    plain = re.sub(r"\d[\d.,]*\s*[^\W\d_]+", "", text)
    return bool(_KIND_WORDS.search(plain) and SCALED_UNITS.search(plain))


def _other_names(pandas: Any, head: Head, error: TableError, source: FileSource) -> RecordingFileError:
    """Say what reads a table whose names are not those of the axes."""
    known = [what for name in head.names if (what := meaning_of(name).what) in AXES]
    with suppress(TableError):
        columns_of(tuple(filter(None, head.names)), source.axes)
        return RecordingFileError(head.path, error.parts, line=head.line)  # it is about another column
    way_out: Sequence[str] = [f"; line {head.line} names the columns"] if not known else []
    if len(head.names) >= len(AXES) and all(map(NUMERIC.fullmatch, head.names)):
        problem = f"has no names of columns: line {head.line} holds {len(head.names)} numbers"
        if not (way_out := _names_given(head)):
            names = "csv={'header': None, 'names': [...]} (--csv header=None --csv 'names=[...]')"
            way_out = [f"; name all of them in their order, fx to tz and time among them: {names}"]
        return RecordingFileError(head.path, (problem, *way_out), line=head.line, no_wrench=True)
    of_names = None if "skiprows" in head.options else _line_of_names(head, source.axes)
    if of_names is not None and of_names + 1 != head.line:
        way_out = [f"; line {of_names + 1} names the columns: pass ", in_both(csv={"skiprows": of_names})]
        known = list(AXES)
    elif source.axes is None:
        way_out = (
            (_names_given(head) if not known else [])
            or _renamed(head, error)
            or (_axes_given(pandas, head, source) if not known else [])
            or way_out
        )
        if not way_out and len(set(known)) == len(known) < len(AXES):
            way_out = ["; for these alone pass ", in_both(axes=",".join(known))]
    return RecordingFileError(head.path, (*error.parts, *way_out), line=head.line, no_wrench=not known)


def _renamed(head: Head, error: TableError) -> list[str]:
    """Say how columns are named anew: six or seven in the order of the axes, or those whose unit is not known."""
    names = [name for name in head.names if name]
    if "the unit of column" in str(error):
        plain = [meaning_of(name).base if meaning_of(name).what in AXES else name for name in names]
        return ["; if it is one of these, pass it, ", in_both(csv={"header": 0, "names": plain}, units=UNITS)]
    meanings = [meaning_of(name) for name in names]
    known = [one.what for one in meanings]
    units = [one.unit for one in meanings]
    missing = [what for what in ("time", *AXES) if what not in known]
    missing = missing[1:] if known.count(None) == len(missing) - 1 and missing[0] == "time" else missing
    if not missing or known.count(None) != len(missing) or len(set(names)) < len(names):
        return []
    if not any(units) and not {*known} & {*AXES}:
        return []
    first = dict(
        zip(
            head.names, cells_of("".join(head.lines[head.below : head.below + 1]), head.options), strict=False
        )
    )
    if any(
        what is None and not NUMERIC.fullmatch(first.get(name, ""))
        for name, what in zip(names, known, strict=True)
    ):
        return []
    rest = iter(missing)
    bases = [next(rest) if what is None else name for name, what in zip(names, known, strict=True)]
    named = [
        f"{base} [{unit}]" if unit and what is None else base
        for base, unit, what in zip(bases, units, known, strict=True)
    ]
    if any(meaning_of(name).scale is None for name in named):
        return []
    is_scaled = any(one.what is one.unit is None and SCALED_UNITS.search(one.base) for one in meanings)
    way = {"csv": {"header": 0, "names": named}} | ({"units": UNITS} if is_scaled else {})
    return ["; if its columns are these, pass ", in_both(**way)]


def _line_of_names(head: Head, axes: tuple[str, ...] | None) -> int | None:
    """Return how many lines stand above one that names all axes, or is followed by as many numbers."""
    split = [
        (i, [[cell.strip(' "') for cell in one.split(separator)] for one in head.lines[i : i + 4]])
        for i in range(len(head.lines))
        for separator in SEPARATORS
    ]
    for i, (names, *_) in split:
        with suppress(TableError):
            columns_of(tuple(names), axes)
            return i
    for i, (names, *rows) in split:
        numbers = [sum(map(bool, map(NUMERIC.fullmatch, row))) for row in rows if len(row) == len(names)]
        if len(numbers) == 3 and min(numbers) >= len(AXES) and not any(map(NUMERIC.fullmatch, names)):
            return i
    return None


def _names_given(head: Head) -> list[str]:
    """Say how to name six or seven columns of numbers, where no line has a name for each."""
    separator = str(head.options.get("sep", ","))
    pattern = re.escape(separator) if len(separator) == 1 else separator
    for i, line in enumerate(head.lines):
        cells = [cell.strip() for cell in re.split(pattern, line)]
        cells = cells[:-1] if cells and not cells[-1] else cells
        names = _BY_WIDTH.get(len(cells))
        if names is None or not all(map(NUMERIC.fullmatch, cells)):
            continue
        own = {name for name in head.names if name and not NUMERIC.fullmatch(name)}
        if len(own) >= len(cells):
            return []
        skipped = {"skiprows": i} if i else {}
        begin = "; if its columns are these, in N and N m (else pass units=, --units, too), pass "
        return [begin, in_both(csv={"header": None, **skipped, "names": names})]
    return []


def _axes_given(pandas: Any, head: Head, source: FileSource) -> list[str]:
    """Say which columns of numbers may be other axes: ids, positions, temperatures and clocks are none."""
    columns, _ = _columns(_read(pandas, head, _FEW), head)
    if mend := reshaped(columns):
        return frames_line(_opening(head), source, Table(name=source.name, columns=columns), mend)
    numbers = [
        name
        for name, cells in columns.items()
        if cells.dtype.kind in "iuf" or all(NUMERIC.fullmatch(str(cell)) for cell in cells)
        if not NUMERIC.fullmatch(name) and meaning_of(name).what is None
    ]
    clock = {}
    if numbers and not is_clock(list(columns)):
        stamps = [float(str(cell).replace(",", ".")) for cell in columns[numbers[0]]]
        if len(stamps) > 2 and all(a < b for a, b in pairwise(stamps)):
            clock = {"time": numbers.pop(0)}
    meanings = [meaning_of(name) for name in numbers]
    others = [
        name
        for name, meaning in zip(numbers, meanings, strict=True)
        if not _NO_AXIS.fullmatch(meaning.base) and (meaning.unit or "").lower() not in _NO_AXIS_UNITS
    ]
    others = others or [name for name in numbers if meaning_of(name).base.lower() in ("x", "y", "z")]
    measured = [
        name for name in others if columns[name].dtype.kind not in "iu" or len(set(columns[name])) > 1
    ]
    others = measured if len(measured) >= len(AXES) else others
    short = [meaning_of(name).base for name in others]
    names = others if len(set(short)) < len(short) else short
    ends = [name.lower()[-2:] for name in names]
    if len(names) > len(AXES) and (len(set(ends)) < len(ends) or any(end[-1:] not in "xyz" for end in ends)):
        shown = ", ".join(names[:_MOST_NAMED]) + " ..." * (len(names) > _MOST_NAMED)
        return [
            f"; axes= names those of its columns that are the axes, in the order fx to tz (--axes): {shown}"
        ]
    return ["; for other axes pass ", in_both(axes=",".join(names), **clock)] if names else []

"""The ways out of refusals: lines of Python that read the file, and options, with all that is wanted at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from granular_id._core import GranularIdError
from granular_id._text import RATE, WayOut, alternatives, in_both, is_unknown
from granular_id.io.files import RecordingFileError
from granular_id.io.source import FileSource, LoadOptions
from granular_id.recording import AXES, LABEL, Table, meaning_of

_MODULES = ("dataclasses", "h5py", "io", "json", "numpy", "pandas", "pathlib", "re", "scipy.io")
_READERS = {
    **dict.fromkeys((".xlsx", ".xls", ".ods"), "read_excel({})"),
    ".feather": "read_feather({})",
    ".jsonl": "read_json({}, lines=True)",
}
PART_NAMES = (("force", "forces", "f"), ("torque", "torques", "moment", "moments", "tau", "t", "m"))
"""Names of forces and torques, for ways out only: people see what they type."""

_MOST_STEPS, _MANY = 6, 50
_NUMBERS = (r"[\W_]*\d+$", r"[\W_]+\(\d+\)$", r"[\W_\d]+$")
"""What numbers files at the ends of their names: the first that gives the label of a file serves for those like it."""


def in_python(*lines: str) -> WayOut:
    """Return lines of Python as the end of an error; what they import comes first, the data set last."""
    if not lines:
        return WayOut()
    text = "; ".join([*lines[:-1], f"data = {lines[-1]}"])
    used = [name for name in _MODULES if re.search(rf"(?<![\w.]){re.escape(name)}\.", text)]
    imports = f"import {', '.join(used)}; " * bool(used)
    public = [name for name in ("Dataset", "load") if re.search(rf"(?<![\w.]){name}[.(]", text)]
    code = f"{imports}from granular_id import {', '.join(public)}; {text}"
    way = WayOut(f"; in Python: {code}")
    way.code = code
    return way


def in_python_each(lines: Sequence[str], calls: Sequence[tuple[str, str]]) -> list[str]:
    """Return lines of Python for each way to end them: the call that makes the data set, and what it assumes."""
    parts: list[str] = []
    for call, why in calls:
        whole = in_python(*lines, call)
        way = WayOut((f"; or data = {call}" if parts else whole) + (f", if {why}" if why else ""))
        way.code, way.why = whole.code, why
        parts.append(way)
    return parts


class Place(NamedTuple):
    """What Python calls label and session of a file in a folder, and what that assumes."""

    label: str
    session: str | None
    why: str


def paths_line(source: FileSource) -> str:
    """Return the line that finds all files like this one in the folder that is read."""
    ending = "".join(source.path.suffixes[-2 if source.path.suffix == ".gz" else -1 :])
    pattern = "*/" * source.name.count("/") + "*" + ending
    return f"paths = sorted(pathlib.Path({str(source.root)!r}).glob({pattern!r}))"


def places_of(source: FileSource) -> list[Place]:
    """Return the readings of the place of one file of several, one without a label where it says none."""
    if source.n_alike == 1:
        return []
    stated = {"label": source.label_place, "session": source.session_place}
    readings: list[Mapping[str, Any]] = [stated] if source.label or source.label_else else []
    if source.two_meanings is not None:
        readings = [part.options for part in source.two_meanings if isinstance(part, WayOut) and part.options]
    is_of_folder = source.label_place == "name of the folder"
    text, name = (
        ("path.parent.name", source.path.parent.name) if is_of_folder else ("path.stem", source.path.stem)
    )
    before, _, behind = name.partition(source.name_label or name)
    ends = [f"^{_any_number(before)}"] * bool(before) + [f"{_any_number(behind)}$"] * bool(behind)
    endings = (end for end in (*_NUMBERS, "|".join(ends)) if re.sub(end, "", name) == source.name_label)
    ending = next(endings, None)
    of_name = None if ending is None else f"re.sub(r{ending!r}, '', {text})".replace("\\\\", "\\")
    calls = {"folder": "path.parent.name", "parent": "path.parent.parent.name"}
    calls |= (
        {} if of_name is None else dict.fromkeys(("file", "name of the file", "name of the folder"), of_name)
    )
    names = {"folder": source.path.parent.name, "parent": source.path.parent.parent.name}
    found = []
    for reading in readings:
        label, session = reading["label"], calls.get(reading.get("session", ""))
        if label in calls:
            why = f"{names.get(label, source.name_label)!r} is a material" if len(readings) > 1 else ""
            found.append(Place(calls[label], session, why))
    return found or [Place("", None, "")]


def _any_number(text: str) -> str:
    return re.sub(r"\d+", r"\\d+", re.escape(text))


def frames_line(opening: str, source: FileSource, table: Table, mend: str) -> list[str]:
    """Return the line that reads a table by pandas, mended; of a folder it reads all files like this one.

    `opening` is the call that reads a file, with ``{}`` for its path; `mend` are methods of the frame.
    """
    label = source.label or source.label_else
    named = {"time": "time", "recording": "id", "label": "label", "session": "session"}
    # what a mend makes tells them apart, as the column that was named does not
    if ".assign(recording=" in mend or ".assign(**{'recording':" in mend:
        del named["recording"]
    given = {"rate_hz": source.rate_hz, "time_unit": source.time_unit}
    given |= {named[what]: name for what, name in source.columns if name is not None and what in named}
    given["axes"] = None if source.axes is None else ",".join(source.axes)
    known = source.axes or AXES
    units = {meaning_of(name).what: unit for name, unit in table.units.items()} | dict(table.units)
    stated = source.units or ([units[axis] for axis in known] if set(known) <= units.keys() else None)
    given["units"] = None if stated is None else ",".join(stated)
    words = "".join(f", {name}={value!r}" for name, value in given.items() if value is not None)
    if source.rate_hz is None and "time" not in given and not is_clock(list(table.columns)):
        words += f", rate_hz={RATE}"
    in_table = source.label is None and any(meaning_of(name).what == LABEL for name in table.columns)
    is_labelled = in_table or "label" in given or ".assign(label=" in mend
    texts = [] if is_labelled or label is not None else _few_texts(table)
    if len(texts) == 1 and not any(place.label for place in places_of(source)):
        words, is_labelled = f"{words}, label={texts[0]!r}", True
    if places := places_of(source):
        frames = f"frames = [{opening.format('path')}{mend} for path in paths]"
        calls = []
        for place in places[: 1 if is_labelled else None]:
            labels = "" if is_labelled or not place.label else f", [{place.label} for path in paths]"
            sessions = "" if place.session is None else f", sessions=[{place.session} for path in paths]"
            why = "" if is_labelled else place.why
            calls.append((f"Dataset.from_frames(frames{labels}{words}{sessions})", why))
        return in_python_each([paths_line(source), frames], calls)
    labels = "" if label is None or is_labelled else f", [{label!r}]"
    frame = f"frame = {opening.format(repr(str(source.path)))}{mend}"
    return [in_python(frame, f"Dataset.from_frames(frame{labels}{words})")]


def _few_texts(table: Table) -> list[str]:
    """Return the columns of a few texts in many rows that are not read: they may be labels."""
    found = []
    for name, cells in table.columns.items():
        if (
            cells.dtype.kind in "OUT"
            and meaning_of(name).what is None
            and all(isinstance(one, str) for one in cells)
        ):
            found += [name] * (1 < len(set(cells.tolist())) < len(cells) / _MANY)
    return found


def reshaped(columns: Mapping[str, Any]) -> str:
    """Return methods of a data frame that make columns of axes: of a row a reading, or of axes of several recordings.

    Empty where a table is neither: ``kind, value`` with a name of an axis in each row, or ``rice_1_fx ... oats_2_tz``.
    """
    for name, cells in columns.items():  # a list of all axes in each row
        if (
            cells.dtype == object
            and len(cells)
            and all(np.shape(cell) == (len(AXES),) for cell in cells[:_MANY])
        ):
            return in_columns(name, AXES)
    numbers = [name for name, cells in columns.items() if cells.dtype.kind in "iuf" and not is_clock([name])]
    for name, cells in columns.items():
        if len(cells) and all(meaning_of(str(cell)).what in AXES for cell in cells) and numbers:
            index = [one for one in columns if one not in (name, numbers[-1])]
            return f".pivot(index={index}, columns={name!r}, values={numbers[-1]!r}).reset_index()"
    split = [re.fullmatch(r"(.+?)([\W_]+)([FfTt][XYZxyz])", name) for name in columns]
    found = [one.groups() for one in split if one is not None]
    names, axes = list(dict.fromkeys(one[0] for one in found)), list(dict.fromkeys(one[2] for one in found))
    whole = len(found) == len(names) * len(axes) and len({one[1] for one in found}) == 1
    stems = {re.sub(r"[\W_]*\d+$", "", name) for name in names}
    if not whole or not 1 < len(stems) < len(names) or [axis.lower() for axis in axes] != list(AXES):
        return ""  # FT1 and FT2, or tool and table, are two sensors
    clock = [name for name in columns if meaning_of(name).what == "time"][:1]
    parts = f"f[[*{clock}, *(name + {found[0][1]!r} + axis for axis in {axes})]].set_axis([*{clock}, *{axes}], axis=1)"
    label = r"re.sub(r'[\W_]*\d+$', '', name)"
    each = f"{parts}.assign(recording=name).assign(label={label}) for name in {names}"
    return f".pipe(lambda f: pandas.concat([{each}]))"


def dated_line(root: Path, ending: str) -> WayOut:
    """Return the line that writes an index.csv of names with a date within, and reads it."""
    date = r"\d{4}[-_.]?\d\d[-_.]?\d\d"
    label = rf"re.sub(r'^[\W_]+|[\W_]*\d*$', '', re.split(r'{date}', path.stem)[-1])"
    return in_python(
        f"root = pathlib.Path({str(root)!r})",
        f"paths = sorted(root.glob({'*' + ending!r}))",
        f"labels = [{label} for path in paths]",
        f"days = [re.search(r'{date}', path.stem)[0] for path in paths]",
        "files = [path.name for path in paths]",
        "index = pandas.DataFrame({'file': files, 'label': labels, 'session': days})",
        "index.to_csv(root / 'index.csv', index=False)",
        "load(root)",
    )


def in_columns(name: str, axes: Sequence[str]) -> str:
    """Return the method of a data frame that makes columns of a list in each row."""
    return f".pipe(lambda f: f.assign(**dict(zip({list(axes)}, map(list, zip(*f[{name!r}]))))))"


def index_line(root: Path, ending: str) -> WayOut:
    """Return the line that writes an index.csv by which the first folder is the material, and reads it."""
    return in_python(
        f"root = pathlib.Path({str(root)!r})",
        f"files = [path.relative_to(root) for path in sorted(root.rglob({'*' + ending!r}))]",
        "index = pandas.DataFrame({'file': files, 'label': [file.parts[0] for file in files]})",
        "index.to_csv(root / 'index.csv', index=False)",
        "load(root)",
    )


def unknown_files_line(path: Path, endings: Sequence[str]) -> list[WayOut]:
    """Return the line that reads files which pandas knows, in folders of materials or alone; else nothing."""
    ending = next((ending for ending in endings if ending.lower() in _READERS), None)
    if ending is None:
        return []
    call = f"pandas.{_READERS[ending.lower()]}"
    if not path.is_dir():
        return [in_python(f"frame = {call.format(repr(str(path)))}", "Dataset.from_frames(frame)")]
    paths = f"paths = sorted(pathlib.Path({str(path)!r}).rglob({'*' + ending!r}))"
    call = f"Dataset.from_frames([{call.format('path')} for path in paths], [path.parent.name for path in paths])"
    return [in_python(paths, call)]


def with_all_wanted(
    error: RecordingFileError, source: FileSource, options: LoadOptions, read: Callable[[LoadOptions], object]
) -> RecordingFileError:
    """Let an error name all that its file needs: options that it names are tried, and what is wanted then is added.

    `read` reads the file with other options.
    """
    problems, last = [error.parts], error
    wanted, others = dict[str, Any](), list[dict[str, Any]]()

    def refusal(way: Mapping[str, Any]) -> GranularIdError | None:
        try:
            read(replace(options, **joined({"csv": options.csv} if options.csv else {}, way)))
        except GranularIdError as other:
            return other
        return None

    while last.ways and not last.in_python and len(problems) <= _MOST_STEPS:
        best = next((way for way in last.ways if not is_unknown(way)), last.ways[0])
        others += [joined(wanted, way) for way in last.ways if way is not best and not is_unknown(way)]
        wanted = joined(wanted, best)
        if is_unknown(wanted):
            break
        other = refusal(wanted)
        if not isinstance(other, RecordingFileError) or other.parts in problems:
            break
        last = other
        problems.append(other.parts)
    if len(problems) > 1:
        others = [way for way in others if refusal(way) is None]
    lines = [part for part in last.parts if isinstance(part, WayOut) and part.code]
    doubt = source.two_meanings
    if doubt is not None and doubt not in problems and not lines and "label" not in wanted:
        problems.append(doubt)
        readings = [part.options for part in doubt if isinstance(part, WayOut) and part.options]
        lines = [part for part in doubt if isinstance(part, WayOut) and part.code]
        wanted, *others = [joined(wanted, way) for way in readings]
    if len(problems) == 1:
        return error
    plain = ["".join(_plain(part) for part in parts) for parts in problems]
    options_too = not last.in_python or last is error  # else lines hold what options alone do not read
    both = (
        ["; in all pass ", *alternatives(in_both(**way) for way in (wanted, *others))] if options_too else []
    )
    place = {name: getattr(error, name) for name in ("line", "column", "place", "no_wrench")}
    return RecordingFileError(error.path, ("; then: ".join(plain), *both, *lines), **place)


def _plain(part: str) -> str:
    return part.plain if isinstance(part, WayOut) else part  # of lines of Python nothing


def joined(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of both, the second ones first, and all of `csv`."""
    csv = {**(one.get("csv") or {}), **(other.get("csv") or {})}
    return {**one, **other, **({"csv": csv} if csv else {})}


def is_clock(names: Sequence[str]) -> bool:
    """Return True if one of the names is that of a clock."""
    return any(meaning_of(name).what == "time" for name in names)

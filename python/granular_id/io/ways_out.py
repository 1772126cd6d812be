"""The ways out of refusals: lines of Python that read the file, and options, with all that is wanted at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from granular_id._core import GranularIdError
from granular_id._text import RATE, WayOut, alternatives, in_both, is_unknown
from granular_id.io.files import RecordingFileError
from granular_id.io.source import FileSource, LoadOptions
from granular_id.recording import AXES, Table, meaning_of

_MODULES = ("dataclasses", "h5py", "io", "json", "numpy", "pandas", "pathlib", "scipy.io")
_READERS = {".xlsx": "read_excel", ".xls": "read_excel", ".ods": "read_excel", ".feather": "read_feather"}
_MOST_STEPS = 4


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


def frames_line(opening: str, source: FileSource, table: Table, mend: str) -> WayOut:
    """Return the line that reads a table by pandas, mended; of a folder it reads all files like this one.

    `opening` is the call that reads a file, with ``{}`` for its path; `mend` are methods of the frame.
    """
    label = source.label or source.label_else
    named = {"time": "time", "recording": "id", "label": "label", "session": "session"}
    given = {"rate_hz": source.rate_hz, "time_unit": source.time_unit}
    given |= {named[what]: name for what, name in source.columns if name is not None and what in named}
    given["axes"] = None if source.axes is None else ",".join(source.axes)
    known = source.axes or AXES
    stated = source.units or (
        [table.units[axis] for axis in known] if set(known) <= table.units.keys() else None
    )
    given["units"] = None if stated is None else ",".join(stated)
    words = "".join(f", {name}={value!r}" for name, value in given.items() if value is not None)
    if source.rate_hz is None and "time" not in given and not is_clock(list(table.columns)):
        words += f", rate_hz={RATE}"
    places = {"folder": "path.parent.name", "parent": "path.parent.parent.name"}
    where = places.get(source.label_place)
    if source.path != source.root and where is not None and label is not None:
        pattern = "*/" * source.name.count("/") + "*" + "".join(source.path.suffixes[-2:])
        session = places.get(source.session_place)
        words += f", sessions=[{session} for path in paths]" if session is not None else ""
        return in_python(
            f"paths = sorted(pathlib.Path({str(source.root)!r}).glob({pattern!r}))",
            f"frames = [{opening.format('path')}{mend} for path in paths]",
            f"Dataset.from_frames(frames, [{where} for path in paths]{words})",
        )
    labels = "" if label is None or "label" in given else f", [{label!r}]"
    frame = f"frame = {opening.format(repr(str(source.path)))}{mend}"
    return in_python(frame, f"Dataset.from_frames(frame{labels}{words})")


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
        return [in_python(f"frame = {call}({str(path)!r})", "Dataset.from_frames(frame)")]
    paths = f"paths = sorted(pathlib.Path({str(path)!r}).rglob({'*' + ending!r}))"
    call = f"Dataset.from_frames([{call}(path) for path in paths], [path.parent.name for path in paths])"
    return [in_python(paths, call)]


def with_all_wanted(
    error: RecordingFileError, source: FileSource, options: LoadOptions, read: Callable[[LoadOptions], object]
) -> RecordingFileError:
    """Let an error name all that its file needs: options that it names are tried, and what is wanted then is added.

    `read` reads the file with other options.
    """
    problems, last = [error.parts], error
    wanted, others = dict[str, Any](), list[dict[str, Any]]()
    while last.ways and not last.in_python and len(problems) <= _MOST_STEPS:
        best = next((way for way in last.ways if not is_unknown(way)), last.ways[0])
        others = [
            *others,
            *(joined(wanted, way) for way in last.ways if way is not best and not is_unknown(way)),
        ]
        wanted = joined(wanted, best)
        if is_unknown(wanted):
            break
        try:
            read(replace(options, **joined({"csv": options.csv} if options.csv else {}, wanted)))
            break
        except GranularIdError as other:
            if not isinstance(other, RecordingFileError) or other.parts in problems:
                break
            last = other
            problems.append(other.parts)
    if source.two_meanings is not None and source.two_meanings not in problems:
        problems.append(source.two_meanings)
        readings = [part.options for part in source.two_meanings if isinstance(part, WayOut) and part.options]
        last = RecordingFileError(error.path, source.two_meanings)
        wanted, *others = [joined(wanted, way) for way in readings]
    if len(problems) == 1:
        return error
    plain = ["".join(_plain(part) for part in parts) for parts in problems]
    both = alternatives(in_both(**way) for way in (wanted, *others))
    lines = [part for part in last.parts if isinstance(part, WayOut) and part.code]
    place = {name: getattr(error, name) for name in ("line", "column", "place", "no_wrench")}
    return RecordingFileError(error.path, ("; then: ".join(plain), "; in all pass ", *both, *lines), **place)


def _plain(part: str) -> str:
    return part.plain if isinstance(part, WayOut) else part  # of lines of Python nothing


def joined(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of both, the second ones first, and all of `csv`."""
    csv = {**(one.get("csv") or {}), **(other.get("csv") or {})}
    return {**one, **other, **({"csv": csv} if csv else {})}


def is_clock(names: Sequence[str]) -> bool:
    """Return True if one of the names is that of a clock."""
    return any(meaning_of(name).what == "time" for name in names)

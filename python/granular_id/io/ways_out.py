"""The ways out of refusals: lines of Python that read the file, and options, with all that is wanted at once."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from granular_id._core import GranularIdError
from granular_id._text import in_both
from granular_id.io.files import RecordingFileError
from granular_id.io.source import FileSource, LoadOptions
from granular_id.recording import AXES, Table, meaning_of

RATE = "RATE"
"""What stands for a rate that only the user knows."""

_MODULES = ("dataclasses", "h5py", "io", "json", "numpy", "pandas", "pathlib", "scipy.io")
_READERS = {".xlsx": "read_excel", ".xls": "read_excel", ".ods": "read_excel", ".feather": "read_feather"}
_MOST_STEPS = 4
_NAMED = re.compile(
    r"(?<!\w)(csv|label|session|array|topic|axes|units|id|time|rate_hz)=(\{[^{}]*\}|'[^']*'|RATE)"
)


def in_python(*lines: str) -> str:
    """Return lines of Python as the end of an error; what they import comes first, the data set last."""
    text = "; ".join(lines)
    used = [name for name in _MODULES if re.search(rf"(?<![\w.]){re.escape(name)}\.", text)]
    imports = f"import {', '.join(used)}; " * bool(used)
    public = [name for name in ("Dataset", "load") if re.search(rf"(?<![\w.]){name}[.(]", text)]
    return f"; in Python: {imports}from granular_id import {', '.join(public)}; {text}"


def passed(options: Mapping[str, Any]) -> str:
    """Return options as they are passed in Python and, in brackets, on the command line."""
    both = in_both(**options).replace("--rate-hz", "--recorded-hz")
    return both.replace(f"={RATE!r}", f"={RATE}")


def frames_line(opening: str, source: FileSource, table: Table, mend: str) -> str:
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


def index_line(root: Path, ending: str) -> str:
    """Return the line that writes an index.csv by which the first folder is the material, and reads it."""
    return in_python(
        f"root = pathlib.Path({str(root)!r})",
        f"files = [path.relative_to(root) for path in sorted(root.rglob({'*' + ending!r}))]",
        "index = pandas.DataFrame({'file': files, 'label': [file.parts[0] for file in files]})",
        "index.to_csv(root / 'index.csv', index=False)",
        "load(root)",
    )


def unknown_files_line(path: Path, endings: Sequence[str]) -> str:
    """Return the line that reads files which pandas knows, in folders of materials or alone; else nothing."""
    ending = next((ending for ending in endings if ending.lower() in _READERS), None)
    if ending is None:
        return ""
    call = f"pandas.{_READERS[ending.lower()]}"
    if not path.is_dir():
        return in_python(f"frame = {call}({str(path)!r})", "Dataset.from_frames(frame)")
    return in_python(
        f"paths = sorted(pathlib.Path({str(path)!r}).rglob({'*' + ending!r}))",
        f"Dataset.from_frames([{call}(path) for path in paths], [path.parent.name for path in paths])",
    )


def options_in(problem: str) -> list[dict[str, Any]]:
    """Return the options that an error names, of each way out: ``pass csv={'skiprows': 7}``."""
    parts = problem.partition("; in Python")[0].split("; ")
    clauses = [clause for part in parts for clause in part.partition("pass ")[2].split(" or ")]
    return [
        {name: RATE if value == RATE else ast.literal_eval(value) for name, value in named}
        for clause in clauses
        if (named := _NAMED.findall(clause))
    ]


def with_all_wanted(
    error: RecordingFileError, source: FileSource, options: LoadOptions, read: Callable[[LoadOptions], object]
) -> RecordingFileError:
    """Let an error name all that its file needs: options that it names are tried, and what is wanted then is added.

    `read` reads the file with other options.
    """
    problems, wanted = [error.problem], dict[str, Any]()
    ways = options_in(error.problem)
    while len(ways) == 1 and "; in Python" not in problems[-1]:
        wanted = _joined(wanted, ways[0])
        if RATE in wanted.values() or len(problems) > _MOST_STEPS:
            break
        try:
            read(replace(options, **_joined({"csv": options.csv} if options.csv else {}, wanted)))
            break
        except GranularIdError as other:
            if not isinstance(other, RecordingFileError) or other.problem in problems:
                break
            problems.append(other.problem)
            ways = options_in(other.problem)
    if source.two_meanings is not None and source.two_meanings not in problems:
        problems.append(source.two_meanings)
        ways = options_in(source.two_meanings)
    if len(problems) == 1:
        return error
    last, *line = problems[-1].partition("; in Python")
    plain = [re.sub(r" \(--[^()]*\)", "", problem) for problem in [*problems[:-1], last]]
    both = [passed(_joined(wanted, way)) for way in ways or [{}]]
    whole = f"{'; then: '.join(plain)}; in all pass {' or '.join(both)}{''.join(line)}"
    place = {name: getattr(error, name) for name in ("line", "column", "place", "no_wrench")}
    return RecordingFileError(error.path, whole, **place)


def _joined(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    csv = {**(one.get("csv") or {}), **(other.get("csv") or {})}
    return {**one, **other, **({"csv": csv} if csv else {})}


def is_clock(names: Sequence[str]) -> bool:
    """Return True if one of the names is that of a clock."""
    return any(meaning_of(name).what == "time" for name in names)

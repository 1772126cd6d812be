"""``find_sources``: the files that a path holds, and what their folders and names say of label and session.

1. ``index.csv`` lists the files; files it does not list are not read.
2. Files in folders, ``rice/1.csv``: the folder is the label.
3. Files in one folder, ``fine_sugar_2.csv``: the label is the name without numbers, dates and counted runs at its ends.

Two levels of folders may mean material and session in either order, and are refused unless the files state their label,
or an option says where it stands: ``folder`` (that of the file), ``parent`` (the folder above), ``file`` (its name).
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from granular_id._text import counted, in_both, verb
from granular_id.io.files import RecordingFileError, attempt, list_folder, refuse_outside
from granular_id.io.formats import FORMATS, format_of
from granular_id.io.index import HISTORY_NAME, INDEX_COLUMNS, INDEX_NAME, read_history, read_index
from granular_id.io.source import NO_MATERIAL, SESSION_LIKE, FileSource, LoadOptions
from granular_id.recording import StepReport

LAYOUTS = "label/*.csv, label_1.csv, or an index.csv with the columns file and label"

OTHER_FILES = (
    "a text table is read under a name that ends with .csv or .txt; what numpy or pandas can open, by "
    "Dataset.from_arrays(X, y, rate_hz=...), X of shape (recordings, samples, axes), or by "
    "Dataset.from_frames(frames, labels)"
)
"""What to do about files of no known format."""

_NO_RECORDING = re.compile(
    r"(mean|average|avg|std|median|summary|readme|license|metadata)([\W_].*|$)", re.IGNORECASE
)
"""Names of what lies beside recordings."""

_WORD = rf"(?:{'|'.join(sorted(NO_MATERIAL, key=len, reverse=True))})"
_DATE = (
    r"(?:\d{4}[-_.]?\d\d[-_.]?\d\d|\d\d[-_.]\d\d[-_.]\d{4})(?:[T_ -]*\d\d[-_:.]?\d\d(?:[-_:.]?\d\d)?)?"
    r"|\d\d[-:]\d\d[-:]\d\d"
)
_NUMBER = re.compile(rf"(?:[\s_.-]+{_WORD})?[\s_.-]*\(?(?:{_DATE}|\d+)\)?$", re.IGNORECASE)
"""A number or a date at the end of a name, with the word that it counts: ``_run3``."""

_BEFORE_NUMBER = re.compile(rf"[\s_.-]+(?:{_WORD}[\s_.-]*\d*|{_DATE})$", re.IGNORECASE)
_SIZE = r"(?:mm|cm|um|\N{MICRO SIGN}m|mesh|kg|g|ml|pct|percent)(?:[\W_]|$)"
_AHEAD = re.compile(rf"(?:{_WORD}[\s_.-]*\d+|{_DATE}|\d+)[\s_.-]+(?!{_SIZE})(?=\D)", re.IGNORECASE)
"""The same ahead of a name: ``run3-``, ``2025-03-04_``, but not ``4_mm_``."""

_MOST_DEEP = 12
_EXAMPLES = 3


@dataclass
class Sources:
    """The files of a path and what is known of them."""

    layout: str
    files: list[FileSource] = field(default_factory=list)
    problems: list[RecordingFileError] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    history: Sequence[StepReport] = ()


def find_sources(path: Path, options: LoadOptions) -> Sources:
    """Find what a file or folder holds, before any of it is read."""
    known = format_of(path)
    if known is not None:
        alone = FileSource.alone(path)
        return Sources(known.what, [_told(alone, options, path.resolve(), alone=True)])
    if not path.is_dir():
        wanted = "; ".join(known.what for known in FORMATS)
        problem = f"is of no known format; what can be read: {wanted}; or a folder of such files ({LAYOUTS})"
        raise RecordingFileError(path, f"{problem}; {OTHER_FILES}")
    if (path / INDEX_NAME).is_file():
        return _indexed(path, options)
    return _in_folders(path, options)


def _told(source: FileSource, options: LoadOptions, path: Path, *, alone: bool = False) -> FileSource:
    """Put in what the options say by the place of a file."""
    told: dict[str, str] = {}
    for what in ("label", "session"):
        rule = getattr(options, what)
        if rule is None:
            continue
        told[f"{what}_place"] = rule
        if rule == "file":  # a session is one file, whatever number it has
            told[what] = _label_of(path) or path.stem if what == "label" else _place_of(source)
        elif rule in ("folder", "parent"):
            folder = path.parent if rule == "folder" else path.parent.parent
            if not alone and source.root.resolve() not in (folder, *folder.parents):
                problem = f"{what}='parent', but there is no folder above its own in {source.root}"
                raise RecordingFileError(source.path, problem)
            told[what] = folder.name
            if what == "session" and not alone:  # a day of the same name may be another's
                label_rule, root = options.label or "folder", source.root.resolve()
                of_label = {"folder": path.parent, "parent": path.parent.parent}.get(label_rule)
                above = [one for one in (folder, *folder.parents) if root in one.parents and one != of_label]
                told[what] = "/".join(one.name for one in reversed(above)) or folder.name
    return replace(source, **told)  # type: ignore[arg-type]


def _place_of(source: FileSource) -> str:
    inside = source.path.is_relative_to(source.root)
    return source.path.relative_to(source.root).as_posix() if inside else source.path.name


def _label_of(path: Path) -> str | None:
    """Return the name of a file without what numbers it at its ends; None where nothing of a material is left."""
    stem = path.name
    for known in FORMATS:
        ending = next((suffix for suffix in known.suffixes if stem.lower().endswith(suffix)), None)
        if ending is not None:
            stem = stem[: -len(ending)]
            break
    label = _NUMBER.sub("", stem)
    while label != stem and (before := _BEFORE_NUMBER.sub("", label)) != label:
        label = before
    label = _AHEAD.sub("", label, count=1).strip(" _.-")
    return None if not _NUMBER.sub("", label) or label.lower() in NO_MATERIAL else label


def _indexed(root: Path, options: LoadOptions) -> Sources:
    found = Sources("index.csv")
    columns, files = read_index(root, found.problems)
    for source in files:
        if format_of(source.path) is None:
            problem = f"{source.path.relative_to(root).as_posix()!r} is of no known format"
            found.problems.append(RecordingFileError(root / INDEX_NAME, problem, column="file"))
        else:
            told = attempt(found.problems, _told, source, options, source.path.resolve())
            found.files += [] if told is None else [told]
    if "label" not in columns:
        found.notes.append(f"index.csv has no column label (found: {', '.join(columns)})")
    others = [column for column in columns if column not in INDEX_COLUMNS]
    if others:
        found.notes.append(f"columns of index.csv kept in meta: {', '.join(others)}")
    listed = {source.path for source in files}
    walked = Sources("")
    _walk(root, root, walked)
    unlisted = [
        source.name for source in walked.files if source.path not in listed and source.name != INDEX_NAME
    ]
    if n := len(unlisted):
        beside = f"{counted(n)} beside index.csv ({unlisted[0]}{' ...' * (n > 1)}) {verb(n, 'is', 'are')}"
        found.notes.append(f"{beside} not listed in it and {verb(n, 'was', 'were')} not read")
    if (root / HISTORY_NAME).is_file():
        found.history = read_history(root / HISTORY_NAME)
    return found


def _in_folders(root: Path, options: LoadOptions) -> Sources:
    found = Sources("label/*")
    others = _walk(root, root, found)
    beside = [source for source in found.files if _NO_RECORDING.match(source.path.name)]
    if beside and len(beside) < len(found.files):
        found.files = [source for source in found.files if source not in beside]
        found.notes.append(
            f"not read, as their names are not those of recordings: {_listed([one.name for one in beside])}"
        )
    if not found.files and not found.problems:
        problem = f"holds no recordings; wanted {LAYOUTS} (or files of another format)"
        kinds = ", ".join(ending for ending, _ in Counter(others).most_common(3))
        raise RecordingFileError(
            root, problem + (f"; it holds files of no known format ({kinds}); {OTHER_FILES}" * bool(kinds))
        )
    if n := len(others):
        kinds = ", ".join(ending for ending, _ in Counter(others).most_common(3))
        found.notes.append(
            f"{counted(n, 'file')} of no known format {verb(n, 'is', 'are')} not read ({kinds})"
        )
    if options.label is None:
        found.files = _by_place(root, found)
    found.files = [
        _told(source, options, root.resolve() / source.path.relative_to(root)) for source in found.files
    ]
    return found


def _walk(folder: Path, root: Path, found: Sources, depth: int = 0) -> list[str]:
    """Gather what can be read below a folder; return the endings of what cannot."""
    refuse_outside(folder, root)
    files, folders = list_folder(folder)
    others: list[str] = []
    for path in [*files, *folders]:
        if format_of(path) is not None:
            found.files.append(FileSource(path, root, path.relative_to(root).as_posix()))
        elif path.is_dir() and depth < _MOST_DEEP:
            deeper = attempt(found.problems, _walk, path, root, found, depth + 1)
            others += deeper or []
        elif not path.is_dir():
            others.append(path.suffix or path.name)
    return others


def _by_place(root: Path, found: Sources) -> list[FileSource]:
    """Say what folder or name a label is taken from by default, or why that may mean two things."""
    depths = {len(Path(source.name).parts) - 1 for source in found.files}
    if depths == {0}:
        found.layout = "label_*"
        return _flat(found)
    if len(depths) > 1:
        first = {
            depth: next(s.name for s in found.files if len(Path(s.name).parts) - 1 == depth)
            for depth in sorted(depths)
        }
        both = " and ".join(f"{name!r}" for name in list(first.values())[:2])
        places = ("folder", "parent", "file") if min(depths) else ("folder", "file")
        way_out = f"or say where the label stands: {' or '.join(in_both(label=place) for place in places)}"
        problem = (
            f"recordings lie at several levels of folders ({both}); wanted one layout: {LAYOUTS}; {way_out}"
        )
        raise RecordingFileError(root, problem)
    doubt = _two_levels(found.files[0]) if depths != {1} else _no_materials(found)
    return [
        replace(
            source,
            label_else=None if doubt else source.path.parent.name,
            label_place="folder",
            two_meanings=doubt,
        )
        for source in found.files
    ]


def _flat(found: Sources) -> list[FileSource]:
    labels = [_label_of(source.path) for source in found.files]
    unnamed = [source.name for source, label in zip(found.files, labels, strict=True) if label is None]
    if unnamed:
        found.notes.append(
            f"{counted(len(unnamed), 'file')} whose name gives no label ({unnamed[0]!r}): wanted {LAYOUTS}"
        )
    return [
        replace(source, label_else=label, label_place="name of the file")
        for source, label in zip(found.files, labels, strict=True)
    ]


def _two_levels(first: FileSource) -> str:
    *above, outer, inner, _ = Path(first.name).parts
    top = (
        f"; that {above[0]!r} is the material only an index.csv says"
        if above
        else "; an index.csv says it, too"
    )
    return (
        f"files lie in folders within folders ({first.name!r}), which may mean two things: {inner!r} is the material "
        f"and {outer!r} the session: pass {in_both(label='folder', session='parent')}; or {outer!r} is the material "
        f"and {inner!r} the session: pass {in_both(label='parent', session='folder')}{top}"
    )


def _no_materials(found: Sources) -> str | None:
    """Say why folders are most likely no materials: days, persons, runs, or the same numbered names in each.

    The same names without numbers may be either: the folders are taken, and a note has the other reading.
    """
    files = found.files
    stems: dict[str, dict[str, None]] = {}
    for source in files:
        stems.setdefault(source.path.parent.name, {})[_label_of(source.path) or ""] = None
    names = list(stems)
    session_like = all(SESSION_LIKE.fullmatch(name) for name in names)
    alike = len(names) > 1 and all(
        len(one) > 1 and any(one.keys() & other.keys() for name, other in stems.items() if name != own)
        for own, one in stems.items()
    )
    numbered = all(_NUMBER.search(source.path.stem) for source in files)
    series = len({_NUMBER.sub("", name).lower() for name in names}) == 1
    if alike and not (numbered or series or session_like):
        two = " and ".join(map(repr, list(stems[names[0]])[:2]))
        way_out = f"if those are the materials, pass {in_both(label='file', session='folder')}"
        found.notes.append(f"folders hold files of the same names ({two}): {way_out}")
    if not session_like and not (alike and (numbered or series)):
        return None
    example = files[0].name
    label = _label_of(files[0].path) or files[0].path.stem
    return (
        f"folders may be no materials ({example!r}): {names[0]!r} is the session and {label!r} the material: pass "
        f"{in_both(label='file', session='folder')}; or {names[0]!r} is the material: pass {in_both(label='folder')}; "
        "an index.csv says it, too"
    )


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _EXAMPLES} more" if len(names) > _EXAMPLES else ""
    return ", ".join(names[:_EXAMPLES]) + more


def beside_note(paths: Sequence[str | os.PathLike[str]]) -> str:
    """Say which files beside recordings hold no axes of a wrench."""
    return f"not read, as they hold none of the axes: {_listed([os.fspath(path) for path in paths])}"

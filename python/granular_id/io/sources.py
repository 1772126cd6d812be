"""``find_sources``: the files that a path holds, and what their folders and names say of label and session.

1. ``index.csv`` lists the files; files it does not list are not read.
2. Files in folders, ``rice/1.csv``: the folder is the label, without its number where each holds one: ``rice_1/ft``.
3. Files in one folder, ``fine_sugar_2.csv``: the label is the name without numbers, dates and counted runs at its ends.

Two levels of folders may mean material and session in either order, and are refused unless the files state their label,
or an option says where it stands: ``folder`` (that of the file), ``parent`` (the folder above), ``file`` (its name).
One folder around all that is called ``data``, ``raw`` ... is none of them.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from granular_id._text import counted, in_both, verb
from granular_id.io.csv_head import encoding_of
from granular_id.io.files import RecordingFileError, attempt
from granular_id.io.formats import FORMATS, FileFormat
from granular_id.io.index import (
    HISTORY_NAME,
    INDEX_COLUMNS,
    INDEX_NAME,
    column_of_files,
    read_history,
    read_index,
)
from granular_id.io.source import NO_MATERIAL, SESSION_LIKE, FileSource, LoadOptions
from granular_id.io.ways_out import dated_line, in_python, index_line, unknown_files_line
from granular_id.recording import StepReport

LAYOUTS = "label/*.csv, label_1.csv, or an index.csv with the columns file and label"

OTHER_FILES = (
    "a text table is read under a name that ends with .csv or .txt; what numpy or pandas can open, by "
    "Dataset.from_arrays(X, y, rate_hz=...), X of shape (recordings, samples, axes), or by "
    "Dataset.from_frames(frames, labels)"
)
"""What to do about files of no known format."""

_NO_RECORDING = re.compile(
    r"(mean|average|avg|std|median|summary|readme|license|metadata)([\W_].*|$)|(labels|materials|overview|protokoll|protocol|notes)\.\w+"
    r"|(.*[\W_])?(mean|average|avg|median|mittelwerte?)[\W_]*\d*\.\w+",
    re.IGNORECASE,
)
"""Names of what lies beside recordings."""

_WORD = rf"(?:{'|'.join(sorted(NO_MATERIAL, key=len, reverse=True))})"
_DATE = (
    r"(?<!\d)(?:(?:\d{4}[-_.]?\d\d[-_.]?\d\d|\d\d[-_.]\d\d[-_.]\d{4})(?:[T_ -]*\d\d[-_:.]?\d\d(?:[-_:.]?\d\d)?)?"
    r"|\d\d[-:]\d\d[-:]\d\d|\d{6})(?!\d)"
)
_MONTH = (
    "(?:jan(?:uary)?|feb(?:ruary)?|mar(?:ch)?|apr(?:il)?|may|june?|july?|aug(?:ust)?|sept?(?:ember)?|oct(?:ober)?|"
    "nov(?:ember)?|dec(?:ember)?)"
)
_NUMBER = re.compile(rf"(?:[\s_.-]+{_WORD})?[\s_.-]*\(?\d+\)?$", re.IGNORECASE)
"""A number at the end of a name, with the word that it counts: ``_run3``."""

_COPY = re.compile(r"(.+?)(?: - (?:copy|kopie|copie|copia|kopio)| copy)?(?: ?\(\d+\))?", re.IGNORECASE)
"""What file managers and browsers call a copy: ``rice_1 (1)``, ``rice_1 - Copy``."""

_AT_DATE = re.compile(rf"[\s_.-]*\(?{_DATE}\)?$")
_BEFORE_NUMBER = re.compile(rf"[\s_.-]+{_WORD}[\s_.-]*\d*$", re.IGNORECASE)
_COUNT = re.compile(r"(.*[^\W_].*?)[\s_.-]+([^\W\d_]*)(\d+)")
"""A name that ends in a number, perhaps behind a word of any language: ``rice_Tag1``, ``rice_01``."""

_SIZE = r"(?:mm|cm|um|\N{MICRO SIGN}m|mesh|kg|g|ml|pct|percent)(?:[\W_]|$)"
_AHEAD = re.compile(rf"\A(?:(?:{_WORD}[\s_.-]*\d+|{_DATE}|\d+)[\s_.-]+)+(?!{_SIZE})(?=\D)", re.IGNORECASE)
"""The same ahead of a name: ``run3-``, ``2025-03-04_``, but not ``4_mm_``."""

_FRONT = re.compile(r"([^\W\d_]\d+)[\s_.-]+([^\W\d_].*)")
"""A name behind a letter with a number, as of a person: ``P1_rice``."""

_PUSH = re.compile(rf"(?:(?!day|session){_WORD})?[\W_]*\d{{1,4}}", re.IGNORECASE)
"""A name that counts recordings: ``push_1``, ``07``."""

_CONTAINER = re.compile(
    r"raw|csv|((raw|all|ft|force|sensor|robot|recorded)[\s_-]?)?data(set)?s?|recordings?|measurements?|logs?|files?|exports?",
    re.IGNORECASE,
)
"""What a folder around all others is called, and says neither material nor session."""

_DIGITS = re.compile(r"([0-9]+)")

_ORDERED = re.compile(
    rf"{SESSION_LIKE.pattern}|{_WORD}[\W_]*\w{{0,3}}|[a-z]?\d+|(?:{_DATE})|(?:{_MONTH}[\W_]*\d|\d+[\W_]*{_MONTH}).*",
    re.IGNORECASE,
)
"""Names of folders that count or name days, persons or runs: of two levels the other one is the material first."""

_NO_LABEL = frozenset(
    ("", "empty", "full", "missing", "left", "right", "slow", "fast", "before", "after", "raw")
)
"""Names of files in folders that are no materials: then the folders are."""

_SHORT_WORD = 2
"""Letters of a word that is no material: ``_s1``, ``_V1``."""

_Option = tuple[str, dict[str, str]]
_MOST_DEEP, _MOST_NOTES = 12, 3
_EXAMPLES = 3


@dataclass
class Sources:
    """The files of a path and what is known of them; `others` are the endings of those of no known format."""

    layout: str
    files: list[FileSource] = field(default_factory=list)
    problems: list[RecordingFileError] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    others: list[str] = field(default_factory=list)
    history: Sequence[StepReport] = ()


def format_of(path: Path) -> FileFormat | None:
    """Return the format that a path looks like, if any does: a file by its ending, a folder by what lies in it."""
    # os.path.isdir says False of what cannot be a path at all, where Path.is_dir raises
    if not os.path.isdir(path):  # noqa: PTH112
        name = path.name.lower()
        return next((known for known in FORMATS if name.endswith(known.suffixes)), None)
    try:
        names = os.listdir(path)  # noqa: PTH208 (a third of the time)
    except OSError:
        return None
    return next((one for one in FORMATS if one.sign and any(map(one.sign.fullmatch, names))), None)


def find_sources(path: Path, options: LoadOptions) -> Sources:
    """Find what a file or folder holds, before any of it is read."""
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder")
    known, stated = format_of(path), options.stated
    if known is not None:
        source = FileSource(path=path, root=path.resolve().parent, name=path.name, **stated)
        is_stated = options.label is not None or options.session is not None
        source = placed(source, options, path.resolve(), alone=True) if is_stated else source
        return Sources(known.what, [source], notes=_index_beside(path))
    if not path.is_dir():
        wanted = "; ".join(known.what for known in FORMATS)
        problem = f"is of no known format; what can be read: {wanted}; or a folder of such files ({LAYOUTS})"
        line = unknown_files_line(path, [path.suffix])
        raise RecordingFileError(path, (f"{problem}; {OTHER_FILES}", *line))
    found = Sources("label/*")
    _walk(path, found, stated)
    if (path / INDEX_NAME).is_file():
        return _indexed(path, options, found)
    beside = [source.name for source in found.files if _NO_RECORDING.match(source.path.name)]
    if 0 < len(beside) < len(found.files):
        found.files = [source for source in found.files if source.name not in beside]
        found.notes.append(f"not read, as their names are not those of recordings: {listed(beside)}")
        if options.label is None:
            _refuse_index_unread(path, beside, [source.name for source in found.files])
    _leave_out_notes(found)
    paths = [source.path for source in found.files]
    found.notes += _doubles(paths)
    labels = labels_of(paths)
    found.files = [replace(one, name_label=label) for one, label in zip(found.files, labels, strict=True)]
    _name_by_folders(found)
    kinds = ", ".join(ending for ending, _ in Counter(found.others).most_common(3))
    if not found.files and not found.problems:
        problem = f"holds no recordings; wanted {LAYOUTS} (or files of another format)"
        line = unknown_files_line(path, found.others)
        of_others = [f"; it holds files of no known format ({kinds}); {OTHER_FILES}", *line] if kinds else []
        raise RecordingFileError(path, [problem, *of_others])
    if n := len(found.others):
        unknown = f"{counted(n, 'file')} of no known format {verb(n, 'is', 'are')} not read ({kinds})"
        found.notes.append(unknown)
    if options.label is None:
        _label_by_place(path, found)
    if options.label is not None or options.session is not None:
        root = path.resolve()
        found.files = [placed(one, options, root / one.path.relative_to(path)) for one in found.files]
    return found


def _leave_out_notes(found: Sources) -> None:
    """Leave out texts that lie above the folders of all recordings of another ending: notes on them."""
    depths = Counter(source.name.count("/") for source in found.files)
    deep = max(depths, default=0)
    endings = {source.path.suffix for source in found.files if source.name.count("/") == deep}
    if ".txt" in endings:
        return
    above = [one for one in found.files if one.name.count("/") < deep and one.path.suffix == ".txt"]
    if 0 < len(above) <= _MOST_NOTES and len(depths) > 1:
        found.files = [source for source in found.files if source not in above]
        found.notes.append(
            f"not read, as they lie above the recordings: {listed([one.name for one in above])}"
        )


def _refuse_index_unread(root: Path, beside: Sequence[str], names: Sequence[str]) -> None:
    """Refuse a folder in which a table lists files, and is not called index.csv."""
    for name in beside:
        if (column := column_of_files(root / name, names)) is not None:
            renamed = f".rename(columns={{{column[0]!r}: 'file'}})" * (column[0] != "file")
            how = f"dtype=str, sep=None, engine='python', encoding={encoding_of(root / name)!r}"
            read = f"table = pandas.read_csv({str(root / name)!r}, {how}){renamed}"
            ends = [f"table['file'] += {column[1]!r}"] * bool(column[1])
            write = f"table.to_csv({str(root / INDEX_NAME)!r}, index=False)"
            line = in_python(read, *ends, write, f"load({str(root)!r})")
            raise RecordingFileError(
                root / name, (f"lists files; wanted in a file called {INDEX_NAME}", line)
            )


def _index_beside(path: Path) -> list[str]:
    """Say that one file of a folder with an index is read without it."""
    places = [folder / INDEX_NAME for folder in path.absolute().parents[:2] if path.name != INDEX_NAME]
    return [
        f"{file.parent.name}/{file.name} is not read with a single file: name the folder for label, session and meta"
        for file in places
        if file.is_file()
    ]


def _walk(root: Path, found: Sources, stated: dict[str, Any]) -> None:
    """Gather what can be read below a folder, in natural order: ``rice_2`` before ``rice_10``, files before folders."""

    def unlisted(error: OSError) -> None:
        problem = f"cannot be listed: {error.strerror}"
        found.problems.append(RecordingFileError(error.filename, problem))

    inside = root.resolve()
    paths: list[tuple[Any, Path]] = []
    for place, folders, names in os.walk(root, onerror=unlisted, followlinks=True):
        folder = Path(place)
        parts = folder.relative_to(root).parts
        shown = [name for name in [*names, *folders] if not name.startswith(".")]
        deeper = {name for name in folders if not name.startswith(".") and len(parts) < _MOST_DEEP}
        for name in shown:
            path, is_file = folder / name, name not in folders
            if not is_file and not path.resolve().is_relative_to(inside):
                problem = "is a link that leaves the folder; links out are not followed"
                found.problems.append(RecordingFileError(path, problem))
                deeper.discard(name)
            elif format_of(path) is not None:
                levels = [*((True, part) for part in parts), (not is_file, name)]
                split = [(below, enumerate(_DIGITS.split(part)), part) for below, part in levels]
                order = [
                    (below, [int(p) if i % 2 else p for i, p in each], part) for below, each, part in split
                ]
                paths.append((order, path))
                deeper.discard(name)
            elif is_file:
                found.others.append(path.suffix or name)
        folders[:] = [name for name in folders if name in deeper]
    paths.sort(key=lambda one: one[0])
    n_alike = Counter(path.suffix for _, path in paths)
    found.files = [
        FileSource(
            path=path,
            root=root,
            name=path.relative_to(root).as_posix(),
            n_alike=n_alike[path.suffix],
            **stated,
        )
        for _, path in paths
    ]


def placed(source: FileSource, options: LoadOptions, path: Path, *, alone: bool = False) -> FileSource:
    """Put in what the options say by the place of a file."""
    known: dict[str, Any] = {}
    for what in ("label", "session"):
        rule = getattr(options, what)
        if rule is None:
            continue
        known[f"{what}_place"] = rule
        if rule == "file":  # a session is one file, whatever number it has
            inside = source.path.is_relative_to(source.root)
            place = source.path.relative_to(source.root).as_posix() if inside else source.path.name
            of_name = source.name_label or label_of(path) or path.stem
            known[what] = of_name if what == "label" else place
        elif rule in ("folder", "parent"):
            folder = path.parent if rule == "folder" else path.parent.parent
            if not alone and source.root.resolve() not in (folder, *folder.parents):
                problem = f"{what}='parent', but there is no folder above its own in {source.root}"
                raise RecordingFileError(source.path, problem)
            known[what] = folder.name
            if what == "session" and not alone:  # a day of the same name may be another's
                label_rule, root = options.label or "folder", source.root.resolve()
                of_label = {"folder": path.parent, "parent": path.parent.parent}.get(label_rule)
                above = [one for one in (folder, *folder.parents) if root in one.parents and one != of_label]
                known[what] = "/".join(one.name for one in reversed(above)) or folder.name
    return replace(source, **known)


def label_of(path: Path) -> str | None:
    """Return the name of a file without what numbers it at its ends; None where nothing of a material is left."""
    return labels_of([path])[0]


def labels_of(paths: Sequence[Path]) -> list[str | None]:
    """Return what `label_of` each of some files is, where names together show more: which words count runs."""
    stems = [_stem(path) for path in paths]
    known = set(stems)
    stems = [one if (one := _original(stem)) in known else stem for stem in stems]
    names, before, is_first = stems, list[str](), True
    while is_first or names != before:
        before = names
        names = [_without_dates(name, stem) for name, stem in zip(names, stems, strict=True)]
        shorter = _without_common_count(names, is_first=is_first)
        names = [_NUMBER.sub("", name) for name in names] if is_first and shorter == names else shorter
        is_first = False
    return [_without_front(name) for name in _without_letters(names)]


def _original(stem: str) -> str:
    """Return what a copy is one of."""
    found = _COPY.fullmatch(stem)
    return stem if found is None else found[1]


def _doubles(paths: Sequence[Path]) -> list[str]:
    """Note files of a folder that are called like others: copies of these, or the same in another format."""
    stems = {(path.parent, _stem(path)) for path in paths}
    first: dict[tuple[Path, str], Path] = {}
    found = []
    for path in sorted(paths, key=lambda path: len(path.name)):
        original = (path.parent, _original(_stem(path)))
        key = original if original in stems else (path.parent, _stem(path))
        found += [(path.name, first[key].name)] if key in first else []
        first.setdefault(key, path)
    n = counted(len(found), "file")
    return (
        [f"{n} may be a recording that is there already ({' as '.join(map(repr, found[0]))})"]
        if found
        else []
    )


def _without_letters(names: Sequence[str]) -> list[str]:
    """Leave out a letter with a number ahead of all names, one of which at least has two materials: ``P1_rice``."""
    found = [_FRONT.fullmatch(name) for name in names]
    if None in found:
        return list(names)
    both = {one.groups() for one in found if one is not None}
    several = len(both) > len({front for front, _ in both})
    return [one[2] for one in found if one is not None] if several else list(names)


def _stem(path: Path) -> str:
    endings = (suffix for known in FORMATS for suffix in known.suffixes if path.name.lower().endswith(suffix))
    return path.name.removesuffix(path.name[-len(ending) :]) if (ending := next(endings, "")) else path.name


def _without_dates(name: str, stem: str) -> str:
    """Leave out dates at the end, and words that count what stood behind them: ``_run2``, or ``_run``."""
    before = ""
    while before != name:
        before, name = name, _AT_DATE.sub("", name)
        name = name if name == stem else _BEFORE_NUMBER.sub("", name)
    return name


def _without_common_count(names: Sequence[str], *, is_first: bool) -> list[str]:
    """Leave out the number at the end with its word where it counts: 1, 2, 3 ... of two materials or more.

    All names with a number end so. What no other number followed may be a part of the material, as in ``white_rice1``
    and ``brown_rice1``: then longer words stay unless three materials have them.
    """
    found = [_COUNT.fullmatch(name) for name in names]
    counts = [(one[1], one[2].casefold(), int(one[3])) for one in found if one is not None]
    materials, words = {material for material, _, _ in counts}, {word for _, word, _ in counts}
    numbers = {number for _, _, number in counts}
    ends_so = all(
        one is not None or not name[-1:].isdecimal() for one, name in zip(found, names, strict=True)
    )
    if not ends_so or len(words) != 1:
        return list(names)
    word = next(iter(words))
    fewest = 3 if is_first and len(word) > _SHORT_WORD else 2
    in_a_row = min(numbers) <= 1 and len(numbers) == max(numbers) - min(numbers) + 1
    if len(materials) < fewest or not in_a_row or (is_first and not word):
        return list(names)
    return [name if one is None else one[1] for one, name in zip(found, names, strict=True)]


def _without_front(name: str) -> str | None:
    label = _AHEAD.sub("", name).strip(" _.-")
    return None if not _NUMBER.sub("", label) or label.lower() in NO_MATERIAL else label


def _indexed(root: Path, options: LoadOptions, walked: Sources) -> Sources:
    found = Sources("index.csv")
    columns, files = read_index(root, found.problems, found.notes, options.stated)
    for source in files:
        if format_of(source.path) is None:
            problem = f"{source.path.relative_to(root).as_posix()!r} is of no known format"
            found.problems.append(RecordingFileError(root / INDEX_NAME, problem, column="file"))
        else:
            known = attempt(found.problems, placed, source, options, source.path.resolve())
            found.files += [] if known is None else [known]
    if "label" not in columns:
        found.notes.append(f"index.csv has no column label (found: {', '.join(columns)})")
    others = [column for column in columns if column not in INDEX_COLUMNS]
    if others:
        found.notes.append(f"columns of index.csv read into meta: {', '.join(others)}")
    listed_paths = {source.path for source in files}
    unlisted = [one.name for one in walked.files if one.path not in listed_paths and one.name != INDEX_NAME]
    if n := len(unlisted):
        beside = f"{counted(n)} beside index.csv ({unlisted[0]}{' ...' * (n > 1)}) {verb(n, 'is', 'are')}"
        found.notes.append(f"{beside} not listed in it and {verb(n, 'was', 'were')} not read")
    if (root / HISTORY_NAME).is_file():
        found.history = read_history(root / HISTORY_NAME)
    return found


def _label_by_place(root: Path, found: Sources) -> None:
    """Say what folder or name a label is taken from by default, or why that may mean two things."""
    depths = {source.name.count("/") for source in found.files}
    place = found.files[0].label_place if found.files else ""
    outer = {Path(source.name).parts[0] for source in found.files}
    is_within = depths == {2} and len(outer) == 1 and all(map(_CONTAINER.fullmatch, outer))  # data/rice/1.csv
    if depths == {0} or (place and (depths == {1} or is_within)):
        found.layout = "label_1/*" if place else "label_*"
        n_labels = len({source.name_label for source in found.files})
        for i, source in enumerate(found.files):
            found.files[i] = replace(
                source,
                label_else=source.name_label,
                label_place=place or "name of the file",
                n_labels=n_labels,
            )
        dated = next(
            (one for one in found.files if re.search(rf"[^\W\d].*{_DATE}", one.name_label or "")), None
        )
        if dated is not None and not place:
            problem = f"a date stands within names ({dated.path.name!r}): the label may stand behind it"
            lines = dated_line(root, dated.path.suffix)
            insist = f"; to take the date as a part of it pass {in_both(label='file')}"
            raise RecordingFileError(root, [problem, insist, lines])
        unnamed = [source.name for source in found.files if source.label_else is None]
        if unnamed:
            problem = f"whose name gives no label ({unnamed[0]!r}): wanted {LAYOUTS}"
            found.notes.append(f"{counted(len(unnamed), 'file')} {problem}")
        return
    bare = next((one for one in found.files if one.path.suffix == ".db3" and one.path.is_file()), None)
    if len(depths) > 1 and bare is not None:
        folder = bare.path.parent
        problem = (
            f"lies without a metadata.yaml beside it: `ros2 bag reindex {folder}` writes one, or move it away"
        )
        raise RecordingFileError(bare.path, problem)
    if len(depths) > 1:
        firsts = [
            next(one for one in found.files if one.name.count("/") == depth) for depth in sorted(depths)
        ]
        both = " and ".join(repr(one.name) for one in firsts[:2])
        problem = f"recordings lie at several levels of folders ({both}); wanted one layout: {LAYOUTS}"
        of_names = ["; if the names of files hold the label pass ", in_both(label="file")]
        of_first = ["; where the first folder is the material", index_line(root, firsts[0].path.suffix)]
        names = {source.name_label for source in found.files}
        is_named = None not in names and len(names) > 1
        ways = of_names * is_named + of_first * bool(min(depths))
        raise RecordingFileError(root, [problem, *ways])
    doubt = None
    if depths == {1} or is_within:
        doubt = _no_materials(found)
    elif found.files:
        doubt = _two_levels(found.files)
    n_labels = len({source.path.parent for source in found.files})
    for i, source in enumerate(found.files):
        label = None if doubt else source.path.parent.name
        found.files[i] = replace(
            source, label_else=label, label_place=place or "folder", two_meanings=doubt, n_labels=n_labels
        )


def _name_by_folders(found: Sources) -> None:
    """Name files by their folders, without numbers, where each folder holds one file of the same name: a push."""
    folders = [source.path.parent for source in found.files]
    names: dict[Path, set[str]] = {}
    for source in found.files:
        names.setdefault(source.path.parent, set()).add(source.path.name)
    are_alike = len(set(map(frozenset, names.values()))) == 1  # ft.csv and joints.csv in each
    if not are_alike or {source.name.count("/") for source in found.files} not in ({1}, {2}):
        return
    labels = labels_of(folders)
    counts = [int((re.findall(r"\d+", folder.name) or ["0"])[-1]) for folder in folders]
    least: dict[str | None, int] = {}
    for label, count in zip(labels, counts, strict=True):
        least[label] = min(count, least.get(label, count))
    of_all = sorted(dict(zip(folders, counts, strict=True)).values())
    is_one_count = of_all in ([*range(len(of_all))], [*range(1, len(of_all) + 1)])  # run_3_rice
    no_materials = all(label is None or SESSION_LIKE.fullmatch(label) for label in labels)
    is_bare = all(label == folder.name for label, folder in zip(labels, folders, strict=True))
    if (
        None in labels
        or no_materials
        or is_bare
        or not 1 < len(least) < len(of_all)
        or (max(least.values()) > 1 and not is_one_count)
    ):
        return  # sand_40, sand_80 are materials
    for i, (source, label) in enumerate(zip(found.files, labels, strict=True)):
        found.files[i] = replace(source, name_label=label, label_place="name of the folder")


def _two_levels(files: Sequence[FileSource]) -> tuple[str, ...]:
    """Say that either of two levels may be the material, first the one whose folders are no days, persons or runs."""
    first = files[0]
    *above, outer, inner, _ = Path(first.name).parts
    top = ["; an index.csv says it, too"]
    if above:
        top = [f"; where {above[0]!r} is the material", index_line(first.root, first.path.suffix)]
    folders = [source.path.parent for source in files]
    is_one_each = len(set(folders)) == len(folders)
    levels = [{one.name for one in folders}, {one.parent.name for one in folders}]
    is_counted = [
        all(map(_ORDERED.fullmatch, names))
        or len({_NUMBER.sub("", name) for name in names}) == 1 < len(names)
        for names in levels
    ]
    in_folder: _Option = (
        f"{inner!r} is the material and {outer!r} the session",
        {"label": "folder", "session": "parent"},
    )
    above_it: _Option = (
        f"{outer!r} is the material and {inner!r} the session",
        {"label": "parent", "session": "folder"},
    )
    readings = [in_folder, above_it]
    are_pushes = all(
        _PUSH.fullmatch(one.name) or _NUMBER.sub("", one.name) == one.parent.name for one in folders
    )
    if is_one_each and are_pushes and not is_counted[1]:  # rice/push_1/ft.csv, rice/rice_1/ft.csv
        pushes = f"{outer!r} is the material and {inner!r} a recording"
        readings = [(pushes, {"label": "parent"}), above_it, in_folder]
    elif first.label_place == "name of the folder":  # day1/rice_1/ft.csv
        readings[0] = (
            f"{first.name_label!r} is the material and {outer!r} the session",
            {"label": "file", "session": "parent"},
        )
    elif is_counted == [True, False] or all(one.name.lower() in _NO_LABEL for one in folders):
        readings.reverse()
    labels = {(source.name_label or "").lower() for source in files}
    others = _NO_LABEL | {name.lower() for source in files for name in Path(source.name).parts[:-1]}
    if (
        first.label_place == "" and 1 < len(labels) < len(files) and not labels & others
    ):  # anna/03-11/rice_1.csv
        of_names = (
            f"{first.name_label!r} is the material and {inner!r} the session",
            {"label": "file", "session": "folder"},
        )
        readings.insert(0, of_names)
    parts: list[str] = []
    for reading, options in readings:
        parts += ["; or " * bool(parts) + f"{reading}: pass ", in_both(**options)]
    problem = f"files lie in folders within folders ({first.name!r}), which may mean two things: "
    return (problem, *parts, *top)


def _no_materials(found: Sources) -> tuple[str, ...] | None:
    """Say why folders may be no materials: days, persons, runs, or files of the same names, or of several words."""
    files = found.files
    stems: dict[str, dict[str, None]] = {}
    for source in files:
        stems.setdefault(source.path.parent.name, {})[(source.name_label or "").lower()] = None
    names = list(stems)
    n_folders = Counter(stem for one in stems.values() for stem in one)
    shared = any(n > 1 for n in n_folders.values())
    words = not any(re.search(r"\d", source.path.stem) for source in files) and not any(
        name.lower() in stem for name, one in stems.items() for stem in one
    )
    are_counts = len({re.sub(r"\d+", "", source.path.stem) for source in files}) == 1
    several = (
        any(len(one) > 1 for one in stems.values()) and not n_folders.keys() & _NO_LABEL and not are_counts
    )
    if not (several and (shared or words)) and not all(SESSION_LIKE.fullmatch(name) for name in names):
        return None
    example, label = files[0].name, files[0].name_label
    problem = f"folders may be no materials ({example!r})"
    if not all(source.name_label for source in files):
        insist = in_both(label="folder")
        return (f"{problem}: list file and label in an index.csv, or if they are materials pass {insist}",)
    return (
        f"{problem}: {names[0]!r} is the session and {label!r} the material: pass ",
        in_both(label="file", session="folder"),
        f"; or {names[0]!r} is the material: pass ",
        in_both(label="folder"),
        "; an index.csv says it, too",
    )


def listed(names: Sequence[str]) -> str:
    """Name the first few."""
    more = f" and {len(names) - _EXAMPLES} more" if len(names) > _EXAMPLES else ""
    return ", ".join(names[:_EXAMPLES]) + more

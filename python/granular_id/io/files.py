"""Files and folders from outside and for others: the one error about them, how they are listed, checked and made."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import stat
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from itertools import dropwhile
from os import PathLike, fspath
from pathlib import Path
from types import ModuleType
from typing import ParamSpec, TypeVar

from granular_id._checks import WayOutError, parts_of
from granular_id._files import cannot_write
from granular_id._text import install

_P = ParamSpec("_P")
_T = TypeVar("_T")


class RecordingFileError(WayOutError):
    """A file or folder that cannot be read as recordings: which one, where in it, and what is wrong.

    Parameters
    ----------
    path : str or path
        The file or folder.
    problem : str
        What came and what is wanted.
    line : int or None
        Line in the file, 1-based (the header is line 1).
    column : str or None
        Name of the column, or its 1-based number where there is no name.
    place : str or None
        Any other place in the file: ``"message 17"``, ``"variable X"``, ``"row group 3"``.

    no_wrench : bool, default False
        Whether the file is readable and holds none of the axes: it may be something else beside recordings.

    Attributes
    ----------
    skippable : bool
        Whether ``on_error="skip"`` would pass over the fault and read the rest.

    Examples
    --------
    >>> from granular_id import RecordingFileError
    >>> print(RecordingFileError("a.csv", "'nan' is not a plain decimal number", line=7, column="fx"))
    a.csv, line 7, column fx: 'nan' is not a plain decimal number
    """

    def __init__(
        self,
        path: str | PathLike[str],
        problem: str | Sequence[str],
        *,
        line: int | None = None,
        column: str | None = None,
        place: str | None = None,
        no_wrench: bool = False,
    ) -> None:
        # names that are not valid text reach Python as lone surrogates, which no terminal can print
        self.path = fspath(path).encode("utf-8", "backslashreplace").decode("utf-8")
        self.line = line
        self.column = column
        self.place = place
        self.skippable = False
        self.no_wrench = no_wrench
        where = [
            *([f"line {line}"] if line is not None else []),
            *([f"column {column}"] if column is not None else []),
            *([place] if place is not None else []),
        ]
        super().__init__(*parts_of(problem))
        self.args = (printable(f"{', '.join([self.path, *where])}: {self.problem}"),)

    def __reduce__(self) -> tuple[object, ...]:
        where = {name: getattr(self, name) for name in ("line", "column", "place", "no_wrench")}
        return (
            partial(RecordingFileError, **where),
            (self.path, self.parts),
            {"skippable": self.skippable},
        )


def printable(text: str) -> str:
    """Escape what is no text on one line: names from files may hold line ends, and codes that steer terminals."""
    return text if text.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def failed(path: str | PathLike[str], what: str, error: Exception) -> RecordingFileError:
    """Return the one exception for whatever a library raised about a file, with what was done."""
    if isinstance(error, RecordingFileError):
        return error
    lines = str(error).strip().splitlines() or [""]
    reason = ": ".join(text for text in (type(error).__name__, lines[0][:200]) if text)
    return RecordingFileError(path, f"{what} failed with {reason}")


@contextmanager
def naming(path: str | PathLike[str], what: str) -> Iterator[None]:
    """Turn whatever a library raises about a file into the one exception, but for a missing library."""
    try:
        yield
    except (RecordingFileError, ImportError):
        raise
    except Exception as error:
        raise failed(path, what, error) from error


def attempt(
    problems: list[RecordingFileError], function: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs
) -> _T | None:
    """Call a function; when it raises RecordingFileError, put that into `problems` and return None."""
    try:
        return function(*args, **kwargs)
    except RecordingFileError as error:
        problems.append(error)
        return None


def need(module: str, *, extra: str, why: str) -> ModuleType:
    """Import a library, or say how to install it."""
    try:
        return import_module(module)
    except ImportError as error:
        library = module.partition(".")[0]
        raise ImportError(f"{library} is needed {why}: {install(extra)}") from error


def check_place(path: Path, root: Path) -> None:
    """Refuse what lies outside `root`, is no regular file (a pipe is not opened), or cannot be opened.

    A folder that is one recording is looked through, before any file in it is opened.
    """
    places = [(path, root)]
    if os.path.isdir(path):  # noqa: PTH112 (says False of a name that is too long, where Path.is_dir raises)
        walked = ((Path(folder), [*names, *folders]) for folder, folders, names in os.walk(path))
        places += [(folder / name, path) for folder, names in walked for name in names]
    for one, around in places:
        if not Path(os.path.realpath(one)).is_relative_to(os.path.realpath(around)):
            raise RecordingFileError(one, "is a link that leaves the folder; links out are not followed")
        try:
            mode = one.stat().st_mode
            if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
                raise RecordingFileError(one, "is not a regular file")
            if stat.S_ISREG(mode):
                one.open("rb").close()
        except OSError as error:
            raise RecordingFileError(one, f"cannot be read: {error.strerror or error}") from error


_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
_EDGES = "._-"
_LONGEST, _LONGEST_BYTES = 60, 100
"""A file system takes 255 bytes, some 143, and there is more to a name than its label."""


def check_room(target: Path) -> None:
    """Refuse a place where nothing new can be written."""
    if os.path.lexists(target):
        if target.is_symlink() or not target.is_dir():
            raise FileExistsError(f"{target}: there is something already; nothing is overwritten")
        if any(target.iterdir()):
            raise FileExistsError(f"{target}: the folder is not empty; nothing is overwritten")
    if not target.absolute().parent.is_dir():
        raise FileNotFoundError(f"{target.parent}: no such folder")


@contextmanager
def new_folder(folder: str | os.PathLike[str]) -> Iterator[Path]:
    """Fill a folder under a temporary name beside its place, and rename it when the block ends well."""
    target = Path(folder)
    check_room(target)
    partial = target.absolute().parent / f".{target.name}.{secrets.token_hex(4)}.partial"
    try:
        partial.mkdir()
        yield partial
        if target.exists():
            target.rmdir()  # empty, as checked; some systems do not rename over a folder
        partial.rename(target)
    except OSError as error:
        shutil.rmtree(partial, ignore_errors=True)
        raise cannot_write(target, error) from error
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


def safe_name(label: str | None) -> str:
    """Make a file name of a label that no system takes for anything else; it need not be unique.

    Letters, digits and accents of every script stay, in the one form (NFC) in which systems agree on them.
    """
    if label is None:
        return "unlabelled"
    safe = "".join(c if _is_safe(c) else " " for c in unicodedata.normalize("NFC", label))
    name = re.sub(" +", "_", safe)[:_LONGEST].encode()[:_LONGEST_BYTES].decode(errors="ignore")
    name = "".join(dropwhile(lambda c: c in _EDGES or unicodedata.category(c)[0] == "M", name))
    name = name.rstrip(_EDGES) or "label"
    return f"label_{name}" if _RESERVED.fullmatch(name) else name


def _is_safe(character: str) -> bool:
    return character in _EDGES or unicodedata.category(character)[0] in "LMN"

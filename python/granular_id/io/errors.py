"""The one exception that reading and writing recordings raises about a file; libraries that are not there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from os import PathLike, fspath
from types import ModuleType
from typing import ParamSpec, TypeVar

from granular_id._text import install

_P = ParamSpec("_P")
_T = TypeVar("_T")


class RecordingFileError(ValueError):
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

    Attributes
    ----------
    skippable : bool
        Whether ``on_error="skip"`` would pass over the fault and read the rest.
    no_wrench : bool
        Whether the file is readable and holds none of the axes: it may be something else beside recordings.

    Examples
    --------
    >>> from granular_id import RecordingFileError
    >>> print(RecordingFileError("a.csv", "'nan' is not a plain decimal number", line=7, column="fx"))
    a.csv, line 7, column fx: 'nan' is not a plain decimal number
    """

    def __init__(
        self,
        path: str | PathLike[str],
        problem: str,
        *,
        line: int | None = None,
        column: str | None = None,
        place: str | None = None,
    ) -> None:
        # names that are not valid text reach Python as lone surrogates, which no terminal can print
        self.path = fspath(path).encode("utf-8", "backslashreplace").decode("utf-8")
        self.problem = problem
        self.line = line
        self.column = column
        self.place = place
        self.skippable = False
        self.no_wrench = False
        where = [
            *([f"line {line}"] if line is not None else []),
            *([f"column {column}"] if column is not None else []),
            *([place] if place is not None else []),
        ]
        super().__init__(printable(f"{', '.join([self.path, *where])}: {problem}"))

    def __reduce__(self) -> tuple[object, ...]:
        fields = (self.path, self.problem, self.line, self.column, self.place)
        return (_rebuild, fields, {"skippable": self.skippable, "no_wrench": self.no_wrench})


def printable(text: str) -> str:
    """Escape what is no text on one line: names from files may hold line ends, and codes that steer terminals."""
    return text if text.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def _rebuild(
    path: str, problem: str, line: int | None, column: str | None, place: str | None
) -> RecordingFileError:
    return RecordingFileError(path, problem, line=line, column=column, place=place)


@contextmanager
def naming(path: str | PathLike[str], what: str) -> Iterator[None]:
    """Turn whatever a library raises about a file into the one exception, with the file and what was done.

    A missing library stays an ImportError, which says what to install.
    """
    try:
        yield
    except (RecordingFileError, ImportError):
        raise
    except Exception as error:
        lines = str(error).strip().splitlines() or [""]
        said = ": ".join(text for text in (type(error).__name__, lines[0][:200]) if text)
        raise RecordingFileError(path, f"{what} failed with {said}") from error


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

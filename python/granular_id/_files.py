"""Files that are either whole or absent."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

__all__ = [
    "cannot_write",
    "check_source",
    "check_target",
    "made_folder",
    "new_file",
    "refuse_other_kind",
    "whole_file",
    "whole_lines",
    "write_json",
]


JSON, PAGES, TABLES, MODELS = (".json",), (".html", ".htm"), (".csv",), (".safetensors",)
"""Endings of the kinds of files that are written here, besides pictures and recordings."""

RECORDINGS = (
    *(".csv", ".tsv", ".csv.gz", ".tsv.gz", ".npz", ".npy", ".mat", ".h5", ".hdf5", ".parquet"),
    *(".mcap", ".bag", ".db3"),
)
"""Endings of what is read as recordings: those of `granular_id.io.formats`, which stands above this file."""

PICTURES = (".png", ".svg", ".pdf")

_KNOWN = (
    *(*JSON, *PAGES, *TABLES, *MODELS, *RECORDINGS, *PICTURES),
    *(".rrd", ".jsonl", ".ndjson", ".eps", ".jpg", ".jpeg"),
)


def refuse_other_kind(path: str | os.PathLike[str], endings: Sequence[str]) -> None:
    """Refuse a name that ends like another kind of file than what would be written.

    A file of the own kind may be replaced: that is what a caller of a library expects of a path. The command line asks.

    Parameters
    ----------
    path : path-like
        File to be written.
    endings : sequence of str
        Of the own kind, lower case, with the point. Endings that no kind has are taken too.

    Raises
    ------
    ValueError
        Naming the path and what is wanted.

    Examples
    --------
    >>> from granular_id._files import JSON, refuse_other_kind
    >>> refuse_other_kind("result.json", JSON)
    >>> refuse_other_kind("recordings.npz", JSON)
    Traceback (most recent call last):
    ...
    ValueError: path must end in .json, not like another kind of file, got 'recordings.npz'
    """
    name = Path(path).name.lower()
    if name.endswith(_KNOWN) and not name.endswith(tuple(endings)):
        wanted = " or ".join(endings)
        raise ValueError(f"path must end in {wanted}, not like another kind of file, got {os.fspath(path)!r}")


def check_source(path: str | os.PathLike[str]) -> Path:
    """Return a path to be read; FileNotFoundError where there is nothing."""
    source = Path(path)
    if not source.exists():
        raise FileNotFoundError(f"{os.fspath(path)}: no such file or folder")
    return source


def check_target(path: str | os.PathLike[str]) -> Path:
    """Refuse a path that cannot become a file, before hours of work depend on it.

    A temporary file is made beside the target and removed: some folders say that they can be written, and
    cannot.

    Parameters
    ----------
    path : path-like
        File to be written later.

    Returns
    -------
    Path

    Raises
    ------
    IsADirectoryError
        The path is a folder.
    FileExistsError
        The path is something else that is no file, such as a device.
    FileNotFoundError
        Its folder does not exist.
    OSError
        It cannot be written: not permitted, disk full, name too long ...
    """
    target = Path(path)
    _draft_of(target).unlink()
    return target


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write beside the target and rename at the end, so that no reader ever meets half a file.

    Parameters
    ----------
    path : path-like
        File to write; an existing one is replaced only when the block ends well.

    Yields
    ------
    Path
        Temporary file in the same folder, with the same ending. It is removed when the block raises, also on
        an interrupt.

    Raises
    ------
    OSError
        As `check_target`; one from within the block names the target instead of the temporary file.
    """
    target = Path(path)
    draft = _draft_of(target)
    try:
        yield draft
        draft.replace(target)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise cannot_write(target, error) from error
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


@contextmanager
def new_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write a file as `whole_file` does, where there is nothing yet.

    Raises
    ------
    FileExistsError
        There is something at `path` already, be it a link that leads nowhere.
    OSError
        As `whole_file`.
    """
    if os.path.lexists(path):
        raise FileExistsError(f"{os.fspath(path)}: there is something already; nothing is overwritten")
    with whole_file(path) as draft:
        yield draft


@contextmanager
def whole_lines(path: str | os.PathLike[str]) -> Iterator[Callable[[str], None]]:
    """Write lines as they come, each whole or not at all: what a full disk or an interrupt leaves of one is taken away.

    Parameters
    ----------
    path : path-like
        File to write; the first line replaces what is in it. A new one is removed again where no line was written.

    Yields
    ------
    callable
        Takes a line without its end.

    Raises
    ------
    OSError
        The file cannot be written, also from the callable; names it.
    """
    target = Path(path)
    is_new = not target.exists()
    try:
        file = target.open("xb" if is_new else "ab", buffering=0)
    except OSError as error:
        raise cannot_write(target, error) from error
    end = 0

    def write(line: str) -> None:
        nonlocal end
        left = (line + "\n").encode()
        try:
            if not end:
                file.truncate(0)
                file.seek(0)
            while left:
                left = left[file.write(left) :]
            end = file.tell()
        except BaseException as error:
            file.truncate(end)
            file.seek(end)
            if isinstance(error, OSError):
                raise cannot_write(target, error) from error
            raise

    try:
        yield write
    finally:
        file.close()
        if is_new and not end:
            target.unlink(missing_ok=True)


def write_json(path: str | os.PathLike[str], content: object) -> None:
    r"""Write plain values as a JSON file for people and programs: UTF-8, indented by one blank, whole or not at all.

    Parameters
    ----------
    path : path-like
        See `whole_file`.
    content : object
        Dicts, lists, texts and finite numbers.

    Raises
    ------
    ValueError
        A number is not finite: JSON has no word for it, and half of all readers would refuse the file. `path` ends
        like another kind of file.
    OSError
        As `whole_file`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from granular_id._files import write_json
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_json(file := pathlib.Path(folder, "a.json"), {"label": "Weiß"})
    ...     file.read_text(encoding="utf-8")
    '{\n "label": "Weiß"\n}\n'
    """
    refuse_other_kind(path, JSON)
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, indent=1)
    with whole_file(path) as draft:
        draft.write_text(text + "\n", encoding="utf-8")


@contextmanager
def made_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Make a folder for the files of a block; when the block raises, remove what was made and is still empty.

    Parameters
    ----------
    path : path-like
        The folder, made with its parents where they are missing.

    Yields
    ------
    Path

    Raises
    ------
    NotADirectoryError
        A file is in the way.
    OSError
        The folder cannot be made.
    """
    folder = Path(path)
    missing = [place for place in (folder, *folder.parents) if not os.path.lexists(place)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise NotADirectoryError(f"{folder} is or lies in a file, wanted a folder") from error
    except OSError as error:
        raise type(error)(f"cannot make the folder {folder}: {error.strerror}") from error
    try:
        yield folder
    except BaseException:
        for place in missing:  # the innermost first
            if any(place.iterdir()):
                break
            place.rmdir()
        raise


def _draft_of(target: Path) -> Path:
    try:
        if target.is_dir():
            raise IsADirectoryError(f"{target} is a folder, wanted the name of a file")
        if target.exists() and not target.is_file():
            raise FileExistsError(f"cannot write {target}: it is no ordinary file")
        if not target.parent.is_dir():
            raise FileNotFoundError(f"cannot write {target}: the folder {target.parent} does not exist")
        # A long name must not become too long by what is added.
        draft = target.with_name(f".{target.stem[:20]}-{secrets.token_hex(8)}{target.suffix}")
        draft.touch(exist_ok=False)
    except OSError as error:
        if error.strerror is None:  # one of the above, which says enough
            raise
        raise cannot_write(target, error) from error
    return draft


def cannot_write(target: Path, error: OSError) -> OSError:
    """Return the error about what could not be written, by the name that was asked for."""
    cause = error.__cause__ if isinstance(error.__cause__, OSError) else error  # about a file within a folder
    return type(error)(f"cannot write {target}: {cause.strerror or cause}")

"""Files that are either whole or absent."""

from __future__ import annotations

import json
import math
import os
import secrets
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from granular_id._core import GranularIdError

JSON, PAGES, TABLES, MODELS = (".json",), (".html", ".htm"), (".csv",), (".safetensors",)
"""Endings of the kinds of files that are written here, besides pictures and recordings."""

_TEXTS = (".csv", ".tsv", ".csv.gz", ".tsv.gz", ".txt.gz", ".lvm", ".dat")
_ARRAYS = (".npz", ".npy", ".mat", ".h5", ".hdf5", ".parquet")
RECORDINGS = (*_TEXTS, *_ARRAYS, ".mcap", ".bag", ".db3")
"""Endings of what is read as recordings: those of `granular_id.io.formats` but .txt, as reports are texts, too."""

PICTURES = (".png", ".svg", ".pdf")

NO_FOLDERS = (".txt", ".xlsx", ".xls", ".ods", ".feather", ".json", ".pkl", ".zip", ".gz", ".tar")
"""Endings of files that are no names of folders."""

_OTHERS = (".rrd", ".jsonl", ".ndjson", ".eps", ".jpg", ".jpeg")
_KNOWN = (*JSON, *PAGES, *TABLES, *MODELS, *RECORDINGS, *PICTURES, *_OTHERS)


def refuse_other_kind(path: str | os.PathLike[str], endings: Sequence[str]) -> None:
    """Refuse a name that ends like another kind of file; one of the own kind may be replaced, as callers expect."""
    name = Path(path).name.lower()
    if name.endswith(_KNOWN) and not name.endswith(tuple(endings)):
        wanted = " or ".join(endings)
        raise GranularIdError(
            f"path must end in {wanted}, not like another kind of file, got {os.fspath(path)!r}"
        )


def check_source(path: str | os.PathLike[str]) -> Path:
    """Return a path to be read; FileNotFoundError where there is nothing."""
    source = Path(path)
    if not source.exists():
        raise FileNotFoundError(f"{os.fspath(path)}: no such file or folder")
    return source


def check_target(path: str | os.PathLike[str]) -> Path:
    """Refuse a path that cannot become a file, before hours of work depend on it."""
    # Some folders say that they can be written, and cannot: a temporary file is made and removed.
    target = Path(path)
    _draft_of(target).unlink()
    return target


def absolute(path: str | os.PathLike[str]) -> str:
    """Return a path from the root on that does not follow links: other machines may have them elsewhere."""
    return os.path.abspath(path)  # noqa: PTH100 (Path.absolute leaves "..")


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write beside the target and rename at the end, so that no reader ever meets half a file."""
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
def durable_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write a file as `whole_file` does, which survives the loss of power, its name too."""
    with whole_file(path) as draft:
        yield draft
        _sync(draft, os.O_RDWR)
    if os.name == "posix":  # elsewhere folders cannot be opened
        _sync(Path(path).parent, os.O_RDONLY)


def _sync(path: Path, how: int) -> None:
    descriptor = os.open(path, how)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def new_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write a file as `whole_file` does, where there is nothing yet."""
    if os.path.lexists(path):
        raise FileExistsError(f"{os.fspath(path)}: there is something already; nothing is overwritten")
    with whole_file(path) as draft:
        yield draft


@contextmanager
def whole_lines(path: str | os.PathLike[str]) -> Iterator[Callable[[str], None]]:
    """Write lines as they come, each whole or not at all, whatever a full disk or an interrupt leaves of one.

    The first line replaces what was there.
    """
    target, end = Path(path), -1

    def write(line: str) -> None:
        nonlocal end
        end, text = max(end, 0), (line + "\n").encode()
        try:
            with target.open("ab") as file:
                file.truncate(end)
                file.write(text)
        except OSError as error:
            raise cannot_write(target, error) from error
        end += len(text)

    try:
        yield write
    finally:
        if end >= 0 and target.exists():
            os.truncate(target, end)


def write_json(path: str | os.PathLike[str], content: object) -> None:
    """Write plain values as a JSON file for people and programs: UTF-8, indented by one blank, whole or not at all."""
    refuse_other_kind(path, JSON)
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, indent=1)
    with whole_file(path) as draft:
        draft.write_text(text + "\n", encoding="utf-8")


def json_value(value: Any) -> Any:
    """Return what JSON knows: an object for a dataclass, a list for an array or tuple, None for NaN."""
    if is_dataclass(value):
        return {field.name: json_value(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {name: json_value(part) for name, part in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [json_value(part) for part in value]
    return None if isinstance(value, float) and math.isnan(value) else value


@contextmanager
def made_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Make a folder for the files of a block; when the block raises, remove what was made and is still empty."""
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
    """Make an empty file beside the target, or say why it cannot become a file."""
    try:
        if target.is_dir():
            raise IsADirectoryError(f"{target} is a folder, wanted the name of a file")
        with suppress(FileNotFoundError, NotADirectoryError):
            if not stat.S_ISREG(target.stat().st_mode):
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
    """Return the error about what could not be written, by the name that was requested."""
    cause = error.__cause__ if isinstance(error.__cause__, OSError) else error  # about a file within a folder
    return type(error)(f"cannot write {target}: {cause.strerror or cause}")

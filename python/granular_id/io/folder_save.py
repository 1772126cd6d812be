"""Folders that are either whole or absent, and names of what lies in them."""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import dropwhile
from pathlib import Path

from granular_id._files import cannot_write
from granular_id.recording import Dataset

INDEX_NAME = "index.csv"
INDEX_COLUMNS = ("file", "label", "session", "start_time", "rate_hz", "trigger_index", "name", "meta", "axes")
"""The last one is there where recordings have other axes than the six of a wrench."""

IRREGULAR = "irregular"
"""What stands for a rate where a recording's own stamps are to be kept as they are."""

HISTORY_NAME = "history.json"
"""Beside index.csv: the steps that made the data set, see ``StepReport.to_dict``."""

_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
_EDGES = "._-"
_LONGEST, _LONGEST_BYTES = 60, 100
"""A file system takes 255 bytes, some 143, and there is more to a name than its label."""


def checked_dataset(dataset: object) -> Dataset:
    """Return a data set, or say that it is none."""
    if not isinstance(dataset, Dataset):
        raise TypeError(f"dataset must be a Dataset, got {type(dataset).__name__}")
    return dataset


def history_json(dataset: Dataset) -> str:
    """Return the steps that made a data set as one JSON text."""
    return json.dumps([step.to_dict() for step in dataset.history])


def write_history(dataset: Dataset, folder: Path) -> None:
    """Write the steps that made a data set into its folder, where there were any."""
    if dataset.history:
        (folder / HISTORY_NAME).write_text(history_json(dataset), encoding="utf-8")


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
    kept = "".join(c if _is_safe(c) else " " for c in unicodedata.normalize("NFC", label))
    name = re.sub(" +", "_", kept)[:_LONGEST].encode()[:_LONGEST_BYTES].decode(errors="ignore")
    name = "".join(dropwhile(lambda c: c in _EDGES or unicodedata.category(c)[0] == "M", name))
    name = name.rstrip(_EDGES) or "label"
    return f"label_{name}" if _RESERVED.fullmatch(name) else name


def _is_safe(character: str) -> bool:
    return character in _EDGES or unicodedata.category(character)[0] in "LMN"

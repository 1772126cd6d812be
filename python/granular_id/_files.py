"""Files that are either whole or absent."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["check_target", "whole_file"]


def check_target(path: str | os.PathLike[str]) -> Path:
    """Refuse a path that cannot become a file, before hours of work depend on it.

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
    FileNotFoundError
        Its folder does not exist.
    PermissionError
        Its folder is not writable.
    """
    target = Path(path)
    if target.is_dir():
        raise IsADirectoryError(f"{target} is a folder, wanted the name of a file")
    if not target.parent.is_dir():
        raise FileNotFoundError(f"cannot write {target}: the folder {target.parent} does not exist")
    if not os.access(target.parent, os.W_OK):
        raise PermissionError(f"cannot write {target}: the folder {target.parent} is not writable")
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
    """
    target = check_target(path)
    draft = target.with_name(f".{target.stem}-{secrets.token_hex(8)}{target.suffix}")
    draft.touch(exist_ok=False)
    try:
        yield draft
        draft.replace(target)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise

"""Where an interrupted command keeps what it has finished, so that the same command goes on from there."""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from granular_id.evaluation.checkpoint import RUN

__all__ = ["Kept", "kept_for"]


class Kept(KeyboardInterrupt):
    """Ctrl-C in a command that keeps finished partitions, with what to say about them."""


@contextmanager
def kept_for(command: str, *, fresh: bool) -> Iterator[Path | None]:
    """Give a folder to keep finished work in while the block runs; it is removed when the block ends well.

    Parameters
    ----------
    command : str
        What was typed: the same words in the same folder mean the same work.
    fresh : bool
        Forget what an earlier run has left.

    Yields
    ------
    Path or None
        Below ``$XDG_CACHE_HOME/granular-id`` (``~/.cache/granular-id``); None where that cannot be written.

    Raises
    ------
    Kept
        On Ctrl-C, if anything was finished.
    """
    mark = hashlib.blake2b(f"{Path.cwd()}\n{command}".encode(), digest_size=8).hexdigest()
    folder = _cache() / mark
    if fresh:
        shutil.rmtree(folder, ignore_errors=True)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        usable = os.access(folder.parent, os.W_OK)
    except OSError:
        usable = False  # a home that is read-only must not stop an evaluation
    if not usable:
        yield None
        return
    try:
        yield folder
    except KeyboardInterrupt:
        finished = sum(path.name != RUN for path in folder.glob("*.json"))
        if not finished:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        raise Kept(
            f"Interrupted: {finished} finished partitions are kept; the same command goes on from there "
            "(--fresh starts over)."
        ) from None
    shutil.rmtree(folder, ignore_errors=True)


def _cache() -> Path:
    if os.environ.get("XDG_CACHE_HOME"):
        root = Path(os.environ["XDG_CACHE_HOME"])
    elif sys.platform == "win32" and os.environ.get("LOCALAPPDATA"):
        root = Path(os.environ["LOCALAPPDATA"])
    else:
        root = Path.home() / ".cache"
    return root / "granular-id"

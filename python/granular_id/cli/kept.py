"""Where an interrupted command keeps what it has finished, so that the same command goes on from there."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from granular_id.evaluation.checkpoint import RUN, OtherEvaluationError

try:
    import fcntl
except ImportError:  # Windows: two processes with the same command at once are not kept apart there
    fcntl = None  # type: ignore[assignment]

__all__ = ["Kept", "Work", "kept_for"]

CACHE = "GRANULAR_ID_CACHE"
"""Environment variable: the folder for finished work, instead of granular-id in the user's cache."""

T = TypeVar("T")


class Kept(KeyboardInterrupt):
    """Ctrl-C in a command that keeps what it has finished; the text says what to do about it."""


class Work:
    """A folder for finished work, or None where none can be had."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder

    def going_on(self, work: Callable[[Path | None], T]) -> T:
        """Do some work that goes on from the folder; from the start where the recordings have changed since."""
        try:
            return work(self.folder)
        except OtherEvaluationError:
            self.forget()
            return work(self.folder)

    def finished(self) -> int:
        """Count what is kept."""
        return 0 if self.folder is None else sum(path.name != RUN for path in self.folder.glob("*.json"))

    def forget(self) -> None:
        """Remove what is kept."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


@contextmanager
def kept_for(command: str, *, fresh: bool) -> Iterator[Work]:
    """Keep finished work while the block runs, and when Ctrl-C or a crash ends it; forget it when it ends well.

    Parameters
    ----------
    command : str
        What was typed: the same words in the same folder mean the same work, with --force or without.
    fresh : bool
        Forget what an earlier run has left.

    Yields
    ------
    Work
        Below ``$GRANULAR_ID_CACHE``, or ``granular-id`` in the user's cache (``~/.cache``); without a folder where
        that cannot be written.

    Raises
    ------
    Kept
        On Ctrl-C, if anything was finished.
    """
    words = [word for word in shlex.split(command) if word not in ("--fresh", "--force")]
    mark = hashlib.blake2b("\n".join((str(Path.cwd()), *words)).encode(), digest_size=8).hexdigest()
    with _held(_cache(), mark) as folder:
        work = Work(folder)
        if fresh:
            work.forget()
        yield from _kept_in(work)


def _kept_in(work: Work) -> Iterator[Work]:
    try:
        yield work
    except BaseException as stop:
        finished = work.finished()
        if not finished:
            work.forget()
        elif isinstance(stop, KeyboardInterrupt):
            raise Kept(
                f"Interrupted: {finished} finished partitions are kept; the same command goes on from there "
                "(--fresh starts over)."
            ) from None
        raise
    work.forget()


@contextmanager
def _held(root: Path, mark: str) -> Iterator[Path | None]:
    """Give a folder that no other process uses meanwhile; None where there is none to be had.

    A home that is read-only, or the same command running twice, must not stop an evaluation: it runs without.
    """
    try:
        root.mkdir(parents=True, exist_ok=True)
        lock = (root / f"{mark}.lock").open("w")
    except OSError:
        yield None
        return
    with lock:
        try:
            if fcntl is not None:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            yield None
            return
        try:
            yield root / mark
        finally:
            if not (root / mark).exists():
                Path(lock.name).unlink(missing_ok=True)


def _cache() -> Path:
    if os.environ.get(CACHE):
        return Path(os.environ[CACHE])
    if os.environ.get("XDG_CACHE_HOME"):
        root = Path(os.environ["XDG_CACHE_HOME"])
    elif sys.platform == "win32" and os.environ.get("LOCALAPPDATA"):
        root = Path(os.environ["LOCALAPPDATA"])
    else:
        root = Path.home() / ".cache"
    return root / "granular-id"

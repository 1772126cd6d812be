"""Ctrl-C that is never lost."""

from __future__ import annotations

import _thread
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

__all__ = ["heeding_interrupts"]

_AGAIN_S = 0.02


@contextmanager
def heeding_interrupts() -> Iterator[None]:
    """Repeat a Ctrl-C that Python drops.

    One that arrives while an object is being deleted (`zipfile.ZipFile` closes itself then) is printed as "ignored",
    and the program would go on to its end. It is raised again a moment later, from outside the deletion.
    """
    before = sys.unraisablehook

    def hook(dropped: UnraisableHookArgs) -> None:
        if dropped.exc_type is KeyboardInterrupt:
            again = threading.Timer(_AGAIN_S, _thread.interrupt_main)
            again.daemon = True
            again.start()
        else:
            before(dropped)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before

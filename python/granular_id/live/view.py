"""Views: what shows snapshots, in one thread for all of them, so that none ever holds up a capture."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from threading import Condition, Thread
from typing import TYPE_CHECKING, Any

from typing_extensions import Self

if TYPE_CHECKING:
    from granular_id.live.snapshot import Snapshot

__all__ = ["Views"]

_PERIOD_S = 0.1  # numbers that change faster cannot be read, and the capture needs the processor
_PATIENCE_S = 3.0  # at the end; a terminal that is stopped must not keep the program alive


class Views:
    """Shows snapshots in several views: objects with ``show(snapshot)`` and optionally ``close()``.

    A thread of its own calls them, one after another. A view that raises is left out from then on: `errors` names it,
    and the others show that.

    Examples
    --------
    >>> from granular_id.live import Views
    >>> from granular_id.live.snapshot import Snapshot
    >>> class Printing:
    ...     def show(self, snapshot):
    ...         print(snapshot.words.line)
    >>> with Views([Printing()]) as views:
    ...     views.publish(Snapshot("armed", hint="push now"))
    Armed: push now  |  lag -, lost 0
    """

    def __init__(self, views: Iterable[Any]) -> None:
        self.errors: tuple[str, ...] = ()
        self._views, self._busy = list(views), ""
        self._next_s, self._is_closed = -float("inf"), False
        self._changed = Condition()
        self._waiting: deque[Snapshot] = deque(maxlen=64)
        self._thread = Thread(target=self._run, name="granular_id views", daemon=True)
        if self._views:
            self._thread.start()

    def wants_snapshot(self) -> bool:
        """Whether it is time for another snapshot; a change of state may be published at any time."""
        return bool(self._views) and time.monotonic() >= self._next_s

    def publish(self, snapshot: Snapshot) -> None:
        """Leave a snapshot to be shown; it replaces one of the same state that still waits."""
        self._next_s = time.monotonic() + _PERIOD_S
        with self._changed:
            if self._waiting and self._waiting[-1].state == snapshot.state:
                self._waiting.pop()
            self._waiting.append(snapshot)
            self._changed.notify()

    def close(self) -> None:
        """Show what waits, then close the views; one that is stuck is left behind."""
        if self._is_closed:
            return
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(_PATIENCE_S)
        if self._thread.is_alive():
            self.errors += (f"{self._busy} is stuck",)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._is_closed)
                if not self._waiting:
                    break
                snapshot = self._waiting.popleft()
            snapshot = replace(snapshot, warnings=(*snapshot.warnings, *self.errors))
            for view in tuple(self._views):
                if not self._call(view, "show", snapshot):
                    self._views.remove(view)
                    self._call(view, "close")
        for view in self._views:
            self._call(view, "close")

    def _call(self, view: Any, name: str, *arguments: object) -> bool:
        self._busy = type(view).__name__
        try:
            if hasattr(view, name):
                getattr(view, name)(*arguments)
        except Exception as error:  # a broken view must not end a capture
            self.errors += (f"{self._busy} has stopped: {error}",)
            return False
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

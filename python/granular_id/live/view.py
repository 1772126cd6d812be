"""Views: what shows snapshots, and how none of them ever holds up a capture."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from types import TracebackType
from typing import TYPE_CHECKING, Protocol

from typing_extensions import Self

from granular_id._checks import finite_number
from granular_id.live.view_thread import ViewThread

if TYPE_CHECKING:
    from granular_id.live.snapshot import Snapshot

__all__ = ["MAX_HZ", "BackgroundView", "View", "Views", "checked_max_hz"]

MAX_HZ = 30.0
"""No view is updated more often: the eye gains nothing, and the capture needs the processor."""


def checked_max_hz(value: object) -> float:
    """Return a number of updates per second that a view may have, or say which it may."""
    rate = finite_number("max_hz", value)
    if not 0 < rate <= MAX_HZ:
        raise ValueError(f"max_hz must be above 0 and at most {MAX_HZ:g}, got {rate:g}")
    return rate


class View(Protocol):
    """Shows snapshots."""

    def publish(self, snapshot: Snapshot) -> None:
        """Show this from now on. Returns at once, whatever the screen, browser or disk does."""

    def close(self) -> None:
        """Show the last snapshot, then give everything back. May be called again."""


class BackgroundView(ViewThread):
    """A view whose work is done by a thread of its own; `publish` only leaves the snapshot where it will look.

    Publishing appends to a deque of fixed length and takes no lock, so it cannot wait for anybody. When the thread
    falls behind, the oldest snapshots are dropped and counted.

    Parameters
    ----------
    name : str
        Of the thread, and for messages.
    max_hz : float
        The thread looks this often.
    waiting : int
        Snapshots that may wait. 1: only the newest is of interest.
    patience_s : float
        See `ViewThread`.

    Notes
    -----
    The thread starts at the end of this constructor: derived classes set what `show` uses before they call it.
    """

    def __init__(
        self, name: str, *, max_hz: float = MAX_HZ, waiting: int = 1, patience_s: float = 2.0
    ) -> None:
        super().__init__(name, patience_s=patience_s)
        self.dropped = 0
        """Snapshots that came too fast for this view."""
        self._period_s = 1.0 / checked_max_hz(max_hz)
        self._waiting: deque[tuple[int, Snapshot]] = deque(maxlen=waiting)
        self._handled = 0
        self.begin()

    @abstractmethod
    def show(self, snapshot: Snapshot) -> None:
        """Show one snapshot; in the thread of the view."""

    @abstractmethod
    def finish(self) -> None:
        """Give back what `show` uses; in the thread of the view, after the last snapshot or a failure."""

    def leave(self, number: int, snapshot: Snapshot) -> None:
        """Append to what waits; when that is full, the oldest is dropped."""
        self._waiting.append((number, snapshot))

    def keep(self) -> None:
        """Show what waits, again and again, and once more at the end."""
        try:
            while not self._closing.wait(self._period_s):
                self._show_waiting()
            self._show_waiting()
        finally:
            self.finish()

    def _show_waiting(self) -> None:
        for _ in range(len(self._waiting)):
            number, snapshot = self._waiting.popleft()
            self.dropped += number - self._handled - 1
            self._handled = number
            self.show(snapshot)


class Views:
    """Several views as one. A view that fails is left out from then on, and the others say so.

    Parameters
    ----------
    views : iterable of View
        None at all is fine: then nothing is ever wanted.
    max_hz : float, default 30
        Snapshots wanted per second, at most `MAX_HZ`.

    Examples
    --------
    >>> from granular_id.live.view import Views
    >>> with Views([]) as views:
    ...     views.wants_snapshot()
    False
    """

    def __init__(self, views: Iterable[View], *, max_hz: float = MAX_HZ) -> None:
        self._period_s = 1.0 / checked_max_hz(max_hz)
        self._views = list(views)
        self._broken: list[View] = []
        self._next_s = -float("inf")
        self.complaints: tuple[str, ...] = ()
        """What ended views. The others show it; where there are none, whoever made them has to."""

    def add(self, view: View) -> None:
        """Show snapshots there as well, from now on."""
        self._views.append(view)

    def wants_snapshot(self) -> bool:
        """Tell whether it is time for another snapshot: building one for nobody would be a waste."""
        return bool(self._views) and time.monotonic() >= self._next_s

    def publish(self, snapshot: Snapshot) -> None:
        """Pass a snapshot on, whether it was wanted or not: the last one of a capture must not be lost."""
        self._next_s = time.monotonic() + self._period_s
        if self.complaints:
            snapshot = replace(snapshot, warnings=(*snapshot.warnings, *self.complaints))
        for view in tuple(self._views):
            if not self._does(partial(view.publish, snapshot)):
                self._views.remove(view)
                self._broken.append(
                    view
                )  # closed at the end: that may take a while, and a capture is running

    def close(self) -> None:
        """Close all of them; what fails now is among the complaints."""
        for views in (self._views, self._broken):
            while views:
                self._does(views.pop().close)

    def _does(self, work: Callable[[], None]) -> bool:
        try:
            work()
        except Exception as error:  # a broken view must not end a capture
            if str(error) not in self.complaints:  # a view that broke says so again when it is closed
                self.complaints += (str(error),)
            return False
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

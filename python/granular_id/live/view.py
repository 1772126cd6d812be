"""Views: what shows snapshots, and how none of them ever holds up a capture."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from threading import Event, Thread
from types import TracebackType
from typing import TYPE_CHECKING, Protocol

from typing_extensions import Self

from granular_id._checks import finite_number

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


class BackgroundView(ABC):
    """A view whose work is done by a thread of its own; `publish` only leaves the snapshot where it will look.

    Publishing appends to a deque of fixed length and takes no lock, so it cannot wait for anybody. When the thread
    falls behind, the oldest snapshots are dropped and counted. Derived classes say how to `show` one.

    Parameters
    ----------
    name : str
        Of the view, for messages.
    max_hz : float, default 30
        The thread looks this often, at most 30.
    waiting : int, default 1
        Snapshots that may wait. 1: only the newest is of interest.
    patience_s : float, default 2
        How long `close` waits for the thread; a terminal that is stopped must not keep the program alive.

    Attributes
    ----------
    dropped : int
        Snapshots that came too fast for this view.
    failure : Exception or None
        What ended the view, if something did.

    Notes
    -----
    The thread starts at the end of this constructor: derived classes set what `show` uses before they call it.

    Examples
    --------
    >>> from granular_id.live import BackgroundView, Snapshot
    >>> class Printing(BackgroundView):
    ...     def show(self, snapshot):
    ...         print(snapshot.words.line)
    >>> with Printing("printing view") as view:
    ...     view.publish(Snapshot("armed", hint="push now"))
    Armed: push now  |  lag -, lost 0
    """

    def __init__(
        self, name: str, *, max_hz: float = MAX_HZ, waiting: int = 1, patience_s: float = 2.0
    ) -> None:
        self.name, self.dropped = name, 0
        self.failure: Exception | None = None
        self._period_s = 1.0 / checked_max_hz(max_hz)
        self._patience_s = patience_s
        self._waiting: deque[tuple[int, Snapshot]] = deque(maxlen=waiting)
        self._published = self._handled = self._shown = 0
        self._closing = Event()
        self._thread = Thread(target=self._run, name=f"granular_id {name}", daemon=True)
        self._thread.start()

    @abstractmethod
    def show(self, snapshot: Snapshot) -> None:
        """Show one snapshot; in the thread of the view."""

    def finish(self) -> None:  # noqa: B027  # most have nothing to give back
        """Give back what `show` uses; in the thread of the view, after the last snapshot or a failure."""

    def publish(self, snapshot: Snapshot) -> None:
        """Show this from now on.

        Raises
        ------
        RuntimeError
            The view has failed or is closed.
        """
        self._tell_failure()
        if self._closing.is_set():
            raise RuntimeError(f"the {self.name} is closed")
        self._published += 1
        self._waiting.append((self._published, snapshot))

    @property
    def is_idle(self) -> bool:
        """Whether all that was published is shown, and nothing is being drawn."""
        return self._shown == self._published or not self._thread.is_alive()

    def close(self) -> None:
        """Show what waits and end the thread; one that is stuck in a write is left behind after a while.

        Raises
        ------
        RuntimeError
            The view has failed, or is stuck: what it had not shown yet is lost then.
        """
        self._closing.set()
        self._thread.join(self._patience_s)
        self._tell_failure()
        if self._thread.is_alive():
            raise RuntimeError(f"the {self.name} was stuck, and not waited for after {self._patience_s:g} s")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _tell_failure(self) -> None:
        if self.failure is not None:
            raise RuntimeError(f"the {self.name} has stopped: {self.failure}") from self.failure

    def _run(self) -> None:
        try:
            self._keep_showing()
        except Exception as error:  # told by publish or close
            self.failure = error
        try:
            self.finish()
        except Exception as error:
            self.failure = self.failure or error

    def _keep_showing(self) -> None:
        while not self._closing.wait(self._period_s):
            self._show_waiting()
        self._show_waiting()

    def _show_waiting(self) -> None:
        for _ in range(len(self._waiting)):
            number, snapshot = self._waiting.popleft()
            self.dropped += number - self._handled - 1
            self._handled = number
            self.show(snapshot)
            self._shown = number


class Views:
    """Several views as one. A view that fails is left out from then on, and the others say so.

    Parameters
    ----------
    views : iterable of View
        None at all is fine: then nothing is ever wanted.
    max_hz : float, default 30
        Snapshots wanted per second, at most 30.

    Attributes
    ----------
    complaints : tuple of str
        What ended views. The others show it; where there are none, whoever made them has to.

    Examples
    --------
    >>> from granular_id.live import Views
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

    def add(self, view: View) -> None:
        """Show snapshots there as well, from now on."""
        self._views.append(view)

    def wants_snapshot(self) -> bool:
        """Tell whether it is time for another snapshot: building one for nobody would be a waste."""
        return bool(self._views) and time.monotonic() >= self._next_s

    @property
    def are_idle(self) -> bool:
        """Whether nothing is being drawn, as far as views tell it (`BackgroundView.is_idle`)."""
        return all(getattr(view, "is_idle", True) for view in self._views)

    def publish(self, snapshot: Snapshot) -> None:
        """Pass a snapshot on, whether it was wanted or not: the last one of a capture must not be lost."""
        self._next_s = time.monotonic() + self._period_s
        if self.complaints:
            snapshot = replace(snapshot, warnings=(*snapshot.warnings, *self.complaints))
        for view in tuple(self._views):
            if not self._does(partial(view.publish, snapshot)):
                # closed at the end: that may take a while, and a capture is running
                self._views.remove(view)
                self._broken.append(view)

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

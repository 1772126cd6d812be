"""A view that is kept by a thread of its own: how it begins, fails and ends."""

from __future__ import annotations

from abc import ABC, abstractmethod
from threading import Event, Thread
from types import TracebackType
from typing import TYPE_CHECKING

from typing_extensions import Self

if TYPE_CHECKING:
    from granular_id.live.snapshot import Snapshot

__all__ = ["ViewThread"]


class ViewThread(ABC):
    """Numbers what is published and leaves it for a thread, which `keep` describes; failures come out at the publisher.

    Neither publishing nor its errors wait for the thread. Call `begin` once everything that `keep` uses is there.

    Parameters
    ----------
    name : str
        Of the view, for messages.
    patience_s : float
        How long `close` waits for the thread; a terminal that is stopped must not keep the program alive.
    """

    def __init__(self, name: str, *, patience_s: float) -> None:
        self.name = name
        self.failure: Exception | None = None
        """What ended the view, if something did."""
        self._patience_s = patience_s
        self._published = 0
        self._closing = Event()
        self._thread = Thread(target=self._run, name=f"granular_id {name}", daemon=True)

    @abstractmethod
    def leave(self, number: int, snapshot: Snapshot) -> None:
        """Leave a snapshot where the thread will find it; in the thread of the publisher, which must not wait."""

    @abstractmethod
    def keep(self) -> None:
        """Show what was left until `_closing` is set, then give everything back; in the thread of the view."""

    def begin(self) -> None:
        """Start the thread."""
        self._thread.start()

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
        self.leave(self._published, snapshot)

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
            self.keep()
        except Exception as error:  # told by publish or close
            self.failure = error

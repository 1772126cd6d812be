"""The thread that most sources written in Python need: started, stopped, and its death remembered."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod

from granular_id.live.source import Health, SourceInfo, WrenchSink

__all__ = ["ThreadedSource"]

_STOP_S = 5.0
"""How long `stop` waits for the thread: longer than any driver call should take to return."""


class ThreadedSource(ABC):
    """A source that writes rows from one Python thread.

    Subclasses implement `deliver`; start, stop, errors and health are kept here. What `deliver` raises ends the
    source and becomes the error in `health`; when it returns by itself, the source has finished.

    Parameters
    ----------
    info : SourceInfo

    Notes
    -----
    A Python thread shares the interpreter with everything else, and can be late by tens of milliseconds when
    others compute: good enough for drivers that queue, for simulations and replays. `rdt` has a thread in Rust.
    """

    def __init__(self, info: SourceInfo) -> None:
        self._info = info
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
        self._error: str | None = None
        self._finished = False

    @property
    def info(self) -> SourceInfo:
        """What the source measures."""
        return self._info

    @abstractmethod
    def deliver(self, buffer: WrenchSink, stopping: threading.Event) -> None:
        """Write rows until there are no more or `stopping` is set; runs in the source's own thread."""

    def counters(self) -> dict[str, int]:
        """Return what `health` is to tell beside; nothing by default."""
        return {}

    def start(self, buffer: WrenchSink) -> None:
        """Begin to write rows into `buffer`.

        Raises
        ------
        RuntimeError
            It has been started or stopped before: every source runs once.
        """
        if self._thread is not None or self._stopping.is_set():
            how = "stopped" if self._thread is None else "started"
            raise RuntimeError(f"{self._info.name} was {how} before; open the source anew")
        self._thread = threading.Thread(
            target=self._work, args=(buffer,), name=f"source {self._info.name}", daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """End the thread and wait for it.

        Raises
        ------
        RuntimeError
            The thread does not end within 5 s: a driver hangs.
        """
        self._stopping.set()
        if self._thread is None or self._thread is threading.current_thread():
            return
        self._thread.join(_STOP_S)
        if self._thread.is_alive():
            raise RuntimeError(f"{self._info.name} did not stop within {_STOP_S:g} s: its driver hangs")

    def health(self) -> Health:
        """Tell how the source is."""
        error, finished = self._error, self._finished
        over = finished or error is not None or self._stopping.is_set()
        alive = self._thread is not None and self._thread.is_alive()
        return Health(alive and not over, error, finished, self.counters())

    def _work(self, buffer: WrenchSink) -> None:
        try:
            self.deliver(buffer, self._stopping)
        except Exception as error:  # whatever a driver raises: `health` tells it
            self._error = f"{type(error).__name__}: {error}"
        else:
            self._finished = not self._stopping.is_set()

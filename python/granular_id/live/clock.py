"""How live code waits and what runs beside it, in one place so that tests can put simulated time there."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from granular_id._core import WrenchReader, host_ns
from granular_id.live.priority import at_once

__all__ = ["CLOCK", "WAIT_S", "Clock"]

WAIT_S = 0.02
"""How long to wait for a row at a time: so soon are errors and the end noticed where none comes."""

_ASK_S = 0.01


class Clock:
    """How live code waits, and what runs beside it; tests put simulated time in its place."""

    def now_ns(self) -> int:
        """Return the host's monotonic time."""
        return host_ns()

    def wait(self, reader: WrenchReader, seconds: float) -> None:
        """Wait for a row."""
        reader.wait(seconds)

    def start(
        self,
        work: Callable[[], bool | None],
        when: WrenchReader | threading.Event | None,
        urgent: Sequence[int] | None,
    ) -> None:
        """Call `work` in a thread: once when an event is set, else at each row or every 10 ms, until it returns False.

        The thread gets real-time priority where `urgent` is not None. While one waits for rows, those with these native
        ids get it as well, and all others of Python.
        """

        def run() -> None:
            if isinstance(when, threading.Event):
                when.wait()
                work()
                return
            pause = threading.Event()
            while work():
                if when is None:
                    pause.wait(_ASK_S)
                else:
                    when.wait(WAIT_S)

        def run_at_once() -> None:
            with at_once(urgent or (), all_of_python=isinstance(when, WrenchReader)):
                run()

        target = run if urgent is None else run_at_once
        threading.Thread(target=target, name=f"granular_id {work.__name__}", daemon=True).start()


CLOCK = Clock()

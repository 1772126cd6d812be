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

    def repeat(
        self, work: Callable[[], bool], reader: WrenchReader | None, urgent: Sequence[int] | None
    ) -> None:
        """Call `work` in a thread until it returns False: whenever a row comes in, without a reader every 10 ms.

        The thread gets real-time priority where `urgent` is not None. While one waits for rows, those with these native
        ids get it as well, and all others of Python.
        """

        def loop() -> None:
            pause = threading.Event()
            while work():
                if reader is None:
                    pause.wait(_ASK_S)
                else:
                    reader.wait(WAIT_S)

        watches = reader is not None
        name = "granular_id supervisor" if watches else "granular_id robot"
        _start(name, loop, urgent, all_of_python=watches)

    def call(self, work: Callable[[], None], when: threading.Event, urgent: Sequence[int] | None) -> None:
        """Call `work` once in a thread, as soon as the event is set."""

        def once() -> None:
            when.wait()
            work()

        _start("granular_id stop", once, urgent)


CLOCK = Clock()


def _start(
    name: str, work: Callable[[], None], urgent: Sequence[int] | None, *, all_of_python: bool = False
) -> None:
    def run() -> None:
        if urgent is None:
            work()
        else:
            with at_once(urgent, all_of_python=all_of_python):
                work()

    threading.Thread(target=run, name=name, daemon=True).start()

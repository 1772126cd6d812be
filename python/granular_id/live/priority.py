"""Real-time priority for the threads that hold a push against its limits, where the system grants it."""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress

__all__ = ["at_once", "reading_threads", "warn_if_refused"]

_WATCHING, _READING, _OTHERS = 3, 2, 1
"""Above everything at usual priority, below what drivers ask for; who reads may not keep the watch waiting."""

_SWITCH_S = 0.0005
"""So long may another thread, of a view, keep Python's lock at a time; Python's own 5 ms are all that a limit has."""

_REFUSED = (
    "limits of force and torque are watched at the usual priority: beside busy programs stop() may come 10 ms or more "
    "after the sample beyond, with real-time priority within 1 ms. Linux grants it by the line 'USER - rtprio 3' in "
    "/etc/security/limits.conf, from the next login on"
)

_lock = threading.Lock()
_before: list[float] = []  # switch intervals, one for each that is at work; the first is the program's own


@contextmanager
def at_once(threads: Iterable[int] = ()) -> Iterator[bool]:
    """Let the calling thread, those with these native ids and all of Python run as soon as they have something to do.

    They get SCHED_FIFO where it is granted (then this yields True), what they start does not; afterwards all is as
    before. Only for threads that mostly wait: nothing of usual priority runs on their core meanwhile.
    """
    with _lock:
        _before.append(sys.getswitchinterval())
        sys.setswitchinterval(min(_SWITCH_S, _before[0]))
    own, raised = threading.get_native_id(), list[int]()
    try:
        # A thread of Python that keeps the lock while other programs run would keep the watch waiting.
        others = [thread.native_id for thread in threading.enumerate()]
        levels = dict.fromkeys(others, _OTHERS) | dict.fromkeys(threads, _READING) | {own: _WATCHING}
        for thread, level in levels.items():
            if isinstance(thread, int) and _raised(thread, level):
                raised.append(thread)
        yield own in raised
    finally:
        for thread in raised:
            with suppress(OSError):  # a thread that has ended
                os.sched_setscheduler(thread, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
        with _lock:
            first = _before[0]
            _before.pop()
            if not _before:
                sys.setswitchinterval(first)


def _raised(thread: int, priority: int) -> bool:
    """Give a thread of usual priority that of real time; False: it is not granted, or it has another already."""
    if not hasattr(os, "sched_setscheduler"):
        return False
    with suppress(OSError):
        if os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER:
            os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
            return True
    return False


def reading_threads(source: object) -> list[int]:
    """Return the native ids of the threads that read a sensor, where its source tells them."""
    threads = getattr(source, "threads", [])
    return threads if isinstance(threads, list) else []


def warn_if_refused() -> None:
    """Warn where the system grants the calling thread no real-time priority."""
    with at_once() as granted:
        if not granted:
            warnings.warn(_REFUSED, RuntimeWarning, stacklevel=1)

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
_holders: dict[int, tuple[int, int]] = {}  # thread -> how many have requested its priority, and the highest


@contextmanager
def at_once(threads: Iterable[int] = (), *, all_of_python: bool = False) -> Iterator[bool]:
    """Give SCHED_FIFO to the calling thread and those with these native ids; yield whether it is granted."""
    # Only for threads that mostly wait: nothing of usual priority runs on their core meanwhile. What they start does
    # not get it. The other threads of Python get it, below these, as one that keeps the lock while other programs run
    # keeps everybody waiting.
    own, raised = threading.get_native_id(), list[int]()
    others = [thread.native_id for thread in threading.enumerate()] if all_of_python else []
    levels = dict.fromkeys(others, _OTHERS) | dict.fromkeys(threads, _READING) | {own: _WATCHING}
    with _lock:
        _before.append(sys.getswitchinterval())
        sys.setswitchinterval(min(_SWITCH_S, _before[0]))
    try:
        with _lock:
            for thread, level in levels.items():
                if isinstance(thread, int) and _held(thread, level):
                    raised.append(thread)
        yield own in raised
    finally:
        with _lock:
            for thread in raised:
                _let_go(thread)
            first = _before[0]
            _before.pop()
            if not _before:
                sys.setswitchinterval(first)


def _held(thread: int, level: int) -> bool:
    """Raise a thread to a level at least, and count who requested it; False where it is not granted."""
    count, before = _holders.get(thread, (0, 0))
    if level > before and not _raised(thread, level, again=count > 0):
        return False
    _holders[thread] = count + 1, max(level, before)
    return True


def _let_go(thread: int) -> None:
    count, level = _holders[thread]
    if count > 1:
        _holders[thread] = count - 1, level
        return
    del _holders[thread]
    with suppress(OSError):  # a thread that has ended
        os.sched_setscheduler(thread, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))


def _raised(thread: int, level: int, *, again: bool) -> bool:
    """Give a thread of usual priority that of real time; False: it is not granted, or it has another already."""
    if not hasattr(os, "sched_setscheduler"):
        return False
    with suppress(OSError):
        if again or os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER:
            os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(level))
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

"""Real-time priority for the threads that hold a push against its limits, where the system grants it."""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress

__all__ = ["at_once", "reading_threads", "warn_if_refused"]

_WATCHING, _READING = 2, 1
"""Above everything at usual priority, below what drivers ask for; who reads may not keep the other waiting."""

_SWITCH_S = 0.0005
"""So long may another thread, of a view, keep Python's lock at a time; Python's own 5 ms are all that a limit has."""

_REFUSED = (
    "limits of force and torque are watched at the usual priority: beside busy programs stop() may come 10 ms or more "
    "after the sample beyond, with real-time priority within 1 ms. Linux grants it by the line 'USER - rtprio 1' in "
    "/etc/security/limits.conf, from the next login on"
)

_lock = threading.Lock()
_switches: list[float] = []  # one for each that is at work; the first is what it was before


@contextmanager
def at_once(threads: Iterable[int] = ()) -> Iterator[None]:
    """Let the calling thread, and those with these native ids, run as soon as they have something to do.

    They get SCHED_FIFO where it is granted, threads and processes that they start do not; afterwards all is as before.
    Only threads that mostly wait may have it: nothing of usual priority runs on their core meanwhile.
    """
    with _lock:
        _switches.append(sys.getswitchinterval())
        sys.setswitchinterval(min(_SWITCH_S, _switches[0]))
    before: dict[int, int | None] = {}
    try:
        own = threading.get_native_id()
        for thread in dict.fromkeys((own, *threads)):
            before[thread] = _raised(thread, _WATCHING if thread == own else _READING)
        yield
    finally:
        for thread, policy in before.items():
            if policy is not None:
                with suppress(OSError):  # a thread that has ended
                    # Without the flag only who may do anything can set it again.
                    os.sched_setscheduler(thread, policy | os.SCHED_RESET_ON_FORK, os.sched_param(0))
        with _lock:
            switch_s = _switches[0]
            _switches.pop()
            if not _switches:
                sys.setswitchinterval(switch_s)


def _raised(thread: int, priority: int) -> int | None:
    """Give a thread real-time priority; return what it had, None where it is not granted, or it has that already."""
    if not hasattr(os, "sched_setscheduler"):
        return None
    try:
        policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
        if policy in (os.SCHED_FIFO, os.SCHED_RR):
            return None
        os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError:
        return None
    return policy


def reading_threads(source: object) -> list[int]:
    """Return the native ids of the threads that read a sensor, where its source tells them."""
    threads = getattr(source, "threads", [])
    return threads if isinstance(threads, list) else []


def warn_if_refused() -> None:
    """Warn, once a process, where the system grants the calling thread no real-time priority."""
    thread = threading.get_native_id()
    with at_once():
        known = hasattr(os, "sched_getscheduler")
        policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK if known else None
    if policy is None or policy not in (os.SCHED_FIFO, os.SCHED_RR):
        warnings.warn(_REFUSED, RuntimeWarning, stacklevel=1)

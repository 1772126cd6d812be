"""Signals that end a program stop the arms that move."""

from __future__ import annotations

import atexit
import os
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import FrameType
from typing import Protocol

from granular_id.live.outcome import FailureReason

__all__ = ["MOVING", "ending", "number_heard", "stop_on_signals", "stopped_robots"]

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
SIGNALS = tuple(signal.Signals[name] for name in _NAMES if hasattr(signal, name))
"""What asks a program to end: Ctrl-C, `kill`, a terminal or connection that closes; SIGBREAK is that of Windows."""

_LEAVE_S = 2.0
"""So long does the end of the program wait for arms to stand."""


class Moving(Protocol):
    """An arm in motion."""

    standing: threading.Event

    @property
    def robot(self) -> object:
        """Whose motion it is."""

    def stop(self, reason: FailureReason, text: str) -> None:
        """Have it stopped, at once and without waiting for it."""


MOVING: set[Moving] = set()

_HEARD: list[str] = []  # by whom: the main thread and the one that listens hear each signal, in either order
_STOPPED: list[Moving] = []
_BLOCKS: list[object] = []


def number_heard() -> int:
    """Return how many signals were heard: who has called before nothing may begin to move for after the next."""
    return max(_HEARD.count("main"), _HEARD.count("listening"))


def stopped_robots() -> bool | None:
    """Whether the arms that a signal has stopped stand; None where none moved."""
    return all(one.standing.is_set() for one in _STOPPED) if _STOPPED else None


def ending(signum: int) -> BaseException:
    """Return what a signal raises: KeyboardInterrupt, or SystemExit with the code by which shells know it."""
    return KeyboardInterrupt() if signum == signal.SIGINT else SystemExit(128 + signum)


@contextmanager
def stop_on_signals() -> Iterator[None]:
    """Stop the robot when a signal ends the program: SIGINT (Ctrl-C), SIGTERM, SIGHUP (the terminal is closed).

    The library installs no handlers unasked, and without one SIGTERM and SIGHUP end a program at once, while the arm
    moves on. Within this block a signal stops every arm that moves, from a thread of its own, whatever the main thread
    does, and raises in the main thread: SIGINT a KeyboardInterrupt, the others SystemExit with 128 and the signal's
    number (143, 129). A `Recorder`, a `LiveIdentifier` and `granular_id.identify` wait until the arm stands before they
    pass it on; a second signal ends that, and the program even where a driver hangs. Those that were made before a
    signal move nothing after it, in any thread, until their ``resume`` is called.

    What is ignored when the block begins stays ignored (``nohup``). At its end the handlers of before are back. Blocks
    may stand in one another.

    Raises
    ------
    RuntimeError
        Not in the main thread: Python gives signals to no other.

    Notes
    -----
    Nothing can be called on SIGKILL (``kill -9``), SIGQUIT, a crash or a power cut, nor while a C function keeps
    Python's lock; Ctrl-Z holds the program, not the arm. The motion then goes on for its own duration: know where the
    emergency stop is.

    Examples
    --------
    >>> import tempfile
    >>> from granular_id.live import Recorder, opened, stop_on_signals
    >>> with tempfile.TemporaryDirectory() as folder, stop_on_signals():
    ...     with opened("sim:rice?seed=1&speed=20") as stream:
    ...         recorded = Recorder(stream, stream.source.robot(), folder).record("rice")
    >>> recorded.recording.n_samples
    1600
    """
    if threading.current_thread() is not threading.main_thread():
        raise RuntimeError(
            "stop_on_signals must be entered in the main thread: Python gives signals to no other"
        )
    with ExitStack() as undo:
        outermost = not _BLOCKS
        if outermost:
            _STOPPED.clear()
        _BLOCKS.append(undo)
        undo.callback(_BLOCKS.pop)
        for number in SIGNALS:
            handler = signal.getsignal(number)
            if handler not in (signal.SIG_IGN, None):  # None: of another language, which cannot be put back
                undo.callback(signal.signal, number, handler)
                signal.signal(number, _raise)
        if outermost:  # the last, so that it has heard of every signal before the handlers of before are back
            undo.enter_context(_listening())
        yield


@contextmanager
def _listening() -> Iterator[None]:
    """Hear signals in a thread at once: the main thread may be held up by a driver."""
    ear, bell = socket.socketpair()
    bell.setblocking(False)
    before = signal.set_wakeup_fd(bell.fileno(), warn_on_full_buffer=False)

    def listen() -> None:
        with ear:
            while number := ear.recv(1):
                if before != -1:
                    with suppress(OSError):  # whoever listened before is not deaf meanwhile
                        os.write(before, number)
                if number[0] in SIGNALS and signal.getsignal(number[0]) is _raise:
                    _stop_all(number[0])

    thread = threading.Thread(target=listen, name="granular_id signals", daemon=True)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        bell.close()
        thread.join()


def _raise(signum: int, _frame: FrameType | None) -> None:
    # Arms are stopped by the thread that listens: this may run while the main thread holds one of their locks.
    _HEARD.append("main")
    _STOPPED.extend(tuple(MOVING))
    raise ending(signum)


def _stop_all(signum: int) -> None:
    _HEARD.append("listening")
    for one in tuple(MOVING):
        _STOPPED.append(one)
        one.stop(FailureReason.INTERRUPTED, f"ended by {signal.Signals(signum).name}")


@atexit.register
def _at_exit() -> None:
    """Stop what a thread that dies with the program would leave moving, and let nothing begin."""
    _HEARD.extend(("main", "listening"))
    moving = tuple(MOVING)
    for one in moving:
        one.stop(FailureReason.INTERRUPTED, "the program ended")
    for one in moving:
        one.standing.wait(_LEAVE_S)


def _forget() -> None:
    """Leave the parent's robots, and its ear for signals, to the parent."""
    MOVING.clear()
    if _BLOCKS:
        signal.set_wakeup_fd(-1)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)

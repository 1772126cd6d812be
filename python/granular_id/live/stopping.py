"""Robots in motion, and what stops them when the program is told to end."""

from __future__ import annotations

import atexit
import os
import signal
import socket
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING
from weakref import WeakSet

if TYPE_CHECKING:
    from granular_id.live.robot import Motion, Robot

__all__ = ["InMotion", "ending", "robot_was_stopped", "stop_on_signals"]

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
SIGNALS = tuple(signal.Signals[name] for name in _NAMES if hasattr(signal, name))
"""What asks a program to end: Ctrl-C, `kill`, a terminal or connection that closes; SIGBREAK is that of Windows."""

_GRACE_S = 0.2
"""So long has the main thread for stopping what moves: most drivers are used by one thread only."""

_IN_MOTION: set[InMotion] = set()

_HEARD: list[int] = []
"""Signals that the blocks of now have heard: nothing begins to move until the outermost one ends."""

_STOPPED: list[InMotion] = []
"""What moved when such a signal came, and was stopped for it."""

_TOLD: WeakSet[threading.Thread] = WeakSet()
"""Threads that ran when such a block ended: no exception tells them that the program is to end."""


class InMotion:
    """A robot that may move, from `begin` until it stands.

    `signum` is the signal that told it to stop; `is_ending`: the thread that drives it has called ``stop()``;
    `moves`: a motion of a machine was commanded; `was_stopped`: ``stop()`` is over, or there is no robot; `motion` is
    the last one that was commanded, and should end by itself until `due_s` of the monotonic clock.
    """

    def __init__(self, robot: Robot | None) -> None:
        self.signum: int | None = None
        self.was_stopped = robot is None
        self._robot = robot
        self._lock = threading.Lock()
        self.is_ending = self.moves = False
        self.motion: Motion | None = None
        self.due_s = 0.0
        self._in_main_thread = threading.current_thread() is threading.main_thread()

    @property
    def is_told(self) -> bool:
        """Whether a signal says that it must not move, or not any more."""
        return self.signum is not None or bool(_HEARD) or threading.current_thread() in _TOLD

    @property
    def keeps_signals(self) -> bool:
        """Whether the main thread is about to stop it, which no second signal may cut short."""
        about_to = self.is_ending or self.signum is not None
        return self._in_main_thread and about_to and not self.was_stopped

    @property
    def stands(self) -> bool:
        """Whether the last motion has ended; not where its robot cannot tell."""
        try:
            return self.motion is None or self.motion.finished()
        except Exception:  # whatever the robot's library raises
            return False

    def begin(self) -> None:
        """Note that it may move from now on, unless it `is_told` already: a signal sees the one or the other.

        A motion of the robot that goes on, though it was to stop, becomes its own.
        """
        for one in tuple(_IN_MOTION):
            if self._robot is not None and one._robot is self._robot:
                if not one.stands:
                    self.motion, self.moves = one.motion, one.moves
                if one.was_stopped:
                    _IN_MOTION.discard(one)
        _IN_MOTION.add(self)

    def command(self, motion: Motion, duration_s: float) -> Motion:
        """Take note of a motion that was commanded, for so long."""
        self.motion, self.due_s = motion, time.monotonic() + duration_s
        return motion

    def tell(self, signum: int) -> None:
        """Say in a thread of its own that a signal came; the main thread hears it by itself."""
        if not self._in_main_thread:
            self.signum = self.signum or signum

    def end(self) -> None:
        """Stop the robot; what a signal raises waits for `raise_signal`."""
        self.is_ending = True
        self.stop()

    def stop(self) -> None:
        """Stop the robot from any thread, one after the other."""
        if self._robot is None:
            return
        alone = self._lock.acquire(timeout=_GRACE_S)  # a driver that hangs there may still hear this call
        try:
            self._robot.stop()
        except Exception:
            self.was_stopped = True  # as far as it can be
            raise
        else:
            self.was_stopped = True
            if self.moves and _HEARD:
                _STOPPED.append(self)
        finally:
            if alone:
                self._lock.release()

    def over(self, *, stands: bool) -> None:
        """Note that it stands or was stopped; where it goes on nevertheless, who begins next is to know."""
        if not (stands or self.was_stopped):  # the signal came right before
            self.stop()
        if stands or self.stands:
            _IN_MOTION.discard(self)

    def raise_signal(self) -> None:
        """Raise what a signal has asked for meanwhile."""
        if self.signum is not None and self._in_main_thread:
            raise ending(self.signum)


def ending(signum: int) -> BaseException:
    """Return what a signal raises: KeyboardInterrupt, or SystemExit with the code by which shells know it."""
    return KeyboardInterrupt() if signum == signal.SIGINT else SystemExit(128 + signum)


def robot_was_stopped() -> bool:
    """Whether a signal that the blocks of now have heard has stopped a robot."""
    return bool(_STOPPED)


@contextmanager
def stop_on_signals() -> Iterator[None]:
    """Stop the robot when the program is told to end: SIGINT (Ctrl-C), SIGTERM, SIGHUP (the terminal is closed).

    The library installs no handlers unasked, and without one SIGTERM and SIGHUP end a program at once, while the arm
    moves on. Within this block each of them raises in the main thread: SIGINT a KeyboardInterrupt, the others
    SystemExit with 128 and the signal's number (143, 129). A `Recorder`, a `LiveIdentifier` and
    `granular_id.identify` call the robot's ``stop()`` on the way out. Where the main thread is held up (in a driver, or
    because the push runs in another thread) a thread of this block calls it after 0.2 s. Further signals wait until
    ``stop()`` has returned. Once a signal was heard, no motion begins in this block, nor later in another thread that
    ran within it: pushes there end with `FailureReason.INTERRUPTED`.

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
        if _raise not in map(signal.getsignal, SIGNALS):  # no block stands around this one
            undo.callback(_over)
        ear, bell = socket.socketpair()
        bell.setblocking(False)
        fd_before = signal.set_wakeup_fd(bell.fileno(), warn_on_full_buffer=False)
        leaving = threading.Event()
        watch = threading.Thread(
            target=_watch, args=(ear, fd_before, leaving), name="granular_id signals", daemon=True
        )
        watch.start()
        undo.callback(watch.join, _GRACE_S)  # so that it is not late to write where others write by then
        undo.callback(bell.close)
        undo.callback(leaving.set)
        undo.callback(signal.set_wakeup_fd, fd_before)
        for number in SIGNALS:
            handler = signal.getsignal(number)
            if handler not in (signal.SIG_IGN, None):  # None: of another language, which cannot be put back
                undo.callback(signal.signal, number, handler)
                signal.signal(number, _raise)
        try:
            yield
        finally:
            _stop_all(one for one in tuple(_IN_MOTION) if one.signum is not None and not one.was_stopped)


def _over() -> None:
    if _HEARD:
        _TOLD.update(set(threading.enumerate()) - {threading.main_thread()})
    _HEARD.clear()
    _STOPPED.clear()


def _raise(signum: int, _frame: FrameType | None) -> None:
    _HEARD.append(signum)
    moving = tuple(_IN_MOTION)
    waits = any(one.keeps_signals for one in moving)
    for one in moving:
        one.signum = one.signum or signum
    if not waits:
        raise ending(signum)


def _watch(ear: socket.socket, fd_before: int, leaving: threading.Event) -> None:
    """Hear signals at once, whatever the main thread does, and stop what it leaves moving."""
    with ear:
        while number := ear.recv(1):
            if fd_before != -1 and not leaving.is_set():
                with suppress(OSError):  # whoever listened before is not deaf meanwhile
                    os.write(fd_before, number)
            if number[0] in SIGNALS and signal.getsignal(number[0]) is _raise:
                _HEARD.append(number[0])  # the main thread may be long in hearing it
                moving = tuple(_IN_MOTION)
                leaving.wait(_GRACE_S)
                left = [one for one in moving if one in _IN_MOTION and not (one.is_ending or one.was_stopped)]
                for one in left:
                    one.tell(number[0])
                with suppress(Exception):  # the thread that drives it tries again, and reports it
                    _stop_all(left)


@atexit.register
def _at_exit() -> None:
    """Stop what a thread that dies with the program would leave moving."""
    _stop_all(one for one in tuple(_IN_MOTION) if not one.was_stopped)


def _stop_all(moving: Iterable[InMotion]) -> None:
    with ExitStack() as stack:  # one that fails does not save the others from it
        for one in moving:
            stack.callback(one.stop)


def _forget() -> None:
    """Leave the parent's robots, and its ear for signals, to the parent."""
    _IN_MOTION.clear()
    if signal.getsignal(signal.SIGTERM) is _raise or signal.getsignal(signal.SIGINT) is _raise:
        signal.set_wakeup_fd(-1)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)

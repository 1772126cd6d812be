"""Signals that end a command: never lost, the robot is stopped, and the signal named."""

from __future__ import annotations

import _thread
import os
import select
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, TextIO

from granular_id.cli.outputs import show

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_AGAIN_S = 0.02
_LOOK_S = 0.1
"""Between two looks whether anybody reads what is written."""

NO_READER = 141
"""Exit code where nobody reads what is written: that of SIGPIPE, as shells know it."""

_ENDINGS = {
    128 + number: number
    for number in signal.Signals
    if number.name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
}
"""Exit codes by which shells know these signals."""


def raise_again(dropped: UnraisableHookArgs) -> None:
    """Repeat a Ctrl-C, or another signal that ends the program, that Python drops: a `sys.unraisablehook`.

    One that arrives while an object is being deleted (`zipfile.ZipFile` closes itself then) is printed as "ignored",
    and the program would go on to its end. It is raised again a moment later, from outside the deletion.
    """
    number = _signal_of(dropped.exc_value)
    if number is None:
        sys.__unraisablehook__(dropped)
        return
    again = threading.Timer(_AGAIN_S, _thread.interrupt_main, (number,))
    again.daemon = True
    again.start()


@contextmanager
def stopping_the_robot() -> Iterator[None]:
    """Stop the robot on every signal that ends a session, say so where it moved, and exit with the signal's code."""
    from granular_id.live.signals import stop_on_signals, stopped_robots

    over, unread = threading.Event(), threading.Event()
    with stop_on_signals():
        threading.Thread(target=_watch_output, args=(over, unread), daemon=True).start()
        try:
            yield
        except (KeyboardInterrupt, SystemExit) as end:
            number = _signal_of(end)
            if number is None:
                raise
            leave_lost_terminal()
            stopped = stopped_robots()
            robot = {True: "the robot is stopped, ", False: "THE ROBOT MAY STILL MOVE, ", None: ""}[stopped]
            why = "Nobody reads the output" if unread.is_set() else f"Ended by {number.name}"
            if stopped is not None or not unread.is_set():
                show(f"{why}: {robot}no file was left half-written.", "yellow", err=True)
            sys.exit(NO_READER if unread.is_set() else 128 + number)
        finally:
            over.set()


def _watch_output(over: threading.Event, unread: threading.Event) -> None:
    """End a session, as SIGHUP does, where nobody reads its output: connections without a terminal send no signal."""
    piped = not sys.stdout.isatty()  # a terminal that is closed sends its own signal, too
    while not over.wait(_LOOK_S):
        if is_lost(sys.stdout):
            if piped:
                unread.set()
            _thread.interrupt_main(signal.SIGHUP)
            return


def is_lost(stream: TextIO) -> bool:
    """Whether the reader of a pipe is gone, or the terminal."""
    if not hasattr(select, "poll"):  # Windows
        return False
    poll = select.poll()
    try:
        poll.register(stream.fileno(), 0)
    except ValueError:  # no file
        return False
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))


def leave_lost_terminal() -> None:
    """Write to nowhere from now on where a terminal is gone: what ends a program also ends what it writes to."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(ValueError):  # no file
            descriptor = stream.fileno()
            try:
                stream.flush()
                os.write(descriptor, b"")
                lost = is_lost(stream)
            except OSError:
                lost = True
            if lost:
                os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)


def _signal_of(error: BaseException | None) -> signal.Signals | None:
    """Return the signal that an exception stands for."""
    if isinstance(error, KeyboardInterrupt):
        return signal.SIGINT
    code = error.code if isinstance(error, SystemExit) else None
    return _ENDINGS.get(code) if isinstance(code, int) else None

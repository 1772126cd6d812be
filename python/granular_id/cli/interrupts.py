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

import typer

from granular_id.cli.outputs import show

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_AGAIN_S = 0.02
_LOOK_S = 0.1
"""Between two looks whether anybody reads what is written."""

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

    over = threading.Event()
    with stop_on_signals():
        threading.Thread(target=_watch_output, args=(over,), daemon=True).start()
        try:
            yield
        except (KeyboardInterrupt, SystemExit) as end:
            number = _signal_of(end)
            if number is None:
                raise
            leave_lost_terminal()
            robot = {True: "the robot is stopped, ", False: "THE ROBOT MAY STILL MOVE, ", None: ""}[
                stopped_robots()
            ]
            show(f"Ended by {number.name}: {robot}no file was left half-written.", "yellow", err=True)
            raise typer.Exit(128 + number) from None
        finally:
            over.set()


def _watch_output(over: threading.Event) -> None:
    """Raise SIGHUP where nobody reads standard output any more: connections without a terminal end without a signal."""
    while not over.wait(_LOOK_S):
        if _is_lost(sys.stdout):
            _thread.interrupt_main(signal.SIGHUP)
            return


def _is_lost(stream: TextIO) -> bool:
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
                lost = _is_lost(stream)
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

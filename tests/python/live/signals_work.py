"""A session whose robot notes its calls, in a process of its own, to be ended by a signal.

Usage: signals_work.py DESCRIPTOR HOW FOLDER | WORDS OF A COMMAND
"""

import os
import signal
import sys
import threading
from contextlib import nullcontext, suppress
from types import SimpleNamespace

import numpy as np

from granular_id.live import (
    CaptureError,
    Recorder,
    SourceInfo,
    ThreadedSource,
    host_ns,
    opened,
    signals,
    source as sources,
    stop_on_signals,
    supervisor,
)
from granular_id.live.robot import TimedMotion

NOTES, HOW, *WORDS = os.fdopen(int(sys.argv[1]), "w", encoding="utf-8"), *sys.argv[2:]
moves, once = threading.Event(), iter([True])


def note(what):
    NOTES.write(f"{what}\n")
    NOTES.flush()


class Bench(ThreadedSource):
    """A sensor that feels nothing."""

    def __init__(self, _url=None):
        super().__init__(SourceInfo("bench", 500, device_clock=True, synthetic=True))

    def deliver(self, buffer, stopping):
        pace, n = sources.Pace(self.info), 0
        while not stopping.wait(pace.period_s):
            ticks = n + np.arange(pace.due(n))
            buffer.push_block(0.01 * np.sin(ticks[:, None] * np.ones(6)), ticks / 500)
            n += len(ticks)

    def robot(self):
        return NotingRobot()


class NotingRobot:
    """Notes when the tool moves and each call of `stop`."""

    n_stops = 0

    def move_line(self, _direction, _speed_m_s, duration_s):
        self.motion = motion = TimedMotion(host_ns(), duration_s)
        ended = motion.finished

        def finished():
            if host_ns() >= motion.start_host_ns and not moves.is_set():
                moves.set()
                if HOW not in ("deaf", "held up"):
                    note("moves")
            return HOW not in ("hangs", "broken") and ended()

        motion.finished = finished
        return motion

    def stop(self):
        note("stop")
        self.n_stops += 1
        if HOW == "hangs" or (HOW == "hangs once" and self.n_stops == 1):
            threading.Event().wait()
        if HOW == "broken":
            raise ConnectionError("the arm does not answer")
        self.motion.cancel()

    def move_back(self):
        """Stay."""


def on_step(*_):
    if HOW == "deaf" and moves.is_set() and next(once, False):
        with suppress(BaseException):
            note("moves")
            threading.Event().wait()
    elif HOW == "held up" and moves.is_set():
        signal.pthread_sigmask(signal.SIG_BLOCK, signals.SIGNALS)  # as C code does, it hears of no signal
        note("moves")
        os.read(0, 1)
        note("goes on")


def record(folder):
    with opened(Bench()) as stream:
        recorder = Recorder(stream, stream.source.robot(), folder, on_step=on_step)
        try:
            while True:
                recorder.record("rice")
        except CaptureError as error:
            note(error.reason.value)


def main():
    if HOW == "broken":
        supervisor._BRAKE_S = 0.0
    signals._LEAVE_S = 0.2
    if WORDS[0] in ("record", "live"):
        from granular_id.cli import main as command

        sys.argv = ["granular-id", *WORDS]
        command()
    elif HOW == "exit":
        threading.Thread(target=record, args=WORDS, daemon=True).start()
        moves.wait()  # the program is over then, and its thread with it
    else:
        with stop_on_signals(), stop_on_signals() if HOW == "nested" else nullcontext():
            if HOW == "thread":
                threading.Thread(target=record, args=WORDS).start()
                threading.Event().wait()  # not join(): Python forgets a thread whose join() a signal has ended
            else:
                record(*WORDS)


sources.entry_points = lambda group: [SimpleNamespace(name="bench", load=lambda: Bench)]
main()

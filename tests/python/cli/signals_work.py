"""A session with a robot that notes when it is told what, in a process of its own, to be ended by a signal.

Usage: signals_work.py LOG command|api|thread|nested|deaf|blocked|slow|broken|exit FOLDER|words of a command
       signals_work.py LOG during|between|leaving MODEL
"""

from __future__ import annotations

import hashlib
import sys
import threading
import time
from pathlib import Path

from granular_id import Identifier
from granular_id.live import CaptureError, LiveIdentifier, Recorder, Views, opened, setup_of, stop_on_signals
from granular_id.live.sim import SimRobot, SimSource

LOG, WHAT, *WORDS = Path(sys.argv[1]), *sys.argv[2:]


def note(what):
    with LOG.open("a", encoding="utf-8") as log:
        log.write(f"{time.monotonic_ns()} {what}\n")


class NotingRobot(SimRobot):
    """Notes each call; with `blocked`, the call of the driver keeps the main thread in C for seconds."""

    def move_line(self, direction, speed_m_s, duration_s):
        motion = super().move_line(direction, speed_m_s, duration_s)
        note("moving")
        if WHAT == "blocked":
            try:
                hashlib.pbkdf2_hmac("sha256", b"", b"", 3_000_000)
            finally:
                note("driver returns")
        return motion

    def stop(self):
        note("stop begins")
        if WHAT == "slow":
            time.sleep(0.5)  # a second signal comes meanwhile
        super().stop()
        note("stop")
        if WHAT == "broken":
            raise ConnectionError("the arm does not answer")


def robot(source):
    return NotingRobot(source)


SimSource.robot = robot


def record(folder):
    with opened("sim:rice?seed=1") as stream:
        on_step = swallow if WHAT == "deaf" else None
        Recorder(stream, stream.source.robot(), folder, on_step=on_step).record("rice")


def swallow(step, capture):
    try:
        time.sleep(0.05)
    except BaseException:
        note("swallowed")


class NotingView:
    """Notes provisional answers."""

    def show(self, snapshot):
        if snapshot.decision is not None and not snapshot.decision.final:
            note("provisional answer")

    def close(self):
        pass


def name(model, over):
    """Name pushes until it is told to end; it hears of a signal during a push, or while nothing moves."""
    speed = 1 if WHAT == "during" else 20
    with opened(f"sim:rice?seed=1&speed={speed}") as stream:
        live = LiveIdentifier(
            stream, model, setup_of(stream.source), early=True, pre_s=0.25, views=Views([NotingView()])
        )
        try:
            for push in live.pushes():
                note("answer" if push.reason is None else push.reason.value)
                if WHAT != "during":
                    time.sleep(1)
        except CaptureError as error:
            note(error.reason.value)
    over.set()


def name_in_a_thread(model):
    over = threading.Event()  # Python forgets a thread whose join() a signal has ended
    with stop_on_signals():
        threading.Thread(target=name, args=(Identifier.load(model), over)).start()
        try:
            over.wait()
        finally:
            if WHAT == "between":  # else the block is left before the thread goes on
                over.wait()


def main():
    if WORDS[0] in ("record", "live"):
        from granular_id.cli import main as command

        sys.argv = ["granular-id", *WORDS]
        command()
        return
    if WHAT in ("during", "between", "leaving"):
        name_in_a_thread(WORDS[0])
        return
    folder = WORDS[0]
    if WHAT == "exit":
        threading.Thread(target=record, args=(folder,), daemon=True).start()
        while not (LOG.exists() and LOG.read_text("utf-8")):
            time.sleep(0.01)
        return  # the program is over, and its thread with it
    with stop_on_signals():
        if WHAT == "thread":
            worker = threading.Thread(target=record, args=(folder,))
            worker.start()
            worker.join()
        elif WHAT == "nested":
            with stop_on_signals():
                record(folder)
        else:
            record(folder)


main()

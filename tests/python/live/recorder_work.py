"""A recorder in a process of its own: interrupted, killed, or with a full disk.

Usage: recorder_work.py interrupt|kill|full FOLDER
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

from granular_id.live.recorder import Recorder
from granular_id.live.sim import SimRobot, SimSource
from granular_id.live.stream import opened


class TalkingRobot(SimRobot):
    def move_line(self, direction, speed_m_s, duration_s):
        motion = super().move_line(direction, speed_m_s, duration_s)
        print("moving", flush=True)
        return motion

    def stop(self):
        super().stop()
        print("robot stopped", flush=True)


class TalkingSource(SimSource):
    def stop(self):
        super().stop()
        print("source stopped", flush=True)


def main(what: str, folder: str) -> None:
    speed = 1 if what == "interrupt" else 20
    source = TalkingSource("rice", seed=1, speed=speed)
    with opened(source) as stream:
        recorder = Recorder(stream, TalkingRobot(source), folder)
        if what == "interrupt":
            recorder.record("rice")
            return
        recorder.record("rice")
        print("one is there", flush=True)
        if what == "kill":
            slow_writes()
        else:
            resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
        recorder.record("rice")


def slow_writes() -> None:
    write = np.lib.format.write_array

    def slow(file, array, **options):
        write(file, array, **options)
        print("writing", flush=True)
        time.sleep(120)

    np.lib.format.write_array = slow


main(*sys.argv[1:])

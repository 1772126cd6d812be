"""From a row beyond a limit of force to the robot's stop().

    python benches/limit_to_stop.py --hits 1000
    python benches/limit_to_stop.py --hits 1000 --busy 2
    python benches/limit_to_stop.py --hits 100 --busy 2 --consumer sleeps

A sensor at 500 Hz, read by a thread of Python, feels 60 N at a random moment of a push with a limit of 50 N. The time
is from when the row beyond entered the buffer to the call of ``stop()``; driver and arm come on top. Beside it so many
other programs compute; the consumer of the rows does nothing, computes in Python, or sleeps for 1 s at each step. The
host of a virtual machine may take a processor away, often for 100 ms, from programs of any priority: hits for most of
whose time it did so are counted apart (``taken``). Take real-time priority away by
``setpriv --bounding-set=-sys_nice --inh-caps=-sys_nice python ...``.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from granular_id.live import (
    CallbackRobot,
    CaptureError,
    Recorder,
    SourceInfo,
    ThreadedSource,
    host_ns,
    opened,
)
from granular_id.live.priority import at_once

_RATE_HZ, _LIMIT_N = 500.0, 50.0


class Sensor(ThreadedSource):
    """Feels 60 N from `hit_ns` on, and notes when it delivered the first row beyond the limit."""

    def __init__(self) -> None:
        super().__init__(SourceInfo("bench", _RATE_HZ, device_clock=True))
        self.hit_ns, self.sent_ns, self.stolen_ms = 0, 0, 0.0

    def deliver(self, buffer: Any, stopping: threading.Event) -> None:
        begun_ns = host_ns()
        for k in range(1 << 30):
            time.sleep(max(0.0, k / _RATE_HZ - 1e-9 * (host_ns() - begun_ns)))
            if stopping.is_set():
                return
            is_hit = 0 < self.hit_ns <= host_ns()
            if is_hit and not self.sent_ns:
                self.stolen_ms = stolen_ms()
                self.sent_ns = host_ns()
            buffer.push([60.0 * is_hit + 0.01 * (k % 3), 0, 0, 0, 0, 0], k / _RATE_HZ)


def stolen_ms() -> float:
    """Return how long the host of this virtual machine has held up its processors."""
    try:
        ticks = Path("/proc/stat").read_text().split(maxsplit=9)[8]
        return 1e3 * float(ticks) / os.sysconf("SC_CLK_TCK")
    except OSError:
        return 0.0


def consume(kind: str) -> None:
    """Do what a consumer does with a step."""
    if kind == "sleeps":
        time.sleep(1.0)
    elif kind == "computes":
        sum(i * i for i in range(20_000))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--hits", type=int, default=1000)
    parser.add_argument("--busy", type=int, default=0, help="programs that compute beside it")
    parser.add_argument("--consumer", choices=("none", "computes", "sleeps"), default="none")
    options = parser.parse_args()
    draw, took_ms, taken_ms, sensor = random.Random(1), list[float](), list[float](), Sensor()
    stops = list[int]()

    def push(*_: object) -> None:
        sensor.hit_ns = host_ns() + round(1e9 * draw.uniform(0.02, 0.1))

    robot = CallbackRobot(push, lambda: stops.append(host_ns()))
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(options.busy)]
    try:
        with opened(sensor) as stream, tempfile.TemporaryDirectory() as folder:
            recorder = Recorder(
                stream,
                robot,
                folder,
                n_samples=125,
                pre_s=0.05,
                max_force_n=_LIMIT_N,
                on_step=lambda *_: consume(options.consumer),
            )
            while len(took_ms) < options.hits:
                try:
                    recorder.record("rice")
                except CaptureError:
                    ms = 1e-6 * (stops[0] - sensor.sent_ns)
                    time.sleep(0.02)  # it is counted by ticks
                    by_host = stolen_ms() - sensor.stolen_ms > max(ms / 2, 5.0) and ms > 5.0
                    (taken_ms if by_host else took_ms).append(ms)
                sensor.hit_ns = sensor.sent_ns = 0
                stops.clear()
                recorder.resume()
    finally:
        for one in busy:
            one.kill()
    with at_once() as granted:
        quantiles = np.quantile(took_ms, [0.5, 0.99, 0.999])
    names = ("median", "p99", "p99.9")
    figures = {name: round(float(value), 2) for name, value in zip(names, quantiles, strict=True)}
    about = {**vars(options), "real_time": granted, "load": round(os.getloadavg()[0], 1)}
    taken = {"hits": len(taken_ms), "largest": round(max(taken_ms, default=0.0), 2)}
    print(json.dumps(about | {"ms": figures | {"largest": round(max(took_ms), 2)}, "taken": taken}))


if __name__ == "__main__":
    main()

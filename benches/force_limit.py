"""From a sample beyond the limit of force to the call of the robot's ``stop()``, beside busy programs.

Run: python benches/force_limit.py [record|live|views] [--sensor box] [--hits 2000] [--busy 2] [--usual]. A robot that
is a clock pushes with ``max_force_n``; one sample, drawn at random, is of 60 N. `thread`: from a source in Python,
noted right before it is pushed. `box`: from a fake Net F/T in another process, noted right before it is sent.
`views`: with the screen of a terminal and the page. `--usual`: without real-time priority.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import random
import time
import warnings
from contextlib import nullcontext, suppress
from io import StringIO
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console

import granular_id as gid
from granular_id import live
from granular_id.live import drive
from granular_id.live.robot import TimedMotion
from granular_id.testing import FakeNetft

RATE_HZ, BEYOND_N = 500, 60.0
NOISE = np.random.default_rng(0).normal(0, 0.02, (4096, 6))


def is_due(left: Any, sent_ns: Any) -> bool:
    """Count the samples until the one beyond; note when it is its turn."""
    if not left.value:
        return False
    left.value -= 1
    if left.value:
        return False
    sent_ns.value = time.monotonic_ns()
    return True


class Thread(live.ThreadedSource):
    def __init__(self, hit: Any) -> None:
        super().__init__(live.SourceInfo("bench", RATE_HZ, device_clock=True))
        self._hit = hit

    def deliver(self, buffer: Any, stopping: Any) -> None:
        begin, k = time.monotonic(), 0
        while not stopping.is_set():
            time.sleep(max(0.0, begin + k / RATE_HZ - time.monotonic()))
            buffer.push([BEYOND_N, 0, 0, 0, 0, 0] if is_due(*self._hit) else NOISE[k % 4096], k / RATE_HZ)
            k += 1


class Box(FakeNetft):
    hit: Any

    def _send_due(self) -> None:
        if self._next is not None and self._next[0] <= time.monotonic() and is_due(*self.hit):
            when, datagram = self._next
            counts = int(1e6 * BEYOND_N).to_bytes(4, "big")
            self._next = when, datagram._replace(data=datagram.data[:12] + counts + datagram.data[16:])
        super()._send_due()


def be_the_box(hit: Any, urls: Any) -> None:
    with suppress(OSError):  # a box of its own would wait for no processor
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    Box.hit = hit
    with Box(NOISE, rate_hz=RATE_HZ, synthetic=False) as box:
        urls.put(box.url)
        box.wait()


def be_busy() -> None:
    while True:
        sum(range(10_000))


class Arm:
    """Moves by the clock; orders the sample beyond, and notes how long it took to be stopped."""

    def __init__(self, hit: Any, n_samples: int) -> None:
        (self._left, self._sent_ns), self._n, self._draw = hit, n_samples, random.Random(1)
        self._motion = TimedMotion(0, 0)
        self.took_ms: list[float] = []

    def tcp_pose(self) -> None:
        return None

    def move_line(self, *move: Any) -> TimedMotion:
        self._left.value = self._draw.randint(2, self._n)
        self._motion = TimedMotion(live.host_ns(), move[-1])
        return self._motion

    def stop(self) -> None:
        if self._sent_ns.value:
            self.took_ms.append(1e-6 * (time.monotonic_ns() - self._sent_ns.value))
        self._sent_ns.value = self._left.value = 0
        self._motion.cancel()


def measure(kind: str, n_hits: int, source: Any, hit: Any) -> list[float]:
    rest_s, n = (0.02, 60) if kind == "record" else (0.25, 300)
    arm = Arm(hit, n - round(rest_s * RATE_HZ))
    limits = {"max_force_n": 50.0, "rate_tolerance": 1.0, "max_gap": 100, "pre_s": rest_s}
    with TemporaryDirectory() as folder, live.opened(source) as stream, live.Views([]) as views:
        if kind == "record":
            recorder = live.Recorder(stream, arm, folder, n_samples=n, **limits)
        else:
            data = gid.synthesize(["rice", "oat flakes"], 6, duration_s=n / RATE_HZ)
            model = gid.Identifier.fit(data, "multiband", estimate=False)
            if kind == "views":
                views.add(live.TerminalView(Console(file=StringIO(), force_terminal=True, width=140)))
                views.add(live.MonitorServer(0))
            setup = live.setup_of(stream.source, arm)
            identifying = live.LiveIdentifier(stream, model, setup, views=views, **limits)
        while len(arm.took_ms) < n_hits:
            with suppress(live.CaptureError):
                recorder.record("nothing") if kind == "record" else identifying.push()
    return arm.took_ms


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("kind", choices=("record", "live", "views"), nargs="?", default="record")
    parser.add_argument("--sensor", choices=("thread", "box"), default="thread")
    parser.add_argument("--hits", type=int, default=2000)
    parser.add_argument("--busy", type=int, default=2)
    parser.add_argument("--usual", action="store_true")
    options = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    hit, urls = [context.Value("q", 0) for _ in range(2)], context.SimpleQueue()
    beside = [context.Process(target=be_busy, daemon=True) for _ in range(options.busy)]
    if options.sensor == "box":
        beside.append(context.Process(target=be_the_box, args=(hit, urls), daemon=True))
    if options.usual:
        drive.at_once = lambda *_: nullcontext()
        warnings.simplefilter("ignore")
    for process in beside:
        process.start()
    try:
        source = live.open_source(urls.get()) if options.sensor == "box" else Thread(hit)
        took_ms = np.array(measure(options.kind, options.hits, source, hit))
    finally:
        for process in beside:
            process.kill()
    print(vars(options), f"{os.cpu_count()} cores, load {os.getloadavg()[1]:.1f}; ms from sample to stop():")
    at = "  ".join(f"{p:g} %: {np.percentile(took_ms, p):.2f}" for p in (50, 90, 99, 99.9, 100))
    print(f"{at}; {np.count_nonzero(took_ms > 5)} over 5 ms")


if __name__ == "__main__":
    main()

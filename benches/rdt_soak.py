"""How late and how complete samples of a sensor box arrive while Python is busy.

    python benches/rdt_soak.py --rate-hz 500 --seconds 600
    python benches/rdt_soak.py --rate-hz 7000 --seconds 60

A fake box in a process of its own sends records over loopback and notes ``time.monotonic_ns()`` right before each is
sent. The client receives them in this process, whose main thread meanwhile computes and never gives the interpreter
away for long: Python loops, and calls into C that hold it for tenths of a second. Lateness of a sample is the stamp
that its row got in the buffer minus the box's note: the way through the kernel and the waking of the receiver thread,
and none of the box's own lateness in sending. Both stamps are of the same clock of the system; the constant between
their zeros is measured at the end of the run, to a microsecond.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from granular_id._core import WrenchBuffer, host_ns
from granular_id.live.source import open_source


def be_busy(until_s: float) -> dict[str, float]:
    """Compute until then; returns how long calls held the interpreter at most, and how many there were."""
    numbers = np.random.default_rng(0).permutation(400_000).tolist()
    longest = calls = 0
    while time.monotonic() < until_s:
        before = time.monotonic()
        sorted(numbers)  # one call, during which no other Python thread runs
        longest, calls = max(longest, time.monotonic() - before), calls + 1
        sum(i * i for i in range(300_000))
    return {"calls": calls, "longest_call_ms": round(1e3 * longest, 1)}


def clock_offset_ns() -> int:
    """Add this to `host_ns` and get ``time.monotonic_ns``."""
    pairs = [(time.monotonic_ns(), host_ns(), time.monotonic_ns()) for _ in range(10_000)]
    before, ours, after = min(pairs, key=lambda pair: pair[2] - pair[0])
    return (before + after) // 2 - ours


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rate-hz", type=float, default=500.0)
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    n_records = round(options.rate_hz * options.seconds)
    with tempfile.TemporaryDirectory() as folder:
        stamps = Path(folder, "stamps.npy")
        command = [sys.executable, "-m", "granular_id.testing", "--rate-hz", str(options.rate_hz)]
        command += ["--records", str(n_records), "--stamps", str(stamps)]
        box = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert box.stdout is not None
        source = open_source(box.stdout.readline().strip())
        buffer = WrenchBuffer(options.seconds + 10, rate_hz=source.info.rate_hz, tick_hz=source.info.tick_hz)
        reader = buffer.reader(from_oldest=True)
        source.start(buffer)
        until_s = time.monotonic() + options.seconds
        busy = be_busy(until_s)
        box.wait()
        source.stop()
        sent_ns = np.load(stamps).astype(np.int64)
    offset_ns = clock_offset_ns()
    block = reader.read()
    counters = source.health().counters
    if counters["requests"] != 1 or len(sent_ns) != n_records:
        sys.exit(f"the stream was requested {counters['requests']} times: run it again")
    number = (block.ticks - block.ticks[0]).astype(np.int64) // round(
        source.info.tick_hz / source.info.rate_hz
    )
    late_us = (block.host_ns.astype(np.int64) + offset_ns - sent_ns[number]) / 1e3
    behind_ns = sent_ns - np.arange(n_records) * 1e9 / source.info.rate_hz
    figures = {
        "rate_hz": source.info.rate_hz,
        "seconds": options.seconds,
        "sent": n_records,
        "received": len(block),
        "lost": n_records - len(block),
        "late_us": {
            "median": round(float(np.median(late_us)), 1),
            "p99.9": round(float(np.quantile(late_us, 0.999)), 1),
            "largest": round(float(late_us.max()), 1),
        },
        "over_1_ms": int(np.count_nonzero(late_us > 1000)),
        "box_itself_late_us_p99.9": round(float(np.quantile((behind_ns - behind_ns.min()) / 1e3, 0.999)), 1),
        "busy": busy,
        "load": os.getloadavg(),
        "counters": {name: count for name, count in counters.items() if count},
    }
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()

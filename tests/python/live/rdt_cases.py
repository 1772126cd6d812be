"""A fake box and a client of ours, run to the end of the stream."""

from __future__ import annotations

import time
from dataclasses import asdict

import numpy as np

from granular_id._core import WrenchBuffer
from granular_id.live.rdt import RdtSource
from granular_id.testing import FakeNetft, Faults

RATE_HZ, TICK_HZ = 2000.0, 8000.0
COMPARED = (
    "lost", "duplicates", "reordered", "stale", "malformed", "implausible", "out_of_range", "bad_status",
    "saturated", "warnings", "restarts", "rows",
)  # fmt: skip


TWICE = "the machine is so busy that the stream had to be asked for twice"


def signal(n=700, seed=0):
    """Wrenches that counts hold exactly, so that what arrives must be what was sent, to the last bit."""
    rng = np.random.default_rng(seed)
    return rng.integers(-5_000_000, 5_000_000, size=(n, 6)) / 1e6


def source_of(box, **options):
    return RdtSource("127.0.0.1", box.port, http_port=box.http_port, **options)


def buffer_of(source, seconds=10.0, **options):
    return WrenchBuffer(seconds, rate_hz=source.info.rate_hz, tick_hz=source.info.tick_hz, **options)


def until(condition, timeout_s=20.0):
    """Wait for something that must happen, however busy the machine is."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.005)


def run(faults=None, **options):
    """Receive a whole stream. Returns source, buffer, its reader and the box."""
    expected = 1 + (faults.deaf if faults else 0)
    for _ in range(5):
        source, buffer, reader, box = run_once(faults, **options)
        # on a busy machine the first record may take longer than the client's patience
        if source.health().counters["requests"] == expected:
            return source, buffer, reader, box
    raise AssertionError(TWICE)


def run_once(faults, *, n_records=700, reorder_depth=64, options=None, **box_options):
    """Receive a stream that may have been asked for twice."""
    settings = {"rate_hz": RATE_HZ, "tick_hz": TICK_HZ, "seed": 3, **box_options}
    with FakeNetft(signal(), faults=faults, n_records=n_records, **settings) as box:
        source = source_of(box, **(options or {}))
        buffer = buffer_of(source, reorder_depth=reorder_depth)
        reader = buffer.reader(from_oldest=True)
        source.start(buffer)
        try:
            assert box.wait(60)
        finally:
            source.stop()
        until(lambda: box.requests[-1][2:4] == b"\0\0")
    return source, buffer, reader, box


def counted(source):
    counters = source.health().counters
    return {name: counters[name] for name in COMPARED}


def injected(box):
    made = {**asdict(box.injected), "rows": box.injected.rows}
    return {name: made[name] for name in COMPARED}


def every_fault(share):
    return Faults(
        loss=share, duplicate=share, reorder=share, stale=share, garbage=share, forged=share, absurd=share,
        bad_status=share, saturation=share, warning=share,
    )  # fmt: skip

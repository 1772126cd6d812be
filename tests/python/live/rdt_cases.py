"""A fake box and a client of ours, run to the end of the stream."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import asdict

import numpy as np

from granular_id._core import WrenchBuffer
from granular_id.live.rdt import RdtSource
from granular_id.testing import FakeNetft
from sink_cases import rows_in

RATE_HZ, TICK_HZ = 1750.0, 7000.0
STOP, START, BUFFERED, BIAS = (b"\x12\x34\0" + bytes([code, 0, 0, 0, 0]) for code in (0, 2, 3, 0x42))
COMPARED = ("lost", "duplicates", "reordered", "bad_status", "rows")


def signal(n=700, seed=0):
    """Wrenches that counts hold exactly, so that what arrives must be what was sent, to the last bit."""
    rng = np.random.default_rng(seed)
    return rng.integers(-5_000_000, 5_000_000, size=(n, 6)) / 1e6


def source_of(box, **options):
    return RdtSource("127.0.0.1", box.port, http_port=box.http_port, **options)


def buffer_of(source, seconds=10.0, **options):
    return WrenchBuffer(seconds, rate_hz=source.info.rate_hz, tick_hz=source.info.tick_hz, **options)


def taken(buffer, n):
    """Wait for the first n rows; return their wrenches."""
    return rows_in(buffer, n)[0].wrench[:n]


@contextmanager
def streaming(box, *, seconds=10.0, reorder_depth=0, source=None, **options):
    """A source that writes into a buffer, stopped at the end."""
    source = source_of(box, **options) if source is None else source
    buffer = buffer_of(source, seconds, reorder_depth=reorder_depth)
    source.start(buffer)
    try:
        yield source, buffer
    finally:
        source.stop()


def run(faults=None, *, n_records=700, buffered=False, page=None):
    """Receive a whole stream. Returns source, reader and box."""
    with (
        FakeNetft(signal(), rate_hz=RATE_HZ, faults=faults, n_records=n_records, page=page, seed=3) as box,
        streaming(box, reorder_depth=64, buffered=buffered) as (source, buffer),
    ):
        assert box.wait(60)
    return source, buffer.reader(from_oldest=True), box


def counted(source):
    counters = source.health().counters
    return {name: counters[name] for name in COMPARED}


def injected(box):
    made = {**asdict(box.injected), "rows": box.injected.sent}
    return {name: made[name] for name in COMPARED}

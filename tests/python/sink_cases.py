"""What a source writes into a buffer, for tests of sources."""

from __future__ import annotations

import numpy as np

from granular_id.live import Health, WrenchBuffer
from granular_id.live.rows import Rows


def buffer_of(source, **options):
    """Make a buffer that a source may write into."""
    return WrenchBuffer(60.0, rate_hz=source.info.rate_hz, tick_hz=source.info.tick_hz, **options)


def begun(source, **options):
    """Start a source; return the buffer that it writes into."""
    buffer = buffer_of(source, **options)
    source.start(buffer)
    return buffer


def rows_in(buffer, n):
    """Wait until a buffer holds n rows; return those that it holds, and the number of rows in each epoch."""
    reader, blocks = buffer.reader(from_oldest=True), []
    while sum(map(len, blocks)) < n:
        assert reader.wait(20)
        blocks.append(reader.read())
    epochs = np.bincount([block.epoch for block in blocks], [len(block) for block in blocks])
    return Rows.joined([Rows.of(block) for block in blocks]), epochs.tolist()


def rows_of(source, n):
    """Run a source until so many rows are there; return them."""
    rows, _ = rows_in(begun(source), n)
    assert source.health() == Health(running=True)
    source.stop()
    assert source.health() == Health(running=False)
    assert not source._thread.is_alive()
    return rows

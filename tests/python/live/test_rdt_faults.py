"""Our client against the fake box: what was sent arrives, and each fault is counted exactly as it was made."""

from __future__ import annotations

import numpy as np
import pytest

from granular_id._core import SAMPLE_FLAGS, host_ns
from granular_id.testing import FakeNetft, Faults
from rdt_cases import (
    BUFFERED,
    START,
    STOP,
    TICK_HZ,
    counted,
    injected,
    run,
    signal,
    streaming,
)
from sink_cases import eventually


def blocks(reader):
    """All that a reader has."""
    found = []
    while len(block := reader.read()):
        found.append(block)
    return found


@pytest.mark.parametrize("buffered", [False, True])
def test_values_and_times_are_those_of_the_box(buffered):
    source, buffer, reader, box = run(options={"buffered": buffered})
    (block,) = blocks(reader)
    np.testing.assert_array_equal(block.wrench, signal())
    # device time is the sensor's own, whatever the host's clock says of it
    np.testing.assert_array_equal(block.ticks, 1_000_000 + 4 * np.arange(700))
    np.testing.assert_array_equal(block.time_s, block.ticks / TICK_HZ)
    assert not block.missing_before[1:].any()
    assert not block.flags.any()
    assert counted(source) == injected(box)
    assert buffer.stats()["written"] == 700
    assert box.requests == [BUFFERED if buffered else START, STOP]
    assert source.health().counters["datagrams"] == (18 if buffered else 700)
    assert not source.health().running
    assert source.health().error is None


@pytest.mark.parametrize(("seed", "buffered"), [(0, False), (1, True)])
def test_every_fault_is_counted_exactly(seed, buffered):
    faults = Faults(loss=0.04, duplicate=0.04, reorder=0.04, bad_status=0.04)
    source, buffer, reader, box = run(
        faults, n_records=1000, seed=seed, options={"buffered": buffered}, per_datagram=5
    )
    made = injected(box)
    assert counted(source) == made
    assert all(made.values()), "all of them happened"
    assert source.health().counters["records"] == made["rows"] + made["duplicates"]
    # every row is the sample that its time says
    found = blocks(reader)
    ticks = np.concatenate([block.ticks for block in found]).astype(np.int64)
    np.testing.assert_array_equal(
        np.concatenate([block.wrench for block in found]), signal()[(ticks - 1_000_000) // 4 % 700]
    )
    assert len(ticks) == buffer.stats()["written"] == made["rows"]
    flags = np.concatenate([block.flags for block in found])
    assert np.count_nonzero(flags & SAMPLE_FLAGS["BAD_STATUS"]) == made["bad_status"]
    assert sum(int(block.missing_before.sum()) for block in found) == made["lost"]


@pytest.mark.parametrize(("share", "buffered", "least"), [(0.1, False, 1), (0.5, True, 40)])
def test_late_rows_without_patience_are_dropped_by_the_buffer_alone(share, buffered, least):
    faults, options = Faults(reorder=share), {"buffered": buffered}
    source, buffer, _, box = run(faults, n_records=1000, reorder_depth=0, options=options)
    assert counted(source) == injected(box)
    assert buffer.stats()["late"] == box.injected.reordered >= least
    assert buffer.stats()["epochs"] == 0


class Stalling(FakeNetft):
    """A box that may hold back what is due, and then sends everything at once."""

    stalls = False

    def _send_due(self):
        if not self.stalls:
            super()._send_due()


def test_the_alarm_fires_when_packets_stall():
    with Stalling(rate_hz=500) as box, streaming(box) as (source, buffer):
        eventually(lambda: buffer.stats()["written"] > 50)
        box.stalls = True
        eventually(lambda: buffer.lag_s() > 0.6)
        assert source.health().counters["stalls"] >= 1
        box.stalls = False
        # everything comes at once: nothing was lost, and the lag is gone
        eventually(lambda: buffer.stats()["written"] > 350)
        eventually(lambda: buffer.lag_s() < 0.3)
        assert source.health().counters["lost"] == 0


def test_the_alarm_fires_when_the_reader_stalls():
    with FakeNetft(rate_hz=500) as box, streaming(box, seconds=0.2) as (_, buffer):
        reader = buffer.reader(from_oldest=True)
        eventually(lambda: buffer.stats()["written"] > 300)  # nobody reads meanwhile
        block = reader.read()
        written = buffer.stats()["written"]
    assert len(block) <= buffer.capacity
    assert block.missed >= 200
    assert block.missed + len(block) <= written
    # the age of what was read is known
    assert (host_ns() - int(block.host_ns[0])) * 1e-9 > 0.02

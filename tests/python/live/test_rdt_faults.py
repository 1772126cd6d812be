"""Our client against the fake box: what was sent arrives, and each fault is counted exactly as it was made."""

from __future__ import annotations

import numpy as np
import pytest

from granular_id._core import SAMPLE_FLAGS, host_ns
from granular_id.testing import FakeNetft, Faults
from rdt_cases import (
    COMPARED,
    RATE_HZ,
    TICK_HZ,
    buffer_of,
    counted,
    every_fault,
    injected,
    run,
    signal,
    source_of,
    until,
)


def rows(reader):
    """All blocks of a reader."""
    blocks = []
    while len(block := reader.read()):
        blocks.append(block)
    return blocks


def test_values_and_times_are_those_of_the_box():
    source, buffer, reader, box = run()
    (block,) = rows(reader)
    np.testing.assert_array_equal(block.wrench, signal())
    np.testing.assert_array_equal(np.diff(block.ticks.astype(np.int64)), 4)
    assert block.ticks[0] == 1_000_000
    np.testing.assert_array_equal(block.time_s[[0, -1]], np.array([1_000_000, 1_000_000 + 4 * 699]) / TICK_HZ)
    assert not block.missing_before[1:].any()
    assert not block.flags.any()
    assert counted(source) == injected(box)
    assert buffer.stats()["written"] == 700
    assert box.requests == [b"\x12\x34\0\x02\0\0\0\0", b"\x12\x34\0\0\0\0\0\0"]
    assert not source.health().running
    assert source.health().error is None


@pytest.mark.parametrize(
    "share",
    [
        "loss",
        "duplicate",
        "reorder",
        "stale",
        "garbage",
        "forged",
        "absurd",
        "bad_status",
        "saturation",
        "warning",
    ],
)
def test_each_fault_alone(share):
    source, _, _, box = run(Faults(**{share: 0.15}))
    assert counted(source) == injected(box)
    changed = {name for name in COMPARED if counted(source)[name]} - {"rows"}
    also = {"saturation": "bad_status"}.get(share)
    assert changed - {also}, "the fault must have happened"
    assert len(changed - {also}) == 1, changed


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("buffered", [False, True])
def test_all_faults_together(seed, buffered):
    source, buffer, reader, box = run(
        every_fault(0.04), n_records=1000, seed=seed, options={"buffered": buffered}, per_datagram=5
    )
    made = injected(box)
    assert counted(source) == made
    counters = source.health().counters
    dropped = ("duplicates", "stale", "implausible", "out_of_range")
    assert counters["records"] == made["rows"] + sum(made[name] for name in dropped)
    # every row is the sample that its time says
    blocks = rows(reader)
    ticks = np.concatenate([block.ticks for block in blocks]).astype(np.int64)
    np.testing.assert_array_equal(
        np.concatenate([block.wrench for block in blocks]), signal()[(ticks - 1_000_000) // 4 % 700]
    )
    assert len(ticks) == buffer.stats()["written"] == made["rows"]
    flags = np.concatenate([block.flags for block in blocks])
    assert np.count_nonzero(flags & SAMPLE_FLAGS["BAD_STATUS"]) == made["bad_status"]
    assert np.count_nonzero(flags & SAMPLE_FLAGS["SATURATED"]) == made["saturated"]
    missing = sum(int(block.missing_before.sum()) for block in blocks)
    assert missing == made["lost"] + made["stale"]


@pytest.mark.parametrize(("share", "buffered", "least"), [(0.1, False, 1), (0.3, True, 40)])
def test_late_rows_without_patience_are_dropped_by_the_buffer_alone(share, buffered, least):
    faults, options = Faults(reorder=share), {"buffered": buffered}
    source, buffer, _, box = run(faults, n_records=1000, reorder_depth=0, options=options)
    assert counted(source) == injected(box)
    assert buffer.stats()["late"] == box.injected.reordered >= least
    assert buffer.stats()["epochs"] == 0


def test_both_numbers_wrap():
    source, _, reader, box = run(Faults(wrap=300, loss=0.05))
    assert counted(source) == injected(box)
    (block,) = rows(reader)
    ticks = block.ticks.astype(np.int64)
    assert ticks[0] < 2**32 < ticks[-1] == ticks[0] + 4 * 699
    assert (np.diff(ticks) > 0).all()


@pytest.mark.parametrize("first", [40, 250])
def test_a_restarted_box_is_a_new_epoch(first):
    source, buffer, reader, box = run(Faults(restart=first, loss=0.05, duplicate=0.05, reorder=0.05))
    assert box.injected.restarts == 699 // first
    assert counted(source) == injected(box)
    blocks = rows(reader)
    assert len({block.epoch for block in blocks}) == len(blocks) == 1 + box.injected.restarts
    assert all((np.diff(block.ticks.astype(np.int64)) > 0).all() for block in blocks)
    assert buffer.stats()["epochs"] == box.injected.restarts


def test_buffered_datagrams():
    source, _, reader, box = run(n_records=410, options={"buffered": True})
    assert box.requests[0] == b"\x12\x34\0\x03\0\0\0\0"
    assert source.health().counters["datagrams"] == 11
    assert counted(source) == injected(box)
    (block,) = rows(reader)
    np.testing.assert_array_equal(block.wrench, signal()[:410])


@pytest.mark.parametrize(("faults", "delayed"), [(Faults(jitter_s=0.02), 700), (Faults(drift=0.5), 0)])
def test_jitter_and_a_clock_that_drifts_lose_nothing(faults, delayed):
    source, _, reader, box = run(faults)
    assert counted(source) == injected(box)
    assert box.injected.delayed == delayed
    (block,) = rows(reader)
    np.testing.assert_array_equal(block.wrench, signal())
    # device time is the sensor's own, whatever the host's clock says of it
    np.testing.assert_allclose(np.diff(block.time_s), 1 / RATE_HZ, rtol=1e-9)


def test_the_alarm_fires_when_packets_stall():
    with FakeNetft(rate_hz=500, faults=Faults(stall=100, stall_s=1.0)) as box:
        source = source_of(box)
        buffer = buffer_of(source)
        source.start(buffer)
        until(lambda: buffer.lag_s() > 0.3)
        assert source.health().counters["stalls"] >= 1
        # afterwards everything comes at once: nothing was lost, and the lag is gone
        until(lambda: buffer.stats()["written"] > 600)
        until(lambda: buffer.lag_s() < 0.3)
        source.stop()
        assert source.health().counters["lost"] == 0


def test_the_alarm_fires_when_the_reader_stalls():
    with FakeNetft(rate_hz=500) as box:
        source = source_of(box)
        buffer = buffer_of(source, seconds=0.2)
        reader = buffer.reader()
        source.start(buffer)
        # nobody reads meanwhile
        until(lambda: buffer.stats()["written"] > 300)
        block = reader.read()
        written = buffer.stats()["written"]
        source.stop()
    assert len(block) <= buffer.capacity
    assert block.missed >= 200
    assert block.missed + len(block) <= written
    # the age of what was read is known
    assert (host_ns() - int(block.host_ns[0])) * 1e-9 > 0.02

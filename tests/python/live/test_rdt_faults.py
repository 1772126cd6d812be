"""Clients against the fake box: what was sent arrives, and each fault is counted exactly as it was made.

Ours, and an independent one, pynetft: both send the same bytes and see the same.
"""

from __future__ import annotations

import threading

import numpy as np
import pytest

from granular_id._core import SAMPLE_FLAGS, host_ns
from granular_id.live.netft_page import FORCE_UNITS, TORQUE_UNITS
from granular_id.testing import FakeNetft, Faults
from rdt_cases import BUFFERED, RATE_HZ, START, STOP, TICK_HZ, counted, injected, run, signal, streaming

N_RECORDS = 250
"""All of them fit into the socket of pynetft: a busy machine must not lose it any."""


def blocks(reader):
    """All that a reader has."""
    while len(block := reader.read()):
        yield block


@pytest.mark.parametrize("buffered", [False, True])
def test_rdt_values_and_times_are_those_of_the_box(buffered):
    source, buffer, reader, box = run(options={"buffered": buffered})
    block = reader.read()
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
    assert (source.health().running, source.health().error) == (False, None)


@pytest.mark.parametrize(("seed", "buffered"), [(0, False), (1, True)])
def test_rdt_every_fault_is_counted_exactly(seed, buffered):
    faults = Faults(loss=0.04, duplicate=0.04, reorder=0.04, bad_status=0.04)
    source, buffer, reader, box = run(
        faults, n_records=1000, seed=seed, options={"buffered": buffered}, per_datagram=5
    )
    made = injected(box)
    assert counted(source) == made
    assert all(made.values()), "all of them happened"
    assert source.health().counters["records"] == made["rows"] + made["duplicates"]
    # every row is the sample that its time says
    found = list(blocks(reader))
    ticks = np.concatenate([block.ticks for block in found]).astype(np.int64)
    np.testing.assert_array_equal(
        np.concatenate([block.wrench for block in found]), signal()[(ticks - 1_000_000) // 4 % 700]
    )
    assert len(ticks) == buffer.stats()["written"] == made["rows"]
    flags = np.concatenate([block.flags for block in found])
    assert np.count_nonzero(flags & SAMPLE_FLAGS["BAD_STATUS"]) == made["bad_status"]
    assert sum(int(block.missing_before.sum()) for block in found) == made["lost"]


@pytest.mark.parametrize(("share", "buffered", "least"), [(0.1, False, 1), (0.5, True, 40)])
def test_rdt_late_rows_are_dropped_by_the_buffer_alone(share, buffered, least):
    faults, options = Faults(reorder=share), {"buffered": buffered}
    source, buffer, _, box = run(faults, n_records=1000, reorder_depth=0, options=options)
    assert counted(source) == injected(box)
    assert buffer.stats()["late"] == box.injected.reordered >= least
    assert buffer.stats()["epochs"] == 0


def test_rdt_slow_reader_knows_what_it_missed():
    with (
        FakeNetft(rate_hz=RATE_HZ, tick_hz=TICK_HZ, n_records=600) as box,
        streaming(box, seconds=0.1) as (_, buffer),
    ):
        reader = buffer.reader(from_oldest=True)
        assert box.wait(60)
    block = reader.read()
    assert len(block) <= buffer.capacity
    assert block.missed + len(block) == buffer.stats()["written"] == 600
    assert host_ns() > int(block.host_ns[0]), "the age of what was read is known"


class Theirs:
    """The stream of a box, received with pynetft: its samples, health and the box."""

    def __init__(self, faults=None, **options):
        pynetft = pytest.importorskip("pynetft")
        settings = {"rate_hz": RATE_HZ, "tick_hz": TICK_HZ, "seed": 3, **options}
        self.samples, came = [], threading.Semaphore(0)
        with FakeNetft(signal(), faults=faults, n_records=N_RECORDS, **settings) as self.box:
            config = pynetft.Config(
                sensor_host="127.0.0.1",
                rdt_port=self.box.port,
                http_port=self.box.http_port,
                deliver_samples_with_error_status=True,
                receive_timeout=5.0,
            )

            def take(sample):
                self.samples.append(sample)
                came.release()

            with pynetft.Client(config, queue_size=4 * N_RECORDS, callback=take) as client:
                assert self.box.wait(30)
                made = self.box.injected
                for _ in range(made.sent - made.reordered):  # it drops late ones
                    assert came.acquire(timeout=20)
            self.health = client.health()  # counts agree when its thread has ended


@pytest.mark.parametrize(("force", "torque"), [("N", "Nm"), ("lbf", "lbf-in")])
def test_rdt_requests_and_values_are_those_of_pynetft(force, torque):
    units = {"page": {"scfgfu": force, "scfgtu": torque}}
    theirs = Theirs(**units)
    _, _, reader, ours = run(n_records=N_RECORDS, **units)
    assert ours.requests == [theirs.box.requests[0], theirs.box.requests[-1]] == theirs.box.requests
    block = reader.read()
    np.testing.assert_array_equal([sample.ft_sequence for sample in theirs.samples], block.ticks)
    factors = np.repeat([float(FORCE_UNITS[force]), float(TORQUE_UNITS[torque])], 3)
    expected = np.array([sample.wrench for sample in theirs.samples]) * factors
    # to the last bit, where there is nothing to convert
    np.testing.assert_allclose(block.wrench, expected, rtol=0 if force == "N" else 4e-16, atol=0)


@pytest.mark.parametrize(
    "faults", [Faults(loss=0.1), Faults(duplicate=0.1), Faults(loss=0.04, duplicate=0.04, reorder=0.04)]
)
def test_rdt_counts_agree_with_pynetft(faults):
    theirs = Theirs(faults)
    source, _, _, ours = run(faults, n_records=N_RECORDS)
    assert ours.injected == theirs.box.injected
    health, counters = theirs.health, source.health().counters
    assert health.received_count == counters["records"]
    assert health.duplicate_count == counters["duplicates"]
    assert health.out_of_order_count == counters["reordered"]
    assert health.device_error_count == counters["bad_status"] == 0
    # it leaves a late record among the lost ones, and drops it
    assert health.lost_count == counters["lost"] + counters["reordered"]
    assert health.delivered_count == counters["rows"] - counters["reordered"]

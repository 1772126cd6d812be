"""Clients against the fake box: what was sent arrives, and each fault is counted exactly as it was made.

Ours, and an independent one, pynetft: both send the same bytes and see the same.
"""

from __future__ import annotations

import threading

import numpy as np
import pytest

from granular_id._core import SAMPLE_FLAGS
from granular_id.live.netft_page import FORCE_UNITS, TORQUE_UNITS
from granular_id.testing import FakeNetft, Faults
from rdt_cases import BUFFERED, RATE_HZ, START, STOP, TICK_HZ, counted, injected, run, signal

N_RECORDS = 250
"""All of them fit into the socket of pynetft: a busy machine must not lose it any."""


@pytest.mark.parametrize("buffered", [False, True])
def test_rdt_values_and_times_are_those_of_the_box(buffered):
    source, reader, box = run(buffered=buffered)
    block = reader.read()
    np.testing.assert_array_equal(block.wrench, signal())
    # device time is the sensor's own, whatever the host's clock says of it
    np.testing.assert_array_equal(block.ticks, 1_000_000 + 4 * np.arange(700))
    np.testing.assert_array_equal(block.time_s, block.ticks / TICK_HZ)
    assert not block.missing_before[1:].any()
    assert not block.flags.any()
    assert counted(source) == injected(box)
    assert box.requests == [BUFFERED if buffered else START, STOP]
    assert source.health().counters["datagrams"] == (18 if buffered else 700)
    assert (source.health().running, source.health().error) == (False, None)


@pytest.mark.parametrize(("share", "buffered"), [(0.04, False), (0.25, True)])
def test_rdt_every_fault_is_counted_exactly(share, buffered):
    source, reader, box = run(Faults(share, share, share, share), n_records=1200, buffered=buffered)
    made = injected(box)
    assert counted(source) == made
    assert all(made.values()), "all of them happened"
    found = []
    while len(block := reader.read()):
        found.append(block)
    ticks, wrench, flags, missing = (
        np.concatenate([getattr(block, name) for block in found])
        for name in ("ticks", "wrench", "flags", "missing_before")
    )
    # every row is the sample that its time says
    np.testing.assert_array_equal(wrench, signal()[(ticks.astype(np.int64) - 1_000_000) // 4 % 700])
    assert len(ticks) == made["rows"]
    assert np.count_nonzero(flags & SAMPLE_FLAGS["BAD_STATUS"]) == made["bad_status"]
    assert missing.sum() == made["lost"]


class Theirs:
    """The stream of a box, received with pynetft: its samples, health and the box."""

    def __init__(self, faults, page):
        pynetft = pytest.importorskip("pynetft")
        self.samples, came = [], threading.Semaphore(0)
        options = {"rate_hz": RATE_HZ, "faults": faults, "n_records": N_RECORDS, "page": page, "seed": 3}
        with FakeNetft(signal(), **options) as self.box:
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


@pytest.mark.parametrize(
    ("faults", "force", "torque"),
    [
        (Faults(), "N", "Nm"),
        (Faults(), "lbf", "lbf-in"),
        (Faults(loss=0.1), "N", "Nm"),
        (Faults(loss=0.04, duplicate=0.04, reorder=0.04), "N", "Nm"),
    ],
)
def test_rdt_requests_values_and_counts_are_those_of_pynetft(faults, force, torque):
    page = {"scfgfu": force, "scfgtu": torque}
    theirs = Theirs(faults, page)
    source, reader, ours = run(faults, n_records=N_RECORDS, page=page)
    assert ours.requests == [theirs.box.requests[0], theirs.box.requests[-1]] == theirs.box.requests
    assert ours.injected == theirs.box.injected
    health, counters = theirs.health, source.health().counters
    assert health.received_count == counters["records"]
    assert health.duplicate_count == counters["duplicates"]
    assert health.out_of_order_count == counters["reordered"]
    # it leaves a late record among the lost ones, and drops it
    assert health.lost_count == counters["lost"] + counters["reordered"]
    assert health.delivered_count == counters["rows"] - counters["reordered"]
    if not counters["reordered"]:
        blocks = [reader.read() for _ in range(1 + counters["lost"])]
        ticks, wrench = (np.concatenate([getattr(b, name) for b in blocks]) for name in ("ticks", "wrench"))
        np.testing.assert_array_equal([sample.ft_sequence for sample in theirs.samples], ticks)
        factors = np.repeat([FORCE_UNITS[force], TORQUE_UNITS[torque]], 3)
        # to the last bit, where there is nothing to convert
        expected = np.array([sample.wrench for sample in theirs.samples]) * factors
        np.testing.assert_allclose(wrench, expected, rtol=0 if force == "N" else 1e-15, atol=0)

"""An independent client, pynetft, against the fake box: it and ours send the same bytes and see the same."""

from __future__ import annotations

import numpy as np
import pytest

from granular_id.live.netft_page import FORCE_UNITS, TORQUE_UNITS
from granular_id.testing import FakeNetft, Faults
from rdt_cases import RATE_HZ, STOP, TICK_HZ, run, signal
from sink_cases import eventually

pynetft = pytest.importorskip("pynetft")

N_RECORDS = 250
"""All of them fit into its socket: a busy machine must not lose it any."""


def theirs(faults=None, **options):
    """Receive the stream of a box with pynetft. Returns its samples, health and the box."""
    settings = {"rate_hz": RATE_HZ, "tick_hz": TICK_HZ, "seed": 3, **options}
    with FakeNetft(signal(), faults=faults, n_records=N_RECORDS, **settings) as box:
        config = pynetft.Config(
            sensor_host="127.0.0.1",
            rdt_port=box.port,
            http_port=box.http_port,
            deliver_samples_with_error_status=True,
            receive_timeout=5.0,
        )
        samples = []
        with pynetft.Client(config, queue_size=4 * N_RECORDS, callback=samples.append) as client:
            assert box.wait(30)
            sent = len(box.send_stamps)
            eventually(lambda: (h := client.health()).received_count + h.malformed_count >= sent)
            # a record is received before it is delivered; of faulty ones not all are
            eventually(lambda: len(samples) >= (sent if faults is None else 0))
        # counts agree when its thread has ended
        health = client.health()
        eventually(lambda: box.requests[-1] == STOP)
    return samples, health, box


@pytest.mark.parametrize(("force", "torque"), [("N", "Nm"), ("lbf", "lbf-in")])
def test_requests_are_the_same_bytes_and_values_theirs_times_the_unit(force, torque):
    units = {"page": {"scfgfu": force, "scfgtu": torque}}
    samples, _, box = theirs(**units)
    _, _, reader, ours = run(n_records=N_RECORDS, **units)
    assert ours.requests == [box.requests[0], box.requests[-1]] == box.requests
    block = reader.read()
    np.testing.assert_array_equal([sample.ft_sequence for sample in samples], block.ticks)
    factors = np.repeat([float(FORCE_UNITS[force]), float(TORQUE_UNITS[torque])], 3)
    expected = np.array([sample.wrench for sample in samples]) * factors
    # to the last bit, where there is nothing to convert
    np.testing.assert_allclose(block.wrench, expected, rtol=0 if force == "N" else 4e-16, atol=0)


@pytest.mark.parametrize(
    "faults",
    [
        Faults(loss=0.1),
        Faults(duplicate=0.1),
        Faults(reorder=0.1),
        Faults(loss=0.04, duplicate=0.04, reorder=0.04),
    ],
    ids=repr,
)
def test_counts_agree(faults):
    _, health, box = theirs(faults)
    source, _, _, ours = run(faults, n_records=N_RECORDS)
    assert ours.injected == box.injected
    counters = source.health().counters
    assert health.received_count == counters["records"]
    assert health.duplicate_count == counters["duplicates"]
    assert health.out_of_order_count == counters["reordered"]
    assert health.device_error_count == counters["bad_status"] == 0
    # it leaves a late record among the lost ones, and drops it
    assert health.lost_count == counters["lost"] + counters["reordered"]
    assert health.delivered_count == counters["rows"] - counters["reordered"]
    # and its word for a sample that did not advance is used for repeated records too
    assert health.ft_stall_count == counters["duplicates"]

"""The fake box by itself: its command, what it plays, what it refuses."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np

from granular_id.live import opened
from granular_id.testing import FakeNetft, Faults, Injected


def sent(faults, seed=0):
    """All datagrams of a box from which 500 records are requested, and what went wrong."""
    with FakeNetft(faults=faults, seed=seed, n_records=500) as box:
        return [data for _, data in box._datagrams(1)], box.injected


def test_faults_same_seed_is_the_same_stream():
    faults = Faults(loss=0.2, duplicate=0.2, reorder=0.2, bad_status=0.2)
    assert sent(faults, 1) == sent(faults, 1)
    assert sent(faults, 1) != sent(faults, 2)


def test_faults_leave_first_and_last_records_alone():
    datagrams, injected = sent(Faults(loss=1.0))
    numbers = [int.from_bytes(data[:4], "big") for data in datagrams]
    assert numbers == [1, 2, 3, 498, 499, 500]
    assert injected == Injected(sent=6, lost=494)


def test_fake_box_command_counts_what_it_injected(tmp_path):
    stamps = tmp_path / "stamps.npy"
    options = ("--records", "200", "--loss", "0.1", "--stamps", stamps)
    command = [sys.executable, "-W", "ignore", "-m", "granular_id.testing", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        with opened(process.stdout.readline().strip()) as stream:
            output, _ = process.communicate(timeout=60)
        counters = stream.source.health().counters
    assert process.returncode == 0
    made = json.loads(output)
    assert made["lost"] == counters["lost"] > 0
    assert len(np.load(stamps)) == made["sent"] == counters["rows"]

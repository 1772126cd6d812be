"""The fake box by itself: its command, what it plays, what it refuses."""

from __future__ import annotations

import json
import signal as signals
import socket
import subprocess
import sys

import numpy as np
import pytest

from granular_id.live import opened
from granular_id.testing import FakeNetft, Faults, Injected


def sent(faults, seed=0):
    """All datagrams of a box that is asked for a stream of 500 records, and what went wrong."""
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


def test_fake_box_other_requests_are_noted_and_ignored():
    with FakeNetft(n_records=5) as box, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.settimeout(20)
        client.connect(("127.0.0.1", box.port))
        for junk in (b"", b"\x12\x34\0\x02", b"\x12\x35\0\x02\0\0\0\0", b"\x12\x34\0\x77\0\0\0\0"):
            client.send(junk)
        client.send(b"\x12\x34\0\x02\0\0\0\0")
        numbers = [int.from_bytes(client.recv(100)[:4], "big") for _ in range(5)]
        assert box.wait(20)
        assert numbers == [1, 2, 3, 4, 5]
        assert len(box.requests) == 5


def command(*arguments):
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", "-m", "granular_id.testing", *map(str, arguments)],
        stdout=subprocess.PIPE,
        text=True,
    )


def test_fake_box_command_counts_what_it_injected(tmp_path):
    stamps = tmp_path / "stamps.npy"
    arguments = ("--records", 200, "--loss", 0.1, "--stamps", stamps)
    with command(*arguments) as process:
        with opened(process.stdout.readline().strip()) as stream:
            output, _ = process.communicate(timeout=60)
        counters = stream.source.health().counters
    assert process.returncode == 0
    made = json.loads(output)
    assert made["lost"] == counters["lost"] > 0
    assert len(np.load(stamps)) == made["sent"] == counters["rows"]


@pytest.mark.usefixtures("heeding_interrupts")
def test_fake_box_command_runs_until_ctrl_c():
    with command("--material", "rice") as process:
        assert process.stdout.readline().startswith("rdt://127.0.0.1:")
        process.send_signal(signals.SIGINT)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    assert json.loads(output)["sent"] == 0

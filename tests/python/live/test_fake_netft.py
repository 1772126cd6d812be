"""The fake box by itself: its command, what it plays, what it refuses."""

from __future__ import annotations

import json
import signal as signals
import socket
import subprocess
import sys
from itertools import islice

import numpy as np
import pytest

import granular_id as gid
from granular_id.live.fake_netft import FakeNetft
from granular_id.live.fake_netft_command import main
from granular_id.live.fake_netft_faults import Faults, Injected
from granular_id.live.fake_netft_plan import RECORD, FaultPlan
from granular_id.live.fake_netft_signal import counts_of, played, pushes
from granular_id.live.source import open_source
from granular_id.synthetic import synthesize
from rdt_cases import TWICE, buffer_of, run, source_of


def test_a_record_has_36_bytes():
    assert RECORD.itemsize == 36
    (datagram,) = FaultPlan(Faults(), step=14, first_ft=0x01020304).datagrams(
        np.array([[1, -1, 2, -2, 3, -3]])
    )
    words = [1, 0x01020304, 0, 1, -1 % 2**32, 2, -2 % 2**32, 3, -3 % 2**32]
    assert datagram.data == b"".join(word.to_bytes(4, "big") for word in words)


def test_the_same_seed_makes_the_same_faults():
    def stream(seed):
        faults = Faults(loss=0.2, duplicate=0.2, reorder=0.2, garbage=0.2, jitter_s=0.1)
        plan = FaultPlan(faults, step=14, first_ft=0, n_records=500, seed=seed)
        return list(plan.datagrams(np.zeros((500, 6), dtype=np.int32))), plan.injected

    assert stream(1) == stream(1)
    assert stream(1) != stream(2)


def test_first_and_last_records_are_left_alone():
    faults = Faults(loss=1.0)
    plan = FaultPlan(faults, step=14, first_ft=0, n_records=100)
    sent = [datagram.due for datagram in plan.datagrams(np.zeros((100, 6), dtype=np.int32))]
    assert sent == [0, 1, 2, 97, 98, 99]
    assert plan.injected == Injected(sent=6, lost=94)


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (["loss"], "fault 'loss' has no number; wanted loss=NUMBER"),
        (["loss=much"], "no number"),
        (["loss=2"], "loss must be from 0 to 1, got 2"),
        (["loss=-0.1"], "loss must be from 0 to 1"),
        (["drift=0.6"], "drift must be from -0.5 to 0.5"),
        (["wrap=1.5"], "wrap must be a whole number of at least 0, got 1.5"),
        (["loss=nan"], "loss must be finite"),
        (["loss=0.6", "duplicate=0.6"], "must add up to 1 at most, got 1.2"),
        (["lost=0.1"], "fault 'lost=0.1' is none; known: loss, "),
    ],
)
def test_faults_are_checked(texts, words):
    with pytest.raises(ValueError, match=words):
        Faults.parse(texts)


def test_arguments_are_checked():
    with pytest.raises(ValueError, match=r"force_unit must be one of N, .*, got 'pound'"):
        FakeNetft(force_unit="pound")
    with pytest.raises(ValueError, match=r"signal has shape \(5, 3\)"):
        FakeNetft(np.zeros((5, 3)))
    with pytest.raises(ValueError, match="rate_hz must be positive"):
        FakeNetft(rate_hz=0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(OSError, match="in use"):
            FakeNetft(port=taken.getsockname()[1])


def test_counts_are_rounded_and_held():
    assert counts_of(np.array([[2.6e-6, -2.4e-6, 1e9, 1e-3, 0, 0]]), 1e6, 1e3).tolist() == [
        [3, -2, 2**31 - 1, 1, 0, 0]
    ]


def test_recordings_are_played(tmp_path):
    data = synthesize("rice", 2, rate_hz=250, duration_s=1.0)
    gid.save(data, tmp_path / "rice.npz")
    wrench, rate_hz, synthetic = played(tmp_path / "rice.npz", None)
    np.testing.assert_array_equal(wrench, np.concatenate([data[0].wrench, data[1].wrench]))
    assert (rate_hz, synthetic) == (250, True)
    with FakeNetft(wrench, rate_hz=rate_hz, tick_hz=7000, n_records=500) as box:
        source = source_of(box)
        buffer = buffer_of(source)
        reader = buffer.reader(from_oldest=True)
        source.start(buffer)
        assert box.wait(30)
        source.stop()
    np.testing.assert_allclose(reader.read().wrench, wrench, rtol=0, atol=0.51e-6)


def test_what_comes_from_a_model_says_so():
    for synthetic in (True, False):
        with FakeNetft(synthetic=synthetic) as box:
            assert source_of(box).info.synthetic is synthetic


def test_recordings_without_one_rate_are_refused(tmp_path):
    gid.save(synthesize("rice", 1, rate_hz=250, duration_s=1.0), tmp_path / "a.npz")
    gid.save(synthesize("rice", 1, rate_hz=500, duration_s=1.0), tmp_path / "b.npz")
    with pytest.raises(ValueError, match=r"recordings have the rates .* resample them first"):
        played(tmp_path, None)


def test_a_material_is_simulated():
    np.testing.assert_array_equal(
        pushes("rice", 500, seed=2, n_pushes=1), synthesize("rice", 1, seed=2)[0].wrench
    )
    with pytest.raises(ValueError, match="unobtainium"):
        pushes("unobtainium", 500)


def test_requests_of_another_kind_are_noted_and_ignored():
    with FakeNetft() as box, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.settimeout(20)
        client.connect(("127.0.0.1", box.port))
        for junk in (b"", b"\x12\x34\0\x02", b"\x12\x35\0\x02\0\0\0\0", b"\x12\x34\0\x77\0\0\0\0"):
            client.send(junk)
        # a number of records asked for
        client.send(b"\x12\x34\0\x02\0\0\0\x05")
        numbers = [int.from_bytes(client.recv(100)[:4], "big") for _ in range(5)]
        assert box.wait(20)
        assert numbers == [1, 2, 3, 4, 5]
        assert len(box.requests) == 5


def test_the_clock_of_the_box_drifts():
    with FakeNetft(rate_hz=500, faults=Faults(drift=0.25)) as box:
        when = [when for when, _ in islice(box._timed(1, None), 1000)]
    np.testing.assert_allclose(np.diff(when), 1 / (500 * 1.25), rtol=1e-6)


def test_the_first_records_of_an_older_stream_do_not_confuse():
    # asked for twice, as by a client that is impatient
    source, buffer, _, box = run(Faults(deaf=1), n_records=50)
    assert source.health().counters["rows"] == buffer.stats()["written"] == box.injected.sent == 50


def test_the_command(tmp_path):
    stamps = tmp_path / "stamps.npy"
    command = [sys.executable, "-m", "granular_id.live.fake_netft", "--records", "200", "--fault", "loss=0.1"]
    with subprocess.Popen([*command, "--stamps", stamps], stdout=subprocess.PIPE, text=True) as process:
        source = open_source(process.stdout.readline().strip())
        source.start(buffer_of(source))
        output, _ = process.communicate(timeout=60)
        source.stop()
    assert process.returncode == 0
    made = json.loads(output)
    if source.health().counters["requests"] > 1:
        pytest.skip(TWICE)
    assert made["lost"] == source.health().counters["lost"] > 0
    assert len(np.load(stamps)) == made["sent"] == source.health().counters["rows"]


def test_the_command_until_ctrl_c():
    text = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from granular_id.live.fake_netft_command import main; main(['--material', 'rice'])"
    )
    with subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().startswith("rdt://127.0.0.1:")
        process.send_signal(signals.SIGINT)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    assert json.loads(output)["sent"] == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--fault", "los=1"], "fault 'los=1' is none"),
        (["--material", "unobtainium"], "unobtainium"),
        (["--play", "no-such-file.npz"], "no-such-file"),
    ],
)
def test_the_command_refuses(arguments, words):
    with pytest.raises(SystemExit, match=words):
        main(arguments)

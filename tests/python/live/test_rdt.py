"""Our client of a fake box: what was sent arrives, faults are counted, it starts, stops, and programs end."""

from __future__ import annotations

import signal as signals
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager
from dataclasses import asdict

import numpy as np
import pytest

from granular_id._core import SAMPLE_FLAGS, WrenchBuffer
from granular_id.live.netft_page import NetftPageError
from granular_id.live.rdt import RdtSource
from granular_id.live.source import WrenchSource, open_source
from granular_id.testing import FakeNetft, Faults
from sink_cases import begun, buffer_of, rows_in

RATE_HZ, TICK_HZ = 1750.0, 7000.0
STOP, START, BUFFERED, BIAS = (b"\x12\x34\0" + bytes([code, 0, 0, 0, 0]) for code in (0, 2, 3, 0x42))
N_RECORDS = 250  # all fit into the socket of pynetft: a busy machine must not lose it any
NAMES = ("ticks", "wrench", "flags", "missing_before")
COMPARED = ("lost", "duplicates", "reordered", "bad_status", "rows")


def signal(n=700, seed=0):
    """Wrenches that counts hold exactly, so that what arrives must be what was sent, to the last bit."""
    rng = np.random.default_rng(seed)
    return rng.integers(-5_000_000, 5_000_000, size=(n, 6)) / 1e6


def source_of(box, **options):
    return RdtSource("127.0.0.1", box.port, http_port=box.http_port, **options)


def taken(buffer, n):
    """Wait for the first n rows; return their wrenches."""
    return rows_in(buffer, n)[0].wrench[:n]


@contextmanager
def streaming(box, *, reorder_depth=0, source=None, **options):
    """A source that writes into a buffer, stopped at the end."""
    source = open_source(box.url, **options) if source is None else source
    buffer = begun(source, reorder_depth=reorder_depth)
    try:
        yield source, buffer
    finally:
        source.stop()


def run(faults=None, *, n_records=700, buffered=False):
    """Receive a whole stream. Returns source, reader and box."""
    with (
        FakeNetft(signal(), rate_hz=RATE_HZ, faults=faults, n_records=n_records, seed=3) as box,
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
    assert isinstance(source, WrenchSource)


@pytest.mark.parametrize(("share", "buffered"), [(0.04, False), (0.25, True)])
def test_rdt_every_fault_is_counted_exactly(share, buffered):
    source, reader, box = run(Faults(share, share, share, share), n_records=1200, buffered=buffered)
    made = injected(box)
    assert counted(source) == made
    assert all(made.values()), "all of them happened"
    found = []
    while len(block := reader.read()):
        found.append(block)
    ticks, wrench, flags, missing = (np.concatenate([getattr(b, name) for b in found]) for name in NAMES)
    # every row is the sample that its time says
    np.testing.assert_array_equal(wrench, signal()[(ticks.astype(np.int64) - 1_000_000) // 4 % 700])
    assert len(ticks) == made["rows"]
    assert np.count_nonzero(flags & SAMPLE_FLAGS["BAD_STATUS"]) == made["bad_status"]
    assert missing.sum() == made["lost"]


def theirs(faults):
    """Receive the stream of a box with pynetft; return its samples, its health and the box."""
    pynetft = pytest.importorskip("pynetft")
    samples, came = [], threading.Semaphore(0)

    def take(sample):
        samples.append(sample)
        came.release()

    with FakeNetft(signal(), rate_hz=RATE_HZ, faults=faults, n_records=N_RECORDS, seed=3) as box:
        config = pynetft.Config(
            sensor_host="127.0.0.1",
            rdt_port=box.port,
            http_port=box.http_port,
            deliver_samples_with_error_status=True,
            receive_timeout=5.0,
        )
        with pynetft.Client(config, queue_size=4 * N_RECORDS, callback=take) as client:
            assert box.wait(30)
            for _ in range(box.injected.sent - box.injected.reordered):  # it drops late ones
                assert came.acquire(timeout=20)
    return samples, client.health(), box  # its counts agree when its thread has ended


@pytest.mark.parametrize("faults", [Faults(loss=0.1), Faults(loss=0.04, duplicate=0.04, reorder=0.04)])
def test_rdt_requests_values_and_counts_are_those_of_pynetft(faults):
    samples, health, box = theirs(faults)
    source, reader, ours = run(faults, n_records=N_RECORDS)
    assert ours.requests == [box.requests[0], box.requests[-1]] == box.requests
    assert ours.injected == box.injected
    counters = source.health().counters
    assert health.received_count == counters["records"]
    assert health.duplicate_count == counters["duplicates"]
    assert health.out_of_order_count == counters["reordered"]
    # it leaves a late record among the lost ones, and drops it
    assert health.lost_count == counters["lost"] + counters["reordered"]
    assert health.delivered_count == counters["rows"] - counters["reordered"]
    if not counters["reordered"]:
        blocks = [reader.read() for _ in range(1 + counters["lost"])]
        ticks, wrench = (np.concatenate([getattr(b, name) for b in blocks]) for name in ("ticks", "wrench"))
        np.testing.assert_array_equal([sample.ft_sequence for sample in samples], ticks)
        np.testing.assert_array_equal([sample.wrench for sample in samples], wrench)


def test_rdt_info_holds_what_the_page_says():
    changes = {"setuserfilter": "4", "cfgcalsn": "FT12345", "setbias": "1;2;3;4;5;6"}
    with FakeNetft(page=changes) as box:
        info = source_of(box).info
    assert (info.name, info.serial, info.filter_hz) == ("Net F/T 127.0.0.1", "FT12345", 73)
    assert (info.device_clock, info.synthetic) == (True, True)
    assert info.full_scale == (290, 290, 580, 10, 10, 10)
    assert info.meta["page"]["setbias"] == "1;2;3;4;5;6"


def test_rdt_bias_is_sent_only_with_the_option():
    with FakeNetft(np.full((10, 6), 2.0)) as box:
        source = source_of(box)
        with pytest.raises(RuntimeError, match="start it first"):
            source.bias()
        with streaming(box, source=source) as (_, buffer):
            assert (taken(buffer, 10) == 2.0).all()
            assert set(box.requests) == {START}
            source.bias()
            reader, value = buffer.reader(), 2.0
            while value:
                assert reader.wait(20)
                value = reader.read().wrench[-1, 0]
    assert [request for request in box.requests if request not in (START, STOP)] == [BIAS]
    assert box.requests[-1] == STOP


class Deaf(FakeNetft):
    """A box that does not hear the first requests for its stream."""

    def __init__(self, n, **options):
        super().__init__(**options)
        self.left = n

    def _obey(self, command, sender):
        if command == START[3] and self.left:
            self.left -= 1
        else:
            super()._obey(command, sender)


def test_rdt_lost_requests_are_repeated():
    with Deaf(3, n_records=100) as box, streaming(box) as (source, buffer):
        taken(buffer, 100)
        assert source.health().counters["requests"] == box.requests.count(START) == 4


def test_rdt_box_that_never_answers_is_left():
    with Deaf(1000) as box:
        source = source_of(box)
        buffer = buffer_of(source)
        with pytest.raises(TimeoutError, match=r"of 10 requests.*another client may own the stream"):
            source.start(buffer)
        assert buffer.push([0] * 6), "the buffer is free again"
    assert box.requests.count(START) == 10
    assert box.requests[-1] == STOP


def test_rdt_second_client_takes_the_stream():
    with FakeNetft() as box, streaming(box) as (source, buffer):
        taken(buffer, 10)
        n_requests = source.health().counters["requests"]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.settimeout(20)
            other.connect(("127.0.0.1", box.port))
            other.send(START)
            for _ in range(600):  # more than a second of silence for ours
                other.recv(36)
        assert "another client may own the stream" in source.health().error
        assert source.health().running
        assert source.health().counters["requests"] == n_requests


def test_rdt_others_cannot_send_into_the_stream():
    with FakeNetft() as box, streaming(box) as (source, buffer):
        taken(buffer, 10)
        # the box's client is the socket of ours: its port is open to the box alone
        port = box._client[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            for _ in range(50):
                other.sendto(bytes(36), ("127.0.0.1", port))
        taken(buffer, 60)
    counters = source.health().counters
    assert counters["datagrams"] == counters["rows"]


def test_rdt_source_runs_once_at_a_time_and_again():
    with FakeNetft() as box:
        source = source_of(box)
        source.stop()
        with streaming(box, source=source) as (_, buffer):
            with pytest.raises(RuntimeError, match="runs already"):
                source.start(buffer_of(source))
            with pytest.raises(RuntimeError, match="a sensor is writing"):
                source_of(box).start(buffer)
            with pytest.raises(RuntimeError, match="a sensor is writing"):
                buffer.push([0] * 6)
        with streaming(box, source=source) as (_, buffer):
            taken(buffer, 10)


def test_rdt_start_without_box_or_fitting_buffer_is_refused():
    with FakeNetft() as box:
        source = source_of(box)
    with pytest.raises(ConnectionRefusedError, match=r"nothing listens at 127\.0\.0\.1:\d+"):
        source.start(buffer_of(source))
    with pytest.raises(ValueError, match="buffer must have tick_hz=7000"):
        source.start(WrenchBuffer(1.0, rate_hz=500))
    with pytest.raises(ValueError, match="n_axes must be 6, got 3"):
        source.start(buffer_of(source, n_axes=3))


def test_rdt_on_robot_has_a_fixed_scale_and_its_own_requests():
    scale = {"cfgcpf": "1e4", "cfgcpt": "1e5"}
    with FakeNetft(signal(50), n_records=50, page=scale) as box:
        source = RdtSource("127.0.0.1", box.port, variant="onrobot", tick_hz=7000)
        with streaming(box, source=source) as (_, buffer):
            source.bias()
            assert box.wait(20)
            scaled = taken(buffer, 1)[0] * [1e4, 1e4, 1e4, 1e5, 1e5, 1e5]
    assert source.info.name == "OnRobot 127.0.0.1"
    assert box.requests[:2] == [b"\x12\x34\0\x82\0\0\0\x02", START]
    assert b"\x12\x34\0\x42\0\0\0\xff" in box.requests
    np.testing.assert_allclose(scaled, np.rint(scaled), atol=1e-6)


@pytest.mark.parametrize(
    ("page", "options", "wanted"),
    [
        ({}, {"rate_hz": 500}, ("netft", 500, 7000)),
        ({"prodname": "Ethernet Axia80-M20"}, {}, ("axia", 500, 7000)),
        ({"prodname": "Ethernet Axia80-M20"}, {"variant": "netft"}, ("netft", 500, 7000)),
        ({"prodname": None, "runrate": None, "setrate": "7812"}, {}, ("axia", 500, 7812)),
        ({"runrate": None}, {"tick_hz": 7000}, ("netft", 500, 7000)),
        ({"comrdtrate": "2333"}, {}, ("netft", 7000 / 3, 7000)),  # as it is, where the page rounds
        ({"runrate": "7812"}, {}, ("netft", 500, 7812)),  # no divisor: the mean
    ],
)
def test_rdt_kind_and_rates_follow_from_page_and_options(page, options, wanted):
    with FakeNetft(page=page) as box:
        info = source_of(box, **options).info
    assert (info.meta["variant"], info.rate_hz, info.tick_hz) == wanted


@pytest.mark.parametrize(
    ("page", "options", "error", "words"),
    [
        ({"runrate": None}, {}, NetftPageError, r"runrate and setrate .* state it: tick_hz=7000"),
        # an index of a table, as some firmware gives it, is no rate
        ({"runrate": None, "setrate": "4"}, {}, NetftPageError, "state it"),
        ({}, {"rate_hz": 1000}, ValueError, r"rate_hz=1000 was stated, .* says 500; leave it out"),
        ({}, {"tick_hz": 7812}, ValueError, r"tick_hz=7812 was stated, .* says 7000"),
        ({}, {"variant": "ati"}, ValueError, "variant must be one of"),
    ],
)
def test_rdt_contradicting_rate_or_kind_is_refused(page, options, error, words):
    with FakeNetft(page=page) as box, pytest.raises(error, match=words):
        source_of(box, **options)


BEGIN = """
import os, signal, sys, time
from granular_id._core import RdtReceiver, WrenchBuffer
from granular_id.live.source import open_source
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what a shell starts in the background
source = open_source(sys.argv[1])
buffer = WrenchBuffer(5, rate_hz=source.info.rate_hz, tick_hz=source.info.tick_hz)
source.start(buffer)
"""

FORK = """
child = os.fork()
if not child:
    health = source.health()
    assert not health.running and "forked" in health.error, health
    source.stop()
    sys.exit(7)  # with all that runs at the end of an interpreter
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
reader = buffer.reader()
assert reader.wait(20) and source.health().running
print("ready", flush=True)
sys.stdin.readline()
"""

# Not pause(): a signal right before it would be waited for in vain.
WAIT = "print('ready', flush=True)\nwhile True: time.sleep(0.05)"


@pytest.mark.parametrize(("text", "code"), [("raise ValueError", 1), (WAIT, -signals.SIGINT), (FORK, 0)])
def test_rdt_box_is_stopped_however_a_program_ends(text, code):
    with FakeNetft() as box:
        process = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-c", BEGIN + text, box.url],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        if code != 1:
            assert process.stdout.readline() == "ready\n"
            assert set(box.requests) == {START}, "a forked child asks for nothing"
        if code < 0:
            process.send_signal(signals.SIGINT)
        _, errors = process.communicate("\n", timeout=60)
    assert process.returncode == code, errors
    assert (box.requests[0], box.requests[-1]) == (START, STOP)

"""Starting, stopping and losing a stream; what the source knows; what it refuses; how programs end."""

from __future__ import annotations

import signal as signals
import socket
import subprocess
import sys

import numpy as np
import pytest

from granular_id._core import WrenchBuffer
from granular_id.live.netft_page import NetftPageError
from granular_id.live.rdt import RdtSource
from granular_id.live.source import WrenchSource
from granular_id.live.stream import opened
from granular_id.testing import FakeNetft
from rdt_cases import BIAS, BUFFERED, START, STOP, buffer_of, signal, source_of, streaming, taken


def test_rdt_url_is_enough():
    with (
        FakeNetft(signal()) as box,
        opened(box.url + "&variant=axia&rate_hz=500&buffered=1") as stream,
    ):
        assert taken(stream.buffer, 50).shape == (50, 6)
        health = stream.health()
        assert (health.running, health.error) == (True, None)
        assert isinstance(stream.source, WrenchSource)
        assert stream.info.meta["variant"] == "axia"
        assert set(box.requests) == {BUFFERED}
    assert not stream.health().running


def test_rdt_info_holds_what_the_page_says():
    changes = {"setuserfilter": "4", "cfgcalsn": "FT12345", "setbias": "1;2;3;4;5;6"}
    with FakeNetft(page=changes) as box:
        info = source_of(box).info
    assert info.name == "Net F/T 127.0.0.1"
    assert (info.rate_hz, info.tick_hz, info.device_clock, info.synthetic) == (500, 7000, True, True)
    assert (info.serial, info.filter_hz) == ("FT12345", 73)
    assert info.full_scale == (290, 290, 580, 10, 10, 10)
    assert info.meta["variant"] == "netft"
    assert info.meta["page"]["setbias"] == "1;2;3;4;5;6"


def test_rdt_bias_is_sent_only_when_asked_for():
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
        asked = source.health().counters["requests"]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.settimeout(20)
            other.connect(("127.0.0.1", box.port))
            other.send(START)
            for _ in range(600):  # more than a second of silence for ours
                other.recv(36)
        assert "another client may own the stream" in source.health().error
        assert source.health().running
        assert source.health().counters["requests"] == asked


def test_rdt_others_cannot_send_into_the_stream():
    with FakeNetft() as box, streaming(box) as (source, buffer):
        taken(buffer, 10)
        # the box's client is the socket of ours: its port is open to the box alone
        port = box._client[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            for _ in range(50):
                stranger.sendto(bytes(36), ("127.0.0.1", port))
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
    with pytest.raises(ConnectionRefusedError, match=r"nobody listens at 127\.0\.0\.1:\d+"):
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


@pytest.mark.parametrize(
    ("text", "code"),
    [("raise ValueError", 1), (WAIT, -signals.SIGINT), (FORK, 0)],
    ids=["an exception", "Ctrl-C", "after a fork"],
)
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

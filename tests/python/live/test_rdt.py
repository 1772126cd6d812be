"""Starting, stopping and losing a stream; what the source tells; what it refuses."""

from __future__ import annotations

import socket
import struct
import threading

import numpy as np
import pytest

from granular_id._core import RdtReceiver, WrenchBuffer
from granular_id.live.netft_page import FORCE_UNITS, TORQUE_UNITS, NetftPageError
from granular_id.live.rdt import RdtSource
from granular_id.live.source import WrenchSource, open_source
from granular_id.live.stream import opened
from granular_id.testing import FakeNetft
from rdt_cases import BIAS, BUFFERED, START, STOP, buffer_of, n_rows, signal, source_of, streaming
from sink_cases import eventually


def test_a_url_is_enough():
    with (
        FakeNetft(signal()) as box,
        opened(box.url + "&variant=axia&rate_hz=500&buffered=1") as stream,
    ):
        eventually(lambda: stream.buffer.stats()["written"] >= 50)
        assert stream.buffer.window(10).wrench.shape == (10, 6)
        health = stream.health()
        assert (health.running, health.error) == (True, None)
        assert isinstance(stream.source, WrenchSource)
        assert stream.info.meta["variant"] == "axia"
        assert set(box.requests) == {BUFFERED}
    assert not stream.health().running


def test_what_the_page_tells_is_kept():
    changes = {"setuserfilter": "4", "cfgcalsn": "FT12345", "setbias": "1;2;3;4;5;6"}
    with FakeNetft(page=changes) as box:
        info = source_of(box).info
    assert info.name == "Net F/T 127.0.0.1"
    assert (info.rate_hz, info.tick_hz, info.device_clock, info.synthetic) == (500, 7000, True, True)
    assert (info.serial, info.filter_hz) == ("FT12345", 73)
    assert info.full_scale == (290, 290, 580, 10, 10, 10)
    assert info.meta["variant"] == "netft"
    assert info.meta["page"]["setbias"] == "1;2;3;4;5;6"


@pytest.mark.parametrize(("force", "torque"), [("N", "Nm"), ("klbf", "lbf-in"), ("g", "kg-cm")])
def test_units_become_newton_and_newton_metre(force, torque):
    """Exactly so, as the tests of the page show; here, that it is the page's units which are taken."""
    page = {
        "scfgfu": force,
        "scfgtu": torque,
        "cfgcpf": repr(1e5 * float(FORCE_UNITS[force])),
        "cfgcpt": repr(1e6 * float(TORQUE_UNITS[torque])),
    }
    with FakeNetft(signal(4), page=page, n_records=4) as box, streaming(box) as (source, buffer):
        eventually(lambda: n_rows(source) == 4)
    assert source.info.full_scale == pytest.approx((290, 290, 580, 10, 10, 10))
    # as near as whole counts allow
    step = np.array([0.51e-5] * 3 + [0.51e-6] * 3)
    assert (abs(buffer.window(4).wrench - signal(4)) < step).all()


def test_bias_is_sent_when_asked_for_and_never_else():
    with FakeNetft(np.full((10, 6), 2.0)) as box:
        source = source_of(box)
        with pytest.raises(RuntimeError, match="start it first"):
            source.bias()
        with streaming(box, source=source) as (_, buffer):
            eventually(lambda: n_rows(source) > 10)
            assert set(box.requests) == {START}
            assert buffer.latest().wrench[0, 0] == 2.0
            source.bias()
            eventually(lambda: buffer.latest().wrench[0, 0] == 0.0)
        eventually(lambda: box.requests[-1] == STOP)
    assert [request for request in box.requests if request not in (START, STOP)] == [BIAS]


class Deaf(FakeNetft):
    """A box that does not hear the first requests for its stream."""

    def __init__(self, n, **options):
        super().__init__(**options)
        self.left = n

    def _obey(self, command, number, sender):
        if command == START[3] and self.left:
            self.left -= 1
        else:
            super()._obey(command, number, sender)


def test_requests_may_be_lost():
    with Deaf(3, n_records=100) as box, streaming(box) as (source, _):
        assert box.wait(20)
        eventually(lambda: n_rows(source) == 100)
        assert source.health().counters["requests"] == box.requests.count(START) == 4


def test_a_box_that_never_answers_is_left_and_others_may_ask_for_its_health_meanwhile():
    with Deaf(1000) as box:
        source, failed = source_of(box), []
        buffer = buffer_of(source)

        def start():
            try:
                source.start(buffer)
            except TimeoutError as error:
                failed.append(str(error))

        thread = threading.Thread(target=start)
        thread.start()
        asked = 0
        while thread.is_alive():
            assert not source.health().running
            source.stop()
            asked += 1
            thread.join(0.001)
        assert asked > 10
        eventually(lambda: box.requests[-1] == STOP)
        assert box.requests.count(START) == 10
        assert buffer.push([0] * 6)  # the buffer is free again
    assert "of 10 requests" in failed[0]
    assert "another client may own the stream" in failed[0]


@pytest.mark.parametrize("n_real", [0, 3])
def test_a_first_datagram_of_junk_is_no_stream(n_real):
    """What a box sends first may have the length of a record and be none; no row is lost by making sure."""
    records = [struct.pack(">3I6i", i, 14 * i, 0, *[1000 * i] * 6) for i in range(1, n_real + 1)]

    def answer(box):
        asked = 0
        while asked < 2:  # the period, then the stream
            request, client = box.recvfrom(8)
            asked += request[2:4] in (b"\0\x82", b"\0\x02")
        for datagram in (b"\xde\xad\xbe\xef" * 9, *records):
            box.sendto(datagram, client)

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as box:
        box.bind(("127.0.0.1", 0))
        threading.Thread(target=answer, args=(box,), daemon=True).start()
        source = RdtSource("127.0.0.1", box.getsockname()[1], variant="onrobot")
        if not n_real:
            with pytest.raises(TimeoutError, match=r"no stream .* \(1 datagrams made none\)"):
                source.start(buffer_of(source))
            return
        with streaming(box, source=source) as (_, buffer):
            eventually(lambda: n_rows(source) == n_real)
        counters = source.health().counters
        assert (counters["implausible"], counters["lost"], counters["restarts"]) == (1, 0, 0)
        assert buffer.reader(from_oldest=True).read().wrench[:, 0].tolist() == [0.1, 0.2, 0.3]


def test_a_second_client_takes_the_stream_and_that_is_told():
    with FakeNetft() as box, streaming(box) as (source, _):
        eventually(lambda: n_rows(source) > 10)
        asked = source.health().counters["requests"]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.connect(("127.0.0.1", box.port))
            other.send(START)
            eventually(lambda: source.health().error is not None)
            assert "another client may own the stream" in source.health().error
            assert source.health().running
            other.send(STOP)
        assert source.health().counters["requests"] == asked


def test_others_cannot_send_into_the_stream():
    with FakeNetft() as box, streaming(box) as (source, _):
        eventually(lambda: n_rows(source) > 10)
        # the box's client is the socket of ours: its port is open to the box alone
        port = box._client[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            for _ in range(50):
                stranger.sendto(bytes(36), ("127.0.0.1", port))
        before = n_rows(source)
        eventually(lambda: n_rows(source) > before + 50)
    counters = source.health().counters
    assert counters["datagrams"] == counters["rows"]


def test_a_source_runs_once_at_a_time_and_again():
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
        source.stop()
        with streaming(box, source=source):
            eventually(lambda: n_rows(source) > 10)


def test_nobody_listens_and_buffers_that_do_not_fit():
    with FakeNetft() as box:
        source = source_of(box)
    with pytest.raises(ConnectionRefusedError, match=r"nobody listens at 127\.0\.0\.1:\d+"):
        source.start(buffer_of(source))
    with pytest.raises(ValueError, match=r"buffer\.tick_hz is 1e"):
        source.start(WrenchBuffer(1.0, rate_hz=500))
    with pytest.raises(TypeError, match="must be a WrenchBuffer"):
        source.start([])


def test_on_robot_has_a_fixed_scale_and_its_own_requests():
    scale = {"cfgcpf": "1e4", "cfgcpt": "1e5"}
    with FakeNetft(signal(50), tick_hz=500, n_records=50, page=scale) as box:
        source = RdtSource("127.0.0.1", box.port, variant="onrobot")
        with streaming(box, source=source) as (_, buffer):
            source.bias()
            assert box.wait(20)
    assert source.info.name == "OnRobot 127.0.0.1"
    assert box.requests[:2] == [b"\x12\x34\0\x82\0\0\0\x02", START]
    assert b"\x12\x34\0\x42\0\0\0\xff" in box.requests
    scaled = buffer.reader(from_oldest=True).read(1).wrench[0] * [1e4, 1e4, 1e4, 1e5, 1e5, 1e5]
    np.testing.assert_allclose(scaled, np.rint(scaled), atol=1e-6)


@pytest.mark.parametrize(
    ("page", "options", "told"),
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
def test_what_page_and_options_say_of_kind_and_rates(page, options, told):
    with FakeNetft(page=page) as box:
        info = source_of(box, **options).info
    assert (info.meta["variant"], info.rate_hz, info.tick_hz) == told


@pytest.mark.parametrize(
    ("page", "options", "error", "words"),
    [
        ({"runrate": None}, {}, NetftPageError, r"runrate and setrate .* state it: tick_hz=7000"),
        # an index of a table, as some firmware gives it, is no rate
        ({"runrate": None, "setrate": "4"}, {}, NetftPageError, "state it"),
        ({}, {"rate_hz": 1000}, ValueError, r"rate_hz=1000 was stated, .* says 500 \(comrdtrate\)"),
        ({}, {"tick_hz": 7812}, ValueError, r"tick_hz=7812 was stated, .* says 7000"),
        ({}, {"variant": "ati"}, ValueError, "variant must be one of"),
    ],
)
def test_rates_and_kinds_that_are_refused(page, options, error, words):
    with FakeNetft(page=page) as box, pytest.raises(error, match=words):
        source_of(box, **options)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("rdt://box?variant=atii", "one of auto, netft, axia, onrobot"),
        ("rdt://box?rate_hz=fast", "a number above 0"),
        ("rdt://box?buffered=yes", "one of 0, 1"),
        ("rdt:?variant=onrobot", "no host"),
        ("rdt://box/x", "the path '/x'"),
        ("rdt://box?variant=onrobot&rate_hz=300", "whole number of milliseconds"),
    ],
)
def test_urls_that_are_refused(url, words):
    with pytest.raises(ValueError, match=words):
        open_source(url)


def test_the_receiver_checks_by_itself():
    good = {
        "variant": "netft", "counts_per_newton": 1e6, "counts_per_newton_metre": 1e6, "limits": [1.0] * 6,
        "rate_hz": 500.0, "buffered": False,
    }  # fmt: skip
    RdtReceiver("127.0.0.1", 49152, **good)
    for name, value, words in [
        ("variant", "ati", "variant must be 'netft'"),
        ("counts_per_newton", 0.0, "counts_per_newton must be from 1 to 1e9, got 0"),
        ("counts_per_newton_metre", float("nan"), "counts_per_newton_metre must be from 1 to 1e12, got NaN"),
        ("limits", [1.0] * 5 + [float("nan")], "limits must be positive"),
        ("rate_hz", float("inf"), "rate_hz must be positive"),
    ]:
        with pytest.raises(ValueError, match=words):
            RdtReceiver("127.0.0.1", 49152, **{**good, name: value})
    with pytest.raises(ValueError, match="n_axes must be 6, got 3"):
        RdtReceiver("127.0.0.1", 49152, **good).start(WrenchBuffer(n_axes=3))
    with pytest.raises(ConnectionError, match="no address"):
        RdtReceiver("no-such-host.invalid", 1, **good).start(WrenchBuffer())

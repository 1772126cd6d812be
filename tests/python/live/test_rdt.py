"""Starting, stopping and losing a stream; what the source tells; what it refuses."""

from __future__ import annotations

import socket
import struct
import threading
import time
from itertools import cycle

import numpy as np
import pytest

from granular_id._core import RdtReceiver, WrenchBuffer
from granular_id.live.netft_page import FORCE_UNITS, TORQUE_UNITS, NetftPageError
from granular_id.live.rdt import RdtSource
from granular_id.live.source import WrenchSource, open_source
from granular_id.live.stream import opened
from granular_id.testing import FakeNetft, Faults
from rdt_cases import buffer_of, run, signal, source_of, until

STOP, START, BIAS, LATCH = (b"\x12\x34\0" + bytes([code, 0, 0, 0, 0]) for code in (0, 2, 0x42, 0x41))


def test_a_url_is_enough():
    with FakeNetft(signal()) as box, opened(box.url + "&variant=axia&rate_hz=500&resume=1") as stream:
        until(lambda: stream.buffer.stats()["written"] >= 50)
        np.testing.assert_array_equal(stream.buffer.window(10).wrench.shape, (10, 6))
        health = stream.health()
        assert health.running
        assert health.error is None
        assert isinstance(stream.source, WrenchSource)
        assert stream.info.meta["variant"] == "axia"
    assert not stream.health().running


def test_what_the_page_tells_is_kept():
    changes = {"setuserfilter": "4", "cfgcalsn": "FT12345", "setbias": "1;2;3;4;5;6"}
    with FakeNetft(page_changes=changes) as box:
        info = source_of(box).info
    assert info.name == "Net F/T 127.0.0.1"
    assert (info.rate_hz, info.tick_hz, info.device_clock, info.synthetic) == (500, 7000, True, True)
    assert (info.serial, info.filter_hz) == ("FT12345", 73)
    assert info.full_scale == (290, 290, 580, 10, 10, 10)
    assert info.meta["variant"] == "netft"
    assert info.meta["page"]["setbias"] == "1;2;3;4;5;6"


@pytest.mark.parametrize(
    ("force_unit", "torque_unit"), list(zip(cycle(FORCE_UNITS), TORQUE_UNITS, strict=False))
)
def test_units_become_newton_and_newton_metre(force_unit, torque_unit):
    newton, newton_metre = float(FORCE_UNITS[force_unit]), float(TORQUE_UNITS[torque_unit])
    with FakeNetft(
        signal(4),
        force_unit=force_unit,
        torque_unit=torque_unit,
        counts_per_force=1e5 * newton,
        counts_per_torque=1e6 * newton_metre,
        n_records=4,
    ) as box:
        source = source_of(box)
        assert source.info.full_scale == pytest.approx((290, 290, 580, 10, 10, 10))
        buffer = buffer_of(source)
        source.start(buffer)
        assert box.wait(20)
        source.stop()
    got = buffer.window(4).wrench
    # as near as whole counts allow
    np.testing.assert_allclose(got[:, :3], signal(4)[:, :3], rtol=0, atol=0.51e-5)
    np.testing.assert_allclose(got[:, 3:], signal(4)[:, 3:], rtol=0, atol=0.51e-6)


def test_bias_is_sent_when_asked_for_and_never_else():
    with FakeNetft(np.full((10, 6), 2.0)) as box:
        source = source_of(box)
        buffer = buffer_of(source)
        for ask in (source.bias, source.reset_threshold_latch):
            with pytest.raises(RuntimeError, match="start it first"):
                ask()
        source.start(buffer)
        until(lambda: buffer.stats()["written"] > 10)
        assert set(box.requests) == {START}
        assert buffer.latest().wrench[0, 0] == 2.0
        source.bias()
        until(lambda: buffer.latest().wrench[0, 0] == 0.0)
        source.reset_threshold_latch()
        source.stop()
        until(lambda: box.requests[-1] == STOP)
    assert [request for request in box.requests if request not in (START, STOP)] == [BIAS, LATCH]


def test_requests_may_be_lost():
    source, _, _, box = run(Faults(deaf=3), n_records=100)
    assert source.health().counters["requests"] == 4
    assert source.health().counters["rows"] == 100
    assert box.requests.count(START) == 4


def test_a_box_that_never_answers():
    with FakeNetft(faults=Faults(deaf=1000)) as box:
        source = source_of(box)
        buffer = buffer_of(source)
        with pytest.raises(TimeoutError, match=r"of 10 requests .*another client may own the stream"):
            source.start(buffer)
        until(lambda: box.requests[-1] == STOP)
        assert box.requests.count(START) == 10
        assert buffer.push([0] * 6)  # the buffer is free again
        assert not source.health().running


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
        buffer = buffer_of(source)
        if not n_real:
            with pytest.raises(TimeoutError, match=r"no stream .* \(1 datagrams made none\)"):
                source.start(buffer)
            return
        source.start(buffer)
        until(lambda: source.health().counters["rows"] == n_real)
        source.stop()
        counters = source.health().counters
        assert (counters["implausible"], counters["lost"], counters["restarts"]) == (1, 0, 0)
        assert buffer.reader(from_oldest=True).read().wrench[:, 0].tolist() == [0.1, 0.2, 0.3]


def test_nobody_listens():
    with FakeNetft() as box:
        source = source_of(box)
    with pytest.raises(ConnectionRefusedError, match=r"nobody listens at 127\.0\.0\.1:\d+"):
        source.start(buffer_of(source))


def test_a_second_client_takes_the_stream():
    with FakeNetft() as box:
        source = source_of(box)
        buffer = buffer_of(source)
        source.start(buffer)
        until(lambda: buffer.stats()["written"] > 10)
        asked = source.health().counters["requests"]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.connect(("127.0.0.1", box.port))
            other.send(START)
            until(lambda: source.health().error is not None)
            assert "another client may own the stream" in source.health().error
            assert source.health().running
            other.send(STOP)
        # without `resume` nothing was asked for again
        assert source.health().counters["requests"] == asked
        source.stop()


def test_a_stream_can_be_asked_for_again():
    with FakeNetft(faults=Faults(second_client=50)) as box:
        source = source_of(box, resume=True)
        buffer = buffer_of(source)
        source.start(buffer)
        until(lambda: source.health().counters["rows"] > 80)
        counters = source.health().counters
        source.stop()
    assert counters["requests"] >= 2
    assert counters["restarts"] >= 1
    assert (counters["lost"], counters["implausible"]) == (0, 0)


def test_others_cannot_send_into_the_stream():
    with FakeNetft() as box:
        source = source_of(box)
        buffer = buffer_of(source)
        source.start(buffer)
        until(lambda: buffer.stats()["written"] > 10)
        # the box's client is the socket of ours: its port is open to the box alone
        port = box._client[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            for _ in range(50):
                stranger.sendto(bytes(36), ("127.0.0.1", port))
        before = source.health().counters["rows"]
        until(lambda: source.health().counters["rows"] > before + 50)
        source.stop()
    counters = source.health().counters
    assert counters["datagrams"] == counters["rows"]


def test_a_source_runs_once_at_a_time_and_again():
    with FakeNetft() as box:
        source = source_of(box)
        buffer = buffer_of(source)
        source.stop()
        source.start(buffer)
        with pytest.raises(RuntimeError, match="runs already"):
            source.start(buffer_of(source))
        other = source_of(box)
        with pytest.raises(RuntimeError, match="a sensor is writing"):
            other.start(buffer)
        with pytest.raises(RuntimeError, match="a sensor is writing"):
            buffer.push([0] * 6)
        source.stop()
        source.stop()
        source.start(buffer)
        until(lambda: source.health().counters["rows"] > 10)
        source.stop()


def test_health_is_told_while_another_thread_starts():
    with FakeNetft(faults=Faults(deaf=1000)) as box:
        source = source_of(box)
        failed = []

        def start():
            try:
                source.start(buffer_of(source))
            except TimeoutError as error:
                failed.append(error)

        thread = threading.Thread(target=start)
        thread.start()
        asked = 0
        while thread.is_alive():
            assert not source.health().running
            source.stop()
            asked += 1
            time.sleep(0.001)
        thread.join()
        assert failed
        assert asked > 10


def test_buffers_that_do_not_fit():
    with FakeNetft() as box:
        source = source_of(box)
    with pytest.raises(ValueError, match=r"buffer\.tick_hz is 1e"):
        source.start(WrenchBuffer(1.0, rate_hz=500))
    with pytest.raises(TypeError, match="must be a WrenchBuffer"):
        source.start([])


def test_on_robot_has_a_fixed_scale_and_its_own_requests():
    with FakeNetft(signal(50), tick_hz=500, counts_per_force=1e4, counts_per_torque=1e5, n_records=50) as box:
        source = RdtSource("127.0.0.1", box.port, variant="onrobot")
        buffer = buffer_of(source)
        source.start(buffer)
        source.bias()
        assert box.wait(20)
        source.stop()
    assert source.info.name == "OnRobot 127.0.0.1"
    assert box.requests[:2] == [b"\x12\x34\0\x82\0\0\0\x02", START]
    assert b"\x12\x34\0\x42\0\0\0\xff" in box.requests
    scaled = buffer.reader(from_oldest=True).read(1).wrench[0] * [1e4, 1e4, 1e4, 1e5, 1e5, 1e5]
    np.testing.assert_allclose(scaled, np.rint(scaled), atol=1e-6)
    with pytest.raises(ValueError, match="whole number of milliseconds"):
        RdtSource("127.0.0.1", variant="onrobot", rate_hz=300)


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
    with FakeNetft(page_changes=page) as box:
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
    with FakeNetft(page_changes=page) as box, pytest.raises(error, match=words):
        source_of(box, **options)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("rdt://box?variant=atii", "one of auto, netft, axia, onrobot"),
        ("rdt://box?rate_hz=fast", "a number above 0"),
        ("rdt://box?resume=yes", "one of 0, 1"),
        ("rdt:?variant=onrobot", "no host"),
        ("rdt://box/x", "the path '/x'"),
    ],
)
def test_urls_that_are_refused(url, words):
    with pytest.raises(ValueError, match=words):
        open_source(url)


def test_the_receiver_checks_by_itself():
    good = {
        "variant": "netft", "counts_per_newton": 1e6, "counts_per_newton_metre": 1e6, "limits": [1.0] * 6,
        "rate_hz": 500.0, "buffered": False, "resume": False,
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
    with pytest.raises(ConnectionError, match="no address"):
        RdtReceiver("no-such-host.invalid", 1, **good).start(WrenchBuffer())

"""WrenchBuffer from Python: rows in, blocks and windows out, and why there is no window."""

import doctest
import signal
import sys
import threading
import time

import numpy as np
import pytest

from granular_id import _core
from granular_id._core import SAMPLE_FLAGS, WindowError, WrenchBuffer
from granular_id.recording import SampleFlag

T = np.arange(100) / 500
X = np.random.default_rng(1).standard_normal((100, 6))


def filled(n=100):
    buffer = WrenchBuffer()
    assert buffer.push_block(X[:n], T[:n]) == n
    return buffer


@pytest.mark.parametrize("name", ["WrenchBuffer", "WrenchReader"])
def test_examples_of_the_documentation(name):
    examples = doctest.DocTestFinder(recurse=False).find(getattr(_core, name), name, globs={})
    for example in examples:
        assert doctest.DocTestRunner(verbose=False).run(example).failed == 0


def test_block_comes_out_as_it_went_in():
    buffer = WrenchBuffer()
    reader = buffer.reader()
    flags = np.arange(100, dtype=np.uint8) % 16
    arrived = np.arange(100, dtype=np.uint64) + 2**60
    assert buffer.push_block(X, T, flags=flags, host_ns=arrived) == 100
    block = reader.read()
    assert (len(block), block.epoch, block.missed) == (100, 0, 0)
    ticks = np.arange(100, dtype=np.uint64) * 2_000_000
    for got, wanted, dtype in [
        (block.wrench, X, "f8"),
        (block.ticks, ticks, "u8"),
        (block.time_s, ticks / 1e9, "f8"),
        (block.host_ns, arrived, "u8"),
        (block.flags, flags, "u1"),
        (block.missing_before, np.zeros(100), "u4"),
    ]:
        np.testing.assert_array_equal(got, wanted)
        assert got.dtype.str[1:] == dtype
    assert len(reader.read()) == 0


def test_rows_one_by_one_are_the_same_as_a_block():
    one, many = WrenchBuffer(reorder_depth=3), WrenchBuffer()
    for row, t in zip(X, T, strict=True):
        assert one.push(row, t, flags=2, host_ns=7)
    one.flush()
    many.push_block(X, T, flags=2, host_ns=7)
    np.testing.assert_array_equal(one.window(100, allow_saturated=True).wrench, X)
    assert one.latest().host_ns.tolist() == many.latest().host_ns.tolist() == [7]
    assert one.stats() == many.stats()
    assert one.stats()["saturated"] == 100


def test_lag_is_the_time_since_the_newest_row_should_have_come():
    buffer = WrenchBuffer()
    assert np.isnan([buffer.lag_s(), buffer.device_time_s(0)]).all()
    buffer.push_block(X, 5 + T, host_ns=10**12 + np.arange(100) * 2_000_000)
    last = 10**12 + 99 * 2_000_000
    assert (buffer.lag_s(last), buffer.lag_s(last + 25_000_000)) == (0, 0.025)
    assert buffer.device_time_s(last) == pytest.approx(5 + T[-1], abs=1e-9)
    live = WrenchBuffer()
    live.push(X[0])
    assert 0 <= live.lag_s() < 10


def test_windows_with_gaps():
    buffer = WrenchBuffer()
    rows = [0, 1, 2, 5, 6]
    buffer.push_block(X[rows], T[rows], host_ns=[0, 10, 20, 50, 60])
    measured = buffer.window(7, max_gap=2)
    assert measured.mask.tolist() == [True, True, True, False, False, True, True]
    np.testing.assert_array_equal(measured.wrench, X[rows])
    np.testing.assert_array_equal(measured.time_s, T[rows])
    line = buffer.window(7, max_gap=2, fill="linear")
    np.testing.assert_allclose(line.wrench[3:5], X[2] + (X[5] - X[2]) * [[1 / 3], [2 / 3]], rtol=1e-12)
    np.testing.assert_array_equal(line.wrench[line.mask], X[rows])
    assert line.flags.tolist() == [0, 0, 0, SampleFlag.GAP_FILLED, SampleFlag.GAP_FILLED, 0, 0]
    assert line.host_ns.tolist() == [0, 10, 20, 30, 40, 50, 60]
    np.testing.assert_array_equal(line.ticks, np.arange(7) * 2_000_000)
    holes = buffer.window(4, max_gap=2, fill="nan")
    np.testing.assert_array_equal(np.isnan(holes.wrench).all(axis=1), ~holes.mask)
    assert holes.mask.tolist() == [False, False, True, True]


def test_a_window_is_a_copy():
    buffer = filled()
    window = buffer.window(10)
    buffer.push_block(X[:50] + 1)
    np.testing.assert_array_equal(window.wrench, X[90:])
    window.wrench[:] = 0
    np.testing.assert_array_equal(buffer.window(10).wrench, X[40:50] + 1)


def test_windows_that_are_not_there_are_refused():
    for n, max_gap, message in (
        (200, 99, "n = 200 needs as many instants, got 151"),
        (3, 1, "at most max_gap = 1 instants"),
    ):
        buffer = filled()
        buffer.push(X[0], 0.3)
        with pytest.raises(WindowError, match=message) as refused:
            buffer.window(n, max_gap=max_gap)
        assert isinstance(refused.value, ValueError)


def test_waiting_ends_with_a_row_or_with_the_time():
    buffer = filled()
    reader = buffer.reader()
    start = time.monotonic()
    assert not reader.wait(0)
    assert not reader.wait(0.03)
    assert time.monotonic() - start >= 0.03
    feeder = threading.Timer(0.02, lambda: buffer.push(X[0]))
    feeder.start()
    assert reader.wait(float("inf"))
    assert reader.wait(0)
    feeder.join()
    assert len(reader.read()) == 1


@pytest.mark.thread_unsafe(reason="installs a signal handler")
@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
def test_a_signal_ends_a_wait():
    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGUSR1, interrupt)
    try:
        timer = threading.Timer(0.05, lambda: signal.raise_signal(signal.SIGUSR1))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            WrenchBuffer().reader().wait(30)
        timer.join()
    finally:
        signal.signal(signal.SIGUSR1, before)


def test_buffer_shows_its_parameters():
    buffer = WrenchBuffer(2.5, rate_hz=100, tick_hz=1000, reorder_depth=np.int64(2), n_axes=9)
    assert (buffer.n_axes, eval(repr(buffer)).n_axes) == (9, 9)
    assert (buffer.seconds, buffer.rate_hz, buffer.tick_hz, buffer.reorder_depth) == (2.5, 100.0, 1000.0, 2)
    assert buffer.capacity == eval(repr(buffer)).capacity == 250
    assert "0 rows" in repr(buffer.reader().read())
    assert "3 instants, 3 rows" in repr(filled().window(3))
    assert "100 rows ahead" in repr(filled().reader(from_oldest=True))
    assert {flag.name: flag.value for flag in SampleFlag} == SAMPLE_FLAGS

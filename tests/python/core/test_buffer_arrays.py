"""Anything array-like goes into a buffer with its own numbers, or not at all with one clear exception."""

import warnings

import numpy as np
import pytest

from granular_id._core import WrenchBuffer

X = np.random.default_rng(5).standard_normal((5, 24, 6))
GOOD = np.zeros((3, 6))
ROW = np.zeros(6)


@pytest.mark.parametrize("kind", [list, tuple, np.float32, lambda row: row[::-1][::-1], lambda row: row > 0])
def test_one_row_of_every_kind(kind):
    value = kind(X[0, 0])
    buffer = WrenchBuffer()
    assert buffer.push(value)
    np.testing.assert_array_equal(buffer.latest().wrench[0], np.asarray(value, np.float64))


def refused(method, error, message, *arguments, **keywords):
    return pytest.param(method, error, message, arguments, keywords, id=f"{method}: {message}")


@pytest.mark.parametrize(
    ("method", "error", "message", "arguments", "keywords"),
    [
        refused("push_block", ValueError, r"wrench .*\(n, 6\), got \(1, 3, 6\)", GOOD[None]),
        refused("push_block", ValueError, r"t .*\(3,\), one per row of wrench, got \(2,\)", GOOD, [0, 1]),
        refused("push_block", ValueError, "t must .* seconds, got -0.1 at row 1", GOOD, [0, -0.1, 1]),
        refused("push_block", ValueError, "t must .* got NaN at row 2", GOOD, [0, 1, np.nan]),
        refused("push_block", ValueError, "flags .* from 0 to 15, got 16", GOOD, flags=16),
        refused("push_block", ValueError, "flags .* got 0.5 at row 1", GOOD, flags=[0, 0.5, 0]),
        refused("push_block", ValueError, r"flags .*\(3,\), .*, got \(1,\)", GOOD, flags=[0]),
        refused("push_block", TypeError, "host_ns .* got dtype float64", GOOD, host_ns=[0.0, 1.0, 2.0]),
        refused("push_block", ValueError, "host_ns .* got -5 at row 1", GOOD, host_ns=[0, -5, 2]),
        refused("push_block", ValueError, r"host_ns .*\(3,\), .*, got \(2,\)", GOOD, host_ns=[0, 1]),
        refused("push_block", ValueError, "host_ns must be an integer from 0", GOOD, host_ns=-1),
        refused("push", ValueError, r"wrench .*\(6,\), got \(1, 6\)", ROW[None]),
        refused("push", ValueError, r"wrench .*\(6,\), got \(3,\)", ROW[:3]),
        refused("push", ValueError, "t must .* got -1", ROW, -1),
        refused("push", ValueError, "flags .* got -1", ROW, flags=-1),
        refused("window", ValueError, "n must be .*, got 5001", 5001),
        refused("window", ValueError, "fill must be 'none' or 'nan' or 'linear', got", 1, fill="cubic"),
        refused("window", ValueError, "max_gap must be an integer from 0", 1, max_gap=-1),
        refused("window", TypeError, "bool.*allow_saturated", 1, allow_saturated="no"),
        refused("reader", TypeError, "bool.*from_oldest", 1),
        refused("lag_s", TypeError, "now_ns must be an integer", 0.5),
    ],
)
def test_bad_input_is_one_clear_error_and_nothing_is_taken(method, error, message, arguments, keywords):
    buffer = WrenchBuffer()
    buffer.push(ROW)
    before = buffer.stats()
    with pytest.raises(error, match=f"(?s){message}"):
        getattr(buffer, method)(*arguments, **keywords)
    assert buffer.stats() == before


@pytest.mark.parametrize(
    ("error", "message", "options"),
    [
        (ValueError, "seconds must be positive and give at most 16777216 rows", {"seconds": 0}),
        (ValueError, "seconds must be positive and give at most", {"seconds": 1e9}),
        (ValueError, "rate_hz must be positive and finite, got -1", {"rate_hz": -1}),
        (ValueError, "tick_hz must be finite and at least rate_hz = 500, got 100", {"tick_hz": 100}),
        (ValueError, "reorder_depth must be .*, got 1025", {"reorder_depth": 1025}),
    ],
)
def test_buffers_that_are_refused(error, message, options):
    with pytest.raises(error, match=f"(?s){message}"):
        WrenchBuffer(**options)


@pytest.mark.parametrize("timeout_s", [-1, float("nan")])
def test_wait_for_no_time_is_refused(timeout_s):
    with pytest.raises(ValueError, match="timeout_s must"):
        WrenchBuffer().reader().wait(timeout_s)


def test_nothing_is_a_block_too():
    buffer = WrenchBuffer()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert buffer.push_block(np.empty((0, 6)), np.empty(0), flags=[], host_ns=[]) == 0
    assert buffer.latest() is None


def test_an_argument_that_pushes_itself_does_not_hang():
    """Code of the caller's may run while an argument is read; it must find the buffer free."""
    buffer = WrenchBuffer()

    class Late:
        def __float__(self):
            buffer.push(ROW, 0.5)
            return 1.0

    assert buffer.push(ROW, Late())
    assert buffer.stats()["written"] == 2

"""Anything array-like goes into a buffer with its own numbers, or not at all with one clear exception."""

import warnings

import numpy as np
import pytest

from array_kinds import KINDS, digest
from granular_id._core import WrenchBuffer

X = np.random.default_rng(5).standard_normal((5, 24, 6))

# Kinds that change the shape: what is pushed must have six axes.
OTHER_SHAPES = {
    "one axis",
    "many axes",
    "data frame of mixed numbers",
}


@pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")
@pytest.mark.parametrize("kind", sorted(KINDS.keys() - OTHER_SHAPES))
def test_every_kind_of_array(kind):
    value = KINDS[kind](X[1])
    before = digest(value)
    plain = np.array(value, np.float64, order="C")
    buffer = WrenchBuffer()
    assert buffer.push_block(value) == len(plain)
    np.testing.assert_array_equal(buffer.window(len(plain)).wrench, plain)
    assert digest(value) == before


@pytest.mark.parametrize("kind", sorted(OTHER_SHAPES))
def test_other_numbers_of_axes_are_refused(kind):
    with pytest.raises(ValueError, match=r"wrench must have shape \(n, 6\), got"):
        WrenchBuffer().push_block(KINDS[kind](X[1]))


@pytest.mark.parametrize("kind", [list, tuple, np.float32, lambda row: row[::-1][::-1], lambda row: row > 0])
def test_one_row_of_every_kind(kind):
    row = X[0, 0] if kind in (list, tuple) else X[0, 0].astype(np.float32)
    value = kind(row)
    buffer = WrenchBuffer()
    assert buffer.push(value)
    np.testing.assert_array_equal(buffer.latest().wrench[0], np.asarray(value, np.float64))


@pytest.mark.parametrize(
    "t",
    [
        np.arange(24) / 500,
        (np.arange(24) / 500).tolist(),
        (np.arange(48) / 1000)[::2],
        np.arange(24)[::-1][::-1] / 500,
        np.arange(24, dtype=np.int32),
    ],
)
def test_times_of_every_kind(t):
    buffer = WrenchBuffer(30, rate_hz=500 if np.max(t) < 1 else 1)
    assert buffer.push_block(X[0], t) == 24
    np.testing.assert_allclose(buffer.window(24, max_gap=3).time_s, np.asarray(t, float), rtol=1e-15)


def refused(error, message, *arguments, method="push_block", **keywords):
    title = f"{method}: {message}"
    return pytest.param(error, message, method, arguments, keywords, id=title)


GOOD = np.zeros((3, 6))
ROW = np.zeros(6)


@pytest.mark.parametrize(
    ("error", "message", "method", "arguments", "keywords"),
    [
        refused(ValueError, r"wrench must have shape \(n, 6\), got \(6,\)", ROW),
        refused(ValueError, r"wrench must have shape \(n, 6\), got \(1, 3, 6\)", GOOD[None]),
        refused(ValueError, r"wrench must have shape \(n, 6\), got \(6, 3\)", GOOD.T),
        refused(TypeError, "wrench must hold real numbers, got dtype complex128", GOOD + 1j),
        refused(TypeError, "wrench must hold real numbers, got dtype object", GOOD.astype(object)),
        refused(TypeError, "wrench must hold real numbers, got dtype <U", [["1"] * 6]),
        refused(TypeError, "wrench must be a plain array, got a masked one", np.ma.masked_array(GOOD)),
        refused(ValueError, r"t must have shape \(3,\), one per row of wrench, got \(2,\)", GOOD, [0, 1]),
        refused(ValueError, r"t must have shape \(3,\), one per row of wrench, got \(\)", GOOD, 0.0),
        refused(ValueError, "t must be from 0 to .* seconds, got -0.1 at row 1", GOOD, [0, -0.1, 1]),
        refused(ValueError, "t must be from 0 to .* seconds, got NaN at row 2", GOOD, [0, 1, np.nan]),
        refused(ValueError, "t must be from 0 to .* seconds, got inf at row 0", GOOD, [np.inf, 0, 1]),
        refused(ValueError, "flags must be made of the bits .* from 0 to 15, got 16", GOOD, flags=16),
        refused(ValueError, "flags must be made of .*, got 0.5 at row 1", GOOD, flags=[0, 0.5, 0]),
        refused(ValueError, "flags must be made of .*, got NaN at row 0", GOOD, flags=[np.nan, 0, 0]),
        refused(ValueError, r"flags must have shape \(3,\), .*, got \(1,\)", GOOD, flags=[0]),
        refused(TypeError, "flags must be an integer, got 1.5j", GOOD, flags=1.5j),
        refused(TypeError, "host_ns must hold integers, got dtype float64", GOOD, host_ns=[0.0, 1.0, 2.0]),
        refused(ValueError, "host_ns must not be negative, got -5 at row 1", GOOD, host_ns=[0, -5, 2]),
        refused(ValueError, r"host_ns must have shape \(3,\), .*, got \(2,\)", GOOD, host_ns=[0, 1]),
        refused(ValueError, "host_ns must be an integer from 0 to", GOOD, host_ns=-1),
        refused(TypeError, "host_ns must be an integer, got 0.5", GOOD, host_ns=0.5),
        refused(ValueError, r"wrench must have shape \(6,\), got \(1, 6\)", ROW[None], method="push"),
        refused(ValueError, r"wrench must have shape \(6,\), got \(5,\)", ROW[:5], method="push"),
        refused(ValueError, r"wrench must have shape \(6,\), got \(\)", 1.0, method="push"),
        refused(TypeError, "t must be a real number, got '1'", ROW, "1", method="push"),
        refused(ValueError, "t must be from 0 to .* seconds, got -1", ROW, -1, method="push"),
        refused(ValueError, "t must be from 0 to .* seconds, got NaN", ROW, np.nan, method="push"),
        refused(ValueError, "flags must be an integer from 0 to 255, got -1", ROW, flags=-1, method="push"),
        refused(TypeError, "flags must be an integer, got 1.0", ROW, flags=1.0, method="push"),
        refused(ValueError, "n must be an integer from 1 to 5000, got 0", 0, method="window"),
        refused(ValueError, "n must be an integer from 1 to 5000, got 5001", 5001, method="window"),
        refused(TypeError, "n must be an integer, got 1.5", 1.5, method="window"),
        refused(
            ValueError,
            "fill must be 'none' or 'nan' or 'linear', got 'cubic'",
            1,
            fill="cubic",
            method="window",
        ),
        refused(ValueError, "max_gap must be an integer from 0 to", 1, max_gap=-1, method="window"),
        refused(TypeError, "allow_saturated must be True or False", 1, allow_saturated="no", method="window"),
        refused(TypeError, "from_oldest must be True or False, got 1", 1, method="reader"),
        refused(TypeError, "now_ns must be an integer", 0.5, method="lag_s"),
    ],
)
def test_bad_input_is_one_clear_error_and_nothing_is_taken(error, message, method, arguments, keywords):
    buffer = WrenchBuffer()
    buffer.push(ROW)
    before = buffer.stats()
    with pytest.raises(error, match=message):
        getattr(buffer, method)(*arguments, **keywords)
    assert buffer.stats() == before


@pytest.mark.parametrize(
    ("error", "message", "options"),
    [
        (ValueError, "seconds must be positive and give at most 16777216 rows", {"seconds": 0}),
        (ValueError, "seconds must be positive and give at most", {"seconds": 1e9}),
        (ValueError, "seconds must be positive and give at most", {"seconds": float("nan")}),
        (TypeError, "seconds must be a real number, got 'a'", {"seconds": "a"}),
        (ValueError, "rate_hz must be positive and finite, got -1", {"rate_hz": -1}),
        (ValueError, "tick_hz must be finite and at least rate_hz = 500, got 100", {"tick_hz": 100}),
        (ValueError, "reorder_depth must be an integer from 0 to 1024, got -1", {"reorder_depth": -1}),
        (ValueError, "reorder_depth must be an integer from 0 to 1024, got 1025", {"reorder_depth": 1025}),
        (TypeError, "reorder_depth must be an integer, got 1.5", {"reorder_depth": 1.5}),
    ],
)
def test_buffers_that_are_refused(error, message, options):
    with pytest.raises(error, match=message):
        WrenchBuffer(**options)


@pytest.mark.parametrize(
    ("error", "call"),
    [
        (ValueError, lambda reader: reader.read(0)),
        (TypeError, lambda reader: reader.read(1.5)),
        (ValueError, lambda reader: reader.wait(-1)),
        (ValueError, lambda reader: reader.wait(float("nan"))),
        (TypeError, lambda reader: reader.wait("soon")),
    ],
)
def test_reads_that_are_refused(error, call):
    with pytest.raises(error, match=r"(max_rows|timeout_s) must"):
        call(WrenchBuffer().reader())


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

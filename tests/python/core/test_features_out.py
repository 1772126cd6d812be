"""Where features are written: any good output is filled, any other is refused, and the input stays as it is."""

import numpy as np
import pandas as pd
import pytest

import features_twin as twin
from array_kinds import Interface, Subclass, misaligned, read_only
from granular_id.features import extract_features

X = np.random.default_rng(21).standard_normal((5, 24, 6))
N = 744
OUT = {
    "too long": (lambda: np.zeros((5, N + 1)), ValueError, r"out must have shape \(5, 744\), got \(5, 745\)"),
    "too short": (lambda: np.zeros((4, N)), ValueError, r"out must have shape \(5, 744\), got \(4, 744\)"),
    "flat": (lambda: np.zeros(5 * N), ValueError, r"out must have shape \(5, 744\), got \(3720,\)"),
    "rank 3": (lambda: np.zeros((1, 5, N)), ValueError, r"out must have shape \(5, 744\), got \(1, 5, 744\)"),
    "0-d": (lambda: np.zeros(()), ValueError, r"out must have shape \(5, 744\), got \(\)"),
    "empty": (lambda: np.zeros((5, 0)), ValueError, r"out must have shape \(5, 744\), got \(5, 0\)"),
    "strided": (lambda: np.zeros((5, 2 * N))[:, ::2], ValueError, "out must be C-contiguous"),
    "strided rows": (lambda: np.zeros((10, N))[::2], ValueError, "out must be C-contiguous"),
    "reversed": (lambda: np.zeros((5, N))[::-1], ValueError, "out must be C-contiguous"),
    "Fortran": (lambda: np.zeros((5, N), order="F"), ValueError, "out must be C-contiguous"),
    "read-only": (lambda: read_only(np.zeros((5, N))), ValueError, "out must be writable"),
    "broadcast": (lambda: np.broadcast_to(0.0, (5, N)), ValueError, "out must be"),
    "misaligned": (lambda: misaligned(np.zeros((5, N))), ValueError, "out must be aligned"),
    "misaligned float32": (
        lambda: misaligned(np.zeros((5, N), np.float32)),
        ValueError,
        "out must be aligned",
    ),
    "byte-swapped": (
        lambda: np.zeros((5, N), np.dtype(float).newbyteorder()),
        TypeError,
        "out .*float64 or float32",
    ),
    "int64": (lambda: np.zeros((5, N), int), TypeError, "out .*float64 or float32 .* got int64"),
    "float16": (lambda: np.zeros((5, N), np.float16), TypeError, "out .*float64 or float32 .* got float16"),
    "long double": (lambda: np.zeros((5, N), np.longdouble), TypeError, "out .*float64 or float32"),
    "complex": (lambda: np.zeros((5, N), complex), TypeError, "out .*float64 or float32 .* got complex128"),
    "object": (lambda: np.zeros((5, N), object), TypeError, "out .*float64 or float32 .* got object"),
    "structured": (lambda: np.zeros((5, N), "f8,f8"), TypeError, "out .*float64 or float32"),
    "list": (lambda: [[0.0] * N] * 5, TypeError, "out .*float64 or float32 .* got .*list"),
    "number": (lambda: 0.0, TypeError, "out .*float64 or float32 .* got .*float"),
    "dtype": (lambda: np.float32, TypeError, "out .*float64 or float32"),
    "buffer": (lambda: bytearray(5 * N * 8), TypeError, "out .*float64 or float32 .* got .*bytearray"),
    "data frame": (lambda: pd.DataFrame(np.zeros((5, N))), TypeError, "out .*float64 or float32"),
    "masked": (lambda: np.ma.masked_all((5, N)), TypeError, "out must be a plain array"),
}


@pytest.mark.parametrize("kind", OUT)
def test_bad_outputs(kind):
    make, error, message = OUT[kind]
    out, x = make(), X.copy()
    before = np.array(out, copy=True).tobytes()
    for threads in (1, 2):
        with pytest.raises(error, match=message):
            extract_features(x, out=out, threads=threads)
    assert np.array(out).tobytes() == before
    assert x.tobytes() == X.tobytes()
    good = np.empty((5, N))
    assert twin.differing_bits(extract_features(x, out=good), twin.features(X)) == 0


@pytest.mark.parametrize(
    "kind", ["memory-mapped", "subclass", "view of bytes", "row of a table", "with ones"]
)
def test_good_outputs_of_all_kinds(kind, tmp_path):
    x, options = X, {}
    if kind == "memory-mapped":
        out = np.memmap(tmp_path / "out.bin", np.float64, "w+", shape=(5, N))
    elif kind == "subclass":
        out = np.zeros((5, N)).view(Subclass)
    elif kind == "view of bytes":
        out = np.frombuffer(bytearray(5 * N * 8)).reshape(5, N)
    elif kind == "row of a table":
        x, out = X[0], np.zeros((3, N))[1]
    else:  # strides of a dimension of length one mean nothing
        x, out = X[:1], np.zeros((4, N))[::4]
    assert extract_features(x, out=out, **options) is out
    assert twin.differing_bits(np.asarray(out), twin.features(x)) == 0


def overlapping(kind):
    """An input of shape (20, 6) and an output for it that share memory."""
    base = np.zeros(2000)
    wrench, out = base[:120].reshape(20, 6), base[:720]
    if kind == "the last number":
        wrench = base[719:839].reshape(20, 6)
    elif kind == "as float32":
        out = base.view(np.float32)[:720]
    elif kind == "stride tricks":
        wrench = np.lib.stride_tricks.as_strided(base, (20, 6), (48, 8))
    elif kind == "two views of one buffer":
        buffer = bytearray(16_000)
        wrench, out = np.frombuffer(buffer)[:120].reshape(20, 6), np.frombuffer(buffer)[:720]
    elif kind == "array interface":
        wrench = np.asarray(Interface(base))[:120].reshape(20, 6)
    return wrench, out


@pytest.mark.parametrize(
    "kind",
    [
        "the same array",
        "the last number",
        "as float32",
        "stride tricks",
        "two views of one buffer",
        "array interface",
    ],
)
def test_an_output_over_the_input_is_refused(kind):
    wrench, out = overlapping(kind)
    assert np.shares_memory(wrench, out)
    wrench[:] = X[0, :20]
    with pytest.raises(ValueError, match=r"out must .*not overlap wrench"):
        extract_features(wrench, out=out)
    assert np.array_equal(wrench, X[0, :20])


def test_an_output_beside_the_input_is_fine():
    base = np.zeros(2000)
    wrench, out = base[720:840].reshape(20, 6), base[:720]
    wrench[:] = X[0, :20]
    assert np.array_equal(extract_features(wrench, out=out), twin.features(X[0, :20]))
    # What is converted is copied first: then the output may lie over it.
    wrench = base[:240].reshape(40, 6)[::2]
    wrench[:] = X[0, :20]
    out = base[:720]
    assert np.array_equal(extract_features(wrench, out=out), twin.features(X[0, :20]))


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"threads": 0}, ValueError, "threads must be an integer of at least 1, got 0"),
        ({"threads": -1}, ValueError, "threads must be .* got -1"),
        ({"threads": 10**30}, ValueError, "threads must be .* got 10{30}"),
        ({"threads": 2.0}, TypeError, "threads must be an integer, got .*float"),
        ({"threads": "2"}, TypeError, "threads must be an integer, got .*str"),
        ({"dtype": np.float16}, TypeError, "dtype must be float64 or float32.*got float16"),
        ({"dtype": ">f8"}, TypeError, "dtype must be float64 or float32.*got >f8"),
        ({"dtype": int}, TypeError, "dtype must be float64 or float32.*got int64"),
        ({"dtype": complex}, TypeError, "dtype must be float64 or float32.*got complex128"),
        ({"dtype": object}, TypeError, "dtype must be float64 or float32.*got object"),
        ({"dtype": "M8[s]"}, TypeError, "dtype must be float64 or float32.*got datetime64"),
        ({"dtype": "f8,f8"}, TypeError, "dtype must be float64 or float32"),
        ({"dtype": "double precision"}, TypeError, "dtype must be"),
        ({"dtype": 64}, TypeError, "dtype must be"),
    ],
)
def test_bad_threads_and_types(arguments, error, message):
    with pytest.raises(error) as caught:
        extract_features(X, **arguments)
    assert caught.match(message)
    assert extract_features(X, threads=1).shape == (5, N)


def test_a_finite_value_does_not_become_infinite_in_float32():
    x = np.zeros((4, 6))
    x[2, 1] = 1e39
    for options in ({"dtype": np.float32}, {"out": np.empty(624, np.float32)}):
        with pytest.raises(ValueError, match="float32"):
            extract_features(x, **options)


def test_the_input_is_checked_before_the_output_is_touched():
    out = np.full((5, N), 7.0)
    for wrench in (X.astype(complex), X[:4], X[..., :5], np.zeros((5, 0, 6))):
        with pytest.raises((TypeError, ValueError)):
            extract_features(wrench, out=out)
        assert (out == 7).all()

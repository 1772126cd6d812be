"""Where features are written: any good output is filled, any other is refused, and the input stays as it is."""

import numpy as np
import pytest

import features_twin as twin
from array_kinds import Subclass, misaligned, read_only
from granular_id.features import extract_features

X = np.random.default_rng(21).standard_normal((5, 24, 6))
N = 744

BAD_OUT = {
    "too long": (np.zeros((5, N + 1)), ValueError, r"out must have shape \(5, 744\), got \(5, 745\)"),
    "flat": (np.zeros(5 * N), ValueError, r"out must have shape \(5, 744\), got \(3720,\)"),
    "strided": (np.zeros((5, 2 * N))[:, ::2], ValueError, "out must be C-contiguous"),
    "Fortran": (np.zeros((5, N), order="F"), ValueError, "out must be C-contiguous"),
    "read-only": (read_only(np.zeros((5, N))), ValueError, "out must be writable"),
    "misaligned": (misaligned(np.zeros((5, N))), ValueError, "out must be aligned"),
    "float32": (np.zeros((5, N), np.float32), TypeError, "out must be a float64 array .* got float32"),
    "byte-swapped": (np.zeros((5, N), ">f8"), TypeError, "out must be a float64 array"),
    "list": ([[0.0] * N] * 5, TypeError, "out must be a float64 array .* got .*list"),
    "buffer": (bytearray(5 * N * 8), TypeError, "out must be a float64 array .* got .*bytearray"),
    "masked": (np.ma.masked_all((5, N)), TypeError, "out must be a plain array"),
}


@pytest.mark.parametrize(("out", "error", "message"), BAD_OUT.values(), ids=BAD_OUT)
def test_bad_outputs(out, error, message):
    before = np.array(out, copy=True).tobytes()
    for threads in (1, 2):
        with pytest.raises(error, match=message):
            extract_features(X, out=out, threads=threads)
    assert np.array(out).tobytes() == before


def test_good_outputs_of_all_kinds(tmp_path):
    whole, first, table = twin.features(X), twin.features(X[0]), np.full((3, N), 7.0)
    for x, out, wanted in [
        (X, np.memmap(tmp_path / "out.bin", np.float64, "w+", shape=(5, N)), whole),
        (X, np.zeros((5, N)).view(Subclass), whole),
        (X, np.frombuffer(bytearray(5 * N * 8)).reshape(5, N), whole),
        (X[0], table[1], first),
        (X[:1], np.zeros((4, N))[::4], whole[:1]),  # strides of a dimension of length one mean nothing
    ]:
        assert extract_features(x, out=out) is out
        assert twin.differing_bits(np.asarray(out), wanted) == 0
    assert (table[[0, 2]] == 7).all()


def overlapping(kind):
    """An input of shape (20, 6) and an output for it that share memory."""
    base = np.zeros(2000)
    wrench, out = base[:120].reshape(20, 6), base[:720]
    if kind == "the last number":
        wrench = base[719:839].reshape(20, 6)
    elif kind == "two views of one buffer":
        buffer = bytearray(16_000)
        wrench, out = np.frombuffer(buffer)[:120].reshape(20, 6), np.frombuffer(buffer)[:720]
    return wrench, out


@pytest.mark.parametrize("kind", ["the same array", "the last number", "two views of one buffer"])
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
    assert np.array_equal(extract_features(wrench, out=out), twin.features(X[0, :20]))


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"threads": 10**30}, ValueError, "threads must be .* got 10{30}"),
        ({"dtype": np.float16}, TypeError, "dtype must be float64 or float32"),
        ({"dtype": ">f8"}, TypeError, "dtype must be float64 or float32, got .>f8"),
        ({"dtype": "double precision"}, TypeError, "dtype must be"),
    ],
)
def test_bad_threads_and_types(arguments, error, message):
    with pytest.raises(error, match=message):
        extract_features(X, **arguments)


def test_a_finite_value_does_not_become_infinite_in_float32():
    x = np.zeros((4, 6))
    x[2, 1] = 1e39
    with pytest.raises(ValueError, match="float32"):
        extract_features(x, dtype=np.float32)


@pytest.mark.parametrize("wrench", [X.astype(complex), X[:4], X[..., :5], np.zeros((5, 0, 6))])
def test_the_input_is_checked_before_the_output_is_touched(wrench):
    out = np.full((5, N), 7.0)
    with pytest.raises((TypeError, ValueError)):
        extract_features(wrench, out=out)
    assert (out == 7).all()

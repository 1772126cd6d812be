"""Arrays in and out: right features or one clear exception, no input is modified, any good output is filled."""

import warnings

import numpy as np
import pytest

import features_twin as twin
from array_kinds import KINDS, Lists, Subclass, digest, misaligned, read_only
from granular_id.features import extract_features
from granular_id.synthetic import synthesize

X = np.random.default_rng(21).standard_normal((5, 24, 6))
OPTIONS = {"n_bins": 10, "density": True}


@pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")
@pytest.mark.parametrize("single", [False, True], ids=["batch", "one recording"])
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_array(kind, single):
    value = KINDS[kind](X[1] if single else X)
    before = digest(value)
    plain = np.array(value, np.float64, order="C")
    wanted = twin.features(plain, **OPTIONS)
    assert twin.differing_bits(extract_features(value, **OPTIONS), wanted) == 0
    into = extract_features(value, threads=2, out=np.empty_like(wanted), **OPTIONS)
    assert twin.differing_bits(into, wanted) == 0
    raw = extract_features(value, hfmh=False)
    assert twin.differing_bits(raw, twin.features(plain, hfmh=False)) == 0
    assert digest(value) == before


def with_value(value, place):
    x = X.copy()
    x[place] = value
    return x


BAD = {
    "0-d": (np.float64(3), ValueError, r"wrench must have shape \(n_samples, n_axes\) or .* got \(\)"),
    "4-d": (X[None], ValueError, r"got \(1, 5, 24, 6\)"),
    "no samples": (np.zeros((0, 6)), ValueError, r"wrench must not be empty, got .*0, 6"),
    "empty and huge": (np.zeros((0, 10**15, 6)), ValueError, r"empty, got .*0, 10{15}, 6"),
    "dict": ({"fx": [1.0]}, TypeError, "wrench is a dict with named columns"),
    "__array__ of no array": (Lists.__new__(Lists), AttributeError, "values"),
    "NaN": (with_value(np.nan, (4, 23, 5)), ValueError, "finite, got NaN at recording 4, sample 23, axis 5"),
    "bad in two places": (
        with_value([np.inf, np.nan], ([4, 1], [0, 20], [0, 2])),
        ValueError,
        "NaN at recording 1, sample 20, axis 2",
    ),
    "strided NaN": (with_value(np.nan, (1, 2, 3))[:, ::2, ::-1], ValueError, "recording 1, sample 1, axis 2"),
}


@pytest.mark.parametrize("options", [{}, {"hfmh": False}, {"threads": 2, "initial": "steady", "raw": False}])
@pytest.mark.parametrize("kind", BAD)
def test_bad_arrays(kind, options):
    value, error, message = BAD[kind]
    before = digest(value) if isinstance(value, np.ndarray) else None
    with pytest.raises(error, match=message):
        extract_features(value, **options)
    if before:
        assert digest(value) == before


@pytest.mark.parametrize("shape", [(40, 1), (40, 6), (3, 40, 6), (2, 40, 25)])
def test_numbers_that_overflow_in_the_filter(shape):
    x = np.zeros(shape)
    x[..., ::2, :] = 1.7e308
    x[..., 1::2, :] = -1.7e308
    with pytest.raises(ValueError, match=r"wrench is too large: recording 0 reaches 1\.7e308"):
        extract_features(x)
    # Nothing is filtered for the raw samples.
    assert np.array_equal(extract_features(x, hfmh=False), twin.features(x, hfmh=False))


def test_a_long_double_beyond_float64():
    if np.finfo(np.longdouble).max == np.finfo(np.float64).max:
        pytest.skip("long double is float64 here")
    with np.errstate(over="ignore"), pytest.raises(ValueError, match="wrench must be finite, got inf"):
        extract_features(np.full((3, 6), np.longdouble("1e4000")))


def test_transposed_recording_alone_is_warned_of():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for kind in ("float16", "long double", "int64 beyond 2**53", "subnormal", "huge", "bool"):
            extract_features(KINDS[kind](X))
    with pytest.warns(UserWarning, match=r"shape \(6, 1600\) has more axes than samples: is it transposed"):
        extract_features(np.zeros((6, 1600)))


def test_recordings_and_data_sets_are_no_arrays():
    data = synthesize(["rice"], n_per_class=2)
    with pytest.raises(TypeError, match=r"got a Recording: pass recording\.wrench, or dataset\.X"):
        extract_features(data[0])
    with pytest.raises(TypeError, match="got a Dataset: pass"):
        extract_features(data)


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


@pytest.mark.thread_unsafe(reason="writes files")
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


@pytest.mark.parametrize("first", [0, 719])
def test_an_output_over_the_input_is_refused(first):
    buffer = bytearray(16_000)  # two arrays that do not know of each other
    wrench, out = np.frombuffer(buffer)[first : first + 120].reshape(20, 6), np.frombuffer(buffer)[:720]
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
    ("wrench", "arguments", "error", "message"),
    [
        (X, {"threads": 10**30}, ValueError, "threads must be .* got 10{30}"),
        (X, {"dtype": np.float16}, TypeError, "dtype must be float64 or float32"),
        (X, {"dtype": ">f8"}, TypeError, "dtype must be float64 or float32, got .>f8"),
        (X, {"dtype": "double precision"}, TypeError, "dtype must be"),
        (X * 1e39, {"dtype": np.float32}, ValueError, "float32"),  # it would become infinite
    ],
)
def test_bad_threads_and_types(wrench, arguments, error, message):
    with pytest.raises(error, match=message):
        extract_features(wrench, **arguments)


@pytest.mark.parametrize("wrench", [X.astype(complex), X[:4], X[..., :5], np.zeros((5, 0, 6))])
def test_the_input_is_checked_before_the_output_is_touched(wrench):
    out = np.full((5, N), 7.0)
    with pytest.raises((TypeError, ValueError)):
        extract_features(wrench, out=out)
    assert (out == 7).all()

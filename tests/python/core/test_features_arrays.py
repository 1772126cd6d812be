"""Arrays of every kind give the right features or one clear exception, and are never modified."""

import warnings

import numpy as np
import pandas as pd
import pytest

import features_twin as twin
from array_kinds import KINDS, Lists, digest
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
    assert (
        twin.differing_bits(extract_features(value, threads=2, out=np.empty_like(wanted), **OPTIONS), wanted)
        == 0
    )
    raw = extract_features(value, hfmh=False)
    assert twin.differing_bits(raw, twin.features(plain, hfmh=False)) == 0
    assert digest(value) == before


def test_there_are_kinds_enough():
    assert len(KINDS) + len(BAD) >= 80


@pytest.mark.thread_unsafe(reason="writes files")
@pytest.mark.parametrize("mode", ["r", "r+", "c"])
def test_memory_mapped(tmp_path, mode):
    np.save(tmp_path / "x.npy", X)
    before = (tmp_path / "x.npy").read_bytes()
    mapped = np.load(tmp_path / "x.npy", mmap_mode=mode)
    assert twin.differing_bits(extract_features(mapped, **OPTIONS), twin.features(X, **OPTIONS)) == 0
    odd = np.memmap(tmp_path / "odd.bin", np.uint8, "w+", shape=X.nbytes + 3)
    odd[3:] = np.frombuffer(X.tobytes(), np.uint8)
    shifted = np.memmap(tmp_path / "odd.bin", np.float64, mode, offset=3, shape=X.shape)
    assert twin.differing_bits(extract_features(shifted, **OPTIONS), twin.features(X, **OPTIONS)) == 0
    del mapped
    assert (tmp_path / "x.npy").read_bytes() == before


def test_an_array_that_others_read_at_the_same_time():
    x = X.copy()
    view = memoryview(x)
    again = [
        extract_features(x, **OPTIONS),
        extract_features(view, **OPTIONS),
        extract_features(x[:], **OPTIONS),
    ]
    assert all(np.array_equal(one, again[0]) for one in again)


def with_value(value, place):
    x = X.copy()
    x[place] = value
    return x


BAD = {
    "0-d": (np.float64(3), ValueError, r"shape \(n_samples, n_axes\) or .* got shape \(\)"),
    "1-d": (X[0, 0], ValueError, r"got shape \(6,\)"),
    "4-d": (X[None], ValueError, r"got shape \(1, 5, 24, 6\)"),
    "64-d": (np.zeros((1,) * 32), ValueError, "got shape"),
    "number": (1.5, ValueError, r"got shape \(\)"),
    "no samples": (np.zeros((0, 6)), ValueError, r"wrench must not be empty, got shape \(0, 6\)"),
    "no axes": (np.zeros((24, 0)), ValueError, r"wrench must not be empty, got shape \(24, 0\)"),
    "no recordings": (np.zeros((0, 24, 6)), ValueError, r"wrench must not be empty, got shape \(0, 24, 6\)"),
    "no samples in a batch": (np.zeros((5, 0, 6)), ValueError, r"must not be empty, got shape \(5, 0, 6\)"),
    "no axes in a batch": (np.zeros((5, 24, 0)), ValueError, r"must not be empty, got shape \(5, 24, 0\)"),
    "empty and huge": (
        np.zeros((0, 10**15, 6)),
        ValueError,
        r"must not be empty, got shape \(0, 10{15}, 6\)",
    ),
    "empty list": ([], ValueError, r"got shape \(0,\)"),
    "empty lists": ([[]], ValueError, r"wrench must not be empty, got shape \(1, 0\)"),
    "complex": (X.astype(complex), TypeError, "wrench must hold real numbers, got dtype complex128"),
    "complex64": (X.astype(np.complex64), TypeError, "wrench must hold real numbers, got dtype complex64"),
    "object": (X.astype(object), TypeError, "wrench must hold real numbers, got dtype object"),
    "date": (np.zeros((24, 6), "M8[s]"), TypeError, "must hold real numbers, got dtype datetime64"),
    "duration": (np.zeros((24, 6), "m8[ns]"), TypeError, "must hold real numbers, got dtype timedelta64"),
    "text": (X.astype(str), TypeError, "wrench must hold real numbers, got dtype <U"),
    "bytes": (X.astype(bytes), TypeError, r"wrench must hold real numbers, got dtype \|S"),
    "void": (np.zeros((24, 6), "V8"), TypeError, r"wrench must hold real numbers, got dtype \|V8"),
    "structured": (np.zeros((24, 6), [("fx", float)]), TypeError, r"real numbers, got dtype \[\('fx'"),
    "one row of records": (np.zeros(24, "f8,f8,f8"), TypeError, "wrench must hold real numbers"),
    "masked": (np.ma.masked_array(X, X > 2), TypeError, "wrench must be a plain array, got a masked one"),
    "masked, nothing hidden": (np.ma.masked_array(X), TypeError, "wrench must be a plain array"),
    "masked records": (np.ma.zeros((24, 6), "f8,f8"), TypeError, "wrench must be a plain array"),
    "string": ("wrench.csv", TypeError, "wrench must hold real numbers"),
    "byte string": (b"wrench", TypeError, "wrench must hold real numbers"),
    "None": (None, TypeError, "wrench must hold real numbers, got dtype object"),
    "dict": ({"fx": [1.0]}, TypeError, "wrench must hold real numbers, got dtype object"),
    "set": ({1.0, 2.0}, TypeError, "wrench must hold real numbers, got dtype object"),
    "function": (extract_features, TypeError, "wrench must hold real numbers, got dtype object"),
    "generator": ((row for row in X), TypeError, "wrench must hold real numbers, got dtype object"),
    "data frame with text": (
        pd.DataFrame({"a": [1.0], "b": ["x"]}),
        TypeError,
        "real numbers, got dtype object",
    ),
    "ragged": ([[1.0, 2.0], [3.0]], ValueError, "wrench must be an array of real numbers, got .*list"),
    "lists of None": ([[None, 1.0]], TypeError, "wrench must hold real numbers, got dtype object"),
    "ints beyond 64 bits": ([[10**30, 1]], TypeError, "wrench must hold real numbers, got dtype object"),
    "__array__ of no array": (Lists.__new__(Lists), AttributeError, "values"),
    "NaN first": (with_value(np.nan, (0, 0, 0)), ValueError, "NaN at recording 0, sample 0, axis 0"),
    "NaN last": (with_value(np.nan, (4, 23, 5)), ValueError, "NaN at recording 4, sample 23, axis 5"),
    "infinity": (with_value(np.inf, (2, 7, 3)), ValueError, "inf at recording 2, sample 7, axis 3"),
    "minus infinity": (with_value(-np.inf, (3, 8, 1)), ValueError, "-inf at recording 3, sample 8, axis 1"),
    "NaN in two places": (
        with_value([np.inf, np.nan], ([4, 1], [0, 20], [0, 2])),
        ValueError,
        "NaN at recording 1, sample 20, axis 2",
    ),
    "all NaN": (np.full((24, 6), np.nan), ValueError, "wrench must be finite, got NaN at .*sample 0, axis 0"),
    "float16 infinity": (
        with_value(np.inf, (1, 2, 3)).astype(np.float16),
        ValueError,
        "recording 1, sample 2",
    ),
    "strided NaN": (with_value(np.nan, (1, 2, 3))[:, ::2, ::-1], ValueError, "recording 1, sample 1, axis 2"),
}


@pytest.mark.parametrize(
    "options", [{}, {"hfmh": False}, {"raw": False}, {"threads": 2, "initial": "steady"}]
)
@pytest.mark.parametrize("kind", BAD)
def test_bad_arrays(kind, options):
    value, error, message = BAD[kind]
    before = digest(value) if isinstance(value, np.ndarray) else None
    with pytest.raises(error, match=message):
        extract_features(value, **options)
    if before:
        assert digest(value) == before
    assert extract_features(X).shape == (5, 744)


@pytest.mark.parametrize("axes", [1, 6, 13, 25])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_every_place_of_a_bad_value_is_found_and_named(bad, axes):
    rng = np.random.default_rng(5)
    x = rng.standard_normal((7, 20, axes))
    for place in zip(*(rng.integers(0, n, 60) for n in x.shape), strict=True):
        x[place], kept = bad, x[place]
        where = "recording {}, sample {}, axis {}$".format(*place)
        for options in ({}, {"hfmh": False}, {"raw": False}, {"order": 1}, {"order": 9}, {"dtype": "f4"}):
            with pytest.raises(ValueError, match=where):
                extract_features(x, threads=2, **options)
        x[place] = kept


def test_a_bad_value_in_a_later_piece_of_float32_results():
    x = np.zeros((200, 4, 6))
    x[150, 3, 2] = np.nan
    with pytest.raises(ValueError, match="recording 150, sample 3, axis 2"):
        extract_features(x, dtype=np.float32)


@pytest.mark.parametrize("shape", [(40, 1), (40, 6), (3, 40, 6), (2, 40, 25)])
def test_numbers_that_overflow_in_the_filter(shape):
    x = np.zeros(shape)
    x[..., ::2, :] = 1.7e308
    x[..., 1::2, :] = -1.7e308
    before = digest(x)
    with pytest.raises(ValueError, match=r"wrench is too large to filter: recording 0 reaches 1\.7e308"):
        extract_features(x)
    assert digest(x) == before
    # Nothing is filtered for the raw samples.
    assert np.array_equal(extract_features(x, hfmh=False), twin.features(x, hfmh=False))


def test_a_long_double_beyond_float64():
    if np.finfo(np.longdouble).max == np.finfo(np.float64).max:
        pytest.skip("long double is float64 here")
    with np.errstate(over="ignore"), pytest.raises(ValueError, match="wrench must be finite, got inf"):
        extract_features(np.full((3, 6), np.longdouble("1e4000")))


def test_no_warning_for_anything_good():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for kind in ("float16", "long double", "int64 beyond 2**53", "subnormal", "huge", "bool"):
            extract_features(KINDS[kind](X))


def test_an_exception_of_the_argument_itself_arrives():
    class Broken:
        def __array__(self, dtype=None, copy=None):
            raise RuntimeError("the sensor is gone")

    with pytest.raises(RuntimeError, match="the sensor is gone"):
        extract_features(Broken())
    assert extract_features(X).shape == (5, 744)


def test_a_transposed_recording_is_warned_of() -> None:
    with pytest.warns(UserWarning, match=r"shape \(6, 1600\) has more axes than samples: is it transposed"):
        extract_features(np.zeros((6, 1600)))


def test_recordings_and_data_sets_are_told_apart_from_arrays() -> None:
    data = synthesize(["rice"], n_per_class=2)
    with pytest.raises(TypeError, match=r"got a Recording: pass recording\.wrench, or dataset\.X"):
        extract_features(data[0])
    with pytest.raises(TypeError, match="got a Dataset: pass"):
        extract_features(data)

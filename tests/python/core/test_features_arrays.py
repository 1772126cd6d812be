"""Arrays of every kind give the right features or one clear exception, and are never modified."""

import warnings

import numpy as np
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

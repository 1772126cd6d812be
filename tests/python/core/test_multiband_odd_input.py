"""Multi-band features of signals that are hardly any, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import multiband_twin as twin
from granular_id._core import MultiBandExtractor
from test_multiband import assert_close, expected, learned, signals


def test_recordings_of_zeros_and_constants_have_the_floors():
    extractor = MultiBandExtractor(100, 3, blocks=("coupling", "quantiles", "envelope", "spectrum"))
    silent = extractor.extract(np.zeros((1, 100, 3)))
    assert_close(silent, expected(extractor, np.zeros((1, 100, 3))))
    # Filters start as if the first sample had lasted for ever: an offset leaves nothing behind.
    constant = np.broadcast_to([1.0, -1e6, 1e9], (2, 100, 3))
    np.testing.assert_array_equal(extractor.extract(constant), np.repeat(silent, 2, axis=0))


def test_one_constant_axis_among_others():
    X = signals(120, 4)
    X[:, :, 2] = 7.0
    extractor = learned(X)
    # Its scale is a billionth of it, so that rounding in the filters shows in the definition; here there is none.
    np.testing.assert_allclose(extractor.extract(X), expected(extractor, X), rtol=1e-9, atol=1e-3)
    X[:, :, 2] = 0.0
    assert_close(learned(X).extract(X), expected(learned(X), X))


def test_identical_recordings_have_identical_features():
    X = np.repeat(signals(100, 2, n=1), 5, axis=0)
    got = learned(X).extract(X)
    np.testing.assert_array_equal(got, np.broadcast_to(got[0], got.shape))


def test_identical_axes():
    X = np.repeat(signals(100, 1), 6, axis=2)
    extractor = learned(X)
    assert_close(extractor.extract(X), expected(extractor, X))


@pytest.mark.parametrize("unit", [1e-100, 1e-9, 1e9, 1e100])
def test_units_do_not_matter_to_learned_scales(unit):
    X = signals(100, 3)
    assert_close(learned(X * unit).extract(X * unit), learned(X).extract(X))


@settings(deadline=None, max_examples=150)
@given(st.data())
def test_no_feature_is_ever_nan(data):
    n_samples, n_axes = data.draw(st.integers(1, 40)), data.draw(st.integers(1, 5))
    n_seen = data.draw(st.integers(1, n_samples))
    magnitude = st.sampled_from([0.0, 5e-324, 1e-150, 1e-3, 1.0, -1.0, 3.5, 1e10, -1e100, 1e144, 1e308])
    values = data.draw(st.lists(magnitude, min_size=n_seen * n_axes, max_size=n_seen * n_axes))
    X = np.reshape(values, (1, n_seen, n_axes))
    extractor = MultiBandExtractor(n_samples, n_axes, blocks=twin.BLOCKS)
    if np.abs(X).max() > 1e145:
        with pytest.raises(ValueError, match="too large for multi-band features: recording 0 reaches 1e308"):
            extractor.extract(X)
    else:
        assert np.isfinite(extractor.extract(X)).all()
        assert np.isfinite(extractor.band_rms(X)).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("threads", [1, 2])
def test_gaps_are_named(value, threads):
    X = signals(60, 3, n=40)
    X[31, 59, 2] = value
    for method in ("extract", "band_rms"):
        with pytest.raises(ValueError, match=r"must be finite, got \S+ at recording 31, sample 59, axis 2"):
            getattr(MultiBandExtractor(60, 3), method)(X, threads=threads)


def test_a_recording_far_beyond_the_scales_is_named():
    X = signals(60, 3, n=12)
    scales = np.ones((MultiBandExtractor(60, 3).n_bands, 3))
    scales[1, 2] = 1e-100
    X[9, 4, 2] = 1e50
    extractor = MultiBandExtractor(60, 3, scales=scales)
    with pytest.raises(ValueError, match=r"too large .* recording 9 reaches 1e50"):
        extractor.extract(X)
    X[9, 4, 2] = 1.0
    extractor.extract(X)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rate_hz": 0.0}, "rate_hz must be positive and finite, got 0"),
        ({"rate_hz": np.nan}, "rate_hz must be positive and finite, got NaN"),
        ({"rate_hz": "fast"}, "rate_hz must be a real number"),
        ({"blocks": "coupling"}, "blocks must be a sequence of names"),
        ({"blocks": 3}, "blocks must be a sequence of names"),
        ({"blocks": ["couplings"]}, "each of blocks must be 'coupling' or 'quantiles' or"),
        ({"blocks": ["level", "level"]}, "blocks must name each block once, got 'level' twice"),
        ({"blocks": []}, "blocks must name at least one block that recordings of 50 samples of 3 axes have"),
        ({"n_samples": 25, "blocks": ["coupling"]}, "at least one block that recordings of 25 samples of 3"),
        ({"n_samples": 0}, "n_samples must be an integer of at least 1"),
        ({"n_samples": 2**40}, "a recording may have at most"),
        ({"n_axes": 0}, "n_axes must be an integer of at least 1"),
        ({"n_samples": 10**6, "n_axes": 10**5}, "1000000 and n_axes = 100000 ask for too many features"),
        ({"n_axes": 10**9}, "n_axes = 1000000000 ask for too many features"),
        ({"scales": np.ones((3, 2))}, r"scales must have shape \(5, 3\), got \(3, 2\)"),
        ({"scales": np.zeros((5, 3))}, "scales must be from 1e-150 to 1e150, got 0 for band 0, axis 0"),
        ({"level_scales": [1.0, np.nan, 1.0]}, "level_scales must be from .* got NaN for band 0, axis 1"),
        ({"level_scales": [1.0]}, r"level_scales must have shape \(3,\), got \(1,\)"),
    ],
)
def test_arguments_are_refused_by_name(changed, message):
    arguments = {"n_samples": 50, "n_axes": 3, **changed}
    with pytest.raises((TypeError, ValueError), match=message):
        MultiBandExtractor(arguments.pop("n_samples"), arguments.pop("n_axes"), **arguments)


@pytest.mark.parametrize(
    ("X", "message"),
    [
        (np.zeros((2, 51, 3)), "at most 50 samples of 3 axes, got 51 samples of 3"),
        (np.zeros((2, 50, 2)), "at most 50 samples of 3 axes, got 50 samples of 2"),
        (np.zeros(50), "X must have shape"),
        (np.zeros((0, 50, 3)), "must not be empty"),
        (np.zeros((2, 0, 3)), "must not be empty"),
        (np.zeros((0, 3)), "must not be empty"),
        ("text", "X must hold real numbers"),
    ],
)
def test_recordings_of_other_shapes(X, message):
    with pytest.raises((TypeError, ValueError), match=message):
        MultiBandExtractor(50, 3).extract(X)


def test_threads_must_be_positive():
    with pytest.raises(ValueError, match="threads must be an integer of at least 1"):
        MultiBandExtractor(50, 3).extract(np.zeros((2, 50, 3)), threads=0)

"""Spaces made of one signal at a time: normalised samples, Fourier transform, histogram, against numpy."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from granular_id.gram import linear_gram
from granular_id.spaces import DFT, RangeNormalizer, RawHistogram
from spaces_cases import recordings

finite = st.floats(-1e300, 1e300)
BATCHES = arrays(
    np.float64, st.tuples(st.integers(1, 4), st.integers(1, 9), st.integers(1, 3)), elements=finite
)


def by_axis(X):
    """(n, C, T)"""
    return np.asarray(X, np.float64).transpose(0, 2, 1)


# --- RangeNormalizer


def test_range_normalizer_is_the_formula():
    X = recordings()
    series = by_axis(X)
    low, high = series.min(2, keepdims=True), series.max(2, keepdims=True)
    expected = ((series - low) / (high - low)).reshape(5, -1)
    np.testing.assert_array_equal(RangeNormalizer().fit_transform(X), expected)


@given(BATCHES)
def test_normalised_axes_run_from_zero_to_one_or_are_zero(X):
    series = RangeNormalizer().fit_transform(X).reshape(len(X), X.shape[2], -1)
    constant = (by_axis(X) == by_axis(X)[:, :, :1]).all(2)
    np.testing.assert_array_equal(series[constant], 0.0)
    np.testing.assert_array_equal(series[~constant].min(1), 0.0)
    np.testing.assert_array_equal(series[~constant].max(1), 1.0)
    order = np.argsort(by_axis(X), axis=2, kind="stable")
    assert (np.diff(np.take_along_axis(series, order, axis=2), axis=2) >= 0).all()


def test_range_normalizer_at_the_ends_of_float64():
    big = np.finfo(np.float64).max
    np.testing.assert_array_equal(RangeNormalizer().fit_transform([[-big, 0.0, big]]), [[0.0, 0.5, 1.0]])
    tiny = 5e-324
    np.testing.assert_array_equal(RangeNormalizer().fit_transform([[0.0, tiny, 2 * tiny]]), [[0.0, 0.5, 1.0]])


def test_range_normalizer_looks_at_each_recording_alone():
    X = recordings()
    together = RangeNormalizer().fit(X)
    assert not together.learns
    np.testing.assert_array_equal(RangeNormalizer().fit(X[:1]).transform(X[3:]), together.transform(X)[3:])
    np.testing.assert_allclose(together.transform(7 * X - 3), together.transform(X), atol=1e-12)


# --- DFT


@pytest.mark.parametrize("n_samples", [1, 2, 5, 64])
@pytest.mark.parametrize("kind", ["complex", "magnitude", "log_magnitude"])
def test_dft_is_half_of_the_full_transform_with_its_scalar_products(kind, n_samples):
    X = recordings(n=3, n_samples=n_samples, n_axes=2)
    full = np.fft.fft(by_axis(X), axis=2)
    expected = {
        "complex": np.concatenate([full.real, full.imag], axis=2),
        "magnitude": np.abs(full),
        "log_magnitude": np.log(np.maximum(np.abs(full), 0.25)),
    }[kind].reshape(3, -1)
    features = DFT(kind, floor=0.25).fit_transform(X)
    np.testing.assert_allclose(linear_gram(features), linear_gram(expected), rtol=1e-9)


def test_dft_column_by_column():
    six_axes = DFT().fit(np.zeros((1, 1600, 6))).get_feature_names_out()
    assert six_axes[[0, 801, -1]].tolist() == ["dft_re_fx_0000", "dft_re_fy_0000", "dft_im_tz_0799"]
    X = recordings(n=2, n_samples=6, n_axes=2)
    dft = DFT().fit(X)
    columns = dict(zip(dft.get_feature_names_out(), dft.transform(X).T, strict=True))
    full = np.fft.fft(by_axis(X), axis=2)
    names = [f"dft_re_axis{a}_000{k}" for a in range(2) for k in range(4)]
    names += [f"dft_im_axis{a}_000{k}" for a in range(2) for k in range(1, 3)]
    assert list(columns) == names
    for name, column in columns.items():
        axis, k = int(name[11]), int(name[-1])
        part = full[:, axis, k].real if "_re_" in name else full[:, axis, k].imag
        np.testing.assert_allclose(column, part * (math.sqrt(2) if k in (1, 2) else 1.0), rtol=1e-12)


@given(shift=st.integers(0, 49), seed=st.integers(0, 9))
@settings(max_examples=25)
@pytest.mark.parametrize("kind", ["magnitude", "log_magnitude"])
def test_magnitudes_do_not_depend_on_when_things_happen(kind, shift, seed):
    X = recordings(n=2, n_samples=50, seed=seed)
    dft = DFT(kind).fit(X)
    np.testing.assert_allclose(dft.transform(np.roll(X, shift, axis=1)), dft.transform(X), atol=1e-9)


def test_magnitudes_below_the_floor_are_raised_to_it():
    X = np.full((1, 64, 1), 0.1)
    dft = DFT("log_magnitude", floor=0.01).fit(X)
    expected = np.full(33, math.log(0.01))
    expected[0] = math.log(6.4)
    expected[1:-1] *= math.sqrt(2)
    np.testing.assert_allclose(dft.transform(X)[0], expected, rtol=1e-12)
    assert (DFT("log_magnitude").fit_transform(np.zeros((1, 1, 1))) == math.log(1e-3)).all()


def test_dft_of_one_recording_is_that_in_a_batch():
    X = recordings(n=40, n_samples=101)
    dft = DFT().fit(X)
    np.testing.assert_array_equal(np.concatenate([dft.transform(one[None]) for one in X]), dft.transform(X))


# --- RawHistogram


def counts(X, bounds, n_bins=100):
    rows = [np.histogram(one, n_bins, tuple(bounds[k]))[0] for row in by_axis(X) for k, one in enumerate(row)]
    return np.asarray(rows, float).reshape(len(X), -1)


def test_raw_histogram_counts_as_numpy_between_learned_extremes():
    X, other = recordings(), recordings(seed=1)
    other[0, 0] = 1e6  # outside: not counted
    histogram = RawHistogram().fit(X)
    bounds = np.column_stack([X.min((0, 1)), X.max((0, 1))])
    assert histogram.learns
    names = histogram.get_feature_names_out()
    assert names[[0, 99, 100, -1]].tolist() == ["hist_fx_00", "hist_fx_99", "hist_fy_00", "hist_tz_99"]
    np.testing.assert_array_equal(histogram.bin_range_, bounds)
    np.testing.assert_array_equal(histogram.transform(other), counts(other, bounds))
    np.testing.assert_array_equal(histogram.bin_range_, bounds)
    assert histogram.transform(X).sum() == X.size
    assert histogram.transform(other)[0].sum() < X[0].size
    clipped = RawHistogram(outside="clip").fit(X).transform(other)
    np.testing.assert_array_equal(clipped, counts(np.clip(other, *bounds.T), bounds))
    assert clipped.sum() == X.size


@pytest.mark.parametrize("bin_range", [(-2.0, 2.0), [[-1.0, 1.0], [0.0, 3.0]]])
def test_raw_histogram_with_given_ranges_learns_nothing(bin_range):
    X = recordings(n_axes=2)
    histogram = RawHistogram(bin_range=bin_range, n_bins=7).fit(X[:1])
    assert not histogram.learns
    np.testing.assert_array_equal(histogram.transform(X), counts(X, np.broadcast_to(bin_range, (2, 2)), 7))


@given(BATCHES, st.integers(1, 200))
def test_raw_histogram_counts_every_training_sample(X, n_bins):
    features = RawHistogram(n_bins=n_bins).fit_transform(X)
    np.testing.assert_array_equal(features.reshape(len(X), X.shape[2], n_bins).sum(2), X.shape[1])


@pytest.mark.parametrize("level", [0.0, -3.0, 1e15, -1e300])
def test_constant_axis_has_room_for_its_bins(level):
    X = np.full((2, 5, 1), level)
    histogram = RawHistogram(n_bins=32_768).fit(X)
    assert histogram.transform(X).sum() == 10
    if abs(level) < 1e5:
        np.testing.assert_array_equal(histogram.bin_range_, [[level - 0.5, level + 0.5]])

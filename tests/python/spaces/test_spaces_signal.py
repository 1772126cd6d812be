"""What holds for any signal: normalised samples, Fourier transform and histogram, at the ends of float64 too."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from granular_id.spaces import DFT, RangeNormalizer, RawHistogram
from spaces_cases import recordings

SHAPES = st.tuples(st.integers(1, 4), st.integers(1, 9), st.integers(1, 3))
BATCHES = arrays(np.float64, SHAPES, elements=st.floats(-1e300, 1e300))


@given(BATCHES)
def test_normalised_axes_run_from_zero_to_one_or_are_zero(X):
    given_series = X.transpose(0, 2, 1)
    series = RangeNormalizer().fit_transform(X).reshape(given_series.shape)
    constant = (given_series == given_series[:, :, :1]).all(2)
    np.testing.assert_array_equal(series[constant], 0.0)
    np.testing.assert_array_equal(series[~constant].min(1), 0.0)
    np.testing.assert_array_equal(series[~constant].max(1), 1.0)
    order = np.argsort(given_series, axis=2, kind="stable")
    assert (np.diff(np.take_along_axis(series, order, axis=2), axis=2) >= 0).all()


@pytest.mark.parametrize("signal", [[-np.finfo(float).max, 0.0, np.finfo(float).max], [0.0, 5e-324, 1e-323]])
def test_range_normalizer_at_the_ends_of_float64(signal):
    np.testing.assert_array_equal(RangeNormalizer().fit_transform([signal]), [[0.0, 0.5, 1.0]])


def test_range_normalizer_knows_no_unit_and_no_zero():
    X = recordings()
    normalizer = RangeNormalizer().fit(X)
    np.testing.assert_allclose(normalizer.transform(7 * X - 3), normalizer.transform(X), atol=1e-12)


@pytest.mark.parametrize("n_samples", [1, 2, 5, 64])
@pytest.mark.parametrize("kind", ["complex", "magnitude", "log_magnitude"])
def test_half_a_spectrum_has_the_scalar_products_of_the_whole(kind, n_samples):
    X = recordings(n=3, n_samples=n_samples, n_axes=2)
    full = np.fft.fft(X.transpose(0, 2, 1), axis=2)
    expected = {
        "complex": np.concatenate([full.real, full.imag], axis=2),
        "magnitude": np.abs(full),
        "log_magnitude": np.log(np.maximum(np.abs(full), 0.25)),
    }[kind].reshape(3, -1)
    features = DFT(kind, floor=0.25).fit_transform(X)
    np.testing.assert_allclose(features @ features.T, expected @ expected.T, rtol=1e-9)


@given(shift=st.integers(0, 49), seed=st.integers(0, 9))
@settings(max_examples=25)
@pytest.mark.parametrize("kind", ["magnitude", "log_magnitude"])
def test_magnitudes_do_not_depend_on_when_things_happen(kind, shift, seed):
    X = recordings(n=2, n_samples=50, seed=seed)
    dft = DFT(kind).fit(X)
    np.testing.assert_allclose(dft.transform(np.roll(X, shift, axis=1)), dft.transform(X), atol=1e-9)


def test_magnitudes_below_the_floor_are_raised_to_it():
    features = DFT("log_magnitude", floor=0.01).fit_transform(np.full((1, 64, 1), 0.1))[0]
    assert features[0] == pytest.approx(math.log(6.4))
    np.testing.assert_allclose(features[1:-1], math.sqrt(2) * math.log(0.01), rtol=1e-12)
    assert (DFT("log_magnitude").fit_transform(np.zeros((1, 1, 1))) == math.log(1e-3)).all()


def test_dft_of_one_recording_is_that_in_a_batch():
    X = recordings(n=40, n_samples=101)
    dft = DFT().fit(X)
    np.testing.assert_array_equal(np.concatenate([dft.transform(one[None]) for one in X]), dft.transform(X))


@given(BATCHES, st.integers(1, 200))
def test_raw_histogram_counts_every_training_sample(X, n_bins):
    features = RawHistogram(n_bins=n_bins).fit_transform(X)
    np.testing.assert_array_equal(features.reshape(len(X), X.shape[2], n_bins).sum(2), X.shape[1])


def test_raw_histogram_counts_what_is_outside_only_where_told():
    X, other = recordings(), recordings(seed=1)
    other[0, 0] = 1e6
    assert RawHistogram().fit(X).transform(other)[0].sum() < X[0].size
    assert RawHistogram(outside="clip").fit(X).transform(other).sum() == X.size


@pytest.mark.parametrize("level", [0.0, -3.0, 1e15, -1e300])
def test_constant_axis_has_room_for_its_bins(level):
    X = np.full((2, 5, 1), level)
    histogram = RawHistogram(n_bins=32_768).fit(X)
    assert histogram.transform(X).sum() == 10
    if abs(level) < 1e5:
        np.testing.assert_array_equal(histogram.bin_range_, [[level - 0.5, level + 0.5]])

"""Every feature space beside its twin in numpy and scipy; names of columns; filters; one recording."""

from functools import partial

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

from granular_id.features import extract_features
from granular_id.spaces import (
    HFMH,
    MultiBand,
    RangeNormalizer,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    TimePermutation,
)
from spaces_cases import SPACES, STATISTICS, data_set, recordings

# --- The twins: features of `X`, fitted on `fitted`


def by_axis(X):
    """(n, C, T)"""
    return np.asarray(X, np.float64).transpose(0, 2, 1)


def raw(_, X):
    return by_axis(X).reshape(len(X), -1)


def ranged(_, X):
    series = by_axis(X)
    low, high = series.min(2, keepdims=True), series.max(2, keepdims=True)
    return ((series - low) / (high - low)).reshape(len(X), -1)


def counts(X, ranges, n_bins):
    rows = [
        [np.histogram(one, n_bins, tuple(ranges[k]))[0] for k, one in enumerate(row)] for row in by_axis(X)
    ]
    return np.asarray(rows, float).reshape(len(X), -1)


def high_passed(X, initial="zero"):
    sos = scipy.signal.butter(8, 23.0, "high", fs=500.0, output="sos")
    out = np.empty_like(X)
    for i, k in np.ndindex(X.shape[0], X.shape[2]):
        state = scipy.signal.sosfilt_zi(sos) * (X[i, 0, k] if initial == "steady" else 0.0)
        out[i, :, k], _ = scipy.signal.sosfilt(sos, X[i, :, k], zi=state)
    return out


def hfmh(fitted, X, *, n_bins=100, learned=False, initial="zero"):
    ranges = np.tile([-1.5, 1.5], (X.shape[2], 1))
    if learned:
        magnitude = np.abs(high_passed(fitted, initial)).reshape(-1, X.shape[2])
        ranges = np.quantile(magnitude, 0.995, axis=0)[:, None] * [-1, 1]
    return counts(high_passed(X, initial), ranges, n_bins)


def histogram(fitted, X):
    return counts(X, np.column_stack([fitted.min((0, 1)), fitted.max((0, 1))]), 100)


def dft(_, X, kind="complex"):
    """Half of the spectrum; what stands for its mirror image too counts twice in scalar products."""
    n = X.shape[1]
    half = np.fft.fft(by_axis(X), axis=2)[:, :, : n // 2 + 1]
    mirrored = slice(1, (n + 1) // 2)
    weights = np.ones(half.shape[2])
    weights[mirrored] = np.sqrt(2)
    parts = [np.abs(half) * weights]
    if kind == "complex":
        parts = [half.real * weights, (half.imag * weights)[:, :, mirrored]]
    return np.concatenate([part.reshape(len(X), -1) for part in parts], axis=1)


def weighted(fitted, X):
    """Each block counts so that its rows of `fitted` have a mean norm of 1."""
    blocks = (raw, partial(hfmh, learned=True))
    norms = [np.linalg.norm(block(fitted, fitted), axis=1).mean() for block in blocks]
    return np.hstack([block(fitted, X) / norm for block, norm in zip(blocks, norms, strict=True)])


TWINS = {
    "raw": raw,
    "range": ranged,
    "hfmh": hfmh,
    "hfmh, own range": partial(hfmh, learned=True, initial="steady", n_bins=25),
    "raw+hfmh": lambda fitted, X: np.hstack([raw(fitted, X), hfmh(fitted, X)]),
    "raw+hfmh, weighted": weighted,
    "dft": dft,
    "dft magnitude": partial(dft, kind="magnitude"),
    "histogram": histogram,
    "histogram, own range": lambda _, X: counts(X, np.tile([-2.0, 2.0], (X.shape[2], 1)), 7),
}
ROUNDED = {"dft", "dft magnitude", "raw+hfmh, weighted"}
LEARNING = {"hfmh, own range", "raw+hfmh, weighted", "histogram"}


@pytest.mark.parametrize("name", TWINS)
@pytest.mark.parametrize("n_samples", [300, 33])
def test_features_equal_those_of_the_twin(name, n_samples):
    X, other = recordings(n_samples=n_samples), 3 * recordings(n=3, n_samples=n_samples, seed=1)
    space = clone({**SPACES, **STATISTICS}[name]).fit(X)
    features, expected = space.transform(other), TWINS[name](X, other)
    if name in ROUNDED:
        np.testing.assert_allclose(features, expected, rtol=1e-12, atol=1e-11)
    else:
        np.testing.assert_array_equal(features, expected)
    np.testing.assert_array_equal(space.transform(X), clone(space).fit_transform(X))
    assert space.learns == (name in LEARNING)
    alone = space if space.learns else clone(space).fit(other[:1])
    np.testing.assert_array_equal(alone.transform(other[:1]), features[:1])


def test_parameters_of_raw_hfmh_reach_the_extraction():
    X, ranges = recordings(n_axes=3), [[-0.5, 0.5], [-0.2, 0.1], [-0.01, 0.01]]
    own = {
        "rate_hz": 100.0,
        "cutoff_hz": 9.2,
        "order": 4,
        "n_bins": 7,
        "bin_range": ranges,
        "initial": "steady",
    }
    transformer = RawHFMH(**own, threads=1)
    np.testing.assert_array_equal(transformer.fit_transform(X), extract_features(X, **own))
    np.testing.assert_array_equal(transformer.bin_range_, ranges)


def test_silent_axis_has_the_papers_range():
    X = recordings(n_axes=2)
    X[:, :, 1] = 0.0
    transformer = HFMH(bin_range="auto").fit(X)
    np.testing.assert_array_equal(transformer.bin_range_[1], [-1.5, 1.5])
    assert transformer.transform(X)[:, 100:].sum() == 5 * 300


SHAPES = st.tuples(st.integers(1, 4), st.integers(1, 9), st.integers(1, 3))
BATCHES = arrays(np.float64, SHAPES, elements=st.floats(-1e100, 1e100))


@given(BATCHES)
def test_normalised_axes_run_from_zero_to_one_in_order(X):
    given_series = X.transpose(0, 2, 1)
    series = RangeNormalizer().fit_transform(X).reshape(given_series.shape)
    constant = (given_series == given_series[:, :, :1]).all(2)
    np.testing.assert_array_equal(series[constant], 0.0)
    np.testing.assert_array_equal(series[~constant].min(1), 0.0)
    np.testing.assert_array_equal(series[~constant].max(1), 1.0)
    order = np.argsort(given_series, axis=2, kind="stable")
    assert (np.diff(np.take_along_axis(series, order, axis=2), axis=2) >= 0).all()


@given(BATCHES, st.integers(1, 200))
def test_histogram_counts_every_training_sample(X, n_bins):
    features = RawHistogram(n_bins=n_bins).fit_transform(X)
    np.testing.assert_array_equal(features.reshape(len(X), X.shape[2], n_bins).sum(2), X.shape[1])


@pytest.mark.parametrize("level", [0.0, -3.0, 1e15])
def test_histogram_of_a_constant_axis_has_room(level):
    X = np.full((2, 5, 1), level)
    fitted = RawHistogram(n_bins=32_768).fit(X)
    assert fitted.transform(X).sum() == 10
    if abs(level) < 1e5:
        np.testing.assert_array_equal(fitted.bin_range_, [[level - 0.5, level + 0.5]])


@pytest.mark.parametrize(
    ("name", "count", "some"),
    [
        ("raw", 1800, ["fx_0000", "fx_0299", "fy_0000", "tz_0299"]),
        ("hfmh", 600, ["hfmh_fx_00", "hfmh_fx_99", "hfmh_fy_00", "hfmh_tz_99"]),
        ("dft", 1800, ["dft_re_fx_0000", "dft_re_fx_0150", "dft_im_fx_0001", "dft_im_tz_0149"]),
        ("dft magnitude", 906, ["dft_fx_0000", "dft_tz_0150"]),
        ("histogram", 600, ["hist_fx_00", "hist_fx_99", "hist_fy_00", "hist_tz_99"]),
    ],
)
def test_names_say_what_a_column_is_in_order(name, count, some):
    names = clone(SPACES[name]).fit(data_set(n=2)).get_feature_names_out().tolist()
    places = [names.index(one) for one in some]
    assert len(names) == count
    assert places == sorted(places)
    assert (places[0], places[-1]) == (0, count - 1)


def test_tare_subtracts_the_mean_at_rest():
    X = recordings()
    tare = Tare(0.1, rate_hz=100.0).fit(X)
    assert tare.n_tare_ == 10
    np.testing.assert_array_equal(tare.transform(X), X - X[:, :10].mean(axis=1, keepdims=True))
    assert not tare.learns


@given(st.integers(1, 40), st.floats(1.0, 2000.0))
def test_tare_rounds_to_whole_samples(n_tare, rate_hz):
    X = recordings(n=1, n_samples=40)
    assert Tare(n_tare / rate_hz, rate_hz=rate_hz).fit(X).n_tare_ == n_tare


def test_permutation_gives_each_recording_its_order():
    times = np.tile(np.arange(300.0)[:, None], (20, 1, 6))
    times[:, 0, 0] = -np.arange(20)  # the first instant tells them apart
    shuffled = TimePermutation().fit_transform(times)
    for before, after in zip(times, shuffled, strict=True):
        assert sorted(map(tuple, before)) == sorted(map(tuple, after))
    orders = shuffled[:, :, 1]
    assert len({tuple(order) for order in orders}) == 20
    # Every place is as likely for every instant: the mean place of 6,000 instants is near the middle.
    assert abs(orders[:, :150].mean() - 149.5) < 5 * 300 / np.sqrt(12 * 3000)


def test_permutation_belongs_to_recording_and_seed():
    X = np.round(recordings(n=8), 1)
    shuffle = TimePermutation(random_state=3).fit(X)
    expected = shuffle.transform(X)
    np.testing.assert_array_equal(shuffle.transform(X[::-1])[::-1], expected)
    np.testing.assert_array_equal(shuffle.transform(X[5:6]), expected[5:6])
    np.testing.assert_array_equal(TimePermutation(random_state=3).fit(X[:2]).transform(X), expected)
    np.testing.assert_array_equal(shuffle.transform(np.asfortranarray(X)), expected)
    np.testing.assert_array_equal(shuffle.transform(np.where(X == 0.0, -0.0, X)), expected)
    assert not np.array_equal(TimePermutation(random_state=4).fit_transform(X), expected)
    # The same on every machine.
    few = TimePermutation().fit_transform(np.arange(8.0)[None, :, None])
    assert few[0, :, 0].tolist() == [0.0, 7.0, 1.0, 6.0, 4.0, 3.0, 5.0, 2.0]


def test_permutation_without_seed_draws_one_in_each_fit():
    X = recordings()
    shuffle = TimePermutation(random_state=None).fit(X)
    first = shuffle.transform(X)
    np.testing.assert_array_equal(shuffle.transform(X), first)
    assert not np.array_equal(shuffle.fit(X).transform(X), first)


@pytest.mark.parametrize("kind", [RawSignal, MultiBand])
def test_one_recording_that_would_pass_for_many_warns(kind):
    X = recordings(n=2, n_samples=40)
    for call in (kind().fit, make_pipeline(kind(), "passthrough").fit_transform):
        with pytest.warns(UserWarning, match=r"\(40, 6\) is taken as 40 recordings .* pass X\[np\.newaxis\]"):
            call(X[0])
    assert kind().fit(X[:1]).n_axes_in_ == 6
    assert kind().fit(X[0][:, :, np.newaxis]).n_axes_in_ == 1  # no warning: pytest makes errors of them
    assert kind().fit(X[0].T).n_features_in_ == 40


@pytest.mark.parametrize(("n", "n_samples"), [(6, 6), (40, 1), (40, 13)])
def test_signals_that_are_no_recording_do_not_warn(n, n_samples):
    assert RawSignal().fit(np.zeros((n, n_samples))).n_features_in_ == n_samples

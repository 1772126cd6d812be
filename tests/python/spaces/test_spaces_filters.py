"""Recordings to recordings: removal of the offset at rest, destruction of the order in time."""

import numpy as np
from hypothesis import given, strategies as st
from sklearn.pipeline import make_pipeline

from granular_id.spaces import HFMH, RawHistogram, RawSignal, Tare, TimePermutation
from spaces_cases import recordings


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


def test_permutation_moves_whole_instants():
    X = recordings()
    shuffled = TimePermutation().fit_transform(X)
    for before, after in zip(X, shuffled, strict=True):
        assert not np.array_equal(before, after)
        assert sorted(map(tuple, before)) == sorted(map(tuple, after))


def test_each_recording_has_an_order_of_its_own():
    times = np.tile(np.arange(300.0)[:, None], (20, 1, 6))
    times[:, 0, 0] = -np.arange(20)  # the first instant tells them apart
    orders = TimePermutation().fit_transform(times)[:, :, 1]
    assert len({tuple(order) for order in orders}) == 20
    # Every place is as likely for every instant: the mean place of 6,000 instants is near the middle.
    assert abs(orders[:, :150].mean() - 149.5) < 5 * 300 / np.sqrt(12 * 3000)


def test_the_order_belongs_to_the_recording_and_the_seed():
    X = recordings(n=8)
    shuffle = TimePermutation(random_state=3).fit(X)
    expected = shuffle.transform(X)
    np.testing.assert_array_equal(shuffle.transform(X[::-1])[::-1], expected)
    np.testing.assert_array_equal(shuffle.transform(X[5:6]), expected[5:6])
    np.testing.assert_array_equal(TimePermutation(random_state=3).fit(X[:2]).transform(X), expected)
    np.testing.assert_array_equal(shuffle.transform(np.asfortranarray(X)), expected)
    assert not np.array_equal(TimePermutation(random_state=4).fit_transform(X), expected)


def test_permutation_ignores_the_sign_of_zero_and_dtype():
    X = np.round(recordings(n=2))
    expected = TimePermutation().fit_transform(X + 0.0)
    X[X == 0.0] = -0.0
    np.testing.assert_array_equal(TimePermutation().fit_transform(X), expected)
    np.testing.assert_array_equal(TimePermutation().fit_transform(X.astype(np.float32)), expected)


def test_the_order_is_the_same_everywhere():
    X = np.arange(8.0)[None, :, None]
    assert TimePermutation().fit_transform(X)[0, :, 0].tolist() == [0.0, 7.0, 1.0, 6.0, 4.0, 3.0, 5.0, 2.0]


def test_open_seed():
    X = recordings()
    shuffle = TimePermutation(random_state=None).fit(X)
    first = shuffle.transform(X)
    np.testing.assert_array_equal(shuffle.transform(X), first)
    assert not np.array_equal(shuffle.fit(X).transform(X), first)
    generators = [np.random.RandomState(5), np.random.RandomState(5)]
    one, other = (TimePermutation(random_state=generator).fit_transform(X) for generator in generators)
    np.testing.assert_array_equal(one, other)


def products(rows):
    return rows @ rows.T


def test_permutation_of_each_recording_changes_the_products():
    X = recordings()
    fixed = X[:, np.random.default_rng(0).permutation(300)]
    gram = products(RawSignal().fit_transform(X))
    np.testing.assert_allclose(products(RawSignal().fit_transform(fixed)), gram, rtol=1e-12)
    slow = X + 5 * np.sin(np.linspace(0, 9, 300))[:, None]
    gram = products(RawSignal().fit_transform(slow))
    permuted = products(make_pipeline(TimePermutation(), RawSignal()).fit_transform(slow))
    np.testing.assert_allclose(np.diag(permuted), np.diag(gram), rtol=1e-12)
    off = ~np.eye(5, dtype=bool)
    assert (permuted[off] < 0.5 * gram[off]).all()


def test_permutation_leaves_histograms_and_changes_hfmh():
    X = recordings()
    histogram = RawHistogram().fit(X)
    shuffled = TimePermutation().fit_transform(X)
    np.testing.assert_array_equal(histogram.transform(shuffled), histogram.transform(X))
    hfmh = HFMH().fit(X)
    assert not np.array_equal(hfmh.transform(shuffled), hfmh.transform(X))

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


def test_permutation_takes_the_course_in_time_away():
    X = recordings() + 5 * np.sin(np.linspace(0, 9, 300))[:, None]

    def products(*steps):
        rows = make_pipeline(*steps, RawSignal()).fit_transform(X)
        return rows @ rows.T

    gram, permuted = products(), products(TimePermutation())
    np.testing.assert_allclose(np.diag(permuted), np.diag(gram), rtol=1e-12)
    assert (permuted < 0.5 * gram)[~np.eye(5, dtype=bool)].all()
    shuffled = TimePermutation().fit_transform(X)
    np.testing.assert_array_equal(RawHistogram().fit(X).transform(shuffled), RawHistogram().fit_transform(X))
    assert not np.array_equal(HFMH().fit(X).transform(shuffled), HFMH().fit_transform(X))

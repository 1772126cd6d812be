"""Stretches that hold most of the contributions, beside a search over all stretches."""

import numpy as np
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from granular_id.explanation.result import regions_of
from granular_id.spaces import FeatureBlock


def block(n, kind="time", axes=("fx",), coordinates=None, unit="s"):
    points = np.arange(float(n)) if coordinates is None else np.asarray(coordinates, dtype=float)
    return FeatureBlock("b", kind, axes, points, unit, slice(0, n * len(axes)))


@given(arrays(np.float64, st.integers(1, 25), elements=st.integers(-5, 5).map(float)))
def test_the_first_is_the_shortest_that_holds_four_fifths_of_the_best(values):
    sums = {(i, j): values[i:j].sum() for i in range(len(values)) for j in range(i + 1, len(values) + 1)}
    best = max(sums.values())
    first = next(regions_of(block(len(values)), values[None]), None)
    if best <= 0:
        assert first is None
        return
    shortest = min(j - i for (i, j), total in sums.items() if total >= 0.8 * best)
    assert first.high - first.low + 1 == shortest
    assert first.contribution == sums[int(first.low), int(first.high) + 1] >= 0.8 * best


@given(arrays(np.float64, (2, 12), elements=st.integers(-5, 5).map(float)))
def test_stretches_do_not_overlap_and_leave_nothing_positive(values):
    taken = np.zeros((2, 12), dtype=bool)
    for region in regions_of(block(12, axes=("fx", "fy")), values):
        row = ("fx", "fy").index(region.axis)
        stretch = slice(int(region.low), int(region.high) + 1)
        assert not taken[row, stretch].any()
        assert region.contribution == values[row, stretch].sum() > 0
        taken[row, stretch] = True
    assert (values[~taken] <= 0).all()


def test_bins_around_zero_are_read_by_size():
    bins = block(4, "magnitude", ("tx",), [-1.5, -0.5, 0.5, 1.5], "N, N m")
    (first, *_) = regions_of(bins, np.array([[3.0, -1.0, -1.0, 2.0]]))
    assert (first.low, first.high, first.contribution, first.either_sign) == (1.0, 2.0, 5.0, True)
    assert str(first) == "tx of b, 1 .. 2 N m of either sign"
    odd = block(3, "magnitude", ("fx",), [-1.0, 0.0, 1.0], "N, N m")
    (only,) = regions_of(odd, np.array([[1.0, 7.0, -9.0]]))
    assert (only.low, only.high, only.contribution, only.unit) == (0.0, 0.5, 7.0, "N")


def test_bins_that_are_not_around_zero_keep_their_sign():
    bins = block(3, "magnitude", ("fz",), [1.0, 2.0, 3.0], "N")
    (only,) = regions_of(bins, np.array([[0.0, 4.0, 0.0]]))
    assert (only.low, only.high, only.either_sign) == (1.5, 2.5, False)

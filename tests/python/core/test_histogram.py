"""Counting against ``numpy.histogram``: the same bin for every value, above all beside the edges."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from effort import cases
from granular_id.signal import histogram


def assert_equals_numpy(a, bins, ends):
    for ours, theirs in zip(histogram(a, bins, ends), np.histogram(a, bins, ends), strict=True):
        assert ours.dtype == theirs.dtype
        assert ours.tobytes() == theirs.tobytes()


@pytest.mark.parametrize(
    ("a", "bins", "ends"),
    [
        # a product of an index and a step that rounds to the wrong side of a value
        ([0.1, 0.2, 0.3, 0.6, 0.7, 0.8, 0.9], 10, (0, 1)),
        (np.arange(-150, 151) / 100, 300, (-1.5, 1.5)),
        (np.array([337, 404, 739, 806, 1007, 1811, 2012]), 8296, (2, 2280)),
        (np.array([0, 0, 0, 1, 2, 3, 3, 4, 5.0]), 30, (-0.5, 5)),
        (np.linspace(0.1, 0.7, 4000), 3000, (0.1, 0.7)),
        # large and small ranges
        (np.linspace(-1e300, 1e300, 999), 333, (-1e300, 1e300)),
        (np.linspace(0, 2e-307, 999), 3, (0, 2e-307)),
        (1e15 + np.arange(100) / 8, 50, (1e15, 1e15 + 12.5)),
        (1 + np.arange(100) * 2**-52, 20, (1.0, 1 + 2**-45)),
        (np.array([-128, -127, 127], np.int8), 5, (-128, 127)),
        (np.array([0, 2**64 - 1], np.uint64), 4, (0, 2.0**64)),
        ([], 2, (0, 1)),
        ([0, 1, 2, 3], 3, (0, 3)),  # the last bin is closed
        (np.array([5e-324, 1e-310, -0.0]), 3, (-1, 1)),
        # below what 1 / width can say
        (np.array([-0.9e-308]), 2, (-1e-308, -2e-313)),
        (np.linspace(0, 1e-308, 99), 10, (0, 1e-308)),
        (np.array([0.0, 5e-324, 1e-323, 1.5e-323]), 3, (0, 1.5e-323)),
    ],
)
def test_values_beside_edges_are_counted_as_by_numpy(a, bins, ends):
    assert_equals_numpy(a, bins, ends)


@st.composite
def bins(draw):
    n_bins = draw(st.one_of(st.integers(1, 12), st.sampled_from([64, 100, 333, 1000, 32_768])))
    low = draw(st.one_of(st.sampled_from([-1.5, 0.0, 0.1, 1e3, -1e-3]), st.floats(-1e6, 1e6)))
    width = draw(st.one_of(st.sampled_from([1.0, 3.0, 0.7, 1e-6]), st.floats(1e-9, 1e9)))
    assume(n_bins * math.ulp(max(abs(low), width)) < width / 4)
    return n_bins, low, low + width


@settings(max_examples=cases(60))
@given(bins(), st.lists(st.floats(allow_nan=True), max_size=5), st.integers(0, 2**32 - 1))
def test_edges_and_neighbours_are_counted_as_by_numpy(parameters, others, seed):
    n_bins, low, high = parameters
    edges = np.linspace(low, high, n_bins + 1)
    inside = np.random.default_rng(seed).uniform(low, high, 50)
    a = np.concatenate([edges, np.nextafter(edges, np.inf), np.nextafter(edges, -np.inf), inside, others])
    assert_equals_numpy(a, n_bins, (low, high))


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"bins": 32_769}, ValueError, "bins must be .*, got 32769"),
        ({"bins": 2.4}, TypeError, "bins must be an integer .*got .*float"),
        ({"range": (0, np.inf)}, ValueError, "bin_range must be finite with low < high"),
        ({"range": (1, 1 + 2**-50)}, ValueError, "bin_range must hold 10 bins of finite size"),
        ({"range": (-1e308, 1e308)}, ValueError, "bin_range must be finite"),
    ],
)
def test_histogram_of_bad_arguments_raises(arguments, error, message):
    with pytest.raises(error, match=message):
        histogram(**{"a": [1.0, 2.0], "bins": 10, "range": (0, 1)} | arguments)

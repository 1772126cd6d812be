"""Extraction counts quickly, by arithmetic, and only beside an edge by comparison: here every value is there.

Two ways lead to high-passed values that lie on an edge or one unit in the last place beside it. One sets the
edges: a bin range is built around filtered values. The other sets the values: with a filter of first order,
sample after sample is chosen so that the filter's output becomes the value wanted.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import features_twin as twin
from effort import cases
from granular_id.features import extract_features
from granular_id.signal import butter


def one_ulp(values, steps):
    """Values moved up or down by so many units in the last place."""
    for _ in range(abs(steps)):
        values = np.nextafter(values, np.inf if steps > 0 else -np.inf)
    return values


def range_with_edge(value, bin_edge, n_bins, width):
    """A range whose edge number `bin_edge` is exactly `value`, or None where rounding has none."""
    low = value - bin_edge * width / n_bins
    for _ in range(16):
        edges = np.linspace(low, low + width, n_bins + 1)
        if edges[bin_edge] == value:
            return low, low + width
        low = np.nextafter(low, np.inf if edges[bin_edge] < value else -np.inf)
    return None


@settings(max_examples=cases(60))
@given(
    n_axes=st.sampled_from([1, 6, 6, 8, 13, 25]),
    n_bins=st.sampled_from([1, 2, 3, 7, 10, 64, 100, 1000, 32_768]),
    n_recordings=st.integers(1, 9),
    n_samples=st.integers(1, 40),
    width=st.sampled_from([3.0, 1.0, 0.1, 1e-3]),
    offset=st.sampled_from([-1, 0, 1]),
    clip=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_edges_that_are_filtered_values(n_axes, n_bins, n_recordings, n_samples, width, offset, clip, seed):
    rng = np.random.default_rng(seed)
    wrench = rng.standard_normal((n_recordings, n_samples, n_axes))
    filtered = twin.high_passed(wrench)
    ranges = []
    for axis in range(n_axes):
        value = one_ulp(rng.choice(filtered[:, :, axis].ravel()), offset)
        edge = int(rng.choice([0, n_bins, rng.integers(n_bins + 1)]))
        ranges.append(range_with_edge(value, edge, n_bins, width) or (value, value + width))
    options = {"bin_range": ranges, "n_bins": n_bins, "outside": "clip" if clip else "drop"}
    got = extract_features(wrench, **options)
    assert twin.differing_bits(got, twin.features(wrench, **options)) == 0


def wrench_for(targets, b, a):
    """Samples that a first-order section turns into `targets`, one column per channel, as nearly as floats go."""
    x, reached = np.empty_like(targets), np.empty_like(targets)
    state = np.zeros(targets.shape[1])
    for t, target in enumerate(targets):
        best_x = (target - state) / b[0]
        best_y = b[0] * best_x + state
        for steps in (-2, -1, 1, 2):
            other = one_ulp((target - state) / b[0], steps)
            y = b[0] * other + state
            nearer = np.abs(y - target) < np.abs(best_y - target)
            best_x, best_y = np.where(nearer, other, best_x), np.where(nearer, y, best_y)
        x[t], reached[t] = best_x, best_y
        state = b[1] * best_x - a[1] * best_y
    return x, reached


BINS = [
    (100, -1.5, 1.5),  # the paper
    (64, -1.0, 1.0),
    (10, 0.0, 1.0),
    (3, 0.1, 0.7),
    (1, -0.3, 0.1),
    (32_768, -1.5, 1.5),
    (1000, -1e-3, 2e-3),
    (7, 99.9, 100.1),
    (4096, 1000.0, 1001.0),  # far from zero: the quick arithmetic is less exact
    (1000, 1e6, 1e6 + 1e-3),
    (32_768, 2.0**20, 2.0**20 + 2.0**-10),  # ... and here of no use at all
    (100, -1e-300, 1e-300),
    (100, -1e300, 1e300),
]


@pytest.mark.parametrize("n_axes", [1, 6, 25])
@pytest.mark.parametrize(("n_bins", "low", "high"), BINS)
def test_filtered_values_that_are_edges(n_bins, low, high, n_axes):
    section = butter(1, 23, "highpass", fs=500)[0]
    rng = np.random.default_rng(n_bins)
    edges = np.linspace(low, high, n_bins + 1)
    n_recordings = max(1, 60 // n_axes)
    shape = (67, n_recordings * n_axes)
    targets = np.where(rng.random(shape) < 0.15, edges[rng.choice([0, -1])], rng.choice(edges, shape))
    kind = rng.integers(-1, 2, shape)
    targets = np.where(kind < 0, one_ulp(targets, -1), np.where(kind > 0, one_ulp(targets, 1), targets))
    x, reached = wrench_for(targets, section[:3], section[3:])
    wrench = np.ascontiguousarray(x.reshape(67, n_recordings, n_axes).swapaxes(0, 1))
    filtered = twin.high_passed(wrench, order=1)
    assert np.array_equal(filtered.swapaxes(0, 1).reshape(shape), reached)
    assert np.isin(filtered, edges).sum() > 100
    assert np.isin(one_ulp(filtered, 1), edges).sum() + np.isin(one_ulp(filtered, -1), edges).sum() > 100
    for outside in ("drop", "clip"):
        options = {"order": 1, "n_bins": n_bins, "bin_range": (low, high), "outside": outside, "raw": False}
        got = extract_features(wrench, **options)
        assert twin.differing_bits(got, twin.features(wrench, **options)) == 0

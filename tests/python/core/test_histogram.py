"""Counting against ``numpy.histogram``: the same bin for every value, above all beside the edges."""

import importlib
import math
import types

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from array_kinds import KINDS, digest
from effort import cases
from granular_id.signal import histogram

X = np.random.default_rng(3).standard_normal((5, 24, 6))
# The cases of numpy's own suite that are about uniform bins of float64.
NUMPYS = [
    "test_simple",
    "test_no_side_effects",
    "test_error_binnum_type",
    "test_finite_range",
    "test_invalid_range",
    "test_bin_edge_cases",
    "test_last_bin_inclusive_range",
    "test_object_array_of_0d",
    "test_signed_overflow_bounds",
    "test_gh_23110",
]


class Replaced(types.ModuleType):
    """numpy, with one function of it replaced."""

    def __init__(self, function):
        super().__init__("numpy")
        self.histogram = function

    def __getattr__(self, name):
        return getattr(np, name)


def numpys_tests():
    try:
        return importlib.import_module("numpy.lib.tests.test_histograms")
    except ImportError:
        pytest.skip("this numpy comes without its tests")


@pytest.mark.thread_unsafe(reason="replaces functions of numpy's test module")
@pytest.mark.parametrize("test", NUMPYS)
def test_numpys_own_cases(test, monkeypatch):
    module = numpys_tests()
    case = module.TestHistogram()
    if not hasattr(case, test):
        pytest.skip(f"this numpy has no {test}")
    calls = []

    def counted(*args, **kwargs):
        calls.append(args)
        return histogram(*args, **kwargs)

    monkeypatch.setattr(module, "histogram", counted)
    monkeypatch.setattr(module, "np", Replaced(counted))
    getattr(case, test)()
    assert calls


def same(a, bins, ends, **options):
    got, wanted = histogram(a, bins, ends, **options), np.histogram(a, bins, ends, **options)
    for ours, theirs in zip(got, wanted, strict=True):
        assert ours.dtype == theirs.dtype
        assert ours.shape == theirs.shape
        assert ours.tobytes() == theirs.tobytes()
    return got


def test_simple_counts():
    counts, edges = histogram(np.linspace(0, 10, 100))
    assert counts.tolist() == [10] * 10
    assert edges.tolist() == list(range(11))
    assert histogram([0, 1, 2, 3], bins=3, range=(0, 3))[0].tolist() == [1, 1, 2]  # the last bin is closed
    assert histogram([True, True, False])[0].tolist() == [1, 0, 0, 0, 0, 0, 0, 0, 0, 2]
    assert histogram(np.ones((2, 3, 4)), 2, (0, 2))[0].tolist() == [0, 24]


def test_densities_integrate_to_one():
    a = np.random.default_rng(1).standard_normal(500)
    counts, edges = same(a, 17, (-1, 2), density=True)
    assert (counts * np.diff(edges)).sum() == pytest.approx(1)
    assert histogram([5.0], 4, (0, 1), density=True)[0].tolist() == [0, 0, 0, 0]


@pytest.mark.parametrize("empty", [[], np.zeros((0, 5)), np.zeros(0, int)], ids=["list", "2-d", "int"])
def test_without_values(empty):
    counts, edges = histogram(empty, 2)
    assert counts.tolist() == [0, 0]
    assert edges.tolist() == [0, 0.5, 1]


@pytest.mark.parametrize(
    ("a", "bins", "ends"),
    [
        # one value many times
        (np.full(7, 3.0), 4, None),
        (np.full(7, 3.0), 5, (2, 2)),
        # a product of an index and a step that rounds to the wrong side of a value
        ([0.1, 0.2, 0.3, 0.6, 0.7, 0.8, 0.9], 10, (0, 1)),
        (np.arange(-150, 151) / 100, 300, (-1.5, 1.5)),
        (np.array([337, 404, 739, 806, 1007, 1811, 2012]), 8296, (2, 2280)),
        (np.array([0, 0, 0, 1, 2, 3, 3, 4, 5.0]), 30, (-0.5, 5)),
        (np.linspace(0.1, 0.7, 4000), 3000, (0.1, 0.7)),
        # large and small ranges
        (np.linspace(-1e300, 1e300, 999), 333, (-1e300, 1e300)),
        (np.linspace(-4e307, 4e307, 999), 7, (-8e307, 8e307)),
        (np.linspace(1e-300, 9e-300, 99), 9, (1e-300, 9e-300)),
        (np.linspace(0, 2e-307, 999), 3, (0, 2e-307)),
        (1e15 + np.arange(100) / 8, 50, (1e15, 1e15 + 12.5)),
        (1 + np.arange(100) * 2**-52, 20, (1.0, 1 + 2**-45)),
        (np.array([1, 254, 255], np.uint8), 5, (0, 255)),
        (np.array([-128, -127, 127], np.int8), 5, None),
        (np.array([0, 2**64 - 1], np.uint64), 4, None),
        (np.array([-(2**63), 2**63 - 1]), 3, None),
        (np.array([5e-324, 1e-310, -0.0]), 3, (-1, 1)),
        # below what 1 / width can say
        (np.array([-0.9e-308]), 2, (-1e-308, -2e-313)),
        (np.linspace(0, 1e-308, 99), 10, (0, 1e-308)),
        (np.array([0.0, 5e-324, 1e-323, 1.5e-323]), 3, (0, 1.5e-323)),
    ],
)
def test_values_beside_float_edges(a, bins, ends):
    same(a, bins, ends)


@st.composite
def bins(draw):
    n_bins = draw(st.one_of(st.integers(1, 12), st.sampled_from([64, 100, 333, 1000, 32_768])))
    low = draw(st.one_of(st.sampled_from([-1.5, 0.0, 0.1, 1e3, -1e-3]), st.floats(-1e6, 1e6)))
    width = draw(st.one_of(st.sampled_from([1.0, 3.0, 0.7, 1e-6]), st.floats(1e-9, 1e9)))
    assume(n_bins * math.ulp(max(abs(low), width)) < width / 4)
    return n_bins, low, low + width


@settings(max_examples=cases(60))
@given(bins(), st.lists(st.floats(allow_nan=True), max_size=5), st.booleans(), st.integers(0, 2**32 - 1))
def test_every_edge_and_its_neighbours(parameters, others, density, seed):
    n_bins, low, high = parameters
    edges = np.linspace(low, high, n_bins + 1)
    inside = np.random.default_rng(seed).uniform(low, high, 50)
    a = np.concatenate([edges, np.nextafter(edges, np.inf), np.nextafter(edges, -np.inf), inside, others])
    same(a, n_bins, (low, high), density=density)


@settings(max_examples=cases(50))
@given(st.lists(st.floats(-1e9, 1e9), max_size=30), st.integers(1, 50))
def test_the_range_of_the_values(a, n_bins):
    low, high = (min(a), max(a)) if a else (0, 1)
    assume(low == high or n_bins * math.ulp(max(abs(low), abs(high))) < (high - low) / 4)
    same(a, n_bins, None)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"bins": 0}, ValueError, "bins must be an integer from 1 to 32768, got 0"),
        ({"bins": 32_769}, ValueError, "bins must be an integer from 1 to 32768, got 32769"),
        ({"bins": 2.4}, TypeError, "bins must be an integer, got .*float"),
        ({"bins": "auto"}, TypeError, "bins must be an integer, got .*str"),
        ({"bins": [0, 1, 2]}, TypeError, "bins must be an integer, got .*list"),
        ({"range": (np.nan, 1)}, ValueError, r"range must be finite: range is \(nan, 1\.0\)"),
        ({"range": (0, np.inf)}, ValueError, r"range must be finite: range is \(0\.0, inf\)"),
        ({"range": (0.1, 0.01)}, ValueError, r"max must be larger than min in range, got \(0\.1, 0\.01\)"),
        ({"range": (0, 10**400)}, ValueError, "range must fit into float64"),
        ({"range": (1, 1 + 2**-50)}, ValueError, "bins and range .* cannot create 10 finite-sized bins"),
        ({"range": (-1e308, 1e308)}, ValueError, "bins and range do not fit together"),
        ({"range": 3}, TypeError, "range must be a pair of numbers"),
        ({"range": (1, 2, 3)}, TypeError, "range must be a pair of numbers"),
        ({"range": "ab"}, TypeError, "range must be a pair of numbers"),
        ({"a": [1 + 1e-16, 1 + 2e-16, 1, 1 + 3e-16]}, ValueError, "cannot create 10 finite-sized bins"),
        ({"a": [0, np.nan]}, ValueError, r"range must be finite: the values of a span \(nan, nan\)"),
        ({"a": [0, np.inf]}, ValueError, r"range must be finite: the values of a span \(0\.0, inf\)"),
        ({"a": [1j]}, TypeError, "a must hold real numbers, got dtype complex128"),
        ({"a": [None]}, TypeError, "a must hold real numbers, got dtype object"),
        ({"a": np.ma.masked_array([1, 2], [0, 1])}, TypeError, "a must be a plain array, got a masked one"),
        ({"a": [[1], [1, 2]]}, ValueError, "a must be an array of real numbers, got list"),
    ],
)
def test_bad_arguments(arguments, error, message):
    with pytest.raises(error, match=message):
        histogram(**{"a": [1.0, 2.0], "range": None} | arguments)


@pytest.mark.filterwarnings("ignore:the matrix subclass:PendingDeprecationWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_array(kind):
    value = KINDS[kind](X)
    before = digest(value)
    counts, edges = histogram(value, 5, (-1, 1))
    wanted = np.histogram(np.array(value, np.float64), 5, (-1, 1))
    np.testing.assert_array_equal(counts, wanted[0])
    np.testing.assert_array_equal(edges, wanted[1])
    assert digest(value) == before

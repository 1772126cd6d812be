"""Feature extraction against scipy and numpy: not one bit may differ, whatever the shape and the options.

``GRANULAR_ID_CASES=20000 pytest tests/python/core/test_features.py -k scipy`` tries more cases.
"""

import os
import platform
import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import features_twin as twin
import granular_id as gid
from core_cases import printed_by
from effort import cases
from granular_id.features import extract_features, feature_names
from granular_id.signal import butter

pytestmark = [
    pytest.mark.skipif(
        platform.machine() not in {"x86_64", "AMD64"}, reason="scipy may be compiled with fused operations"
    ),
    pytest.mark.filterwarnings("ignore:.*is it transposed:UserWarning"),
]


@settings(max_examples=cases(75))
@given(
    n_axes=st.sampled_from(twin.AXES),
    n_recordings=st.one_of(st.none(), st.integers(1, 14)),
    n_samples=st.one_of(st.integers(1, 17), st.integers(1, 260)),
    threads=st.sampled_from([None, 1, 2, 3]),
    dtype=st.sampled_from([np.float64, np.float64, np.float32]),
    into=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_extract_features_equals_scipy_and_numpy(n_axes, n_recordings, n_samples, threads, dtype, into, seed):
    rng = np.random.default_rng(seed)
    options = twin.some_options(rng, n_axes)
    wrench = twin.a_wrench(rng, (n_recordings or 1, n_samples, n_axes))
    wrench = wrench if n_recordings else wrench[0]
    with np.errstate(over="ignore"):  # numbers that float32 does not hold
        wanted = twin.features(wrench, dtype=dtype, **options)
    if not np.isfinite(wanted).all():
        wrench = wrench * 1e-200
        wanted = twin.features(wrench, dtype=dtype, **options)
    out = np.full(wanted.shape, np.nan) if into and dtype == np.float64 else None
    got = extract_features(wrench, threads=threads, dtype=dtype, out=out, **options)
    assert out is None or got is out
    assert twin.differing_bits(got, wanted) == 0


# Extraction counts quickly, by arithmetic, and only beside an edge by comparison. With a filter of first order, sample
# after sample is chosen so that the filter's output is an edge, or one unit in the last place beside it.


def ulp_away(values, steps):
    """Values moved up or down by so many units in the last place."""
    for _ in range(abs(steps)):
        values = np.nextafter(values, np.inf if steps > 0 else -np.inf)
    return values


def wrench_for(targets, b, a):
    """Samples that a first-order section turns into `targets`, one column per channel, as nearly as floats go."""
    x, reached = np.empty_like(targets), np.empty_like(targets)
    state = np.zeros(targets.shape[1])
    for t, target in enumerate(targets):
        best_x = (target - state) / b[0]
        best_y = b[0] * best_x + state
        for steps in (-2, -1, 1, 2):
            other = ulp_away((target - state) / b[0], steps)
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
    targets = np.where(kind < 0, ulp_away(targets, -1), np.where(kind > 0, ulp_away(targets, 1), targets))
    x, reached = wrench_for(targets, section[:3], section[3:])
    wrench = np.ascontiguousarray(x.reshape(67, n_recordings, n_axes).swapaxes(0, 1))
    filtered = twin.high_passed(wrench, order=1)
    assert np.array_equal(filtered.swapaxes(0, 1).reshape(shape), reached)
    assert np.isin(filtered, edges).sum() > 100
    assert np.isin(ulp_away(filtered, 1), edges).sum() + np.isin(ulp_away(filtered, -1), edges).sum() > 100
    for outside in ("drop", "clip"):
        options = {"order": 1, "n_bins": n_bins, "bin_range": (low, high), "outside": outside, "raw": False}
        got = extract_features(wrench, **options)
        assert twin.differing_bits(got, twin.features(wrench, **options)) == 0


VECTOR_UNITS = """
import hashlib, numpy as np, granular_id as gid
rng = np.random.default_rng(0)
digest = hashlib.sha256()
for axes in (6, 1, 3, 13, 25, 40):
    wrench = rng.standard_normal((13, 163, axes))
    digest.update(gid.extract_features(wrench, threads=2, n_bins=37).tobytes())
print(digest.hexdigest())
"""


def vector_units():
    """Those of this machine, as the refusal of another names them."""
    with pytest.raises(AssertionError, match="one of the vector units of this machine") as refused:
        printed_by("import granular_id", **os.environ | {"GRANULAR_ID_SIMD": "none"})
    return re.search(r"machine \((.+?)\)", str(refused.value))[1].split(", ")


@pytest.mark.thread_unsafe(reason="starts processes")
def test_every_vector_unit_gives_the_same_bits():
    digests = {
        unit: printed_by(VECTOR_UNITS, **os.environ | {"GRANULAR_ID_SIMD": unit})
        for unit in ("", *vector_units())
    }
    assert len(digests[""]) == 65
    assert "baseline" in digests
    assert len(set(digests.values())) == 1, digests


def test_names_say_where_a_value_is():
    n_samples, n_bins = 12, 5
    names = feature_names(n_samples=n_samples, n_bins=n_bins)
    assert names == gid.FeatureSpec(n_bins=n_bins).feature_names(n_samples, 6)
    wrench = np.arange(n_samples * 6, dtype=float).reshape(n_samples, 6)
    values = dict(zip(names, extract_features(wrench, n_bins=n_bins), strict=True))
    for k, axis in enumerate(gid.AXES):
        for sample in range(n_samples):
            assert values[f"{axis}_{sample:04d}"] == wrench[sample, k]
        counts = [values[f"hfmh_{axis}_{i:02d}"] for i in range(n_bins)]
        assert np.array_equal(counts, twin.features(wrench[:, [k]], raw=False, n_bins=n_bins))
    few = feature_names(n_samples=1, n_axes=2, n_bins=1)
    assert few == ["axis0_0000", "axis1_0000", "hfmh_axis0_00", "hfmh_axis1_00"]
    many = feature_names(n_samples=10_001, n_bins=101, n_axes=1)
    assert many[0] == "axis0_00000"  # as many digits as needed, so that sorting keeps the order
    assert many[-1] == "hfmh_axis0_100"

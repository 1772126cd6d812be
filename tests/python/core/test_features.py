"""Feature extraction against scipy and numpy: not one bit may differ, whatever the shape and the options.

``GRANULAR_ID_CASES=20000 pytest tests/python/core/test_features.py -k campaign -s`` runs the long campaign and
prints how many numbers were compared.
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

pytestmark = [
    pytest.mark.skipif(
        platform.machine() not in {"x86_64", "AMD64"}, reason="scipy may be compiled with fused operations"
    ),
    pytest.mark.filterwarnings("ignore:.*is it transposed:UserWarning"),
]


def extract(wrench, *, out=None, **keywords):
    """Into a new result, or into one full of NaN."""
    if out is None:
        return extract_features(wrench, **keywords)
    given = np.full(out.shape, np.nan, out.dtype)
    assert extract_features(wrench, out=given, **keywords) is given
    return given


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
def test_equal_to_scipy_and_numpy(n_axes, n_recordings, n_samples, threads, dtype, into, seed):
    rng = np.random.default_rng(seed)
    options = twin.some_options(rng, n_axes)
    wrench = twin.a_wrench(rng, (n_recordings or 1, n_samples, n_axes))
    wrench = wrench if n_recordings else wrench[0]
    with np.errstate(over="ignore"):  # numbers that float32 does not hold
        wanted = twin.features(wrench, dtype=dtype, **options)
    if not np.isfinite(wanted).all():
        wrench = wrench * 1e-200
        wanted = twin.features(wrench, dtype=dtype, **options)
    got = extract(
        wrench, threads=threads, dtype=dtype, out=wanted if into and dtype == np.float64 else None, **options
    )
    assert twin.differing_bits(got, wanted) == 0


def test_campaign():
    n_cases = cases(30)
    rng = np.random.default_rng(2024)
    compared = differing = 0
    for _ in range(n_cases):
        n_axes = int(rng.choice(twin.AXES))
        options = twin.some_options(rng, n_axes)
        shape = (int(rng.integers(1, 40)), int(rng.choice([1, 7, 8, 9, 48, 160, 400])), n_axes)
        wrench = twin.a_wrench(rng, shape)
        got = extract_features(wrench, threads=int(rng.integers(1, 4)), **options)
        wanted = twin.features(wrench, **options)
        compared += got.size
        differing += twin.differing_bits(got, wanted)
    print(f"extraction against scipy and numpy: {n_cases} cases, {compared} values, {differing} differing")
    assert compared > n_cases
    assert differing == 0


def test_the_size_of_the_paper():
    rng = np.random.default_rng(1)
    wrench = 0.2 * np.cumsum(rng.standard_normal((20, 1600, 6)), axis=1)
    wanted = twin.features(wrench)
    for threads in (None, 1, 3):
        assert twin.differing_bits(extract_features(wrench, threads=threads), wanted) == 0
    for recording, row in zip(wrench[:3], wanted, strict=False):
        assert twin.differing_bits(extract_features(recording), row) == 0


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


@pytest.mark.parametrize("n_axes", [1, 6, 7])
@pytest.mark.parametrize(("raw", "hfmh"), [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize(("n_samples", "n_bins"), [(1, 1), (30, 101)])
def test_there_is_one_name_per_feature(n_axes, raw, hfmh, n_samples, n_bins):
    spec = gid.FeatureSpec(raw=raw, hfmh=hfmh, n_bins=n_bins)
    names = feature_names(spec, n_samples=n_samples, n_axes=n_axes)
    values = extract_features(np.zeros((n_samples, n_axes)), spec=spec)
    assert len(set(names)) == len(names) == len(values) == spec.n_features(n_samples, n_axes)
    assert names == spec.feature_names(n_samples, n_axes)
    assert names == feature_names(n_samples=n_samples, n_axes=n_axes, raw=raw, hfmh=hfmh, n_bins=n_bins)
    assert [name.startswith("hfmh_") for name in names] == sorted(name.startswith("hfmh_") for name in names)


def test_names_say_where_a_value_is():
    n_samples, n_bins = 12, 5
    names = feature_names(n_samples=n_samples, n_bins=n_bins)
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

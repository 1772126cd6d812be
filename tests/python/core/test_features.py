"""Feature extraction against scipy and numpy: not one bit may differ, whatever the shape and the options.

``GRANULAR_ID_CASES=20000 pytest tests/python/core/test_features.py -k campaign -s`` runs the long campaign and
prints how many numbers were compared.
"""

import os
import platform
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import features_twin as twin
import granular_id as gid
from effort import cases
from granular_id.features import extract_features, feature_names

pytestmark = [
    pytest.mark.skipif(
        platform.machine() not in {"x86_64", "AMD64"}, reason="scipy may be compiled with fused operations"
    ),
    pytest.mark.filterwarnings("ignore:.*is it transposed:UserWarning"),
]

AXES = [6, 6, 6, 1, 3, 13, 25, 40]


def a_wrench(rng, shape):
    """Signals of many characters: noise, walks, offsets, silence, steps, huge and subnormal numbers."""
    x = rng.standard_normal(shape)
    kind = rng.integers(8)
    if kind == 1:
        x = 0.1 * np.cumsum(x, axis=1)
    elif kind == 2:
        x[rng.random(shape) < 0.9] = 0.0
    elif kind == 3:
        x = np.zeros(shape) + rng.standard_normal()
    elif kind == 4:
        x *= 10.0 ** rng.integers(-323, -300)
    elif kind == 5:
        x *= 10.0 ** rng.integers(1, 200)
    elif kind == 6:
        x = rng.integers(-9, 9, shape).astype(np.float64)
    elif kind == 7:
        x = x * 0.3 + rng.uniform(-40, 40, (1, 1, shape[2]))
    return x


def some_options(rng, n_axes):
    low = rng.uniform(-3, 1, (n_axes, 1))
    ranges = np.hstack([low, low + 10.0 ** rng.uniform(-2, 1, (n_axes, 1))])
    raw, hfmh = [(True, True), (True, True), (False, True), (True, False)][rng.integers(4)]
    return {
        "rate_hz": float(rng.choice([100.0, 500.0, 1000.0])),
        "cutoff_hz": float(rng.uniform(0.5, 49)),
        "order": int(rng.integers(1, 13)),
        "n_bins": int(rng.choice([1, 2, 3, 7, 10, 64, 100, 333])),
        "bin_range": ranges if rng.random() < 0.5 else tuple(ranges[0]),
        "raw": raw,
        "hfmh": hfmh,
        "outside": str(rng.choice(["drop", "clip"])),
        "density": bool(rng.random() < 0.3),
        "initial": str(rng.choice(["zero", "steady"])),
    }


def extract(wrench, *, out=None, **keywords):
    """Into a new result, or into one full of NaN."""
    if out is None:
        return extract_features(wrench, **keywords)
    given = np.full(out.shape, np.nan, out.dtype)
    result = extract_features(wrench, out=given, **keywords)
    assert result is given
    return result


@settings(max_examples=cases(150))
@given(
    n_axes=st.sampled_from(AXES),
    n_recordings=st.one_of(st.none(), st.integers(1, 14)),
    n_samples=st.one_of(st.integers(1, 17), st.integers(1, 260)),
    threads=st.sampled_from([None, 1, 2, 3]),
    dtype=st.sampled_from([np.float64, np.float64, np.float32]),
    into=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_equal_to_scipy_and_numpy(n_axes, n_recordings, n_samples, threads, dtype, into, seed):
    rng = np.random.default_rng(seed)
    options = some_options(rng, n_axes)
    wrench = a_wrench(rng, (n_recordings or 1, n_samples, n_axes))
    wrench = wrench if n_recordings else wrench[0]
    with np.errstate(over="ignore"):  # numbers that float32 does not hold
        wanted = twin.features(wrench, dtype=dtype, **options)
    if not np.isfinite(wanted).all():
        wrench = wrench * 1e-200
        wanted = twin.features(wrench, dtype=dtype, **options)
    got = extract(wrench, threads=threads, dtype=dtype, out=wanted if into else None, **options)
    assert twin.differing_bits(got, wanted) == 0


def test_campaign():
    n_cases = cases(100)
    rng = np.random.default_rng(2024)
    compared = differing = 0
    for _ in range(n_cases):
        n_axes = int(rng.choice(AXES))
        options = some_options(rng, n_axes)
        shape = (int(rng.integers(1, 40)), int(rng.choice([1, 7, 8, 9, 48, 160, 400])), n_axes)
        wrench = a_wrench(rng, shape)
        got = extract_features(wrench, threads=int(rng.integers(1, 4)), **options)
        wanted = twin.features(wrench, **options)
        compared += got.size
        differing += twin.differing_bits(got, wanted)
    print(f"extraction against scipy and numpy: {n_cases} cases, {compared} values, {differing} differing")
    assert compared > n_cases
    assert differing == 0


@pytest.mark.parametrize("threads", [None, 1, 2, 3])
def test_the_size_of_the_paper(threads):
    rng = np.random.default_rng(1)
    wrench = 0.2 * np.cumsum(rng.standard_normal((50, 1600, 6)), axis=1)
    assert twin.differing_bits(extract_features(wrench, threads=threads), twin.features(wrench)) == 0


def test_a_batch_is_its_recordings():
    wrench = np.random.default_rng(2).standard_normal((9, 333, 6))
    batch = extract_features(wrench, threads=2)
    for recording, row in zip(wrench, batch, strict=True):
        assert twin.differing_bits(extract_features(recording), row) == 0


def test_float32_results_are_the_float64_results_rounded_once():
    wrench = np.random.default_rng(3).standard_normal((70, 50, 6))  # 70: more than one piece
    narrow = extract_features(wrench, dtype="float32", density=True)
    assert narrow.dtype == np.float32
    assert np.array_equal(narrow, extract_features(wrench, density=True).astype(np.float32))


def test_float32_input_is_computed_in_float64():
    wrench = np.random.default_rng(4).standard_normal((3, 50, 6)).astype(np.float32)
    got = extract_features(wrench)
    assert got.dtype == np.float64
    assert twin.differing_bits(got, twin.features(wrench.astype(np.float64))) == 0


def test_a_density_of_nothing_is_zero_and_of_something_integrates_to_one():
    wrench = np.zeros((1, 100, 2))
    wrench[0, :, 0] = np.random.default_rng(5).standard_normal(100)
    got = extract_features(wrench, raw=False, density=True, n_bins=10, bin_range=[(-1, 1), (5, 6)])[0]
    assert got[:10].sum() * 0.2 == pytest.approx(1)
    assert np.array_equal(got[10:], np.zeros(10))


def test_clipped_values_are_counted_in_the_outermost_bins():
    wrench = 50 * np.random.default_rng(6).standard_normal((200, 3))
    dropped = extract_features(wrench, raw=False, n_bins=5).reshape(3, 5)
    clipped = extract_features(wrench, raw=False, n_bins=5, outside="clip").reshape(3, 5)
    assert (clipped.sum(axis=1) == 200).all()
    assert (dropped.sum(axis=1) < 200).all()
    assert np.array_equal(clipped[:, 1:-1], dropped[:, 1:-1])


def test_a_steady_start_forgets_the_offset_and_a_start_at_rest_does_not():
    quiet = np.full((100, 6), 30.0)
    at_rest = extract_features(quiet, raw=False).reshape(6, 100)
    steady = extract_features(quiet, raw=False, initial="steady").reshape(6, 100)
    assert (steady[:, 49:51].sum(axis=1) == 100).all()
    assert (at_rest[:, 49:51].sum(axis=1) < 100).all()


def test_a_range_per_axis_counts_each_axis_in_its_own_range():
    wrench = np.random.default_rng(7).standard_normal((64, 2))
    ranges = [(-1, 1), (-0.1, 0.3)]
    both = extract_features(wrench, raw=False, bin_range=ranges, n_bins=9)
    alone = [extract_features(wrench[:, [k]], raw=False, bin_range=ranges[k], n_bins=9) for k in (0, 1)]
    assert np.array_equal(both, np.concatenate(alone))


def test_out_is_filled_and_returned_also_inside_a_larger_array():
    wrench = np.random.default_rng(8).standard_normal((4, 20, 6))
    wanted = extract_features(wrench)
    table = np.full((10, wanted.shape[1]), 7.0)
    assert extract_features(wrench, out=table[3:7]).base is table
    assert np.array_equal(table[3:7], wanted)
    assert (table[:3] == 7).all()
    assert (table[7:] == 7).all()
    one = np.empty(wanted.shape[1])
    assert extract_features(wrench[1], out=one) is one
    assert np.array_equal(one, wanted[1])


@pytest.mark.thread_unsafe(reason="starts processes")
def test_every_vector_unit_gives_the_same_bits():
    program = (
        "import hashlib, numpy as np, granular_id as gid\n"
        "rng = np.random.default_rng(0)\n"
        "digest = hashlib.sha256()\n"
        "for axes in (6, 1, 3, 13, 25, 40):\n"
        "    wrench = rng.standard_normal((13, 163, axes))\n"
        "    digest.update(gid.extract_features(wrench, threads=2, n_bins=37).tobytes())\n"
        "print(digest.hexdigest())\n"
    )
    digests = {}
    for path in ("baseline", "avx2", "avx512", ""):
        environment = {**os.environ, "GRANULAR_ID_SIMD": path}
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        digests[path] = done.stdout
    assert len(digests[""]) == 65
    assert len(set(digests.values())) == 1, digests


@pytest.mark.parametrize("n_axes", [1, 3, 6, 7])
@pytest.mark.parametrize(("raw", "hfmh"), [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize(("n_samples", "n_bins"), [(1, 1), (30, 100), (10_001, 101)])
def test_there_is_one_name_per_feature(n_axes, raw, hfmh, n_samples, n_bins):
    spec = gid.FeatureSpec(raw=raw, hfmh=hfmh, n_bins=n_bins)
    names = feature_names(spec, n_samples=n_samples, n_axes=n_axes)
    values = extract_features(np.zeros((n_samples, n_axes)), spec=spec)
    assert len(names) == len(values) == spec.n_features(n_samples, n_axes)
    assert len(set(names)) == len(names)
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
    assert names[0] == "fx_0000"
    assert names[-1] == "hfmh_tz_04"
    assert feature_names(n_samples=1, n_axes=2, n_bins=1) == [
        "axis0_0000",
        "axis1_0000",
        "hfmh_axis0_00",
        "hfmh_axis1_00",
    ]
    sorted_names = feature_names(n_samples=10_001, n_bins=101, n_axes=1)
    assert sorted_names[0] == "axis0_00000"  # as many digits as needed, so that sorting keeps the order
    assert sorted_names[-1] == "hfmh_axis0_100"

"""The multi-band features of the core against their definition in plain numpy."""

import itertools
import pickle

import numpy as np
import pytest

import multiband_twin as twin
from granular_id._core import MultiBandExtractor

SIZES = [*((n, 2) for n in range(1, 21)), (85, 4), (300, 1), (301, 13), (1600, 6), (100_000, 1)]


def signals(n_samples, n_axes, n=3, seed=0):
    """Noise and a slow wander around an offset, axes of very different size, coupled."""
    rng = np.random.default_rng([seed, n_samples, n_axes])
    x = rng.normal(size=(n, n_samples, n_axes)) + 0.2 * rng.normal(size=(n, n_samples, n_axes)).cumsum(axis=1)
    x = x @ (np.eye(n_axes) + 0.3 * rng.normal(size=(n_axes, n_axes)))
    return (x + rng.normal(size=n_axes)) * np.geomspace(5.0, 0.05, n_axes)


def learned(recordings, blocks=twin.BLOCKS):
    scales, level_scales = twin.learned_scales(recordings)
    # Not the scales themselves: samples of the median recording can then be 1 exactly, which is an edge of a bin, and
    # rounding decides on which side of it they are counted.
    scales = 1.0123 * scales
    shape = recordings.shape[1:]
    return MultiBandExtractor(*shape, blocks=blocks, scales=scales, level_scales=level_scales)


def expected(extractor, recordings):
    scales, level_scales = extractor.scales, extractor.level_scales
    blocks = [block for block in twin.BLOCKS if block in extractor.blocks]
    n_samples = extractor.n_samples
    return np.array([twin.features(x, scales, level_scales, blocks, n_samples) for x in recordings])


def assert_close(got, wanted):
    """Logarithms of sums: rounding of the sums stays below 1e-9 of the feature, or of 1."""
    np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("n_samples", "n_axes"), SIZES)
def test_features_are_those_of_the_definition(n_samples, n_axes):
    X = signals(n_samples, n_axes, n=1 if n_samples > 2000 else 3)
    extractor = learned(X)
    got = extractor.extract(X)
    assert got.shape == (len(X), extractor.n_features)
    assert got.shape[1] == len(extractor.names) == len(set(extractor.names))
    assert_close(got, expected(extractor, X))


@pytest.mark.parametrize(("n_samples", "n_axes"), SIZES)
def test_root_mean_squares_of_bands(n_samples, n_axes):
    X = signals(n_samples, n_axes, n=1 if n_samples > 2000 else 3)
    got = MultiBandExtractor(n_samples, n_axes, blocks=["quantiles"]).band_rms(X)
    np.testing.assert_allclose(got, [twin.rms(twin.band_signals(x)) for x in X], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("block", twin.BLOCKS)
def test_each_block_alone_is_its_part_of_the_whole(block):
    X = signals(200, 3)
    whole, alone = learned(X), learned(X, blocks=[block])
    columns = [name in set(alone.names) for name in whole.names]
    np.testing.assert_array_equal(alone.extract(X), whole.extract(X)[:, columns])
    assert whole.block_sizes[block] == alone.n_features
    assert list(whole.block_sizes) == list(twin.BLOCKS)


def test_bands_without_enough_samples_have_no_coupling():
    for n_axes in (1, 3, 6):
        extractor = MultiBandExtractor(1600, n_axes)
        needed = twin.MIN_ROWS * 2 * n_axes + twin.LAG
        long_enough = sum(n >= needed for n in twin.band_lengths(1600))
        assert extractor.block_sizes["coupling"] == long_enough * n_axes * (2 * n_axes + 1)


@pytest.mark.parametrize("n_samples", [85, 1600])
@pytest.mark.parametrize("share", [0.55, 0.8, 0.999])
def test_a_beginning_has_the_bands_of_the_whole(n_samples, share):
    X = signals(n_samples, 3)
    extractor = learned(X)
    begun = X[:, : int(share * n_samples)]
    assert_close(extractor.extract(begun), expected(extractor, begun))


@pytest.mark.parametrize("n_samples", [1, 3, 4, 7, 85, 1600])
def test_every_beginning_has_finite_features(n_samples):
    X = signals(n_samples, 2)
    extractor = learned(X)
    for n_seen in {1, 2, 3, 5, 17, n_samples // 2} & set(range(1, n_samples + 1)):
        got = extractor.extract(X[:, :n_seen])
        assert got.shape == (3, extractor.n_features)
        assert np.isfinite(got).all()
        np.testing.assert_array_equal(extractor.extract(X[0, :n_seen]), got[0])


def test_names_in_order():
    names = iter(MultiBandExtractor(1600, 6, blocks=twin.BLOCKS).names)
    axes = ["fx", "fy", "fz", "tx", "ty", "tz"]
    both = axes + [f"{axis}_lag2" for axis in axes]
    for band in range(8):
        for one, other in itertools.combinations_with_replacement(both, 2):
            assert next(names) == f"b{band}_coupling_{one}_{other}"
    for band, axis in itertools.product(range(10), axes):
        for what in ("q02", "q10", "q25", "q50", "q75", "q90", "q98", "logrms"):
            assert next(names) == f"b{band}_{what}_{axis}"
    for band, axis, stretch in itertools.product(range(10), axes, range(4)):
        assert next(names) == f"b{band}_envelope_{axis}_{stretch}"
    for axis, k in itertools.product(axes, range(len(twin.spectrum_edges(1600)) - 1)):
        assert next(names) == f"spectrum_{axis}_{k:02d}"
    for axis, k in itertools.product(axes, range(16)):
        assert next(names) == f"level_{axis}_{k:02d}"
    assert list(names) == []
    assert MultiBandExtractor(20, 2).names[0] == "b0_coupling_axis0_axis0"
    assert MultiBandExtractor(17, 2).names[0] == "b0_q02_axis0"


@pytest.mark.parametrize("rate_hz", [10.0, 500.0, 10_000.0])
@pytest.mark.parametrize("n_samples", [1, 7, 85, 1600, 100_000])
def test_bands_and_frequencies_in_hertz(n_samples, rate_hz):
    extractor = MultiBandExtractor(n_samples, 1, rate_hz=rate_hz)
    bands = extractor.bands
    assert bands[0] == (0.0, rate_hz / 2, rate_hz, n_samples)
    assert len(bands) == extractor.n_bands == 1 + twin.n_octaves(n_samples)
    lengths = [len(y) for y in twin.band_signals(np.zeros((n_samples, 1)))]
    assert [n for *_, n in bands] == lengths
    for k, (low, high, rate, _) in enumerate(bands[1:]):
        assert np.isclose(high, twin.TOP * rate_hz / 2 / 2**k)
        assert np.isclose(low, high / 2)
        assert rate == rate_hz / 2 ** max(k - 1, 0)
    at = np.array(twin.spectrum_edges(n_samples)) if n_samples >= twin.SPECTRUM_SAMPLES else np.array([0])
    middles = (at[:-1] + at[1:] - 1) / 2 * rate_hz / n_samples
    np.testing.assert_allclose(extractor.frequencies_hz, middles)


def test_the_rate_changes_no_feature():
    X = signals(200, 3)
    one, other = (MultiBandExtractor(200, 3, rate_hz=rate).extract(X) for rate in (10.0, 10_000.0))
    np.testing.assert_array_equal(one, other)


def test_threads_batches_and_single_recordings_give_the_same_bits():
    X = signals(400, 6, n=23)
    extractor = learned(X)
    batch = extractor.extract(X, threads=1)
    for threads in (2, 7, None):
        np.testing.assert_array_equal(extractor.extract(X, threads=threads), batch)
        np.testing.assert_array_equal(extractor.band_rms(X, threads), extractor.band_rms(X, 1))
    for k in (0, 7, 22, 7):  # the second time in used memory
        np.testing.assert_array_equal(extractor.extract(X[k]), batch[k])
    np.testing.assert_array_equal(extractor.extract(np.asfortranarray(X)), batch)
    np.testing.assert_array_equal(extractor.extract(X[::-1])[::-1], batch)


def test_pickles_and_compares():
    X = signals(50, 3)
    extractor = learned(X)
    copy = pickle.loads(pickle.dumps(extractor))
    assert copy == extractor
    assert repr(copy) == repr(extractor)
    assert "50 samples of 3 axes at 500 Hz" in repr(copy)
    np.testing.assert_array_equal(copy.extract(X), extractor.extract(X))
    assert extractor != MultiBandExtractor(50, 3)
    assert extractor != "extractor"


def test_the_spectrum_of_short_recordings_is_finer_than_their_octaves_or_absent():
    finer = [len(twin.spectrum_edges(n)) - 1 > twin.n_octaves(n) for n in range(4, 4000)]
    assert all(finer[twin.SPECTRUM_SAMPLES - 4 :])
    assert not finer[twin.SPECTRUM_SAMPLES - 5]

"""The multi-band features of the core against their definition in plain numpy, and what is refused."""

import itertools
import pickle
import runpy
from pathlib import Path

import numpy as np
import pytest

import multiband_twin as twin
from granular_id._core import MultiBandExtractor

SIZES = [
    *((n, 2) for n in range(1, 21)),
    (85, 4),
    (99, 3),
    (100, 3),
    (105, 13),
    (301, 13),
    (1600, 6),
    (20_000, 1),
]


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
    return MultiBandExtractor(*recordings.shape[1:], blocks=blocks, scales=scales, level_scales=level_scales)


def expected(extractor, recordings):
    scales, level_scales = extractor.scales, extractor.level_scales
    blocks = [block for block in twin.BLOCKS if block in extractor.blocks]
    n_samples = extractor.n_samples
    return np.array([twin.features(x, scales, level_scales, blocks, n_samples) for x in recordings])


def assert_close(got, wanted):
    """Bands are in float32, the definition in float64: most features differ by 1e-6, logarithms of little by 1e-5."""
    np.testing.assert_allclose(got, wanted, rtol=2e-5, atol=2e-5)


@pytest.mark.parametrize(("n_samples", "n_axes"), SIZES)
def test_features_are_those_of_the_definition(n_samples, n_axes):
    X = signals(n_samples, n_axes, n=3 if n_samples * n_axes < 2000 else 1)
    extractor = learned(X)
    got = extractor.extract(X)
    assert got.shape == (len(X), extractor.n_features)
    assert got.shape[1] == len(extractor.names) == len(set(extractor.names))
    wanted = expected(extractor, X)
    assert_close(got, wanted)
    level = extractor.block_sizes["level"]
    np.testing.assert_allclose(got[:, -level:], wanted[:, -level:], rtol=1e-9, atol=1e-9)
    sizes = [twin.rms(twin.band_signals(x)) for x in X]
    np.testing.assert_allclose(extractor.band_rms(X), sizes, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("block", twin.BLOCKS)
def test_each_block_alone_is_its_part_of_the_whole(block):
    X = signals(200, 3)
    whole, alone = learned(X), learned(X, [block])
    columns = [name in set(alone.names) for name in whole.names]
    np.testing.assert_array_equal(alone.extract(X), whole.extract(X)[:, columns])
    assert whole.block_sizes[block] == alone.n_features
    assert list(whole.block_sizes) == list(twin.BLOCKS)


@pytest.mark.parametrize("n_samples", [85, 150, 1600])
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
        assert np.isfinite(got).all()
        np.testing.assert_array_equal(extractor.extract(X[0, :n_seen]), got[0])


def test_names_in_order():
    names = iter(MultiBandExtractor(1600, 6, blocks=twin.BLOCKS).names)
    axes = ["fx", "fy", "fz", "tx", "ty", "tz"]
    for band in range(8):
        earlier = [f"{axis}_lag{twin.lag(band, 1600)}" for axis in axes]
        now = itertools.combinations_with_replacement(axes, 2)
        for one, other in itertools.chain(now, itertools.product(axes, earlier)):
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


@pytest.mark.parametrize("rate_hz", [10.0, 10_000.0])
@pytest.mark.parametrize("n_samples", [1, 7, 1600, 100_000])
def test_bands_and_frequencies_in_hertz(n_samples, rate_hz):
    extractor = MultiBandExtractor(n_samples, 1, rate_hz=rate_hz)
    bands = extractor.bands
    assert bands[0] == (0.0, rate_hz / 2, rate_hz, n_samples)
    assert len(bands) == extractor.n_bands == 1 + twin.n_octaves(n_samples)
    lengths = [len(y) for y in twin.band_signals(np.zeros((n_samples, 1)))]
    assert [n for *_, n in bands] == lengths == twin.band_lengths(n_samples)
    halvings = 0
    for k, (low, high, rate, _) in enumerate(bands[1:]):
        assert np.isclose(high, twin.TOP * rate_hz / 2 / 2**k)
        assert np.isclose(low, high / 2)
        halvings += twin.halves(k, n_samples)
        assert rate == rate_hz / 2**halvings
    at = np.array(twin.spectrum_edges(n_samples)) if n_samples >= twin.SPECTRUM_SAMPLES else np.array([0])
    middles = (at[:-1] + at[1:] - 1) / 2 * rate_hz / n_samples
    np.testing.assert_allclose(extractor.frequencies_hz, middles)


def test_the_rate_changes_no_feature():
    X = signals(200, 3)
    one, other = (MultiBandExtractor(200, 3, rate_hz=rate).extract(X) for rate in (10.0, 10_000.0))
    np.testing.assert_array_equal(one, other)


def test_multiband_any_batch_and_threads_have_the_same_bits():
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
    np.testing.assert_array_equal(copy.extract(X), extractor.extract(X))
    assert extractor != MultiBandExtractor(50, 3)
    assert extractor != "extractor"


def test_recordings_of_zeros_and_constants_have_the_floors():
    extractor = MultiBandExtractor(100, 3)
    silent = extractor.extract(np.zeros((1, 100, 3)))
    assert_close(silent, expected(extractor, np.zeros((1, 100, 3))))
    # Filters start as if the first sample had lasted for ever: an offset leaves nothing behind.
    constant = np.broadcast_to([1.0, -1e6, 1e9], (2, 100, 3))
    np.testing.assert_array_equal(extractor.extract(constant), np.repeat(silent, 2, axis=0))


def test_one_constant_axis_among_others():
    X = signals(120, 4)
    X[:, :, 2] = 7.0
    extractor = learned(X)
    # Its scale is a billionth of it, so that rounding in the filters shows in the definition; here there is none.
    np.testing.assert_allclose(extractor.extract(X), expected(extractor, X), rtol=1e-9, atol=1e-3)
    X[:, :, 2] = 0.0
    assert_close(learned(X).extract(X), expected(learned(X), X))


def test_little_noise_on_a_long_ramp_is_heard():
    noise = np.random.default_rng(0).normal(size=(3, 1600, 2))
    X = 1e-4 * noise + np.linspace(0, 1, 1600)[:, None]
    extractor = learned(X)
    off = np.abs(extractor.extract(X) - expected(extractor, X))
    assert off.max() < 0.02
    assert off.mean() < 2e-4


@pytest.mark.parametrize("unit", [1e-100, 1e9])
def test_units_do_not_matter_to_learned_scales(unit):
    X = signals(100, 3)
    scaled = learned(X * unit).extract(X * unit)
    assert_close(scaled, learned(X).extract(X))


@pytest.mark.parametrize("method", ["extract", "band_rms"])
def test_gaps_and_huge_numbers_are_named(method):
    X, scales = signals(60, 3, n=40), np.full((MultiBandExtractor(60, 3).n_bands, 3), 1e-4)
    X[31, 59, 2] = -np.inf
    for threads in (1, 2):
        with pytest.raises(ValueError, match="must be finite, got -inf at recording 31, sample 59, axis 2"):
            getattr(MultiBandExtractor(60, 3), method)(X, threads=threads)
    X[31, 59, 2] = 1e9
    if method == "extract":
        with pytest.raises(ValueError, match=r"too large: recording 31 reaches 1e9"):
            MultiBandExtractor(60, 3, scales=scales).extract(X)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rate_hz": 0.0}, "rate_hz must be positive and finite, got 0"),
        ({"blocks": "coupling"}, "(?s)(str|int).*blocks"),
        ({"blocks": ["couplings"]}, "each of blocks must be 'coupling' or 'quantiles' or"),
        ({"blocks": ["level", "level"]}, "blocks must name each block once, got 'level' twice"),
        ({"blocks": []}, "blocks must name at least one block that recordings of 50 samples of 3 axes have"),
        ({"n_samples": 25, "blocks": ["coupling"]}, "at least one block that recordings of 25 samples of 3"),
        ({"n_samples": 2**40}, "n_samples must be from 1 to"),
        ({"n_axes": 10**9}, "n_samples and n_axes must give fewer features, got 50 and 1000000000"),
        ({"scales": np.ones((3, 2))}, r"scales must have shape \(5, 3\), got \(3, 2\)"),
        ({"scales": np.zeros((5, 3))}, "scales must be from 1e-150 to 1e150, got 0 for band 0, axis 0"),
        ({"level_scales": [1.0, np.nan, 1.0]}, "level_scales must be from .* got NaN for band 0, axis 1"),
        ({"level_scales": [1.0]}, r"level_scales must have shape \(3,\), got \(1,\)"),
    ],
)
def test_arguments_are_refused_by_name(changed, message):
    arguments = {"n_samples": 50, "n_axes": 3, **changed}
    with pytest.raises((TypeError, ValueError), match=message):
        MultiBandExtractor(arguments.pop("n_samples"), arguments.pop("n_axes"), **arguments)


@pytest.mark.parametrize(
    ("X", "keywords", "message"),
    [
        (np.zeros((2, 51, 3)), {}, "at most 50 samples of 3 axes, got 51 samples of 3"),
        (np.zeros(50), {}, "X must have shape"),
        (np.zeros((2, 0, 3)), {}, "must not be empty"),
    ],
)
def test_recordings_that_are_refused(X, keywords, message):
    with pytest.raises((TypeError, ValueError), match=message):
        MultiBandExtractor(50, 3).extract(X, **keywords)


def test_features_have_the_bits_of_every_machine():
    runpy.run_path(str(Path(__file__).parents[2] / "wheel_digest.py"))

"""Blocks side by side and how much each counts; what the columns stand for."""

import numpy as np
import pytest
from sklearn.decomposition import PCA
from sklearn.pipeline import FeatureUnion, make_pipeline

from granular_id._core import UNITS
from granular_id._estimators import learns
from granular_id.spaces import (
    DFT,
    HFMH,
    RangeNormalizer,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    feature_blocks,
)
from spaces_cases import SPACES, data_set, recordings, two_bands

RANGES = [[-0.5, 0.5], [-0.2, 0.1], [-0.1, 0.1], [-1.0, 1.0], [-0.3, 0.3], [-0.01, 0.01]]


OWN_RANGES = {"bin_range": RANGES, "initial": "steady", "density": True, "outside": "clip"}


@pytest.mark.parametrize("block_weights", [None, "unit", (0.25, 3.0), [1, 1], np.array([1e-3, 1.0])])
@pytest.mark.parametrize(
    "options",
    [{}, {"bin_range": "auto", "n_bins": 30}, {**OWN_RANGES, "rate_hz": 100.0, "order": 3}],
)
def test_raw_hfmh_is_the_union_bit_for_bit(options, block_weights):
    X, other = recordings(), recordings(seed=1)
    fast = RawHFMH(**options, block_weights=block_weights).fit(X)
    parts = [("raw", RawSignal(rate_hz=options.get("rate_hz", 500.0))), ("hfmh", HFMH(**options))]
    weights = dict(zip(("raw", "hfmh"), fast.block_weights_, strict=True))
    union = FeatureUnion(parts, transformer_weights=weights, verbose_feature_names_out=False).fit(X)
    np.testing.assert_array_equal(fast.transform(other), union.transform(other))
    np.testing.assert_array_equal(fast.get_feature_names_out(), union.get_feature_names_out())
    for one, two in zip(fast.feature_blocks(), feature_blocks(union), strict=True):
        for field in ("name", "kind", "axes", "unit", "columns"):
            assert getattr(one, field) == getattr(two, field)
        np.testing.assert_array_equal(one.coordinates, two.coordinates)


def test_unit_weights_bring_each_block_to_a_mean_norm_of_one():
    X = recordings()
    fast = RawHFMH(block_weights="unit").fit(X)
    raw, hfmh = np.split(fast.transform(X), [1800], axis=1)
    for block in (raw, hfmh):
        assert np.linalg.norm(block, axis=1).mean() == pytest.approx(1.0)


def test_unit_weights_of_silent_or_huge_blocks_are_finite():
    X = np.zeros((3, 40, 6))
    silent = RawHFMH(block_weights="unit").fit(X)  # all 40 counts of an axis in one bin
    np.testing.assert_allclose(silent.block_weights_, [1.0, 1 / np.sqrt(6 * 40**2)], rtol=1e-12)
    X[:, 0, 0] = 1e200  # its square is beyond float64, its norm is not
    assert RawHFMH(block_weights="unit").fit(X).block_weights_[0] == pytest.approx(1e-200, rel=1e-12)


def test_a_union_learns_where_a_part_does():
    assert not learns(FeatureUnion([("raw", RawSignal()), ("tared", make_pipeline(Tare(), DFT()))]))
    assert learns(FeatureUnion([("pca", make_pipeline(RawSignal(), PCA(2)))]))
    assert learns(FeatureUnion([("auto", HFMH(bin_range="auto"))]))


# --- What columns stand for


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("n_axes", [1, 6])
def test_blocks_cover_all_columns_once_with_one_coordinate_each(name, n_axes):
    transformer = SPACES[name].fit(recordings(n_axes=n_axes))
    blocks = transformer.feature_blocks()
    stop = 0
    for block in blocks:
        assert block.columns.start == stop
        stop = block.columns.stop
        assert stop - block.columns.start == len(block.axes) * len(block.coordinates)
        assert (np.diff(block.coordinates) > 0).all()
        names = transformer.get_feature_names_out()[block.columns].reshape(len(block.axes), -1)
        for axis, row in zip(block.axes, names, strict=True):
            assert all(f"_{axis}_" in f"_{column}" for column in row)
    assert stop == transformer.transform(recordings(n_axes=n_axes)).shape[1]
    assert len({block.name for block in blocks}) == len(blocks)


def test_instants_bins_and_frequencies_in_their_units():
    X = recordings(n_samples=500)
    seconds, samples = (RawSignal(rate_hz=rate).fit(X).feature_blocks()[0] for rate in (500.0, None))
    assert (seconds.unit, seconds.coordinates[-1]) == ("s", pytest.approx(0.998))
    assert (samples.unit, samples.coordinates[-1]) == ("sample", 499.0)
    (bins,) = HFMH().fit(data_set()).feature_blocks()
    assert (bins.kind, bins.unit, bins.units) == ("magnitude", "N, N m", UNITS)
    (bins,) = HFMH().fit(X).feature_blocks()
    assert (bins.kind, bins.unit) == ("magnitude", "")
    np.testing.assert_allclose(bins.coordinates, np.arange(-1.485, 1.5, 0.03))
    real, imaginary = DFT(rate_hz=500.0).fit(X).feature_blocks()
    assert (real.name, real.unit, imaginary.name) == ("dft_re", "Hz", "dft_im")
    np.testing.assert_allclose(real.coordinates, np.fft.rfftfreq(500, 1 / 500))
    np.testing.assert_allclose(imaginary.coordinates, np.fft.rfftfreq(500, 1 / 500)[1:-1])
    assert DFT("magnitude").fit(X).feature_blocks()[0].coordinates[-1] == 0.5
    assert RangeNormalizer(rate_hz=100).fit(X).feature_blocks()[0].coordinates[-1] == pytest.approx(4.99)


def test_axes_with_ranges_of_their_own_have_blocks_of_their_own():
    slow, fast = feature_blocks(two_bands().fit(recordings()))
    assert (slow.name, fast.name) == ("slow__hfmh", "fast__hfmh")
    blocks = RawHistogram(n_bins=10).fit(data_set()).feature_blocks()
    seen = [(block.name, block.axes, block.unit) for block in blocks[2:4]]
    assert seen == [("hist_fz", ("fz",), "N"), ("hist_tx", ("tx",), "N m")]
    assert [block.columns.start for block in blocks] == [0, 10, 20, 30, 40, 50]
    (one,) = RawHistogram(n_bins=10).fit(recordings(n_axes=1)).feature_blocks()
    assert (one.name, one.unit) == ("hist", "")


def test_blocks_of_pipelines():
    X = recordings()
    pipeline = make_pipeline(Tare(), make_pipeline("passthrough", RawHFMH())).fit(X)
    assert [block.name for block in feature_blocks(pipeline)] == ["raw", "hfmh"]
    inner = FeatureUnion([("both", RawHFMH()), ("tared", make_pipeline(Tare(), DFT()))])
    union = FeatureUnion([("inner", inner), ("range", RangeNormalizer())]).fit(X)
    blocks = feature_blocks(union)
    assert [block.name for block in blocks] == ["raw", "hfmh", "dft_re", "dft_im", "norm_raw"]
    assert blocks[-1].columns.stop == union.transform(X).shape[1]

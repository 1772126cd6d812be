"""Blocks side by side and how much each counts; what the columns stand for."""

import numpy as np
import pytest
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline

from granular_id._core import UNITS
from granular_id.spaces import (
    DFT,
    HFMH,
    BlockUnion,
    RangeNormalizer,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    feature_blocks,
    unit_weight,
)
from spaces_cases import SPACES, data_set, recordings, two_bands

RANGES = [[-0.5, 0.5], [-0.2, 0.1], [-0.1, 0.1], [-1.0, 1.0], [-0.3, 0.3], [-0.01, 0.01]]


OWN_RANGES = {"bin_range": RANGES, "initial": "steady", "density": True, "outside": "clip"}


@pytest.mark.parametrize("block_weights", [None, "unit", (0.25, 3.0), [1, 1], np.array([1e-3, 1.0])])
@pytest.mark.parametrize(
    "options",
    [{}, {"bin_range": "auto", "n_bins": 30}, {**OWN_RANGES, "rate_hz": 100.0, "order": 3}],
)
def test_the_fast_path_is_the_union_bit_for_bit(options, block_weights):
    X, other = recordings(), recordings(seed=1)
    fast = RawHFMH(**options, block_weights=block_weights).fit(X)
    parts = [("raw", RawSignal(rate_hz=options.get("rate_hz", 500.0))), ("hfmh", HFMH(**options))]
    union = BlockUnion(parts, block_weights=block_weights).fit(X)
    np.testing.assert_array_equal(fast.transform(other), union.transform(other))
    np.testing.assert_array_equal(fast.block_weights_, union.block_weights_)
    np.testing.assert_array_equal(fast.get_feature_names_out(), union.get_feature_names_out())
    np.testing.assert_array_equal(union.fit_transform(X), union.transform(X))
    np.testing.assert_array_equal(fast.fit_transform(X), fast.transform(X))
    assert fast.learns == union.learns
    for one, two in zip(fast.feature_blocks(), union.feature_blocks(), strict=True):
        for field in ("name", "kind", "axes", "unit", "columns"):
            assert getattr(one, field) == getattr(two, field)
        np.testing.assert_array_equal(one.coordinates, two.coordinates)


def test_unit_weights_of_silent_and_of_enormous_blocks():
    X = np.zeros((3, 40, 6))
    silent = RawHFMH(block_weights="unit").fit(X)  # all 40 counts of an axis in one bin
    np.testing.assert_allclose(silent.block_weights_, [1.0, 1 / np.sqrt(6 * 40**2)], rtol=1e-12)
    X[:, 0, 0] = 1e200  # its square is beyond float64, its norm is not
    union = BlockUnion([("raw", RawSignal())], block_weights="unit").fit(X)
    np.testing.assert_allclose(union.block_weights_, [1e-200], rtol=1e-12)
    assert unit_weight(np.zeros(4)) == 1.0
    for norms in ([np.inf], [np.nan], [5e-324]):
        with pytest.raises(ValueError, match="features in the range of float64"):
            unit_weight(norms)


def test_unions_of_unions_and_of_pipelines():
    X = recordings()
    inner = BlockUnion([("raw", RawSignal()), ("hfmh", HFMH())], block_weights=(1, 0.5))
    union = BlockUnion([("both", inner), ("tared", make_pipeline(Tare(), DFT()))]).fit(X)
    expected = [inner.fit_transform(X), make_pipeline(Tare(), DFT()).fit_transform(X)]
    np.testing.assert_array_equal(union.transform(X), np.concatenate(expected, axis=1))
    assert [block.name for block in union.feature_blocks()] == ["raw", "hfmh", "dft_re", "dft_im"]
    assert not union.learns
    assert BlockUnion([("pca", make_pipeline(RawSignal(), PCA(2)))]).learns
    assert BlockUnion([("auto", HFMH(bin_range="auto"))]).learns


def test_fitting_leaves_the_given_blocks_alone():
    X = recordings()
    block = HFMH(bin_range="auto")
    BlockUnion([("hfmh", block)], block_weights="unit").fit(X)
    assert not hasattr(block, "bin_range_")


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
    slow, fast = two_bands().fit(recordings()).feature_blocks()
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

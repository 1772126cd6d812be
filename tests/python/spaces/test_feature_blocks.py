"""What the columns of a feature space stand for, alone, in unions and in pipelines; those of multi-band features."""

import itertools

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.exceptions import NotFittedError
from sklearn.pipeline import FeatureUnion, make_pipeline

import multiband_twin as twin
from granular_id._core import UNITS
from granular_id.spaces import (
    DFT,
    HFMH,
    MultiBand,
    RangeNormalizer,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    band_columns,
    feature_blocks,
)
from granular_id.spaces.multiband import ALL_BLOCKS, BandColumn
from multiband_cases import two_materials
from spaces_cases import SPACES, data_set, recordings

RANGES = [[-0.5, 0.5], [-0.2, 0.1], [-0.1, 0.1], [-1.0, 1.0], [-0.3, 0.3], [-0.01, 0.01]]
SLOW = {"bin_range": RANGES, "initial": "steady", "rate_hz": 100.0, "order": 3}


@pytest.mark.parametrize("block_weights", [None, "unit", (0.25, 3.0), np.array([1e-3, 1.0])])
@pytest.mark.parametrize("options", [{}, {"bin_range": "auto", "n_bins": 30}, SLOW])
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
    if isinstance(block_weights, str):
        for block in np.split(fast.transform(X), [1800], axis=1):
            assert np.linalg.norm(block, axis=1).mean() == pytest.approx(1.0)


def test_unit_weight_of_a_silent_block_is_one():
    silent = RawHFMH(block_weights="unit").fit(np.zeros((3, 40, 6)))  # all 40 counts of an axis in one bin
    np.testing.assert_allclose(silent.block_weights_, [1.0, 1 / np.sqrt(6 * 40**2)], rtol=1e-12)


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("n_axes", [1, 6])
def test_blocks_cover_all_columns_once(name, n_axes):
    transformer = clone(SPACES[name]).fit(recordings(n_axes=n_axes))
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


@pytest.mark.parametrize(
    ("space", "name", "kind", "unit", "coordinates"),
    [
        (RawSignal(rate_hz=500.0), "raw", "time", "s", np.arange(300) / 500),
        (RawSignal(), "raw", "time", "sample", np.arange(300)),
        (RangeNormalizer(rate_hz=100), "norm_raw", "time", "s", np.arange(300) / 100),
        (HFMH(), "hfmh", "magnitude", "", np.arange(-1.485, 1.5, 0.03)),
        (DFT(rate_hz=500.0), "dft_re", "frequency", "Hz", np.fft.rfftfreq(300, 1 / 500)),
        (DFT("magnitude"), "dft", "frequency", "1/sample", np.fft.rfftfreq(300)),
    ],
)
def test_instants_bins_and_frequencies_have_units(space, name, kind, unit, coordinates):
    block = space.fit(recordings()).feature_blocks()[0]
    assert (block.name, block.kind, block.unit) == (name, kind, unit)
    np.testing.assert_allclose(block.coordinates, coordinates, atol=1e-12)


def test_axes_with_ranges_of_their_own_have_blocks_each():
    (block,) = HFMH().fit(data_set()).feature_blocks()
    assert (block.unit, block.units) == ("N, N m", UNITS)
    blocks = RawHistogram(n_bins=10).fit(data_set()).feature_blocks()
    seen = [(block.name, block.axes, block.unit) for block in blocks[2:4]]
    assert seen == [("hist_fz", ("fz",), "N"), ("hist_tx", ("tx",), "N m")]
    assert [block.columns.start for block in blocks] == [0, 10, 20, 30, 40, 50]
    (one,) = RawHistogram(n_bins=10).fit(recordings(n_axes=1)).feature_blocks()
    assert (one.name, one.unit) == ("hist", "")


def test_blocks_of_pipelines_and_unions_lie_side_by_side():
    X = recordings()
    pipeline = make_pipeline(Tare(), make_pipeline("passthrough", RawHFMH())).fit(X)
    assert [block.name for block in feature_blocks(pipeline)] == ["raw", "hfmh"]
    inner = FeatureUnion([("both", RawHFMH()), ("tared", make_pipeline(Tare(), DFT()))])
    union = FeatureUnion([("inner", inner), ("range", RangeNormalizer())]).fit(X)
    blocks = feature_blocks(union)
    assert [block.name for block in blocks] == ["raw", "hfmh", "dft_re", "dft_im", "norm_raw"]
    assert blocks[-1].columns.stop == union.transform(X).shape[1]
    twice = FeatureUnion([("slow", HFMH(cutoff_hz=10.0)), ("fast", HFMH(cutoff_hz=60.0))]).fit(X)
    assert [block.name for block in feature_blocks(twice)] == ["slow__hfmh", "fast__hfmh"]


def test_multiband_learns_the_scales_of_the_twin():
    X = recordings()
    space = MultiBand(blocks=ALL_BLOCKS).fit(X)
    scales, levels = twin.learned_scales(X)
    np.testing.assert_allclose(space.transform(X), [twin.features(x, scales, levels) for x in X], atol=2e-5)
    assert space.bands_[2].n_samples == twin.band_lengths(X.shape[1])[2]


@pytest.mark.parametrize("n_axes", [1, 6, 13])
def test_columns_are_in_the_order_of_the_twin(n_axes):
    X, _, _ = two_materials(n_each=1, n_samples=128, n_axes=n_axes)
    columns = band_columns(MultiBand(blocks=ALL_BLOCKS).fit(X))
    wanted = []
    for band, length in enumerate(twin.band_lengths(128)):
        if length >= twin.least_samples(band, n_axes, 128):
            pairs = itertools.combinations_with_replacement(range(n_axes), 2)
            wanted += [BandColumn("coupling", band, i, j, 0, "") for i, j in pairs]
            lag = twin.lag(band, 128)
            pairs = itertools.product(range(n_axes), repeat=2)
            wanted += [BandColumn("coupling", band, i, j, lag, "") for i, j in pairs]
    assert list(columns.columns[: len(wanted)]) == wanted
    rest = [column.block for column in columns.columns[len(wanted) :]]
    n_quantiles, n_energies = 8 * n_axes * len(columns.bands), 4 * n_axes * len(columns.bands)
    assert rest[: n_quantiles + n_energies] == ["quantiles"] * n_quantiles + ["envelope"] * n_energies
    spectrum, level = columns.read_along()
    assert (spectrum.kind, level.kind) == ("frequency", "time")
    assert spectrum.columns.stop == level.columns.start
    assert level.columns.stop == len(columns.names)
    assert level.coordinates[0] == pytest.approx(128 / 500 / 32)
    assert columns.stretch_s("level", "15") == pytest.approx((15 * 128 / 500 / 16, 128 / 500))


def test_values_spread_over_axes_keep_their_sums():
    columns = band_columns(make_pipeline(Tare(0.01), MultiBand()).fit(two_materials(1, 1600)[0]))
    values = np.random.default_rng(0).normal(size=len(columns.names))
    np.testing.assert_allclose(columns.over_axes(values).sum(axis=1), values)
    assert [block.name for block in columns.read_along()] == ["spectrum"]
    words = [str(columns.bands[k]) for k in (0, 1, 2, -1)]
    assert words == ["the whole signal", "122-245 Hz", "61-122 Hz", "0.48-0.96 Hz"]


def test_other_spaces_have_no_band_columns():
    X, _, _ = two_materials(n_each=1)
    assert band_columns(RawSignal().fit(X)) is None
    assert band_columns(make_pipeline(MultiBand(), PCA(1)).fit(X)) is None
    with pytest.raises(NotFittedError):
        band_columns(MultiBand())

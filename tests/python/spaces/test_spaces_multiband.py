"""Multi-band features of a space: those of the twin, kept by copies; what their columns stand for."""

import itertools
import pickle

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.exceptions import NotFittedError
from sklearn.pipeline import make_pipeline

import multiband_twin as twin
from granular_id.spaces import ALL_BLOCKS, BandColumn, MultiBand, RawSignal, Tare, band_columns
from multiband_cases import two_materials
from spaces_cases import recordings


def test_features_are_those_of_the_twin_and_of_copies():
    X = recordings()
    space = MultiBand(blocks=ALL_BLOCKS).fit(X)
    scales, levels = twin.learned_scales(X)
    wanted = [twin.features(x, scales, levels) for x in X]
    np.testing.assert_allclose(space.transform(X), wanted, atol=2e-5)
    assert space.bands_[2].n_samples == twin.band_lengths(X.shape[1])[2]
    same = pickle.loads(pickle.dumps(space))
    assert same.extractor_ == space.extractor_
    for copy in (same, clone(space)):
        assert copy.get_params() == space.get_params()
        assert repr(copy) == repr(space)


@pytest.mark.parametrize(
    ("n_samples", "dropped"),
    [
        (1600, "recordings of 1600 samples are too short for couplings of axes in the lowest 2 bands"),
        (
            3,
            "recordings of 3 samples are too short for the coupling, the envelope, the spectrum and any octave",
        ),
    ],
)
def test_description_says_what_is_left_out(n_samples, dropped):
    space = MultiBand(rate_hz=500.0).fit(recordings(n=2, n_samples=n_samples))
    lengths = twin.band_lengths(n_samples)
    without = sum(n < twin.least_samples(b, 6, n_samples) for b, n in enumerate(lengths))
    assert without == (2 if n_samples == 1600 else len(lengths))
    assert space.dropped_ == dropped
    first, sizes, last = space.describe().splitlines()
    assert ("octaves from 245 Hz" in first) == (n_samples == 1600)
    assert f"quantiles {8 * 6 * len(lengths)}" in sizes
    assert last == dropped


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

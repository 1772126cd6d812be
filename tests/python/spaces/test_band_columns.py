"""What columns stand for is read from their names; weights fold back through every linear step."""

import itertools

import numpy as np
import pytest
from sklearn.decomposition import PCA
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import RidgeClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import multiband_twin as twin
from granular_id.ecoc import ECOCClassifier
from granular_id.rica import RICA
from granular_id.spaces import (
    BlockScaler,
    MultiBand,
    RawSignal,
    Tare,
    WithinClassWhitening,
    folded_back,
    is_linear_step,
)
from granular_id.spaces.multiband import BandColumn, band_columns
from multiband_cases import ALL, two_materials


@pytest.mark.parametrize("n_axes", [1, 3, 6, 13])
def test_columns_in_the_order_of_the_twin(n_axes):
    X, _, _ = two_materials(n_each=1, n_samples=128, n_axes=n_axes)
    space = MultiBand(blocks=ALL).fit(X)
    columns = band_columns(space)
    bands = range(len(space.bands_))
    now = [(axis, 0) for axis in range(n_axes)]
    wanted = []
    for band, length in zip(bands, twin.band_lengths(128), strict=True):
        earlier = [(axis, twin.lag(band, 128)) for axis in range(n_axes)]
        same = itertools.combinations_with_replacement(now, 2)
        pairs = itertools.chain(same, itertools.product(now, earlier))
        if length >= twin.least_samples(band, n_axes, 128):
            wanted += [BandColumn("coupling", band, i, j, lag, "") for (i, _), (j, lag) in pairs]
    assert list(columns.columns[: len(wanted)]) == wanted
    rest = [column.block for column in columns.columns[len(wanted) :]]
    sizes = [8 * n_axes * len(bands), 4 * n_axes * len(bands)]
    assert rest[: sum(sizes)] == ["quantiles"] * sizes[0] + ["envelope"] * sizes[1]
    assert tuple(dict.fromkeys(one.block for one in columns.columns)) == (ALL if wanted else ALL[1:])
    assert len(columns.axes) == n_axes
    spectrum, level = columns.read_along()
    assert (spectrum.kind, level.kind) == ("frequency", "time")
    assert level.columns.stop == len(columns.names)
    assert level.coordinates[0] == pytest.approx(128 / 500 / 32)


def test_halves_keep_sums():
    X, _, _ = two_materials(n_each=1, n_samples=128)
    columns = band_columns(make_pipeline(Tare(0.01), MultiBand()).fit(X))
    values = np.random.default_rng(0).normal(size=len(columns.names))
    np.testing.assert_allclose(columns.over_axes(values).sum(axis=1), values)


def test_bands_in_words():
    X, _, _ = two_materials(n_each=1, n_samples=1600)
    bands = band_columns(MultiBand().fit(X)).bands
    assert [str(band) for band in bands[:3]] == ["the whole signal", "122-245 Hz", "61-122 Hz"]
    assert str(bands[-1]) == "0.48-0.96 Hz"


def test_other_spaces_have_no_bands():
    X, _, _ = two_materials(n_each=1)
    assert band_columns(RawSignal().fit(X)) is None
    assert band_columns(make_pipeline(MultiBand(), PCA(1)).fit(X)) is None
    with pytest.raises(NotFittedError):
        band_columns(MultiBand())


STEPS = {
    "nothing": (),
    "blocks": (BlockScaler([100, 92]),),
    "blocks, whitened": (BlockScaler([100, 92]), WithinClassWhitening(0.1)),
    "whitened alone": (WithinClassWhitening(1e-3),),
    "standardised": (StandardScaler(),),
    "centred": (StandardScaler(with_std=False),),
    "scaled only": (StandardScaler(with_mean=False),),
    "components": (PCA(8),),
    "whitened components": (StandardScaler(), PCA(8, whiten=True)),
    "rica": (PCA(8), RICA(6, random_state=0)),
}


@pytest.mark.parametrize("name", STEPS)
@pytest.mark.parametrize("classifier", [ECOCClassifier(), RidgeClassifier()])
def test_folded_weights_give_the_same_scores(name, classifier):
    X, y, _ = two_materials(n_each=9, n_samples=32)
    y = np.where(np.arange(len(y)) % 3 == 0, "peas", y)
    X[y == "rice", :, 1] += 0.2
    X[y == "peas", :, 4] += 5.0
    model = make_pipeline(RawSignal(), *STEPS[name], classifier).fit(X, y)
    assert all(map(is_linear_step, model[1:-1]))
    coef, intercept = folded_back(model[1:-1], model[-1].coef_, model[-1].intercept_)
    features = model[:-1].transform(X)
    scores = getattr(model[-1], "binary_scores", model[-1].decision_function)
    np.testing.assert_allclose(RawSignal().fit_transform(X) @ coef.T + intercept, scores(features), atol=1e-9)


def test_one_vector_of_weights_folds_like_many():
    X, y, _ = two_materials(n_each=9, n_samples=32)
    rows = RawSignal().fit_transform(X)
    steps = [BlockScaler().fit(rows)]
    steps.append(WithinClassWhitening().fit(steps[0].transform(rows), y))
    weights = np.random.default_rng(0).normal(size=(3, rows.shape[1]))
    many, constants = folded_back(steps, weights, [1.0, 2.0, 3.0])
    one, constant = folded_back(steps, weights[1], 2.0)
    np.testing.assert_allclose(one, many[1])
    assert constant == pytest.approx(constants[1])

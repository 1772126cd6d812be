"""explain: exact sums, planted differences found, what cannot be explained refused by name."""

import itertools
import json

import numpy as np
import pytest
from sklearn.decomposition import PCA
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import FeatureUnion, Pipeline, make_pipeline
from sklearn.preprocessing import MinMaxScaler, StandardScaler

from evaluation_cases import of_levels
from granular_id.ecoc import ECOCClassifier
from granular_id.explanation import explain, explain_held_out
from granular_id.explanation.difference import pair_factors
from granular_id.recording import Dataset, Recording
from granular_id.rica import RICA
from granular_id.spaces import (
    DFT,
    HFMH,
    BestClassifier,
    MultiBand,
    RangeNormalizer,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    TimePermutation,
    WithinClassWhitening,
    block_sizes,
)
from multiband_cases import ALL, as_wrench, louder, two_materials


def recordings(labels=("oat", "peas", "rice"), n_each=12, n_samples=400):
    """Noise around offsets and vibrations that depend on the material."""
    random = np.random.default_rng(0)
    y = np.repeat(np.array(labels), n_each)
    X = random.normal(scale=0.1, size=(len(y), n_samples, 6))
    for k, label in enumerate(labels):
        X[y == label] *= 1 + 0.5 * k
        X[y == label, :, k] += 0.3
    return X, y


@pytest.fixture(scope="module")
def data():
    return recordings()


SPACES = {
    "raw": RawSignal(rate_hz=500),
    "raw+hfmh": RawHFMH(),
    "unit weights": RawHFMH(block_weights="unit"),
    "own ranges": HFMH(bin_range="auto"),
    "raw histogram": RawHistogram(),
    "tared": make_pipeline(Tare(0.1), RawHFMH()),
    "dft": DFT(rate_hz=500),
    "union": FeatureUnion([("norm", RangeNormalizer()), ("dft", DFT("magnitude"))]),
    "pca": make_pipeline(RawHFMH(), PCA(15)),
    "pca of sklearn, whitened": make_pipeline(RawSignal(), PCA(15, whiten=True)),
    "rica": make_pipeline(RawSignal(), PCA(10), RICA(12, random_state=0)),
    "bands": make_pipeline(MultiBand(blocks=ALL), StandardScaler()),
    "bands, whitened": make_pipeline(Tare(0.1), MultiBand(), WithinClassWhitening(0.01)),
    "best": MultiBand(),
}


def pair_scores(model, first, second, X):
    """Scores of the learner of a pair, positive for `first`, by the model's own way."""
    classifier = model[-1]
    known = list(classifier.classes_)
    a, b = known.index(first), known.index(second)
    matrix = classifier.coding_matrix_
    (learner,) = np.flatnonzero((matrix[a] != 0) & (matrix[b] != 0))
    return matrix[a, learner] * classifier.binary_scores(model[:-1].transform(X))[:, learner]


def added_up(table):
    return sum(sum(row.values()) for row in table.values())


def largest(sums):
    return max(sums, key=sums.get)


@pytest.mark.parametrize("name", SPACES)
def test_every_table_adds_up_to_the_difference(name, data):
    (X, y), pair = data, ("peas", "oat")
    sizes = block_sizes(MultiBand().fit(X)) if name == "best" else None
    classifier = BestClassifier(blocks=sizes) if name == "best" else ECOCClassifier()
    model = Pipeline([("space", SPACES[name]), ("classifier", classifier)]).fit(X[::2], y[::2])
    test, labels = X[1::2], y[1::2]
    seen = explain(model, *pair, test, labels)
    scores = pair_scores(model, *pair, test)
    wanted = [scores[labels == label].mean() for label in pair]
    np.testing.assert_allclose(seen.scores, wanted, rtol=1e-9)
    exactly = pytest.approx(wanted[0] - wanted[1], abs=1e-10 * np.abs(seen.contributions).sum())
    assert seen.contributions.sum() == exactly
    for by in ("block", "band", "time"):
        assert added_up(seen.table(by)) == exactly
    assert sum(seen.sums("axis").values()) == exactly
    assert seen.counts == (6, 6)
    assert len(seen.columns.names) == len(set(seen.columns.names)) == len(seen.weights)


def test_tables_of_bands_are_those_of_the_names():
    """Written anew from the names of the features."""
    X, y = louder()
    model = make_pipeline(MultiBand(blocks=ALL), ECOCClassifier()).fit(as_wrench(X), y)
    seen = explain(model, "rice", "oat", X, y)
    axes, bands, blocks = {}, {}, {}
    for name, value in zip(seen.columns.names, seen.contributions, strict=True):
        words = name.split("_")
        known = [word for word in words if word in ("fx", "fy", "fz", "tx", "ty", "tz")]
        for axis in known:
            axes[axis] = axes.get(axis, 0.0) + value / len(known)
        place = int(words[0][1:]) if words[0][0] == "b" else words[0]
        bands[place] = bands.get(place, 0.0) + value
        block = next((word for word in words if word in ALL), "quantiles")
        blocks[block] = blocks.get(block, 0.0) + value
    assert seen.sums("axis") == pytest.approx(axes)
    assert list(seen.sums("band").values()) == pytest.approx(list(bands.values()))
    assert seen.sums("block") == pytest.approx(blocks)


def test_weights_are_slopes_of_the_score(data):
    """A newton more in one sample moves the score by the weight of that sample."""
    X, y = data
    model = make_pipeline(RawSignal(), PCA(15), RICA(10, random_state=0), ECOCClassifier()).fit(X, y)
    weights = explain(model, "peas", "rice", X, y).weights.reshape(6, -1)
    for axis, sample in ((0, 0), (2, 211), (5, 399)):
        moved = X[:1].copy()
        moved[0, sample, axis] += 1.0
        slope = pair_scores(model, "peas", "rice", moved) - pair_scores(model, "peas", "rice", X[:1])
        assert weights[axis, sample] == pytest.approx(slope[0], rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("space", [(RawSignal(), PCA(15)), (MultiBand(blocks=["level"]),)])
def test_a_planted_time_is_found(space):
    random = np.random.default_rng(1)
    X = random.normal(scale=0.05, size=(30, 1600, 6))
    y = np.repeat(["oat", "rice"], 15)
    X[y == "oat", 450:550, 2] += 0.5
    seen = explain(make_pipeline(*space, ECOCClassifier()).fit(as_wrench(X), y), "oat", "rice", X, y)
    assert largest(seen.sums("axis")) == "fz"
    assert largest(seen.sums("time")) == "0.80-1.20 s"
    assert seen.table("time")["0.80-1.20 s"]["fz"] > 0.7 * seen.difference


def test_classes_may_be_numbers():
    X, y = recordings(labels=(7, 3, 5))
    two = y != 5
    model = make_pipeline(RawSignal(), ECOCClassifier()).fit(X[two], y[two])
    seen = explain(model, 7, 3, X, y)  # recordings of others are left out
    assert (seen.first, seen.second) == (7, 3)
    assert seen.factors.tolist() == [-1.0]
    assert np.sign(seen.scores[0]) == np.sign(model.decision_function(X)[y == 7].mean())
    json.dumps(seen.to_dict())
    named, given = explain(model, 7, 3, X[two]), explain(model, 7, 3, X[two], model.predict(X[two]))
    assert (named.scores, named.counts) == (given.scores, given.counts)  # without labels the model names them
    with pytest.raises(ValueError, match="by must be 'block', 'band' or 'time', got 'name'"):
        seen.table("name")


@pytest.mark.parametrize(
    ("space", "tables"),
    [(HFMH(), {"block"}), (RawHFMH(), {"block", "time"}), (MultiBand(), {"block", "band", "time"})],
)
def test_dict_and_text_hold_the_same_tables(space, tables, data):
    X, y = data
    seen = explain(make_pipeline(space, ECOCClassifier()).fit(X, y), "oat", "rice", X, y)
    read = json.loads(json.dumps(seen.to_dict(), allow_nan=False))
    assert sum(read["features"]["contributions"]) == pytest.approx(read["difference"])
    assert set(read["tables"]) == tables
    headers = [line.split()[0] for line in str(seen).splitlines() if line.endswith("sum")]
    assert set(headers) == tables


def test_a_model_that_gives_data_frames_is_explained(data):
    pytest.importorskip("pandas")
    X, y = data
    model = make_pipeline(RawSignal(), PCA(5, svd_solver="full"), ECOCClassifier())
    plain = explain(model.fit(X, y), "oat", "rice", X, y)
    framed = explain(model.set_output(transform="pandas").fit(X, y), "oat", "rice", X, y)
    np.testing.assert_allclose(framed.contributions, plain.contributions)


def test_factors_are_differences_under_the_linear_loss():
    matrix = np.array([[1, 0, 1], [-1, 1, 0], [0, -1, 1], [1, 1, -1]], dtype=np.int8)
    scores = np.random.default_rng(0).normal(size=(5, 3))
    losses = (1 - matrix[None] * scores[:, None, :]) / 2 * np.abs(matrix)
    values = -losses.sum(axis=2) / np.abs(matrix).sum(axis=1)
    for first, second in ((0, 3), (2, 1)):
        sums = scores @ pair_factors(matrix, first, second)
        np.testing.assert_allclose(values[:, first] - values[:, second], sums, atol=1e-12)


def test_factors_of_several_learners_of_one_pair_are_shared():
    matrix = np.array([[1, -1, 1], [-1, 1, 0], [0, 0, -1]], dtype=np.int8)
    np.testing.assert_array_equal(pair_factors(matrix, 0, 1), [0.5, -0.5, 0.0])


IMU = ("wx", "wy", "wz", "ax", "ay", "az")


@pytest.mark.parametrize("fitted_on", ["a data set", "arrays"])
@pytest.mark.parametrize("bin_range", [(-1.5, 1.5), "auto"])
def test_axes_and_units_are_those_of_the_data_set(fitted_on, bin_range):
    meta = {"units": dict(zip(IMU, ("rad/s",) * 3 + ("m/s2",) * 3, strict=True))}
    X, y = louder()
    data = Dataset([Recording(x, 100.0, label, axes=IMU, meta=meta) for x, label in zip(X, y, strict=True)])
    given = data if fitted_on == "a data set" else data.X
    model = make_pipeline(HFMH(rate_hz=100, bin_range=bin_range), ECOCClassifier()).fit(given, data.y)
    seen = explain(model, "rice", "oat", data)
    assert tuple(seen.sums("axis")) == IMU
    assert seen.columns.along[0].units[0] == "rad/s"
    assert seen.scores == explain(model, "rice", "oat", data.X, data.y).scores
    if bin_range == "auto":
        assert [block.name for block in seen.columns.along] == [f"hfmh_{axis}" for axis in IMU]


@pytest.mark.parametrize(("n_axes", "n_samples", "rate_hz"), [(1, 3, None), (13, 8, 500.0)])
def test_any_number_of_samples_and_axes_adds_up(n_axes, n_samples, rate_hz):
    X, y, _ = two_materials(n_each=4, n_samples=n_samples, n_axes=n_axes)
    model = make_pipeline(RawSignal(rate_hz=rate_hz), ECOCClassifier()).fit(X, y)
    found = explain(model, "rice", "oat", X, y)
    # stretches of different names, none shorter than a sample
    assert (len(found.sums("time")), len(found.sums("axis"))) == (n_samples, n_axes)
    assert added_up(found.table("time")) == pytest.approx(found.difference)


X, Y = recordings(n_samples=100)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"second": "sand"}, "second must be one of 'oat', 'peas', 'rice', got 'sand'"),
        ({"second": "oat"}, "first and second must be two materials, got 'oat' twice"),
        ({"X": X[Y != "rice"], "y": Y[Y != "rice"]}, "y has no 'rice'"),
        ({"X": X[Y == "oat"], "y": None}, "model names no recording of X 'rice'"),
        ({"y": Y[:3]}, "y must have one label per recording of X, got 3 for X of 36 recordings"),
        ({"X": X[:, :30]}, r"X must have shape \(n, 100, 6\) as in fit"),
        ({"X": X[0, 0]}, r"X must be recordings, a Dataset or an array .* got ndarray of shape \(6,\)"),
        ({"X": [[1.0, 2.0], [1.0]], "y": ["oat", "rice"]}, "X must be recordings of one shape"),
        ({"axes": ("fx", "fy", "fz")}, "axes must be 6 different names, one for each axis of X, got"),
    ],
)
def test_bad_arguments_are_refused(change, message):
    fitted = make_pipeline(RawSignal(), ECOCClassifier()).fit(X, Y)
    with pytest.raises((ValueError, TypeError), match=message):
        explain(fitted, **{"first": "oat", "second": "rice", "X": X, "y": Y} | change)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (ECOCClassifier(), "model must be a Pipeline of a feature space and an ECOCClassifier"),
        (make_pipeline(RawSignal(), ECOCClassifier()), "not fitted"),
        (make_pipeline(ECOCClassifier()).fit(X[:, :, 0], Y), "nothing behind filters"),
        (
            make_pipeline(RawSignal(), LogisticRegression()).fit(X, Y),
            "or a BestClassifier, got LogisticRegression",
        ),
        (make_pipeline(RawSignal(), MinMaxScaler(), ECOCClassifier()).fit(X, Y), "got MinMaxScaler"),
        (make_pipeline(TimePermutation(), RawSignal(), ECOCClassifier()).fit(X, Y), "TimePermutation"),
    ],
)
def test_models_that_cannot_be_explained_are_refused(model, message):
    rows = X if len(getattr(model, "steps", ())) != 1 else X[:, :, 0]
    with pytest.raises((TypeError, NotFittedError), match=message):
        explain(model, "oat", "rice", rows, Y)


@pytest.mark.parametrize(
    ("sessions", "folds"),
    [
        # no fold holds out both
        ({"rice": "r1 r2", "oat": "o1 o2", "peas": "p1 p2 p3 p4 p5 p6 p7 p8"}, "held-out sessions"),
        ({"rice": "mon", "oat": "mon", "peas": "mon tue"}, "halves in time order"),
    ],
)
def test_explain_holds_out_what_the_materials_allow(sessions, folds):
    labels = ["rice", "oat", "peas"] * 8
    named = {label: itertools.cycle(words.split()) for label, words in sessions.items()}
    levels, times = np.random.default_rng(0).normal(size=(24, 6)), 1e9 + 60.0 * (np.arange(24) // 3)
    data = of_levels(levels, labels, [next(named[label]) for label in labels], start_time=times)
    pipeline = make_pipeline(RawSignal(), ECOCClassifier())
    explanation, model, split = explain_held_out(data, pipeline, "rice", "oat")
    assert split["folds"] == folds
    assert not set(split["train"]) & set(split["explained"])
    assert sum(explanation.counts) == len(split["explained"])
    assert model == f"trained on {len(split['train'])} of 24 recordings"

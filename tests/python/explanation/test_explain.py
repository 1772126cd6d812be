"""explain: exact sums, planted differences found, what cannot be explained refused by name."""

import json

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from sklearn.decomposition import PCA
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import MinMaxScaler, StandardScaler

from granular_id.ecoc import ECOCClassifier
from granular_id.explanation import explain
from granular_id.explanation.difference import pair_factors
from granular_id.explanation.result import regions_of
from granular_id.recording import Dataset, Recording
from granular_id.rica import RICA
from granular_id.spaces import (
    DFT,
    HFMH,
    BlockUnion,
    FeatureBlock,
    MultiBand,
    PrincipalComponents,
    RangeNormalizer,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    TimePermutation,
)
from multiband_cases import as_wrench, louder


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
    "union": BlockUnion([("norm", RangeNormalizer()), ("dft", DFT("magnitude"))], block_weights=[2.0, 0.01]),
    "pca": make_pipeline(RawHFMH(), PrincipalComponents(20)),
    "pca of sklearn, whitened": make_pipeline(RawSignal(), PCA(15, whiten=True)),
    "scaled": make_pipeline(RawSignal(), StandardScaler()),
    "centred only": make_pipeline(RawSignal(), StandardScaler(with_std=False)),
    "pca+rica": Pipeline(
        [("raw", RawSignal()), ("pca", PrincipalComponents(20)), ("rica", RICA(8, random_state=0, tol=1e-3))]
    ),
    "rica standardised": make_pipeline(
        RawSignal(), PrincipalComponents(10), RICA(12, standardize=True, random_state=0, tol=1e-3)
    ),
}


def added_up(explanation):
    return sum(part.contributions.sum() for part in explanation.blocks)


def pair_scores(model, first, second, X):
    """Scores of the learner of a pair, positive for `first`, by the model's own way."""
    classifier = model[-1]
    known = list(classifier.classes_)
    a, b = known.index(first), known.index(second)
    matrix = classifier.coding_matrix_
    (learner,) = np.flatnonzero((matrix[a] != 0) & (matrix[b] != 0))
    return matrix[a, learner] * classifier.binary_scores(model[:-1].transform(X))[:, learner]


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("pair", [("oat", "rice"), ("peas", "oat")])
def test_contributions_add_up_to_the_difference(name, pair, data):
    X, y = data
    model = Pipeline([("space", SPACES[name]), ("ecoc", ECOCClassifier())]).fit(X[::2], y[::2])
    test, labels = X[1::2], y[1::2]
    seen = explain(model, *pair, test, labels)
    scores = pair_scores(model, *pair, test)
    wanted = [scores[labels == label].mean() for label in pair]
    np.testing.assert_allclose(seen.scores, wanted, rtol=1e-9)
    tolerance = 1e-10 * sum(np.abs(part.contributions).sum() for part in seen.blocks)
    assert abs(added_up(seen) - (wanted[0] - wanted[1])) <= tolerance
    for sums in (seen.by_axis(), seen.by_block()):
        assert sum(sums.values()) == pytest.approx(added_up(seen))
    assert seen.difference > 0
    assert seen.counts == (6, 6)


def test_weights_are_slopes_of_the_score(data):
    """A newton more in one sample moves the score by the weight of that sample."""
    X, y = data
    model = make_pipeline(
        RawSignal(),
        PrincipalComponents(15),
        RICA(10, standardize=True, random_state=0, tol=1e-3),
        ECOCClassifier(),
    ).fit(X, y)
    (part,) = explain(model, "peas", "rice", X, y).blocks
    for axis, sample in ((0, 0), (2, 211), (5, 399)):
        moved = X[:1].copy()
        moved[0, sample, axis] += 1.0
        slope = pair_scores(model, "peas", "rice", moved) - pair_scores(model, "peas", "rice", X[:1])
        assert part.weights[axis, sample] == pytest.approx(slope[0], rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("after", [(), (PrincipalComponents(15), RICA(15, random_state=0, tol=1e-4))])
def test_planted_stretch_of_time_is_found(after):
    random = np.random.default_rng(1)
    X = random.normal(scale=0.05, size=(30, 1600, 6))
    y = np.repeat(["oat", "rice"], 15)
    X[y == "oat", 500:600, 2] += 0.5
    seen = explain(
        make_pipeline(RawSignal(), *after, ECOCClassifier()).fit(as_wrench(X), y), "oat", "rice", X, y
    )
    (region,) = seen.regions(1)
    assert (region.block, region.kind, region.axis, region.unit) == ("raw", "time", "fz", "s")
    assert 0.99 <= region.low <= 1.05
    assert 1.15 <= region.high <= 1.21
    assert region.contribution > 0.7 * seen.difference
    assert seen.by_axis()["fz"] > 0.9 * seen.difference
    assert "fz of raw, 1." in seen.top(1)[0]


@pytest.mark.parametrize("bin_range", [(-1.5, 1.5), "auto"])
def test_planted_vibration_is_found(bin_range):
    random = np.random.default_rng(2)
    X = random.normal(scale=0.02, size=(20, 1600, 6))
    y = np.tile(["oat", "rice"], 10)
    X[y == "rice", :, 3] += random.normal(scale=0.3, size=(10, 1600))
    model = make_pipeline(RawHFMH(bin_range=bin_range, block_weights="unit"), ECOCClassifier()).fit(
        as_wrench(X[:10]), y[:10]
    )
    # On recordings that are new to it: what it learned of the noise of others adds up to nothing there.
    seen = explain(model, "rice", "oat", X[10:], y[10:])
    assert set(seen.by_block()) == {"raw", "hfmh"}
    assert seen.by_block()["hfmh"] > 0.95 * seen.difference
    assert seen.by_axis()["tx"] > 0.95 * seen.difference
    (region,) = seen.regions(1)
    assert (region.axis, region.unit, region.either_sign) == ("tx", "N m", True)
    assert 0 <= region.low < region.high
    assert "from the histograms (hfmh): tx" in str(seen)


def test_two_classes_named_by_numbers():
    X, y = recordings(labels=(7, 3, 5))
    two = y != 5
    model = make_pipeline(RawSignal(), ECOCClassifier()).fit(X[two], y[two])
    seen = explain(model, 7, 3, X, y)  # recordings of others are left out
    assert (seen.first, seen.second) == (7, 3)
    assert seen.factors.tolist() == [-1.0]
    assert seen.difference > 0
    assert np.sign(seen.scores[0]) == np.sign(model.decision_function(X)[y == 7].mean())
    json.dumps(seen.to_dict())


def test_either_direction_is_the_other_with_the_opposite_sign_and_a_dict_holds_all(data):
    X, y = data
    model = make_pipeline(RawHFMH(), ECOCClassifier()).fit(X, y)
    there, back = explain(model, "oat", "rice", X, y), explain(model, "rice", "oat", X, y)
    assert there.scores == pytest.approx((-back.scores[1], -back.scores[0]))
    for one, other in zip(there.blocks, back.blocks, strict=True):
        np.testing.assert_array_equal(one.weights, -other.weights)
        np.testing.assert_allclose(one.contributions, other.contributions)
    read = json.loads(json.dumps(there.to_dict()))
    total = sum(np.sum(block["contributions"]) for block in read["blocks"])
    assert total == pytest.approx(read["difference"])
    assert [block["name"] for block in read["blocks"]] == ["raw", "hfmh"]
    assert read["top"] == list(there.top())


def test_without_labels_recordings_count_for_what_the_model_names_them(data):
    X, y = data
    model = make_pipeline(RawSignal(), ECOCClassifier()).fit(X, y)
    named, given = explain(model, "oat", "rice", X), explain(model, "oat", "rice", X, model.predict(X))
    assert named.scores == given.scores
    assert named.counts == given.counts


def test_a_model_that_gives_data_frames_is_explained_too(data):
    pytest.importorskip("pandas")
    X, y = data
    model = make_pipeline(RawSignal(), PrincipalComponents(5), ECOCClassifier())
    plain = explain(model.fit(X, y), "oat", "rice", X, y)
    framed = explain(model.set_output(transform="pandas").fit(X, y), "oat", "rice", X, y)
    np.testing.assert_allclose(framed.blocks[0].contributions, plain.blocks[0].contributions)


def test_text_where_the_model_does_not_tell_them_apart(data):
    X, y = data
    model = make_pipeline(RawSignal(), ECOCClassifier()).fit(X, y)
    swapped = y.copy()
    swapped[y == "oat"], swapped[y == "rice"] = "rice", "oat"
    text = str(explain(model, "oat", "rice", X, swapped))
    assert "does not score oat above rice" in text
    assert "%" not in text


@pytest.mark.parametrize(
    "matrix",
    [
        2 * np.eye(4) - 1,  # one against all
        [[1, 1, 1], [-1, 1, 1], [-1, -1, 1], [-1, -1, -1]],  # one after the other
        [[1, 0, 1], [-1, 1, 0], [0, -1, 1], [1, 1, -1]],
    ],
)
def test_factors_are_the_difference_of_decision_values_with_the_linear_loss(matrix):
    matrix = np.asarray(matrix, dtype=np.int8)
    scores = np.random.default_rng(0).normal(size=(5, matrix.shape[1]))
    losses = (1 - matrix[None] * scores[:, None, :]) / 2 * np.abs(matrix)
    values = -losses.sum(axis=2) / np.abs(matrix).sum(axis=1)
    for first, second in ((0, 3), (2, 1)):
        sums = scores @ pair_factors(matrix, first, second)
        np.testing.assert_allclose(values[:, first] - values[:, second], sums, atol=1e-12)


@pytest.mark.parametrize("coding", ["onevsall", [[1, 1], [-1, 1], [-1, -1]]])
def test_codings_without_a_learner_of_the_pair_are_explained_by_the_linear_loss(coding, data):
    X, y = data
    model = make_pipeline(RawHFMH(), ECOCClassifier(coding)).fit(X, y)
    seen = explain(model, "rice", "peas", X, y)
    codes, scores = model[-1].coding_matrix_, model[-1].binary_scores(model[:-1].transform(X))
    values = -((1 - codes * scores[:, None, :]) / 2).mean(axis=2)
    gap = values[:, 2] - values[:, 1]
    assert seen.difference == pytest.approx(gap[y == "rice"].mean() - gap[y == "peas"].mean())
    assert added_up(seen) == pytest.approx(seen.difference)


def test_factors_of_several_learners_of_one_pair():
    matrix = np.array([[1, -1, 1], [-1, 1, 0], [0, 0, -1]], dtype=np.int8)
    np.testing.assert_array_equal(pair_factors(matrix, 0, 1), [0.5, -0.5, 0.0])


# -- names of axes


ORDER = [2, 1, 0, 3, 4, 5]
NAMES = ("fz", "fy", "fx", "tx", "ty", "tz")


def largest(shares):
    return max(shares, key=shares.get)


@pytest.mark.parametrize("space", [RawSignal(), HFMH(bin_range="auto"), MultiBand()])
def test_axes_in_another_order_keep_their_names(space):
    X, y = louder()
    model = make_pipeline(space, ECOCClassifier()).fit(X[..., ORDER], y)
    plain = explain(model, "rice", "oat", X[..., ORDER], y)
    seen = explain(model, "rice", "oat", X[..., ORDER], y, axes=NAMES)
    assert tuple(seen.by_axis()) == NAMES
    assert list(seen.by_axis().values()) == list(plain.by_axis().values())
    assert (largest(plain.by_axis()), largest(seen.by_axis())) == ("axis0", "fz")
    assert "fz" in str(seen).lower()


def test_features_and_units_follow_the_names():
    X, y = louder()
    model = make_pipeline(MultiBand(), ECOCClassifier()).fit(X[..., ORDER], y)
    told = explain(model, "rice", "oat", X[..., ORDER], y, axes=NAMES).to_dict()
    assert any("_fz" in name for name in told["features"]["names"][:12])
    model = make_pipeline(RawSignal(), ECOCClassifier()).fit(X[..., :3], y)
    seen = explain(model, "rice", "oat", X[..., :3], y, axes=("left", "right", "up"))
    assert largest(seen.by_axis()) == "up"
    assert {region.axis for region in seen.regions(3)} <= {"left", "right", "up"}


GYRO = ("wx", "wy", "wz", "ax", "ay", "az")


def imu(X, y, units=("rad/s",) * 3 + ("m/s2",) * 3):
    meta = {"units": dict(zip(GYRO, units, strict=True))}
    return Dataset([Recording(x, 100.0, label, axes=GYRO, meta=meta) for x, label in zip(X, y, strict=True)])


@pytest.mark.parametrize("fitted_on", ["a data set", "arrays"])
@pytest.mark.parametrize("bin_range", [(-1.5, 1.5), "auto"])
def test_axes_and_units_are_those_of_the_data_set(fitted_on, bin_range):
    data = imu(*louder())
    given = data if fitted_on == "a data set" else data.X
    model = make_pipeline(HFMH(rate_hz=100, bin_range=bin_range), ECOCClassifier()).fit(given, data.y)
    seen = explain(model, "rice", "oat", data)
    assert tuple(seen.by_axis()) == GYRO
    assert {region.unit for region in seen.regions(20) if region.axis[0] == "w"} == {"rad/s"}
    assert seen.scores == explain(model, "rice", "oat", data.X, data.y).scores
    if bin_range == "auto":
        assert [part.block.name for part in seen.blocks] == [f"hfmh_{axis}" for axis in GYRO]


@pytest.mark.parametrize("units", [("rad/s",) * 3 + ("m/s2",) * 3, ("",) * 6])
def test_values_in_words_have_the_units_of_the_data_set(units):
    X, y = louder()
    data = imu(X + 3.0 * (y == "rice")[:, None, None], y, units)
    model = make_pipeline(MultiBand(blocks=["level"]), ECOCClassifier()).fit(data)
    words = explain(model, "rice", "oat", data).findings(1)[0].words
    axis = words.removeprefix("mean of ").split()[0]
    unit = dict(zip(GYRO, units, strict=True))[axis]
    assert f" {unit} in rice".replace("  ", " ") in words


def test_a_data_set_of_other_axes_than_the_models_is_refused():
    data = imu(*louder())
    model = make_pipeline(RawSignal(), ECOCClassifier()).fit(data)
    with pytest.raises(ValueError, match=r"X has the axes fx .*, in fit they were wx"):
        explain(model, "rice", "oat", as_wrench(data.X), data.y)


# -- stretches that hold most of the contributions, beside a search over all stretches


def block(n, kind="time", axes=("fx",), coordinates=None, unit="s", units=()):
    points = np.arange(float(n)) if coordinates is None else np.asarray(coordinates, dtype=float)
    return FeatureBlock("b", kind, axes, points, unit, slice(0, n * len(axes)), units)


@given(arrays(np.float64, st.integers(1, 25), elements=st.integers(-5, 5).map(float)))
def test_the_first_is_the_shortest_that_holds_four_fifths_of_the_best(values):
    sums = {(i, j): values[i:j].sum() for i in range(len(values)) for j in range(i + 1, len(values) + 1)}
    best = max(sums.values())
    first = next(regions_of(block(len(values)), values[None]), None)
    if best <= 0:
        assert first is None
        return
    shortest = min(j - i for (i, j), total in sums.items() if total >= 0.8 * best)
    assert first.high - first.low + 1 == shortest
    assert first.contribution == sums[int(first.low), int(first.high) + 1] >= 0.8 * best


@given(arrays(np.float64, (2, 12), elements=st.integers(-5, 5).map(float)))
def test_stretches_do_not_overlap_and_leave_nothing_positive(values):
    taken = np.zeros((2, 12), dtype=bool)
    for region in regions_of(block(12, axes=("fx", "fy")), values):
        row = ("fx", "fy").index(region.axis)
        stretch = slice(int(region.low), int(region.high) + 1)
        assert not taken[row, stretch].any()
        assert region.contribution == values[row, stretch].sum() > 0
        taken[row, stretch] = True
    assert (values[~taken] <= 0).all()


def test_bins_around_zero_are_read_by_size():
    bins = block(4, "magnitude", ("tx",), [-1.5, -0.5, 0.5, 1.5], "N, N m", ("N m",))
    (first, *_) = regions_of(bins, np.array([[3.0, -1.0, -1.0, 2.0]]))
    assert (first.low, first.high, first.contribution, first.either_sign) == (1.0, 2.0, 5.0, True)
    assert str(first) == "tx of b, 1 .. 2 N m of either sign"
    odd = block(3, "magnitude", ("fx",), [-1.0, 0.0, 1.0], "N, N m", ("N",))
    (only,) = regions_of(odd, np.array([[1.0, 7.0, -9.0]]))
    assert (only.low, only.high, only.contribution, only.unit) == (0.0, 0.5, 7.0, "N")


def test_bins_that_are_not_around_zero_keep_their_sign():
    bins = block(3, "magnitude", ("fz",), [1.0, 2.0, 3.0], "N")
    (only,) = regions_of(bins, np.array([[0.0, 4.0, 0.0]]))
    assert (only.low, only.high, only.either_sign) == (1.5, 2.5, False)


# -- refusals


X, Y = recordings(n_samples=100)


@pytest.fixture(scope="module")
def fitted():
    return make_pipeline(RawSignal(), ECOCClassifier()).fit(X, Y)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"second": "sand"}, "second must be one of 'oat', 'peas', 'rice', got 'sand'"),
        ({"second": "oat"}, "first and second must be two materials, got 'oat' twice"),
        ({"first": np.array(["oat", "peas"])}, "first must be one of 'oat', 'peas', 'rice', got array"),
        ({"X": X[Y != "rice"], "y": Y[Y != "rice"]}, "y has no 'rice'"),
        ({"X": X[Y == "oat"], "y": None}, "model names no recording of X 'rice'"),
        ({"y": Y[:3]}, "y must have one label per recording of X, got 3 for X of 36 recordings"),
        ({"X": X[:, :30]}, r"X must have shape \(n, 100, 6\) as in fit"),
        (
            {"X": X[0, 0]},
            r"X must be recordings, a Dataset or an array \(n, T, C\), got ndarray of shape \(6,\)",
        ),
        ({"X": [[1.0, 2.0], [1.0]], "y": ["oat", "rice"]}, "X must be recordings of one shape"),
        ({"axes": ("fx", "fy", "fz")}, "axes must be 6 different names, one for each axis of X, got"),
        ({"axes": ("fx",) * 6}, "axes must be 6 different names"),
        ({"axes": "fxfyfz"}, "axes must be a sequence of names of axes, got"),
        ({"axes": 6}, "axes must be a sequence of names of axes, got"),
        ({"axes": [1, 2, 3, 4, 5, 6]}, "axes must be a sequence of names of axes, got"),
    ],
)
def test_bad_arguments(fitted, change, message):
    arguments = {"first": "oat", "second": "rice", "X": X, "y": Y} | change
    with pytest.raises((ValueError, TypeError), match=message):
        explain(fitted, **arguments)


def test_bad_numbers_of_findings(fitted):
    seen = explain(fitted, "oat", "rice", X, Y)
    with pytest.raises(ValueError, match="n must be at least 0, got -1"):
        seen.regions(-1)
    with pytest.raises(TypeError, match=r"n must be a whole number, got 1\.5"):
        seen.top(1.5)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (ECOCClassifier(), "model must be a Pipeline of a feature space and an ECOCClassifier"),
        (make_pipeline(RawSignal(), LogisticRegression()), "or a BestClassifier, got LogisticRegression"),
        (
            make_pipeline(RawSignal(), MinMaxScaler(), ECOCClassifier()),
            "got MinMaxScaler, which cannot be foll",
        ),
        (make_pipeline(TimePermutation(random_state=0), RawSignal(), ECOCClassifier()), "TimePermutation"),
    ],
)
def test_models_that_cannot_be_explained(model, message):
    if hasattr(model, "steps"):
        model = model.fit(X, Y)
    with pytest.raises(TypeError, match=message):
        explain(model, "oat", "rice", X, Y)


def test_models_without_a_fit_without_weights_or_without_a_space_cannot_be_explained():
    model = make_pipeline(RawSignal(), ECOCClassifier())
    with pytest.raises(NotFittedError):
        explain(model, "oat", "rice", X, Y)
    features = model.fit(X, Y)[:-1].transform(X)
    model[-1].fit_gram(features @ features.T, Y)
    with pytest.raises(TypeError, match=r"model must have linear learners.*has no coef_"):
        explain(model, "oat", "rice", X, Y)
    flat = X[:, :, 0]
    with pytest.raises(TypeError, match="nothing behind filters"):
        explain(make_pipeline(ECOCClassifier()).fit(flat, Y), "oat", "rice", flat, Y)

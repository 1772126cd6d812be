"""Identifier: the labels and scores of the scikit-learn pipeline it was made from, in one file."""

import hashlib
import json
import pickle
import subprocess
import sys

import numpy as np
import pytest
from sklearn.ensemble import RandomForestClassifier
from sklearn.linear_model import RidgeClassifier
from sklearn.pipeline import make_pipeline

from evaluation_cases import LABELS, changed, make_data
from granular_id import DFT, HFMH, ECOCClassifier, RawHFMH, RawSignal, synthesize
from granular_id._core import Model, ModelFileError
from granular_id.identifier import SPACES, Identifier, Recipe
from granular_id.recording import Dataset, Recording
from granular_id.spaces import feature_spaces


@pytest.fixture(scope="module")
def data():
    return make_data(8)


@pytest.fixture(scope="module")
def new():
    return make_data(5, seed=9)


@pytest.fixture(scope="module")
def identifier(data):
    return Identifier.fit(data, "raw+hfmh", target_error=0.2)


def same_answers(identifier, pipeline, X):
    """Labels equal; scores within the rounding of a sum of their terms."""
    assert identifier.predict(X).tolist() == pipeline.predict(X).tolist()
    features, classifier = pipeline[0].transform(X), pipeline[-1]
    want = classifier.binary_scores(features)
    size = np.abs(features) @ np.abs(classifier.coef_).T + np.abs(classifier.intercept_)
    assert (np.abs(identifier.scores(X) - want) <= 1e-13 * size).all()
    np.testing.assert_allclose(
        identifier.decision_function(X),
        classifier.decision_function(features),
        rtol=0,
        atol=1e-10 * size.max(),
    )


@pytest.mark.parametrize(
    ("space", "settings"),
    [
        ("raw", {}),
        ("raw", {"coding": "onevsall", "loss": "linear"}),
        ("hfmh", {"n_bins": 7, "bin_range": "auto", "outside": "clip"}),
        ("hfmh", {"density": True, "initial": "steady", "order": 3, "cutoff_hz": 60.0}),
        ("raw+hfmh", {}),
        ("raw+hfmh", {"block_weights": "unit", "bin_range": "auto"}),
        ("raw+hfmh", {"block_weights": (2.0, 0.125), "C": 0.01, "decoding": "loss_based"}),
        ("raw+hfmh", {"coding": "denserandom", "random_state": 3, "loss": "hamming"}),
    ],
)
def test_labels_and_scores_are_those_of_the_pipeline(data, new, space, settings):
    identifier = Identifier.fit(data, space, estimate=False, **settings)
    pipeline = Recipe(space=space, **settings).pipeline(500.0).fit(data.X, data.y)
    same_answers(identifier, pipeline, new.X)
    assert identifier.space == space
    assert identifier.classes == LABELS


@pytest.mark.parametrize("n_axes", [1, 2, 6])
def test_two_classes_and_any_number_of_axes(n_axes):
    names = tuple(f"a{i}" for i in range(n_axes))
    rng = np.random.default_rng(n_axes)
    data = Dataset(
        [
            Recording(rng.normal(k, 1, (30, n_axes)), rate_hz=100, label=m, name=f"{m}{i}", axes=names)
            for i in range(4)
            for k, m in enumerate(("b", "a"))
        ]
    )
    identifier = Identifier.fit(data, "raw+hfmh", cutoff_hz=20.0)
    pipeline = make_pipeline(RawHFMH(rate_hz=100, cutoff_hz=20.0), ECOCClassifier()).fit(data.X, data.y)
    same_answers(identifier, pipeline, data.X)
    assert identifier.axes == names
    assert identifier.decision_function(data.X).shape == (8,)
    assert identifier.predict(data.X[0]).tolist() == [pipeline.predict(data.X[:1])[0]]


@pytest.mark.parametrize("method", ["kullback_leibler", "wu_lin_weng"])
def test_probabilities_are_those_of_the_pipeline_and_survive_the_file(data, new, method, tmp_path):
    identifier = Identifier.fit(data, "hfmh", posterior=method, estimate=False)
    pipeline = Recipe(space="hfmh", posterior=method).pipeline(500.0).fit(data.X, data.y)
    identifier.save(tmp_path / "m.safetensors")
    for model in (identifier, Identifier.load(tmp_path / "m.safetensors")):
        np.testing.assert_allclose(
            model.predict_proba(new.X), pipeline.predict_proba(new.X), rtol=0, atol=1e-9
        )
    answer = identifier.identify(new[0])
    best = identifier.classes.index(answer.label)
    assert answer.probability == pytest.approx(identifier.predict_proba(new.X[:1])[0, best], abs=1e-12)


def test_a_model_without_probabilities_says_so(identifier, new):
    with pytest.raises(ValueError, match="train it with posterior="):
        identifier.predict_proba(new.X)
    assert identifier.identify(new[0]).probability is None


def test_a_file_gives_back_the_same_model(identifier, new, tmp_path):
    identifier.save(tmp_path / "m.safetensors")
    same = Identifier.load(tmp_path / "m.safetensors")
    assert same.core == identifier.core
    assert np.array_equal(same.scores(new.X), identifier.scores(new.X))
    assert (same.trained, same.classes, same.lead_s) == (identifier.trained, LABELS, identifier.lead_s)
    assert (same.rate_hz, same.n_samples, same.spec) == (500.0, 80, identifier.spec)
    assert repr(same) == "Identifier('raw+hfmh', 4 classes, 80 samples at 500 Hz)"
    assert [path.name for path in tmp_path.iterdir()] == ["m.safetensors"]
    assert np.array_equal(pickle.loads(pickle.dumps(identifier)).scores(new.X), identifier.scores(new.X))


def test_the_same_training_gives_the_same_bytes(data):
    settings = {"posterior": "kullback_leibler", "coding": "sparserandom", "target_error": 0.2}
    one = Identifier.fit(data, "raw+hfmh", threads=1, **settings).core.to_bytes()
    assert Identifier.fit(data, "raw+hfmh", threads=2, **settings).core.to_bytes() == one
    assert Identifier.fit(data, "raw+hfmh", threads=1, **settings, C=2.0).core.to_bytes() != one


def test_another_process_trains_the_same_bytes():
    code = (
        "import hashlib, granular_id as gid; from granular_id.identifier import Identifier\n"
        "data = gid.synthesize(['rice', 'fine sugar'], n_per_class=6, duration_s=0.3)\n"
        "print(hashlib.sha256(Identifier.fit(data).core.to_bytes()).hexdigest())"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    data = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.3)
    assert done.stdout.strip() == hashlib.sha256(Identifier.fit(data).core.to_bytes()).hexdigest()


def test_what_it_was_trained_on_is_known(data, identifier):
    trained = identifier.trained
    assert trained["recordings"] == dict.fromkeys(LABELS, 8)
    assert trained["synthetic"] is False
    assert not identifier.synthetic
    assert trained["n_sessions"] == 8
    assert trained["settings"]["space"] == "raw+hfmh"
    assert trained["settings"]["classifier"]["C"] == 1.0
    assert "threads" not in json.dumps(trained)
    assert trained["estimate"]["held_out"] == "held-out sessions"
    assert len(identifier.core.metadata["training_sha256"]) == 64
    assert identifier.core.metadata["coding"] == "onevsone"
    other = Identifier.fit(changed(data, label=lambda r: r.label), "raw+hfmh", estimate=False)
    assert other.core.metadata["training_sha256"] == identifier.core.metadata["training_sha256"]
    moved = Identifier.fit(data[::-1], "raw+hfmh", estimate=False)
    assert moved.core.metadata["training_sha256"] != identifier.core.metadata["training_sha256"]


def test_ranges_of_the_training_are_kept_for_provisional_answers(data, identifier):
    for name, want in (("raw_mean", data.X.mean(0)), ("raw_low", data.X.min(0)), ("raw_high", data.X.max(0))):
        assert np.array_equal(getattr(identifier.core, name), want.T.ravel()), name
    assert Identifier.fit(data, "hfmh", estimate=False).core.raw_mean is None


def test_simulated_recordings_stay_simulated_through_the_file(tmp_path):
    data = synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.3)
    Identifier.fit(data, "raw+hfmh").save(tmp_path / "m.safetensors")
    model = Identifier.load(tmp_path / "m.safetensors")
    assert model.synthetic
    assert repr(model).endswith("trained on SYNTHETIC recordings)")


def test_the_lead_is_known_where_all_recordings_have_the_same():
    data = synthesize(["rice", "fine sugar"], n_per_class=3, duration_s=0.6)
    assert Identifier.fit(data, "hfmh").lead_s is None
    cropped = data.align(200, trigger="recorded", lead_s=0.08)
    assert Identifier.fit(cropped, "hfmh").lead_s == 0.08
    without = changed(cropped, trigger_index=lambda r: None)
    assert Identifier.fit(without, "hfmh").lead_s is None


# -- from a pipeline


def test_any_fitted_pipeline_of_ours_can_be_taken_over(data, new):
    for features in (RawSignal(rate_hz=500), HFMH(n_bins=9), RawHFMH(block_weights="unit")):
        pipeline = make_pipeline(features, ECOCClassifier(RidgeClassifier())).fit(data.X, data.y)
        same_answers(Identifier.from_classifier(pipeline), pipeline, new.X)
    identifier = Identifier.from_classifier(pipeline, samples=data.X, lead_s=0.25)
    assert identifier.core.raw_mean is not None
    assert (identifier.lead_s, identifier.trained) == (0.25, {})


@pytest.mark.parametrize(
    ("steps", "kind", "message"),
    [
        (
            (DFT(), ECOCClassifier()),
            TypeError,
            "must be a fitted pipeline of RawSignal, HFMH, RawHFMH or MultiBand, .*got DFT",
        ),
        (
            (RawSignal(), RandomForestClassifier(n_estimators=2)),
            TypeError,
            "got RawSignal, RandomForestClassifier",
        ),
        (
            (RawSignal(), ECOCClassifier(RandomForestClassifier(2))),
            TypeError,
            "linear learners; these have no coef_",
        ),
        ((RawSignal(), ECOCClassifier()), ValueError, "rate_hz must be stated"),
    ],
)
def test_other_pipelines_are_refused(data, steps, kind, message):
    pipeline = make_pipeline(*steps).fit(data.X, data.y)
    with pytest.raises(kind, match=message):
        Identifier.from_classifier(pipeline)


def test_labels_that_are_no_text_and_other_rates_are_refused(data):
    numbers = make_pipeline(HFMH(), ECOCClassifier()).fit(data.X, np.repeat(range(4), 8))
    with pytest.raises(ValueError, match="classes must be texts, got 0"):
        Identifier.from_classifier(numbers)
    named = make_pipeline(HFMH(), ECOCClassifier()).fit(data.X, data.y)
    with pytest.raises(ValueError, match="rate_hz=100, but the feature space was made for 500 Hz"):
        Identifier.from_classifier(named, rate_hz=100)
    with pytest.raises(TypeError, match="got HFMH"):
        Identifier.from_classifier(HFMH())


def test_samples_of_another_shape_are_refused(data):
    pipeline = make_pipeline(RawHFMH(), ECOCClassifier()).fit(data.X, data.y)
    turned = data.X.transpose(0, 2, 1)
    with pytest.raises(ValueError, match=r"samples must have shape \(n, \d+, 6\), got \(32, 6, \d+\)"):
        Identifier.from_classifier(pipeline, samples=turned)


# -- refusals


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"space": "dft"}, "space must be one of 'best', .*'raw', 'hfmh', 'raw.hfmh', got 'dft'"),
        ({"space": "raw", "block_weights": "unit"}, "space='raw' has one block"),
        ({"target_error": 1.0}, "target_error must lie between 0 and 1, got 1"),
        ({"target_error": 0.0, "early": False}, "target_error must lie between 0 and 1, got 0"),
        ({"n_folds": 1}, "n_folds must be at least 2, got 1"),
        ({"C": -1.0}, "C"),
        ({"coding": "none"}, "coding"),
        ({"n_bins": 0}, "n_bins"),
        (
            {"max_file_bytes": 100_000},
            r"the model would take .* more than the 0.0954 MiB .*; ways out: the space 'hf",
        ),
    ],
)
def test_bad_settings_are_refused(data, settings, message):
    with pytest.raises(ValueError, match=message):
        Identifier.fit(data, **{"space": "raw+hfmh", **settings})


def test_training_takes_best_unless_told_otherwise(data):
    assert Identifier.fit(data, estimate=False).trained["settings"]["space"] == "best"
    assert set(SPACES) < set(feature_spaces())  # a model knows no space that an evaluation does not
    with pytest.raises(ValueError, match=r"space must be one of 'best', 'multiband', 'raw', .*, got 'dft'"):
        Identifier.fit(data, "dft")


def test_a_model_too_large_for_its_file_names_ways_out_that_work():
    rng = np.random.default_rng(0)
    wrench = rng.normal(size=(72, 1600, 6))
    data = Dataset([Recording(w, rate_hz=500, label=f"m{i // 3:02d}") for i, w in enumerate(wrench)])
    with pytest.raises(ValueError, match="276 learners for 24 materials, 10200 features") as refusal:
        Identifier.fit(data, "raw+hfmh")
    for way in (
        "the space 'hfmh' (600 features)",
        "shorter recordings, or a lower rate",
        "'onevsall' (24 learners)",
    ):
        assert way in str(refusal.value)
    for settings in ({"space": "hfmh"}, {"coding": "onevsall"}):
        assert (
            len(Identifier.fit(data, **{"space": "raw+hfmh", **settings}, estimate=False).core.to_bytes())
            < 16 * 2**20
        )


def test_bad_data_is_refused(data):
    with pytest.raises(TypeError, match=r"data must be a granular_id\.Dataset, got ndarray"):
        Identifier.fit(data.X)
    with pytest.raises(ValueError, match="at least 2 classes, got only 'oat'"):
        Identifier.fit(data.select(labels="oat"))
    with pytest.raises(ValueError, match="have no label"):
        Identifier.fit(changed(data, label=lambda r: None))


@pytest.mark.parametrize("name", ["coding", "loss", "decoding", "posterior"])
def test_names_that_do_not_exist_are_refused_by_the_recipe(name):
    with pytest.raises(ValueError, match=rf"{name} must be one of '.*, got 'nose'"):
        Recipe(**{"space": "hfmh", name: "nose"})


def test_bad_recordings_are_refused(identifier, data):
    for wrong, kind in ((data, TypeError), (data[0], TypeError), (data.X[:, :, :5], ValueError)):
        with pytest.raises(kind, match=r"must"):
            identifier.predict(wrong)
    with pytest.raises(
        ValueError, match=r"recording must have shape \(80, 6\) as in the training, got \(79, 6\)"
    ):
        identifier.identify(data.X[0, 1:])
    broken = data.X[:2].copy()
    broken[1, 3, 2] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        identifier.predict(broken)


def test_bad_files_are_refused_by_name(identifier, tmp_path):
    file = tmp_path / "m.safetensors"
    with pytest.raises(FileNotFoundError, match=r"m\.safetensors"):
        Identifier.load(file)
    file.write_bytes(identifier.core.to_bytes()[:-1])
    with pytest.raises(ModelFileError, match=r"m\.safetensors"):
        Identifier.load(file)
    identifier.save(file)
    with pytest.raises(ModelFileError, match=r"m\.safetensors.*max_file_bytes"):
        Identifier.load(file, max_file_bytes=1000)
    with pytest.raises(OSError, match="folder"):
        identifier.save(tmp_path)


def test_only_a_model_makes_an_identifier():
    with pytest.raises(TypeError, match=r"core must be a granular_id\._core\.Model, got str"):
        Identifier("m.safetensors")
    assert issubclass(ModelFileError, ValueError)
    assert Model.__name__ == "Model"

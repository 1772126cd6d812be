"""Identifier: the labels and scores of the scikit-learn pipeline it was made from, in one file."""

import hashlib
import json
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from sklearn.ensemble import RandomForestClassifier
from sklearn.pipeline import make_pipeline

from evaluation_cases import LABELS, changed
from granular_id import DFT, HFMH, ECOCClassifier, RawHFMH, RawSignal, synthesize
from granular_id._core import ModelFileError
from granular_id.identifier import SPACES, Identifier
from granular_id.identifier.metadata import MAX_FILE_BYTES
from granular_id.recording import Dataset, Recording
from granular_id.spaces import feature_spaces


def same_answers(identifier, pipeline, X):
    """Labels equal; scores within the rounding of a sum of their terms."""
    assert identifier.predict(X).tolist() == pipeline.predict(X).tolist()
    features, classifier = pipeline[0].transform(X), pipeline[-1]
    want = classifier.binary_scores(features)
    size = np.abs(features) @ np.abs(classifier.coef_).T + np.abs(classifier.intercept_)
    assert (np.abs(identifier.scores(X) - want) <= 1e-13 * size).all()
    values = classifier.decision_function(features)
    np.testing.assert_allclose(identifier.decision_function(X), values, rtol=0, atol=1e-10 * size.max())


FOUR_CODES = [[1, 1], [-1, 1], [1, -1], [-1, -1]]


@pytest.mark.parametrize(
    ("space", "classifier"),
    [
        (RawSignal(rate_hz=500), ECOCClassifier()),
        (RawSignal(), ECOCClassifier(coding="onevsall", loss="root")),
        (HFMH(n_bins=7, bin_range="auto", outside="clip"), ECOCClassifier()),
        (HFMH(density=True, initial="steady", order=3, cutoff_hz=60.0), ECOCClassifier()),
        (RawHFMH(), ECOCClassifier()),
        (RawHFMH(block_weights="unit", bin_range="auto"), ECOCClassifier()),
        (RawHFMH(block_weights=(2.0, 0.125)), ECOCClassifier(C=0.01)),
        (RawHFMH(), ECOCClassifier(coding=FOUR_CODES, loss="root")),
    ],
)
def test_fit_of_a_pipeline_answers_as_it_does(data, new, space, classifier):
    pipeline = make_pipeline(space, classifier)
    identifier = Identifier.fit(data, pipeline, estimate=False)
    assert not hasattr(pipeline[-1], "coef_"), "the pipeline given is left as it is"
    same_answers(identifier, pipeline.fit(data.X, data.y), new.X)
    assert (identifier.classes, identifier.trained["settings"]["space"]) == (LABELS, "pipeline")
    np.testing.assert_array_equal(identifier.core.coding_matrix, pipeline[-1].coding_matrix_)
    assert identifier.space == {RawSignal: "raw", HFMH: "hfmh", RawHFMH: "raw+hfmh"}[type(space)]


@pytest.mark.parametrize("space", ["raw", "hfmh", "raw+hfmh"])
def test_fit_of_a_named_space_is_that_of_an_evaluation(data, new, space):
    known = feature_spaces(rate_hz=500.0)[space]
    pipeline = make_pipeline(known.transformer, known.classifier or ECOCClassifier()).fit(data.X, data.y)
    identifier = Identifier.fit(data, space, estimate=False)
    same_answers(identifier, pipeline, new.X)
    assert identifier.space == identifier.trained["settings"]["space"] == space


@pytest.mark.parametrize("n_axes", [1, 2, 6])
def test_two_classes_and_any_number_of_axes(n_axes):
    names = tuple(f"a{i}" for i in range(n_axes))
    rng = np.random.default_rng(n_axes)
    recordings = [
        Recording(rng.normal(k, 1, (30, n_axes)), rate_hz=100, label=m, name=f"{m}{i}", axes=names)
        for i in range(4)
        for k, m in enumerate(("b", "a"))
    ]
    data = Dataset(recordings)
    pipeline = make_pipeline(RawHFMH(rate_hz=100, cutoff_hz=20.0), ECOCClassifier()).fit(data.X, data.y)
    identifier = Identifier.fit(data, pipeline)
    same_answers(identifier, pipeline, data.X)
    assert identifier.axes == names
    assert identifier.decision_function(data.X).shape == (8,)
    assert identifier.predict(data.X[0]).tolist() == [pipeline.predict(data.X[:1])[0]]


@pytest.mark.parametrize("space", ["raw+hfmh", "best"])
def test_a_file_gives_back_the_same_model(models, new, space, tmp_path):
    identifier = models[space]
    identifier.save(tmp_path / "m.safetensors")
    same = Identifier.load(tmp_path / "m.safetensors")
    assert (same.core, same.spec, same.trained) == (identifier.core, identifier.spec, identifier.trained)
    assert (same.space, same.classes, same.lead_s) == (space, LABELS, identifier.lead_s)
    assert (same.rate_hz, same.n_samples) == (500.0, 80)
    assert repr(same) == f"Identifier({space!r}, 4 classes, 80 samples at 500 Hz)"
    assert [path.name for path in tmp_path.iterdir()] == ["m.safetensors"]
    for other in (same, pickle.loads(pickle.dumps(identifier))):
        assert np.array_equal(other.scores(new.X), identifier.scores(new.X))


@pytest.mark.parametrize("space", ["raw+hfmh", "best"])
def test_the_same_training_gives_the_same_bytes(data, space):
    one, same, other = (
        Identifier.fit(data, space, **more).core.to_bytes()
        for more in (
            {"threads": 1, "target_error": 0.2},
            {"threads": 2, "target_error": 0.2},
            {"threads": 1, "target_error": 0.3},
        )
    )
    assert same == one
    assert other != one


@pytest.mark.thread_unsafe(reason="starts a process")
def test_another_process_trains_the_same_bytes():
    code = (
        "import hashlib, granular_id as gid; from granular_id.identifier import Identifier\n"
        "data = gid.synthesize(['rice', 'fine sugar'], n_per_class=4, duration_s=0.3)\n"
        "print(hashlib.sha256(Identifier.fit(data).core.to_bytes()).hexdigest())"
    )
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    data = synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.3)
    model = Identifier.fit(data)
    assert done.stdout.strip() == hashlib.sha256(model.core.to_bytes()).hexdigest()
    assert model.trained["settings"]["space"] == "best"


def test_what_it_was_trained_on_is_known(data, plain):
    trained = plain.trained
    assert trained["recordings"] == dict.fromkeys(LABELS, 8)
    assert not trained["synthetic"]
    assert not plain.synthetic
    assert trained["n_sessions"] == 8
    assert trained["settings"]["space"] == "raw+hfmh"
    assert trained["settings"]["steps"][-1]["C"] == 1.0
    assert "threads" not in json.dumps(trained)
    assert trained["estimate"]["held_out"] == "held-out sessions"
    assert plain.core.n_learners == 6
    digests = [
        Identifier.fit(each, "raw+hfmh", estimate=False).core.metadata["training_sha256"]
        for each in (changed(data, label=lambda r: r.label), data[::-1])
    ]
    assert digests[0] == plain.core.metadata["training_sha256"] != digests[1]
    assert len(digests[0]) == 64


def test_the_mean_of_the_training_is_kept_for_provisional_answers(data, plain):
    assert np.array_equal(plain.core.raw_mean, data.X.mean(0).T.ravel())
    assert Identifier.fit(data, "hfmh", estimate=False).core.raw_mean is None


def test_simulated_recordings_and_their_lead_are_known_through_the_file(tmp_path):
    data = synthesize(["rice", "fine sugar"], n_per_class=3, duration_s=0.6)
    cropped = data.align(200, trigger="recorded", lead_s=0.08)
    Identifier.fit(cropped, "hfmh").save(tmp_path / "m.safetensors")
    model = Identifier.load(tmp_path / "m.safetensors")
    assert model.synthetic
    assert repr(model).endswith("trained on SYNTHETIC recordings)")
    assert model.lead_s == 0.08
    # only where all recordings have the same
    assert Identifier.fit(data, "hfmh", estimate=False).lead_s is None
    without = changed(cropped, trigger_index=lambda r: None)
    assert Identifier.fit(without, "hfmh", estimate=False).lead_s is None


# -- from a pipeline


def test_any_fitted_pipeline_of_ours_can_be_taken_over(data, new):
    for features in (RawSignal(rate_hz=500), HFMH(n_bins=9), RawHFMH(block_weights="unit")):
        pipeline = make_pipeline(features, ECOCClassifier()).fit(data.X, data.y)
        same_answers(Identifier.from_classifier(pipeline), pipeline, new.X)
    identifier = Identifier.from_classifier(pipeline, samples=data.X, lead_s=0.25)
    assert identifier.core.raw_mean is not None
    assert (identifier.lead_s, identifier.trained) == (0.25, {})


NUMBERS, LABELLED = np.repeat(range(4), 8), np.repeat(LABELS, 8)
OURS = "must be a pipeline of RawSignal, HFMH, RawHFMH or MultiBand, .*got DFT"
TURNED = np.zeros((32, 6, 80))


@pytest.mark.parametrize(
    ("steps", "y", "more", "kind", "message"),
    [
        ((DFT(), ECOCClassifier()), LABELLED, {}, TypeError, f"pipeline {OURS}"),
        ((RawSignal(), RandomForestClassifier(2)), LABELLED, {}, TypeError, "got RawSignal, RandomForest"),
        ((RawSignal(), ECOCClassifier()), LABELLED, {}, ValueError, "rate_hz must be stated"),
        ((HFMH(), ECOCClassifier()), NUMBERS, {}, ValueError, "classes must be texts, got 0"),
        ((HFMH(), ECOCClassifier()), LABELLED, {"rate_hz": 100}, ValueError, "was made for 500 Hz"),
        (
            (RawHFMH(), ECOCClassifier()),
            LABELLED,
            {"samples": TURNED},
            ValueError,
            r"samples must have shape \(n, \d+, 6\), got \(32, 6, \d+\)",
        ),
    ],
)
def test_other_pipelines_are_refused(data, steps, y, more, kind, message):
    pipeline = make_pipeline(*steps).fit(data.X, y)
    with pytest.raises(kind, match=message):
        Identifier.from_classifier(pipeline, **more)
    with pytest.raises(TypeError, match=f"got {type(steps[0]).__name__}"):
        Identifier.from_classifier(pipeline[0])


# -- refusals


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"space": "dft"}, "space must be one of 'best', 'multiband', 'raw', .*, got 'dft'"),
        ({"space": make_pipeline(DFT(), ECOCClassifier())}, f"space {OURS}"),
        ({"space": make_pipeline(HFMH(n_bins=0), ECOCClassifier())}, "n_bins"),
        ({"space": make_pipeline(HFMH(), ECOCClassifier(C=-1.0))}, "C"),
        ({"target_error": 1.0}, "target_error must lie between 0 and 1, got 1"),
        ({"coverage": 0.0}, "coverage must lie between 0 and 1, got 0"),
        ({"coverage": "much"}, "coverage"),
        ({"share_known": 1.0}, "share_known must lie between 0 and 1, got 1"),
        ({"estimate": "no"}, "estimate"),
        ({"by": "speed"}, "speed"),
        ({"progress": 3}, "progress"),
    ],
)
def test_bad_settings_are_refused(data, settings, message):
    with pytest.raises((ValueError, TypeError), match=message):
        Identifier.fit(data, **{"space": "raw+hfmh", **settings})


def test_a_model_knows_no_space_that_an_evaluation_does_not():
    assert set(SPACES) < set(feature_spaces())


def test_model_too_large_for_its_file_names_ways_that_work():
    rng = np.random.default_rng(0)
    wrench = rng.normal(size=(99, 1600, 6))
    data = Dataset([Recording(w, rate_hz=500, label=f"m{i // 3:02d}") for i, w in enumerate(wrench)])
    with pytest.raises(ValueError, match="528 learners for 33 materials, 10200 features") as refusal:
        Identifier.fit(data, "raw+hfmh")
    for way in ("space='hfmh'", "shorter recordings", "ECOCClassifier('onevsall') (33 learners)"):
        assert way in str(refusal.value)
    for space in ("hfmh", make_pipeline(RawHFMH(), ECOCClassifier("onevsall"))):
        model = Identifier.fit(data, space, estimate=False)
        assert len(model.core.to_bytes()) < MAX_FILE_BYTES


def test_bad_data_is_refused(data):
    for wrong, kind, message in (
        (data.X, TypeError, r"data must be a granular_id\.Dataset, got ndarray"),
        (data.select(labels="oat"), ValueError, "at least 2 classes, got only 'oat'"),
        (changed(data, label=lambda r: None), ValueError, "have no label"),
    ):
        with pytest.raises(kind, match=message):
            Identifier.fit(wrong)


def test_bad_recordings_are_refused(plain, best, data):
    for wrong, kind in ((data[0], TypeError), (data.X[:, :, :5], ValueError)):
        with pytest.raises(kind, match=r"must"):
            plain.predict(wrong)
    with pytest.raises(ValueError, match=r"shape \(80, 6\) as in the training, got \(79, 6\)"):
        plain.identify(data.X[0, 1:])
    broken = data.X[:2].copy()
    broken[1, 3, 2] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        plain.predict(broken)
    with pytest.raises(ValueError, match="recording 1"):  # too loud
        best.predict(np.stack([np.zeros((80, 6)), np.full((80, 6), 1e200)]))
    with pytest.raises(ValueError, match=r"wrench must have shape \(80, 6\)"):
        best.predict(np.zeros((79, 6)))


def test_bad_files_are_refused_by_name(plain, tmp_path):
    file = tmp_path / "m.safetensors"
    with pytest.raises(FileNotFoundError, match=r"m\.safetensors"):
        Identifier.load(file)
    file.write_bytes(plain.core.to_bytes()[:-1])
    with pytest.raises(ModelFileError, match=r"m\.safetensors"):
        Identifier.load(file)
    plain.save(file)
    with pytest.raises(ModelFileError, match=r"m\.safetensors.*max_file_bytes"):
        Identifier.load(file, max_file_bytes=1000)
    with pytest.raises(IsADirectoryError, match="is a folder, wanted a model file"):
        Identifier.load(tmp_path)
    with pytest.raises(OSError, match="folder"):
        plain.save(tmp_path)
    with pytest.raises(TypeError, match=r"Identifier\.load\(path\).*Model, got str"):
        Identifier("m.safetensors")
    assert issubclass(ModelFileError, ValueError)


def test_a_data_set_is_checked_before_it_is_answered():
    rng = np.random.default_rng(0)
    recordings = [Recording(rng.normal(k % 2, 1, (40, 6)), 125.0, label="ab"[k % 2]) for k in range(8)]
    data = Dataset(recordings)
    model = Identifier.fit(data, "raw", estimate=False)
    assert model.predict(data).tolist() == model.predict(data.X).tolist()
    other = Dataset([replace(recordings[0], rate_hz=100.0)])
    with pytest.raises(ValueError, match="100 Hz"):
        model.predict(other)
    with pytest.raises(TypeError, match=r"got a Dataset: pass them one by one, or call predict$"):
        model.identify(data)

"""Identifier: the labels and scores of the scikit-learn pipeline it was made from, in one file."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from sklearn.ensemble import RandomForestClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from evaluation_cases import LABELS, changed, make_data
from granular_id import DFT, HFMH, ECOCClassifier, RawHFMH, RawSignal, synthesize
from granular_id._core import MAX_MULTIBAND_VALUES, ModelFileError
from granular_id.identifier import SPACES, Identifier
from granular_id.identifier.model import MAX_FILE_BYTES
from granular_id.identifier.training import features_of, model_of, pipeline_of, refuse_large
from granular_id.recording import Dataset, Recording
from granular_id.spaces import BestClassifier, BlockScaler, WithinClassWhitening, feature_spaces, fit_pipeline
from granular_id.spaces.multiband import USUAL_BLOCKS, MultiBand
from granular_id.splits import groups_of


def assert_same_answers(identifier, pipeline, X):
    """Labels equal; scores within the rounding of a sum of their terms, and of folding steps into weights."""
    assert identifier.predict(X).tolist() == pipeline.predict(X).tolist()
    features, classifier = pipeline[:-1].transform(X), pipeline[-1]
    want = classifier.binary_scores(features)
    if len(pipeline) == 2 and not isinstance(pipeline[0], MultiBand):
        size = np.abs(features) @ np.abs(classifier.coef_).T + np.abs(classifier.intercept_)
        assert (np.abs(identifier.scores(X) - want) <= 1e-13 * size).all()
    np.testing.assert_allclose(identifier.scores(X), want, rtol=0, atol=1e-9 * (1 + np.abs(want).max()))
    values = classifier.decision_function(features)
    np.testing.assert_allclose(identifier.decision_function(X), values, rtol=0, atol=1e-4)


FOUR_CODES = [[1, 1], [-1, 1], [1, -1], [-1, -1]]


@pytest.mark.parametrize(
    "steps",
    [
        (RawSignal(rate_hz=500), ECOCClassifier()),
        (RawSignal(), ECOCClassifier(coding="onevsall", loss="root")),
        (HFMH(n_bins=7, bin_range="auto"), ECOCClassifier()),
        (HFMH(initial="steady", order=3, cutoff_hz=60.0), ECOCClassifier()),
        (RawHFMH(block_weights="unit", bin_range="auto"), ECOCClassifier()),
        (RawHFMH(block_weights=(2.0, 0.125)), ECOCClassifier(C=0.01)),
        (RawHFMH(), ECOCClassifier(coding=FOUR_CODES, loss="root")),
        (MultiBand(), BlockScaler(), WithinClassWhitening(1e-3), ECOCClassifier(C=1e-3)),
        (MultiBand(), BlockScaler(), ECOCClassifier("onevsall", loss="hinge", C=0.1)),
        (MultiBand(), BlockScaler(), BestClassifier(n_folds=2)),
        (MultiBand(), StandardScaler(), ECOCClassifier(C=0.1)),
        (MultiBand(), ECOCClassifier(C=1e-3)),
    ],
)
def test_fit_of_a_pipeline_answers_as_it_does(data, new, steps):
    pipeline = make_pipeline(*steps)
    identifier = Identifier.fit(data, pipeline, estimate=False)
    assert not hasattr(pipeline[-1], "coef_"), "the pipeline given is left as it is"
    fitted = fit_pipeline(pipeline_of(pipeline, 500.0, None)[1], data.X, data.y, groups_of(data))
    assert_same_answers(identifier, fitted, new.X)
    assert (identifier.classes, identifier.trained["settings"]["space"]) == (LABELS, "pipeline")
    np.testing.assert_array_equal(identifier.core.coding_matrix, fitted[-1].coding_matrix_)
    names = {RawSignal: "raw", HFMH: "hfmh", RawHFMH: "raw+hfmh", MultiBand: "multiband"}
    assert identifier.space == names[type(steps[0])]


@pytest.mark.parametrize("space", SPACES)
def test_named_space_is_that_of_an_evaluation(models, data, new, space):
    known = feature_spaces(rate_hz=500.0)[space]
    pipeline = make_pipeline(known.transformer, known.classifier or ECOCClassifier())
    fitted = fit_pipeline(pipeline, data.X, data.y, groups_of(data))
    assert_same_answers(models[space], fitted, new.X)
    assert models[space].space == models[space].trained["settings"]["space"] == space


@pytest.mark.parametrize("n_axes", [1, 2, 6])
def test_two_classes_and_any_number_of_axes(n_axes):
    names = tuple(f"a{i}" for i in range(n_axes))
    rng = np.random.default_rng(n_axes)
    waves = [rng.normal(k % 2, 1, (30, n_axes)) for k in range(8)]
    data = Dataset([Recording(x, 100.0, label="ba"[k % 2], axes=names) for k, x in enumerate(waves)])
    pipeline = make_pipeline(RawHFMH(rate_hz=100, cutoff_hz=20.0), ECOCClassifier()).fit(data.X, data.y)
    identifier = Identifier.fit(data, pipeline)
    assert_same_answers(identifier, pipeline, data.X)
    assert identifier.axes == names
    assert identifier.decision_function(data.X).shape == (8,)
    assert identifier.predict(data.X[0]).tolist() == [pipeline.predict(data.X[:1])[0]]


@pytest.mark.parametrize("space", ["raw+hfmh", "best"])
def test_file_gives_back_the_same_model(models, new, space, tmp_path):
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
def test_same_training_gives_the_same_bytes(data, space):
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


def test_trained_says_what_it_was_trained_on(data, plain):
    trained = plain.trained
    assert trained["recordings"] == dict.fromkeys(LABELS, 8)
    assert not trained["synthetic"]
    assert not plain.synthetic
    assert trained["n_sessions"] == 8
    assert trained["settings"]["space"] == "raw+hfmh"
    assert trained["settings"]["steps"][-1]["C"] == 1.0
    assert "threads" not in json.dumps(trained)
    assert plain.core.n_learners == 6
    digests = [
        Identifier.fit(each, "raw+hfmh", estimate=False).core.metadata["training_sha256"]
        for each in (changed(data, label=lambda r: r.label), data[::-1])
    ]
    assert digests[0] == plain.core.metadata["training_sha256"] != digests[1]
    assert len(digests[0]) == 64


def test_mean_of_the_training_completes_provisional_answers(data, models):
    assert np.array_equal(models["raw"].core.raw_mean, data.X.mean(0).T.ravel())
    assert models["hfmh"].core.raw_mean is None


def test_simulated_recordings_and_their_lead_are_in_the_file(tmp_path):
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


@pytest.mark.parametrize(
    ("make", "at_first"),
    [
        (lambda data: data, False),
        (lambda data: data.align(200), True),
        (lambda data: data.align(250, trigger="recorded").align(200), False),
        (lambda data: data.windows(0.2), True),
    ],
)
def test_requirements_know_whether_recordings_began_at_first(make, at_first):
    data = synthesize(["rice", "fine sugar"], n_per_class=3, duration_s=0.8, seed=3)
    data = make(Dataset([replace(r, trigger_index=k % 2 + 40) for k, r in enumerate(data)]))
    assert Identifier.fit(data, "hfmh", estimate=False).requirements.at_first is at_first


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
    with pytest.raises(TypeError, match=r"Identifier\.fit\(data\) or Identifier\.load\(path\).*got nothing"):
        Identifier()


def test_blocks_without_weights_are_not_computed(data):
    space = MultiBand(blocks=(*USUAL_BLOCKS, "level")).fit(data.X)
    features = space.transform(data.X)
    start = sum(space.block_sizes_.values()) - space.block_sizes_["level"]
    deaf = BestClassifier(n_folds=2).fit(features, data.y)
    deaf.coef_[:, start:] = 0.0
    core = model_of(make_pipeline(space, deaf), data)
    assert core.n_features == start
    assert np.array_equal(core.coef, deaf.coef_[:, :start])
    assert features_of(core, data.X).tobytes() == np.ascontiguousarray(features[:, :start]).tobytes()
    hearing = ECOCClassifier().fit(features, data.y)
    assert model_of(make_pipeline(space, hearing), data).n_features == features.shape[1]


OURS = "must be a pipeline of RawSignal, HFMH, RawHFMH or MultiBand, .*got"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"space": "dft"}, "space must be one of 'best', 'multiband', 'raw', .*, got 'dft'"),
        ({"space": make_pipeline(DFT(), ECOCClassifier())}, f"space {OURS} DFT, ECOCClassifier"),
        ({"space": make_pipeline(RawSignal(), RandomForestClassifier(2))}, f"{OURS} RawSignal, RandomForest"),
        ({"space": make_pipeline(MultiBand(), MultiBand(), ECOCClassifier())}, f"{OURS} MultiBand, Mul"),
        ({"space": make_pipeline(HFMH(rate_hz=100.0), ECOCClassifier())}, "for 100 Hz, .* have 500 Hz"),
        ({"space": make_pipeline(HFMH(), ECOCClassifier(C=-1.0))}, "C"),
        ({"target_error": 1.0}, "target_error must lie between 0 and 1, got 1"),
        ({"coverage": 0.0}, "coverage must lie between 0 and 1, got 0"),
        ({"share_known": 1.0}, "share_known must lie between 0 and 1, got 1"),
        ({"estimate": "no"}, "estimate"),
        ({"by": "speed"}, "speed"),
        ({"progress": 3}, "progress"),
        ({"data": np.zeros((9, 80, 6))}, r"data must be a granular_id\.Dataset, got ndarray"),
        ({"data": make_data(4)[:4]}, "at least 2 classes, got only 'oat'"),
        ({"data": changed(make_data(4), label=lambda r: None)}, "have no label"),
    ],
)
def test_fit_of_bad_arguments_is_refused(data, settings, message):
    with pytest.raises((ValueError, TypeError), match=message):
        Identifier.fit(**{"data": data, "space": "raw+hfmh", **settings})


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


def test_bad_recordings_are_refused(plain, best, data):
    with pytest.raises(TypeError, match=r"must"):
        plain.predict(data[0])
    for model, wrong, message in (
        (plain, np.where(np.arange(480).reshape(80, 6) == 99, np.nan, data.X[:2]), "NaN"),
        (best, np.stack([np.zeros((80, 6)), np.full((80, 6), 1e200)]), "recording 1"),  # too loud
        (best, np.zeros((79, 6)), r"wrench must have shape \(80, 6\)"),
    ):
        with pytest.raises(ValueError, match=message):
            model.predict(wrong)
    with pytest.raises(ValueError, match=r"shape \(80, 6\) as in the training, got \(79, 6\)"):
        plain.identify(data.X[0, 1:])
    with pytest.raises(TypeError, match=r"got a Dataset: pass them one by one, or call predict$"):
        plain.identify(data)


def test_data_set_is_checked_before_it_is_answered(plain, new):
    assert plain.predict(new).tolist() == plain.predict(new.X).tolist()
    with pytest.raises(ValueError, match="100 Hz"):
        plain.predict(Dataset([replace(new[0], rate_hz=100.0)]))


def test_identify_crops_recordings_as_the_training(data):
    model = Identifier.fit(Dataset([replace(r, trigger_index=5) for r in data]), "hfmh", estimate=False)
    whole = Recording(np.concatenate([data.X[0], data.X[1]]), rate_hz=500.0, trigger_index=20)
    answer = model.identify(whole)
    assert answer.final
    assert answer.ranking == model.identify(whole.wrench[15:95]).ranking


@pytest.mark.parametrize("space", ["best", "multiband"])
def test_recordings_too_long_are_refused_before_training(monkeypatch, space):
    monkeypatch.setattr("granular_id.identifier.training.fit_on_features", None)
    longest = MAX_MULTIBAND_VALUES // 6
    refuse_large(pipeline_of(space, 500.0, None)[1], 2, np.zeros((1, longest, 6)))
    wrench = np.zeros((longest + 1, 6))
    long = Dataset([Recording(wrench, 500.0, label=label, name=label) for label in ("oat", "rice")])
    with pytest.raises(ValueError, match=f"{longest + 1} samples .* are too long .* take space='hfmh'$"):
        Identifier.fit(long, space)

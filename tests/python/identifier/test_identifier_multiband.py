"""Models of multi-band features: the labels of their pipelines, the same bits from streams, what was chosen."""

import json
import re

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import multiband_twin as twin
from cli_cases import ended_well, refused, saved
from evaluation_cases import LABELS
from granular_id import ECOCClassifier, FeatureSpec
from granular_id._core import MAX_MULTIBAND_VALUES
from granular_id.identifier import Identifier, StreamingIdentifier, describe_model, describe_performance
from granular_id.identifier.adapt import features_of
from granular_id.identifier.core import pipeline_of, plain_features
from granular_id.identifier.training import refuse_large
from granular_id.recording import Dataset, Recording
from granular_id.spaces import BlockScaler, WithinClassWhitening, feature_spaces, fit_pipeline
from granular_id.spaces.best import BestClassifier
from granular_id.spaces.multiband import ALL_BLOCKS, USUAL_BLOCKS, MultiBand
from granular_id.splits import groups_of


def same_answers(identifier, pipeline, X):
    """Labels equal; scores within the rounding of folding scaling and whitening into weights."""
    assert identifier.predict(X).tolist() == pipeline.predict(X).tolist()
    want = pipeline[-1].binary_scores(pipeline[:-1].transform(X))
    np.testing.assert_allclose(identifier.scores(X), want, rtol=0, atol=1e-9 * (1 + np.abs(want).max()))


def own(*steps):
    return make_pipeline(MultiBand(), *steps)


@pytest.mark.parametrize(
    "pipeline",
    [
        own(BlockScaler(), WithinClassWhitening(1e-3), ECOCClassifier(C=1e-3)),
        own(BlockScaler(), ECOCClassifier("onevsall", loss="hinge", C=0.1)),
        own(BlockScaler(), BestClassifier(n_folds=2)),
        "multiband",
        "best",
    ],
)
def test_labels_and_scores_are_those_of_the_pipeline(data, new, pipeline):
    identifier = Identifier.fit(data, pipeline, estimate=False)
    _, pipeline = pipeline_of(pipeline, 500.0, None)
    same_answers(identifier, fit_pipeline(pipeline, data.X, data.y, groups_of(data)), new.X)
    assert identifier.classes == LABELS


def test_pipelines_are_taken_over_whatever_scales_in_between(data, new):
    for steps in (
        [BlockScaler(), WithinClassWhitening(), ECOCClassifier()],
        [StandardScaler(), ECOCClassifier(C=0.1)],
        [ECOCClassifier(C=1e-3)],
        [BlockScaler(), BestClassifier(n_folds=2)],
    ):
        pipeline = make_pipeline(MultiBand(), *steps).fit(data.X, data.y)
        same_answers(Identifier.from_classifier(pipeline), pipeline, new.X)
    with pytest.raises(TypeError, match="got MultiBand, MultiBand, ECOCClassifier"):
        Identifier.from_classifier(make_pipeline(MultiBand(), MultiBand(), ECOCClassifier()))


def test_multiband_is_the_same_in_models_and_in_evaluations(data, new):
    space = feature_spaces(rate_hz=500.0)["multiband"]
    pipeline = fit_pipeline(make_pipeline(space.transformer, space.classifier), data.X, data.y)
    identifier = Identifier.fit(data, "multiband", estimate=False)
    same_answers(identifier, pipeline, new.X)
    assert identifier.core.loss == space.classifier.loss
    values = pipeline.decision_function(new.X)
    np.testing.assert_allclose(-identifier.core.losses(identifier.scores(new.X)), values, atol=1e-4)


def test_features_are_those_of_the_twin(data, new, tmp_path):
    space = MultiBand(blocks=ALL_BLOCKS)
    model = make_pipeline(space, BlockScaler(), ECOCClassifier()).fit(data.X, data.y)
    Identifier.from_classifier(model).save(tmp_path / "m.safetensors")
    identifier = Identifier.load(tmp_path / "m.safetensors")
    spec, core = identifier.spec, identifier.core
    assert spec == space.extractor_
    assert any(line.startswith("  level: ") for line in describe_model(identifier))
    scales, levels = twin.learned_scales(data.X)
    np.testing.assert_allclose(spec.scales, scales, rtol=1e-5)
    np.testing.assert_allclose(spec.level_scales, levels, rtol=1e-9)
    rows = np.array([twin.features(x, scales, levels) for x in new.X])
    np.testing.assert_allclose(rows @ core.coef.T + core.intercept, identifier.scores(new.X), atol=1e-4)


def test_scores_add_up_in_the_order_that_the_file_promises(best, new):
    core = best.core
    for x in new.X[:3]:
        sums = np.zeros(core.n_learners)
        for weights, value in zip(core.coef.T, core.spec.extract(x), strict=True):
            sums += weights * value
        assert np.array_equal(core.intercept + sums, core.scores(x)[0])


@pytest.mark.parametrize("size", [1, 7, 80])
def test_a_stream_gives_the_bits_of_the_batch(best, new, size):
    stream = StreamingIdentifier(best)
    for k, x in enumerate(new.X[:4]):
        stream.reset()
        for start in range(0, len(x), size):
            stream.push(x[start : start + size])
            early = stream.decision()
            assert early.final == (stream.n_seen == len(x))
        assert np.array_equal(stream.core.scores(), best.scores(new.X[k : k + 1])[0])
        whole = best.identify(x)
        assert (early.label, early.ranking, early.probability) == (
            whole.label,
            whole.ranking,
            whole.probability,
        )


def test_a_provisional_answer_is_that_of_the_beginning(best, new):
    stream, x = StreamingIdentifier(best), new.X[0]
    stream.push(x[:33])
    features = best.spec.extract(x[:33])
    np.testing.assert_allclose(
        stream.core.scores(), best.core.coef @ features + best.core.intercept, rtol=1e-9, atol=1e-9
    )


def test_windows_of_a_stream_are_recordings(best, new):
    signal = np.concatenate(new.X[:3])
    stream = StreamingIdentifier(best, hop=30)
    taken = windows = 0
    while taken < len(signal):
        taken += stream.push(signal[taken : taken + 11])
        if stream.is_complete:
            first = stream.core.first_row
            window = signal[first : first + best.n_samples]
            assert np.array_equal(stream.core.scores(), best.scores(window)[0])
            stream.next()
            windows += 1
    assert windows == (240 - 80) // 30 + 1


def test_what_was_chosen_is_known_and_said(best):
    choice = best.trained["choice"]
    assert choice["held_out"] == "sessions"
    assert choice["chosen"]
    assert len(choice["machines"]) == 12
    assert best.trained["settings"]["space"] == best.space == "best"
    said = describe_performance(best)
    assert any(
        f"{len(choice['chosen'])} of 12 candidate models, on {choice['note']}" in line for line in said
    )
    elsewhere = choice["in_folds"]
    assert len({one["held_out"] for one in elsewhere}) == best.trained["estimate"]["n_folds"]
    names = {machine["name"] for machine in choice["machines"]}
    for one in elsewhere:
        assert set(one["chosen"]) <= names
        assert one["note"].startswith("the earlier and the later half")  # of two sessions one trains
        assert one["accuracy_on_the_folds_that_chose"] > 0.5
    for machine in choice["machines"]:
        (line,) = (line for line in said if line[4:].startswith(f"{machine['name']} "))
        assert line.startswith("  > ") == (machine["name"] in choice["chosen"])
        assert f" {100 * np.mean(machine['accuracies']):.1f} % " in line
        times = sum(machine["name"] in one["chosen"] for one in elsewhere)
        assert line.endswith(f" {times} of {len(elsewhere)}")
    lines = "\n".join(describe_model(best))
    assert "band, Hz: typical size of each axis" in lines
    assert "  123 to 245: " in lines or "  122 to 245: " in lines
    assert "480 quantiles" in lines or "quantiles" in lines


def test_blocks_that_no_learner_hears_are_not_computed(data):
    space = MultiBand(blocks=(*USUAL_BLOCKS, "level")).fit(data.X)
    classifier = ECOCClassifier().fit(space.transform(data.X), data.y)
    start = sum(space.block_sizes_.values()) - space.block_sizes_["level"]
    deaf = BestClassifier(n_folds=2).fit(space.transform(data.X), data.y)
    deaf.coef_[:, start:] = 0.0
    identifier = Identifier.from_classifier(make_pipeline(space, deaf))
    assert identifier.space == "multiband"
    assert identifier.core.n_features == start
    assert np.array_equal(identifier.core.coef, deaf.coef_[:, :start])
    rows = plain_features(space, space.transform(data.X), identifier.spec)
    assert rows.tobytes() == features_of(identifier.core, data.X).tobytes()
    both = Identifier.from_classifier(make_pipeline(space, classifier))
    assert both.space == "multiband+level"
    assert both.core.n_features == classifier.coef_.shape[1]


@pytest.mark.parametrize("space", ["best", "multiband"])
def test_recordings_too_long_for_a_file_are_refused_before_anything_is_trained(monkeypatch, space):
    monkeypatch.setattr("granular_id.identifier.training.fit_on_features", None)
    longest = MAX_MULTIBAND_VALUES // 6
    refuse_large(pipeline_of(space, 500.0, None)[1], 2, np.zeros((1, longest, 6)))
    wrench = np.zeros((longest + 1, 6))
    long = Dataset([Recording(wrench, 500.0, label=label, name=label) for label in ("oat", "rice")])
    wanted = (
        f"recordings of {longest + 1} samples of 6 axes are too long for a model of multi-band features: "
        f"{6 * longest + 6} values, at most {MAX_MULTIBAND_VALUES}; shorten them, or take space='hfmh'"
    )
    with pytest.raises(ValueError, match=f"^{re.escape(wanted)}$"):
        Identifier.fit(long, space)


def test_the_command_line_trains_chooses_and_tells(tmp_path, data):
    folder, file = saved(data, tmp_path / "data"), tmp_path / "m.safetensors"
    out = ended_well("train", folder, "-o", file, "--target-error", 0.2)
    assert "accuracy, held-out sessions: " in out
    said = ended_well("model", "info", file, "--json", tmp_path / "m.json")
    assert "features: best, " in said
    assert "chosen (>): " in said
    chosen = said[said.index("chosen (>)") : said.index("early answers")]
    assert chosen in out
    assert len(chosen.splitlines()) == 2 + 12 + 1
    assert "note: recordings of 80 samples are too short for couplings of axes in the lowest" in out
    known = json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))
    assert known["trained"]["choice"]["chosen"]
    assert len(known["spec"]["scales"]) == len(known["spec"]["bands"])
    assert "named rightly" in ended_well("identify", file, folder)
    line = refused("train", folder, "-o", tmp_path / "n", "--C", "3")
    assert "--C must be left out with --space best" in line
    paper = ended_well("train", folder, "-o", tmp_path / "p", "--space", "raw+hfmh", "--target-error", 0.2)
    assert "accuracy, held-out sessions: " in paper
    assert isinstance(Identifier.load(tmp_path / "p").spec, FeatureSpec)

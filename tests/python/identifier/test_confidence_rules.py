"""Candidates, probabilities and refusals of a model: in its file, in streams and in batches."""

import copy
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

import granular_id as gid
from evaluation_cases import LABELS
from granular_id import HFMH, ECOCClassifier
from granular_id._core import Model, ModelFileError
from granular_id.confidence import CandidateRule, Novelty, UnknownRule, softmax
from granular_id.confidence.novelty import scaled
from granular_id.identifier import Identifier, StreamingIdentifier, describe_performance, identify_all
from granular_id.identifier.model import RULES
from granular_id.identifier.training import features_of
from model_cases import put_together, taken_apart, with_trained

GOLDEN = Path(__file__).parents[2] / "data" / "rules"


@pytest.fixture(scope="module")
def identifier(models):
    return models["hfmh"]


def distances(core, X):
    """Return what the novelty of recordings is made of, in plain numpy."""
    scaling, *fitted = core.novelty
    return Novelty(*fitted).parts(scaled(features_of(core, X), scaling))


def with_rules(model, **rules):
    """Return a model with these rules alone."""
    stored = {name: rule.to_dict() for name, rule in rules.items()}
    return Identifier(with_trained(model.core, {RULES: stored}))


def file_of(core, trained):
    """Return a file of a model with something else known of its training, which need not make sense."""
    metadata, tensors = taken_apart(core.to_bytes())
    return put_together({**metadata, "trained": json.dumps(trained)}, tensors)


def test_rules_are_set_on_held_out_recordings_and_come_back(identifier, tmp_path):
    candidates, unknown = rules = identifier.confidence_rules()
    assert (candidates.level, candidates.n_rows, candidates.n_sessions) == (0.8, 32, 8)
    assert (unknown.share_known, unknown.held_out) == (0.9, "held-out sessions")
    assert candidates.classes == unknown.classes == LABELS
    identifier.save(tmp_path / "m.safetensors")
    same = Identifier.load(tmp_path / "m.safetensors")
    assert same.confidence_rules() == rules
    assert same.temperature == identifier.temperature > 0
    stored = identifier.trained[RULES]
    assert CandidateRule.from_dict(stored["candidates"]).to_dict() == stored["candidates"]
    assert UnknownRule.from_dict(stored["unknown"]).to_dict() == stored["unknown"]


def test_final_decisions_have_candidates_and_probabilities(identifier, data):
    """What streams, whole recordings and batches say is what the rules say in plain numpy; provisional: nothing."""
    (candidates, unknown), stream = identifier.confidence_rules(), StreamingIdentifier(identifier)
    values, known = identifier.decision_function(data.X), unknown.knows(distances(identifier.core, data.X))
    shares = softmax(values, identifier.temperature)
    np.testing.assert_allclose(identifier.predict_proba(data.X), shares)
    assert (shares.argmax(axis=1) == values.argmax(axis=1)).all()
    batch = list(identify_all(identifier, data).each())
    for k, x in enumerate(data.X[:6]):
        stream.reset()
        stream.push(x[:40])
        early = stream.decision()
        assert (early.candidates, early.unknown, early.probability) == ((), None, None)
        stream.push(x[40:])
        decision = stream.decision()
        assert decision.candidates == candidates.names(values[k])
        assert decision.unknown == (not known[k])
        assert decision.candidates[0] == decision.label
        assert decision.probability == pytest.approx(shares[k].max())
        assert decision.to_dict()["candidates"] == list(decision.candidates)
        assert decision.unknown == ("like no known material" in str(decision))
        assert identifier.identify(x) == decision
        for name in ("label", "margin", "candidates", "unknown", "probability"):
            assert batch[k][name] == getattr(decision, name)


@pytest.mark.parametrize("space", ["raw", "hfmh", "raw+hfmh", "multiband", "best"])
def test_novelty_of_the_core_is_that_of_numpy(models, data, space):
    model = models[space]
    unknown = model.confidence_rules()[1]
    scores, novelty = model.core.scores_and_novelty(data.X)
    np.testing.assert_allclose(novelty, unknown.novelty(distances(model.core, data.X)), rtol=1e-6)
    assert scores.tobytes() == model.scores(data.X).tobytes()
    alone = [model.core.scores_and_novelty(x, threads=1)[1][0] for x in data.X]
    assert alone == novelty.tolist()
    # A stream refuses exactly where the batch does, to the last bit.
    k = int(np.argsort(novelty)[len(novelty) // 2])
    for limit, refused in ((novelty[k], False), (np.nextafter(novelty[k], 0.0), True)):
        rule = replace(unknown, threshold=float(limit))
        stream = StreamingIdentifier(with_rules(model, unknown=rule), hop=7)
        stream.push(np.concatenate([data.X[0][-7:], data.X[k][:10]]))
        stream.reset()
        for row in data.X[k]:
            stream.push(row)
        assert stream.decision().unknown is refused


def test_novelty_of_overlapping_windows_is_that_of_each(models, data):
    model = models["raw"]
    unknown, drive = model.confidence_rules()[1], np.concatenate(data.X[:2])
    windows = np.array([drive[k : k + model.n_samples] for k in range(0, model.n_samples, 25)])
    novelty = model.core.scores_and_novelty(windows)[1]
    rule = replace(unknown, threshold=float(np.median(novelty)))
    stream, refused = StreamingIdentifier(with_rules(model, unknown=rule), hop=25), []
    row = 0
    while len(refused) < len(windows):
        row += stream.push(drive[row:])
        refused.append(stream.decision().unknown)
        stream.next()
    assert refused == (novelty > rule.threshold).tolist()


ONE_VS_ALL = {"space": make_pipeline(HFMH(), ECOCClassifier("onevsall"))}


@pytest.mark.parametrize("settings", [ONE_VS_ALL, {"share_known": None}, {"coverage": None}])
@pytest.mark.parametrize("n_classes", [2, 3])
def test_streams_apply_the_rules_of_other_models(data, settings, n_classes):
    chosen = [k for k, label in enumerate(data.y) if label in LABELS[:n_classes]]
    usual = {"space": "hfmh", "coverage": 0.8, "share_known": 0.6}
    model = Identifier.fit(data[chosen], target_error=0.2, **usual | settings)
    candidates, unknown = model.confidence_rules()
    for x, losses in zip(data.X, model.losses(data.X), strict=True):
        decision = model.identify(x)
        names = () if candidates is None else candidates.names(-losses)
        assert decision.candidates == names
        known = None if unknown is None else unknown.knows(distances(model.core, x[None])).item()
        assert decision.unknown == (None if known is None else not known)


def test_package_says_what_numpy_and_the_rust_crate_say():
    """Of 60 synthetic pushes of known materials and 20 of others; ``tests/model.rs`` does the same for the crate."""
    model = Identifier.load(GOLDEN / "model.safetensors")
    X = np.fromfile(GOLDEN / "wrench.f32", "<f4").reshape(80, model.n_samples, 6).astype(np.float64)
    wanted = (GOLDEN / "answers.txt").read_text(encoding="utf-8").splitlines()
    decisions = [model.identify(x) for x in X]
    assert [f"{d.label}\t{', '.join(d.candidates)}\t{d.unknown}" for d in decisions] == wanted
    found = model.core.apply_rules(*model.core.scores_and_novelty(X))
    assert found == [(decision.candidates, decision.unknown) for decision in decisions]


def test_table_has_a_column_for_each_rule_of_the_model(identifier, data):
    batch = identify_all(identifier, data)
    rows = [dict(zip(batch.table().header, row, strict=True)) for row in batch.table().rows]
    assert [row["unknown"] for row in rows] == ["yes" if unknown else "" for unknown in batch.unknown]
    assert [row["may be"] for row in rows] == [", ".join(few) for few in batch.candidates]
    header = identify_all(Identifier.fit(data, "hfmh", coverage=None), data).table().header
    assert "unknown" in header
    assert "may be" not in header


def test_model_without_rules_says_nothing(data):
    none = Identifier.fit(data, "hfmh", coverage=None, share_known=None)
    assert RULES not in none.trained
    decision = none.identify(data[0])
    assert (decision.candidates, decision.unknown) == ((), None)
    assert {"candidates: none", "unknown materials: none"} <= set(describe_performance(none))
    bare = Identifier.fit(data, "hfmh", estimate=False)
    assert RULES not in bare.trained
    assert (bare.temperature, bare.identify(data[0]).probability) == (None, None)
    assert "probabilities: none: no recordings were held out" in describe_performance(bare)
    with pytest.raises(ValueError, match="probabilit"):
        bare.predict_proba(data.X)


def test_novelty_parts_that_do_not_fit_are_refused(identifier):
    core, rule = identifier.core, identifier.trained[RULES]["unknown"]
    metadata, tensors = taken_apart(core.to_bytes())
    means, directions = tensors["unknown_means"], tensors["unknown_directions"]
    nan = np.full_like(directions, np.nan)
    for changes, message in (
        ({"unknown_means": means[1:]}, r"unknown_means must have shape \(4, "),
        ({"unknown_scaling": tensors["unknown_scaling"][:, 1:]}, r"unknown_scaling must have shape \(2, "),
        ({"unknown_directions": nan}, r"\[0, 0\] must be finite"),
        ({"unknown_means": means.astype("f8")}, r"must be float32 \(F32\)"),
    ):
        with pytest.raises(ModelFileError, match=message):
            Model.from_bytes(put_together(metadata, {**tensors, **changes}))
    without = {name: values for name, values in tensors.items() if name != "unknown_means"}
    with pytest.raises(ModelFileError, match="tensor 'unknown_means' is missing"):
        Model.from_bytes(put_together(metadata, without))
    for some, rules in ((core, {}), (with_trained(core, {}), {"unknown": rule})):
        with pytest.raises(ModelFileError, match="novelty must be there exactly if a rule refuses"):
            Model.from_bytes(file_of(some, {RULES: rules}))
    with pytest.raises(ValueError, match="novelty"):
        core.apply_rules(np.zeros((1, core.n_learners)))


CHOICE = {"note": "", "random_state": 4, "chosen": [], "in_folds": []}
CHOICE["accuracy_on_the_folds_that_chose"] = None


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("confidence", [], "trained: is no such JSON"),
        ("confidence.other", {}, "unknown field `other`"),
        ("confidence.candidates", {}, "missing field `classes`"),
        ("confidence.candidates.format", "2", "candidates: 'format' must be 'granular-id candidates 1'"),
        ("confidence.candidates.level", 1.5, "candidates: 'level', 'mean' and 'worst' must be numbers"),
        ("confidence.candidates.classes", list("abcd"), "candidates: 'classes' must be the labels"),
        ("confidence.unknown.threshold", "1", 'string "1", expected f64'),
        ("confidence.unknown.weights", [1.0, -1.0], "unknown: 'weights' must be at least 0"),
        ("recordings", {"a": "3"}, "recordings.a must be a whole number, got '3'"),
        ("estimate", {"held_out": "x"}, "estimate must hold 'note', got"),
        ("early", {"why_not": "", "target_error": 0.1}, "early must hold 'answered_early', got"),
        ("notes", "none", "notes must be a list, got 'none'"),
        ("history", [{"step": "align"}], r"history\[0\] must hold 'parameters', got \['step'\]"),
        ("choice", {**CHOICE, "machines": []}, "choice.machines must hold at least one"),
        ("choice", {**CHOICE, "machines": [{"name": "a"}]}, r"choice.machines\[0\] must hold 'chosen'"),
        ("adapted", ["shift"], "adapted must be text"),
        ("source", {"mean": None, "sd": "", "scores": 3}, "source.scores must be text"),
    ],
)
def test_load_refuses_what_a_model_cannot_say(identifier, tmp_path, path, value, message):
    trained = copy.deepcopy(identifier.trained)
    *parents, last = path.split(".")
    place = trained
    for name in parents:
        place = place[name]
    place[last] = value
    file = tmp_path / "m.safetensors"
    file.write_bytes(file_of(identifier.core, trained))
    with pytest.raises(ModelFileError, match=message) as caught:
        Identifier.load(file)
    assert str(caught.value).startswith(str(file))


KNOWN, BESIDE = ("clay granules", "fine sugar", "macaroni", "rice"), ("breadcrumbs", "dry peas", "oat flakes")


def test_background_is_refused_and_trains_no_classifier():
    """SYNTHETIC pushes of six sessions, then of six others."""
    data, new = (
        gid.synthesize([*KNOWN, *BESIDE], 12, 6, seed=seed, duration_s=1.6, rate_hz=250.0)
        for seed in (0, 100)
    )
    bare = {"space": "multiband", "target_error": None}
    without = Identifier.fit(data.select(labels=KNOWN), **bare)
    model = Identifier.fit(data, background=BESIDE, **bare)
    assert model.classes == KNOWN
    assert model.trained["background"] == dict.fromkeys(BESIDE, 12)
    assert model.trained["recordings"] == dict.fromkeys(KNOWN, 12)
    unknown = new.select(labels=BESIDE).X
    assert model.identify(unknown[0]).label in KNOWN
    refused = [
        (one.core.scores_and_novelty(unknown)[1] > one.trained[RULES]["unknown"]["threshold"]).mean()
        for one in (without, model)
    ]
    assert refused[1] > 0.8 > refused[0]
    assert without.core.coef.tobytes() == model.core.coef.tobytes()
    assert [len(part) for part in without.core.novelty] == [2, 3, 4]
    assert [len(part) for part in model.core.novelty] == [2, 6, 4]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"background": "rice"}, "background must be a sequence of labels, got 'rice'"),
        ({"background": ["sand"]}, "background names 'sand', of which there is no recording"),
        ({"background": ["rice"], "share_known": None}, "background has no use where nothing is refused"),
        ({"background": ["rice"], "estimate": False}, "background has no use where nothing is refused"),
        ({"background": KNOWN[1:]}, "at least 2 classes"),
    ],
)
def test_background_that_has_no_use_is_refused(settings, message):
    data = gid.synthesize(KNOWN, 3, duration_s=0.4)
    with pytest.raises((TypeError, ValueError), match=message):
        Identifier.fit(data, "hfmh", **settings)

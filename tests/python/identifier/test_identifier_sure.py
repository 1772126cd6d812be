"""Candidates and refusals of a model: kept in its file, checked when read, the same from streams and batches."""

import json
import subprocess
import sys
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline

from evaluation_cases import LABELS
from granular_id import HFMH, ECOCClassifier
from granular_id._core import Model, ModelFileError
from granular_id.confidence import CandidateRule, Novelty, UnknownRule, candidate_rule, softmax
from granular_id.confidence.novelty import scaled
from granular_id.identifier import (
    Identifier,
    StreamingIdentifier,
    describe_model,
    describe_performance,
    identify_all,
)
from granular_id.identifier.adapt import features_of
from granular_id.identifier.rules import KEY, confidence_rules
from granular_id.recording import Dataset
from model_cases import put_together, taken_apart

GOLDEN = Path(__file__).parents[2] / "data" / "rules"

CHOICE = {
    "note": "halves",
    "random_state": 4,
    "machines": [],
    "chosen": ["plain, C 1"],
    "accuracy_on_the_folds_that_chose": None,
    "in_folds": [],
}


@pytest.fixture(scope="module")
def identifier(data):
    return Identifier.fit(data, "hfmh", coverage=0.8, share_known=0.9, target_error=0.2)


def changed(core, trained):
    return Model(
        core.spec,
        core.coef,
        core.intercept,
        core.coding_matrix,
        core.classes,
        n_samples=core.n_samples,
        metadata={**core.metadata, "trained": json.dumps(trained)},
        novelty=core.novelty if "unknown" in trained.get(KEY, ()) else None,
    )


def distances(core, X):
    """Return what the novelty of recordings is made of, in plain numpy."""
    scaling, *fitted = core.novelty
    return Novelty(*fitted).parts(scaled(features_of(core, X), scaling))


def changed_rule(core, rule):
    """Return a model with another rule of refusal, and streams of it."""
    (spec, coef, intercept, coding, classes), options = core.__getnewargs_ex__()
    metadata = {**core.metadata, "trained": json.dumps({KEY: {"unknown": rule.to_dict()}})}
    return Model(spec, coef, intercept, coding, classes, **{**options, "metadata": metadata})


def file_of(core, trained):
    """Return a file of a model with something else known of its training, which need not make sense."""
    metadata, tensors = taken_apart(core.to_bytes())
    return put_together({**metadata, "trained": json.dumps(trained)}, tensors)


def of_candidates(**changes):
    return lambda rules: {**rules, "candidates": {**rules["candidates"], **changes}}


def of_unknown(**changes):
    return lambda rules: {**rules, "unknown": {**rules["unknown"], **changes}}


def test_rules_are_set_on_the_recordings_held_out_and_come_back(identifier, tmp_path):
    candidates, unknown = rules = confidence_rules(identifier.core)
    assert (candidates.level, candidates.n_rows, candidates.n_sessions) == (0.8, 32, 8)
    assert (unknown.share_known, unknown.held_out) == (0.9, "held-out sessions")
    assert candidates.classes == unknown.classes == LABELS
    identifier.save(tmp_path / "m.safetensors")
    assert confidence_rules(Identifier.load(tmp_path / "m.safetensors").core) == rules
    stored = identifier.trained[KEY]
    assert CandidateRule.from_dict(stored["candidates"]).to_dict() == stored["candidates"]
    assert UnknownRule.from_dict(stored["unknown"]).to_dict() == stored["unknown"]


def test_final_decisions_name_candidates_and_provisional_ones_do_not(identifier, data):
    (candidates, unknown), stream = confidence_rules(identifier.core), StreamingIdentifier(identifier)
    values, known = identifier.decision_function(data.X), unknown.knows(distances(identifier.core, data.X))
    batch = identify_all(identifier.core, data)
    for k, x in enumerate(data.X[:6]):
        stream.reset()
        stream.push(x[:40])
        early = stream.decision()
        assert (early.candidates, early.unknown) == ((), None)
        stream.push(x[40:])
        decision = stream.decision()
        assert decision.candidates == candidates.names(values[k])
        assert decision.unknown == (not known[k])
        assert decision.candidates[0] == decision.label
        assert decision.to_dict()["candidates"] == list(decision.candidates)
        whole = identifier.identify(x)
        assert (whole.candidates, whole.unknown) == (decision.candidates, decision.unknown)
        assert (batch.each[k].candidates, batch.each[k].unknown) == (decision.candidates, decision.unknown)
    assert batch.to_dict()["recordings"][0]["candidates"] == list(batch.each[0].candidates)


def test_core_rules_judge_as_numpy_does(identifier, data):
    """The answers of streams, recordings and batches are those of the rules in plain numpy."""
    values, novelty = identifier.decision_function(data.X), identifier.core.scores_and_novelty(data.X)[1]
    truth = np.array([LABELS.index(label) for label in data.y])
    rule = candidate_rule(LABELS, values, truth, data.sessions, 0.8)
    other = replace(confidence_rules(identifier.core)[1], threshold=float(np.median(novelty)))
    core = changed(identifier.core, {KEY: {"candidates": rule.to_dict(), "unknown": other.to_dict()}})
    scores, novelty = core.scores_and_novelty(data.X)
    known = other.knows(distances(core, data.X))
    names = [rule.names(row) for row in values]
    expected = list(zip(names, (~known).tolist(), strict=True))
    assert core.verdicts(scores, novelty) == expected
    assert core.verdicts(scores[0], novelty[:1]) == expected[:1]
    stream = StreamingIdentifier(core)
    for x, said in zip(data.X, expected, strict=True):
        stream.reset()
        stream.push(x)
        decision = stream.decision()
        assert (decision.candidates, decision.unknown) == said


def test_probabilities_are_a_softmax_with_the_temperature(identifier, data, tmp_path):
    shares = softmax(identifier.decision_function(data.X), identifier.temperature)
    np.testing.assert_allclose(identifier.predict_proba(data.X), shares)
    assert (shares.argmax(axis=1) == identifier.decision_function(data.X).argmax(axis=1)).all()
    batch, stream = identify_all(identifier.core, data), StreamingIdentifier(identifier)
    for k, x in enumerate(data.X[:5]):
        stream.reset()
        stream.push(x[:40])
        assert stream.decision().probability is None
        stream.push(x[40:])
        decision = stream.decision()
        assert decision.probability == identifier.identify(x).probability == batch.each[k].probability
        assert decision.probability == pytest.approx(shares[k].max())
    identifier.save(tmp_path / "m.safetensors")
    assert Identifier.load(tmp_path / "m.safetensors").temperature == identifier.temperature > 0


@pytest.mark.parametrize("space", ["raw", "hfmh", "raw+hfmh", "multiband", "best"])
def test_novelty_of_the_core_is_that_of_numpy(data, space):
    model = Identifier.fit(data, space, target_error=0.2)
    unknown = confidence_rules(model.core)[1]
    scores, novelty = model.core.scores_and_novelty(data.X)
    np.testing.assert_allclose(novelty, unknown.novelty(distances(model.core, data.X)), rtol=1e-6)
    assert scores.tobytes() == model.scores(data.X).tobytes()
    alone = [model.core.scores_and_novelty(x, threads=1)[1][0] for x in data.X]
    assert alone == novelty.tolist()
    # A stream refuses exactly where the batch does, to the last bit.
    k = int(np.argsort(novelty)[len(novelty) // 2])
    for limit, refused in ((novelty[k], False), (np.nextafter(novelty[k], 0.0), True)):
        rule = replace(unknown, threshold=float(limit))
        stream = StreamingIdentifier(changed_rule(model.core, rule), hop=7)
        stream.push(np.concatenate([data.X[0][-7:], data.X[k][:10]]))
        stream.reset()
        for row in data.X[k]:
            stream.push(row)
        assert stream.decision().unknown is refused


def test_novelty_of_windows_that_overlap_is_that_of_each_alone(data):
    model = Identifier.fit(data, "raw", target_error=0.2)
    unknown, drive = confidence_rules(model.core)[1], np.concatenate(data.X[:2])
    windows = np.array([drive[k : k + model.n_samples] for k in range(0, model.n_samples, 25)])
    novelty = model.core.scores_and_novelty(windows)[1]
    rule = replace(unknown, threshold=float(np.median(novelty)))
    stream, refused = StreamingIdentifier(changed_rule(model.core, rule), hop=25), []
    row = 0
    while len(refused) < len(windows):
        row += stream.push(drive[row:])
        refused.append(stream.decision().unknown)
        stream.next()
    assert refused == (novelty > rule.threshold).tolist()


def test_novelty_parts_that_do_not_fit_are_refused(identifier):
    core, rule = identifier.core, identifier.trained[KEY]["unknown"]
    metadata, tensors = taken_apart(core.to_bytes())
    with pytest.raises(ModelFileError, match="tensor 'unknown_means' is missing"):
        Model.from_bytes(put_together(metadata, {k: v for k, v in tensors.items() if k != "unknown_means"}))
    for name, wrong, message in (
        ("unknown_means", tensors["unknown_means"][1:], r"unknown_means must have shape \(4, "),
        ("unknown_scaling", tensors["unknown_scaling"][:, 1:], r"unknown_scaling must have shape \(2, "),
        (
            "unknown_directions",
            np.full_like(tensors["unknown_directions"], np.nan),
            r"\[0, 0\] must be finite",
        ),
        ("unknown_means", tensors["unknown_means"].astype("f8"), r"must be float32 \(F32\), got F64"),
    ):
        with pytest.raises(ModelFileError, match=message):
            Model.from_bytes(put_together(metadata, {**tensors, name: wrong}))
    with pytest.raises(ModelFileError, match="novelty must be there exactly if a rule refuses"):
        Model.from_bytes(file_of(core, {KEY: {}}))
    bare = {name: values for name, values in tensors.items() if not name.startswith("unknown")}
    with pytest.raises(ModelFileError, match="novelty must be there exactly if a rule refuses"):
        Model.from_bytes(put_together({**metadata, "trained": json.dumps({KEY: {"unknown": rule}})}, bare))
    with pytest.raises(ValueError, match="novelty"):
        core.verdicts(np.zeros((1, core.n_learners)))


@pytest.mark.parametrize(
    "settings",
    [
        {"space": make_pipeline(HFMH(), ECOCClassifier("onevsall"))},
        {"share_known": None},
        {"coverage": None},
    ],
)
@pytest.mark.parametrize("n_classes", [2, 3])
def test_streams_apply_the_rules_of_other_models(data, settings, n_classes):
    chosen = [k for k, label in enumerate(data.y) if label in LABELS[:n_classes]]
    usual = {"space": "hfmh", "coverage": 0.8, "share_known": 0.6}
    model = Identifier.fit(data[chosen], target_error=0.2, **usual | settings)
    candidates, unknown = confidence_rules(model.core)
    for x, losses in zip(data.X, model.losses(data.X), strict=True):
        decision = model.identify(x)
        names = () if candidates is None else candidates.names(-losses)
        assert decision.candidates == names
        known = None if unknown is None else unknown.knows(distances(model.core, x[None])).item()
        assert decision.unknown == (None if known is None else not known)


def test_the_package_says_what_plain_numpy_and_the_rust_crate_say():
    """Of 60 synthetic pushes of known materials and 20 of others; ``tests/model.rs`` does the same for the crate."""
    model = Identifier.load(GOLDEN / "model.safetensors")
    X = np.fromfile(GOLDEN / "wrench.f32", "<f4").reshape(80, model.n_samples, 6).astype(np.float64)
    wanted = (GOLDEN / "answers.txt").read_text(encoding="utf-8").splitlines()
    decisions = [model.identify(x) for x in X]
    assert [f"{d.label}\t{', '.join(d.candidates)}\t{d.unknown}" for d in decisions] == wanted
    for x, decision in zip(X, decisions, strict=True):
        assert model.core.verdicts(*model.core.scores_and_novelty(x)) == [
            (decision.candidates, decision.unknown)
        ]


def test_the_table_has_a_column_for_each_rule_of_the_model(identifier, data):
    batch = identify_all(identifier.core, data)
    rows = [dict(zip(batch.table().header, row, strict=True)) for row in batch.table().rows]
    assert [row["unknown"] for row in rows] == ["yes" if named.unknown else "" for named in batch]
    assert [row["may be"] for row in rows] == [", ".join(named.candidates) for named in batch]
    header = (
        identify_all(Identifier.fit(data, "hfmh", coverage=None, target_error=0.2).core, data).table().header
    )
    assert "unknown" in header
    assert "may be" not in header


def test_what_rules_are_worth_is_said(identifier):
    lines = describe_performance(identifier)
    candidates, _ = confidence_rules(identifier.core)
    assert f"candidates: {candidates.promise}" in lines
    assert candidates.promise.startswith("hold the right material of 80 % of recordings in the mean over new")
    assert "probabilities: set on held-out recordings" in lines
    assert "unknown materials: refused, with 10 % of recordings of the known ones" in lines
    loud = np.random.default_rng(0).normal(0, 0.5, (80, 6)) * [1, 0, 0, 0, 0, 1]
    decision = identifier.identify(loud)
    assert decision.unknown == ("like no known material" in str(decision))


def test_a_model_without_rules_says_nothing(data):
    none = Identifier.fit(data, "hfmh", coverage=None, share_known=None, target_error=0.2)
    assert KEY not in none.trained
    decision = none.identify(data[0])
    assert (decision.candidates, decision.unknown) == ((), None)
    assert {"candidates: none", "unknown materials: none"} <= set(describe_performance(none))
    bare = Identifier.fit(data, "hfmh", estimate=False)
    assert KEY not in bare.trained
    assert (bare.temperature, bare.identify(data[0]).probability) == (None, None)
    assert "probabilities: none: no recordings were held out" in describe_performance(bare)
    with pytest.raises(ValueError, match="probabilit"):
        bare.predict_proba(data.X)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rules: [], "confidence: must be a JSON object, got a list"),
        (lambda rules: {"other": {}}, "confidence: has an unknown entry 'other'"),
        (lambda rules: {"candidates": {}}, "candidates: 'format' is missing"),
        (of_candidates(format="2"), "candidates: 'format' must be 'granular-id candidates 1'"),
        (of_candidates(level=1.5), "candidates: 'level' must be a number from 0 to 1"),
        (of_candidates(worst="0.9"), "candidates: 'worst' must be a number from 0 to 1"),
        (
            of_candidates(classes=["a", "b", "c", "d"]),
            "candidates: 'classes' must be the labels of the model",
        ),
        (of_candidates(threshold=None), "candidates: 'threshold' must be a number, got null"),
        (of_candidates(n_rows=0.5), "candidates: 'n_rows' must be a whole number"),
        (of_candidates(more=1), "candidates: has an unknown entry 'more'"),
        (of_unknown(more=1), "unknown: has an unknown entry 'more'"),
        (of_unknown(threshold="1"), "unknown: 'threshold' must be a number, got a text"),
        (of_unknown(share_known=1.0), "unknown: 'share_known' must be a number between 0 and 1"),
        (of_unknown(weights=[1.0]), "unknown: 'weights' must be two numbers, at least 0"),
        (of_unknown(weights=[1.0, -1.0]), "unknown: 'weights' must be two numbers, at least 0"),
        (of_unknown(n_calibration=0.5), "unknown: 'n_calibration' must be a whole number"),
    ],
)
def test_rules_that_are_none_are_refused_when_the_file_is_read(identifier, tmp_path, change, message):
    trained = {**identifier.trained, KEY: change(identifier.trained[KEY])}
    file = tmp_path / "m.safetensors"
    file.write_bytes(file_of(identifier.core, trained))
    with pytest.raises(ModelFileError, match=message) as caught:
        Identifier.load(file)
    assert str(caught.value).startswith(str(file))
    with pytest.raises(ValueError, match=message):
        changed(identifier.core, trained)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ({"recordings": 3}, "recordings must be an object, got 3"),
        ({"recordings": {"a": "3"}}, "recordings.a must be a whole number, got '3'"),
        ({"n_sessions": True}, "n_sessions must be a whole number, got True"),
        ({"estimate": {"held_out": "x"}}, "estimate must hold 'note', got"),
        ({"early": {"why_not": "", "target_error": 0.1}}, "early must hold 'answered_early', got"),
        ({"notes": "none"}, "notes must be a list, got 'none'"),
        ({"history": [{"step": "align"}]}, r"history\[0\] must hold 'parameters', got \['step'\]"),
        ({"choice": {"note": "x"}}, "choice must hold 'random_state'"),
        ({"choice": {**CHOICE, "machines": []}}, "choice.machines must hold at least one"),
        ({"choice": {**CHOICE, "machines": [{"name": "a"}]}}, r"choice.machines\[0\] must hold 'chosen'"),
        (
            of_candidates(n_rows=32.0),
            "candidates.n_rows must be a whole number, got 32.0",
        ),
        (of_unknown(n_calibration=32.0), "unknown.n_calibration must be a whole number, got 32.0"),
    ],
)
def test_what_is_known_must_have_its_shape_when_the_file_is_read(identifier, tmp_path, part, message):
    if callable(part):
        part = {KEY: part(identifier.trained[KEY])}
    file = tmp_path / "m.safetensors"
    file.write_bytes(changed(identifier.core, {**identifier.trained, **part}).to_bytes())
    with pytest.raises(ModelFileError, match=message) as caught:
        Identifier.load(file)
    assert str(caught.value).startswith(str(file))


@pytest.mark.thread_unsafe(reason="starts a process")
def test_a_robot_that_only_identifies_does_not_wait_for_scikit_learn():
    script = (
        "import sys, numpy as np, granular_id as gid\n"
        "model = gid.Identifier.load(sys.argv[1])\n"
        "wrench = np.zeros((model.n_samples, 6))\n"
        "stream = gid.StreamingIdentifier(model)\n"
        "stream.push(wrench)\n"
        "assert stream.decision() == model.identify(wrench)\n"
        "sys.exit('sklearn' in sys.modules)"
    )
    command = [sys.executable, "-c", script, str(GOLDEN / "model.safetensors")]
    assert subprocess.run(command, check=False, timeout=60).returncode == 0


def test_a_choice_is_told_whatever_else_is_known(identifier, tmp_path):
    machine = {"name": "plain, C 1", "chosen": True, "accuracies": [0.5, 1.0]}
    file = tmp_path / "m.safetensors"
    file.write_bytes(changed(identifier.core, {"choice": {**CHOICE, "machines": [machine]}}).to_bytes())
    said = describe_performance(Identifier.load(file))
    assert "chosen (>): 1 of 1 candidate models, on halves; seed 4" in said
    assert any(line.startswith("  > plain, C 1") and "75.0 %" in line for line in said)


def test_notes_that_say_how_grave_they_are_are_said_to_be_those_of_the_data_check(identifier, tmp_path):
    file = tmp_path / "m.safetensors"
    notes = ["error: 2 recordings are one", "warning: no sessions", "too short"]
    file.write_bytes(changed(identifier.core, {**identifier.trained, "notes": notes}).to_bytes())
    said = describe_performance(Identifier.load(file))[-3:]
    assert said == [*(f"data check: {note}" for note in notes[:2]), "note: too short"]


@pytest.mark.parametrize(
    ("triggers", "said"),
    [
        ([None] * 8, "not known, recordings have no trigger"),
        ([None, *[5] * 7], "not known of all, 28 of 32 recordings have a trigger"),
        ([4, *[5] * 7], "not the same in all recordings"),
        ([5] * 8, "0.01 s"),
    ],
)
def test_rest_that_is_not_known_is_not_called_unequal(data, triggers, said):
    some = Dataset([replace(r, trigger_index=t) for r, t in zip(data, cycle(triggers))])
    lines = describe_model(Identifier.fit(some, "hfmh", estimate=False))
    lead = next(line for line in lines if "rest" in line)
    assert lead.endswith(f"rest ahead of the motion: {said}")


def test_rest_of_a_model_that_knows_no_training_is_not_known(identifier):
    said = describe_model(Identifier(changed(identifier.core, {})))
    lead = next(line for line in said if "rest" in line)
    assert lead.endswith("not known, or not the same in all recordings")

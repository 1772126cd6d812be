"""Candidates and refusals of a model: kept in its file, checked when read, the same from streams and batches."""

import json
import subprocess
import sys
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from evaluation_cases import LABELS
from granular_id._core import Model, ModelFileError
from granular_id.confidence import ConformalRule, HeldOutScores, UnknownRule, conformal_rule, unknown_rule
from granular_id.confidence.held_out import Scores
from granular_id.identifier import (
    Identifier,
    StreamingIdentifier,
    describe_model,
    describe_performance,
    identify_all,
)
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
    "in_partitions": [],
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
        metadata={**core.metadata, "posterior": "", "trained": json.dumps(trained)},
    )


def file_of(core, trained):
    """Return a file of a model with something else known of its training, which need not make sense."""
    metadata, tensors = taken_apart(core.to_bytes())
    return put_together({**metadata, "trained": json.dumps(trained)}, tensors)


def of_conformal(**changes):
    return lambda rules: {**rules, "conformal": {**rules["conformal"], **changes}}


def of_unknown(**changes):
    return lambda rules: {**rules, "unknown": {**rules["unknown"], **changes}}


def test_rules_are_set_on_the_recordings_held_out_and_come_back(identifier, tmp_path):
    conformal, unknown = rules = confidence_rules(identifier.core)
    assert (conformal.levels, conformal.n_calibration) == ((0.8,), 32)
    assert unknown.share_known == 0.9
    assert conformal.classes == unknown.classes == LABELS
    assert conformal.held_out == "held-out sessions"
    identifier.save(tmp_path / "m.safetensors")
    assert confidence_rules(Identifier.load(tmp_path / "m.safetensors").core) == rules
    stored = identifier.trained[KEY]
    assert ConformalRule.from_dict(stored["conformal"]).to_dict() == stored["conformal"]
    assert UnknownRule.from_dict(stored["unknown"]).to_dict() == stored["unknown"]


def test_final_decisions_name_candidates_and_provisional_ones_do_not(identifier, data):
    (conformal, unknown), stream = confidence_rules(identifier.core), StreamingIdentifier(identifier)
    values, scores = identifier.decision_function(data.X), identifier.scores(data.X)
    batch = identify_all(identifier, data)
    for k, x in enumerate(data.X[:6]):
        stream.reset()
        stream.push(x[:40])
        early = stream.decision()
        assert (early.candidates, early.unknown) == ((), None)
        stream.push(x[40:])
        decision = stream.decision()
        assert decision.candidates == conformal.names(values[k], at_least_one=True)
        assert decision.unknown == (not unknown.knows(values[k], scores[k]))
        assert decision.candidates[0] == decision.label
        assert decision.to_dict()["candidates"] == list(decision.candidates)
        whole = identifier.identify(x)
        assert (whole.candidates, whole.unknown) == (decision.candidates, decision.unknown)
        assert (batch.each[k].candidates, batch.each[k].unknown) == (decision.candidates, decision.unknown)
    assert batch.to_dict()["recordings"][0]["candidates"] == list(batch.each[0].candidates)


@pytest.mark.parametrize("of_pairs", [True, False])
def test_core_rules_judge_as_numpy_does(identifier, data, of_pairs):
    """The answers of streams, recordings and batches are those of the rules in plain numpy."""
    values, scores = identifier.decision_function(data.X), identifier.scores(data.X)
    truth = np.array([LABELS.index(label) for label in data.y])
    rows = np.arange(truth.size)
    each = Scores(values, scores, None, identifier.core.coding_matrix) if of_pairs else Scores(values)
    held = HeldOutScores(LABELS, truth, each, rows=rows, folds=rows % 4, groups=rows, held_out="nothing")
    rule = conformal_rule(held, [0.8])
    other = unknown_rule(held, share_known=0.6)
    core = changed(identifier.core, {KEY: {"conformal": rule.to_dict(), "unknown": other.to_dict()}})
    known = other.knows(values, scores)
    assert {True, False} == set(known.tolist())
    names = [rule.names(row, at_least_one=True) for row in values]
    expected = list(zip(names, (~known).tolist(), strict=True))
    assert core.verdicts(scores) == expected
    assert core.verdicts(scores[0]) == expected[:1]
    stream = StreamingIdentifier(core)
    for x, said in zip(data.X, expected, strict=True):
        stream.reset()
        stream.push(x)
        decision = stream.decision()
        assert (decision.candidates, decision.unknown) == said


@pytest.mark.parametrize("settings", [{"coding": "onevsall"}, {"share_known": None}, {"coverage": None}])
@pytest.mark.parametrize("n_classes", [2, 3])
def test_streams_apply_the_rules_of_other_models(data, settings, n_classes):
    chosen = [k for k, label in enumerate(data.y) if label in LABELS[:n_classes]]
    model = Identifier.fit(
        data[chosen], "hfmh", target_error=0.2, **{"coverage": 0.8, "share_known": 0.6} | settings
    )
    (conformal, unknown), scores = confidence_rules(model.core), model.scores(data.X)
    for x, losses, row in zip(data.X, model.core.losses(scores), scores, strict=True):
        decision = model.identify(x)
        names = () if conformal is None else conformal.names(-losses, at_least_one=True)
        assert decision.candidates == names
        assert decision.unknown == (None if unknown is None else not unknown.knows(-losses, row))


def test_the_package_says_what_plain_numpy_and_the_rust_crate_say():
    """Of 60 synthetic pushes of known materials and 20 of others; ``tests/model.rs`` does the same for the crate."""
    model = Identifier.load(GOLDEN / "model.safetensors")
    X = np.fromfile(GOLDEN / "wrench.f32", "<f4").reshape(80, model.n_samples, 6).astype(np.float64)
    wanted = (GOLDEN / "answers.txt").read_text(encoding="utf-8").splitlines()
    decisions = [model.identify(x) for x in X]
    assert [f"{d.label}\t{', '.join(d.candidates)}\t{d.unknown}" for d in decisions] == wanted
    for x, decision in zip(X, decisions, strict=True):
        assert model.core.verdicts(model.scores(x)) == [(decision.candidates, decision.unknown)]


def test_the_table_has_a_column_for_each_rule_of_the_model(identifier, data):
    batch = identify_all(identifier, data)
    rows = [dict(zip(batch.table().header, row, strict=True)) for row in batch.table().rows]
    assert [row["unknown"] for row in rows] == ["yes" if named.unknown else "" for named in batch]
    assert [row["may be"] for row in rows] == [", ".join(named.candidates) for named in batch]
    header = identify_all(Identifier.fit(data, "hfmh", coverage=None, target_error=0.2), data).table().header
    assert "unknown" in header
    assert "may be" not in header


def test_what_rules_are_worth_is_said(identifier):
    lines = describe_performance(identifier)
    assert "candidates: hold the right material of 80 % of recordings like those held out" in lines
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
    assert KEY not in Identifier.fit(data, "hfmh", estimate=False).trained


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rules: [], "confidence: must be a JSON object, got a list"),
        (lambda rules: {"other": {}}, "confidence: has an unknown entry 'other'"),
        (lambda rules: {"conformal": {}}, "conformal: 'format' is missing"),
        (of_conformal(format="2"), "conformal: 'format' must be 'granular-id conformal rule 1'"),
        (of_conformal(levels=["0.9"]), "conformal: 'levels' must be rising numbers"),
        (of_conformal(classes=["a", "b", "c", "d"]), "conformal: 'classes' must be the labels of the model"),
        (
            of_conformal(thresholds=[0.1, 0.2]),
            "conformal: 'thresholds' must be numbers or null, one for each",
        ),
        (of_conformal(n_calibration=0.5), "conformal: 'n_calibration' must be a whole number"),
        (of_conformal(more=1), "conformal: has an unknown entry 'more'"),
        (of_unknown(more=1), "unknown: has an unknown entry 'more'"),
        (of_unknown(of_pairs=1), "unknown: 'of_pairs' must be true or false"),
        (of_unknown(threshold="1"), "unknown: 'threshold' must be a number or null, got a text"),
        (of_unknown(share_known=1.0), "unknown: 'share_known' must be a number between 0 and 1"),
        (of_unknown(means=np.eye(4, 3).tolist()), "unknown: 'means' must be 4 rows of 4 numbers"),
        (of_unknown(whitener=np.eye(3).tolist()), "unknown: 'whitener' must be 4 rows of 4 numbers"),
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


def test_refusal_of_pairs_without_pairs_is_refused(data, identifier):
    others = Identifier.fit(data, "hfmh", coding="onevsall", estimate=False)
    trained = {KEY: {"unknown": identifier.trained[KEY]["unknown"]}}
    assert trained[KEY]["unknown"]["of_pairs"]
    with pytest.raises(ModelFileError, match=r"unknown: 'of_pairs' is for one learner for each pair"):
        Model.from_bytes(file_of(others.core, trained))


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
            of_conformal(n_calibration=32.0),
            "conformal.n_calibration must be a whole number, got 32.0",
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

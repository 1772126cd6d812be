"""What a model says about itself: held-out answers, early rule, accuracy over time."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from sklearn.pipeline import make_pipeline

from evaluation_cases import LABELS, changed, make_data
from granular_id import ECOCClassifier, evaluate, extract_features, synthesize
from granular_id.evaluation import confidence_study
from granular_id.identifier import Identifier, accuracy_over_time, describe_model, describe_performance
from granular_id.identifier.rules import checkpoints, provisional_answers
from granular_id.identifier.time_course import over_time
from granular_id.identifier.training import train
from granular_id.recording import Dataset
from granular_id.spaces import feature_spaces
from granular_id.splits import hold_out


@pytest.fixture(scope="module")
def data():
    """Materials that differ in level, with some pushes off theirs."""
    rng = np.random.default_rng(0)

    def wrench(r):
        level = LABELS.index(r.label)
        return rng.normal(level + rng.normal(0, 0.24), 0.3, (60, 6))

    return Dataset([replace(r, wrench=wrench(r)) for r in make_data(8)])


@pytest.fixture(scope="module")
def training(data):
    return train(data, "raw+hfmh", target_error=0.3)


# -- what is held out


@pytest.fixture(scope="module")
def tools(data):
    """The same recordings: four of each material with each of two tools, beside sessions that both share."""
    return changed(data, meta=lambda r: {"tool": "wide" if int(r.name[-1]) < 4 else "thin"})


def test_condition_is_held_out_value_by_value(tools):
    held = train(tools, "hfmh", by="tool", target_error=0.3).held.held
    assert [fold.held_out for fold in held.folds] == ["wide", "thin"]
    assert held.folds.folds[0].test.tolist() == [8 * k + i for k in range(4) for i in range(4)]
    model = Identifier.fit(tools, "hfmh", by="tool", target_error=0.3)
    assert describe_performance(model)[0].startswith("accuracy, another tool: ")


def test_best_chooses_by_the_condition_that_is_held_out(tools):
    choice = Identifier.fit(tools, by="tool").trained["choice"]
    assert choice["note"] == "2 folds of whole conditions"
    assert [one["held_out"] for one in choice["in_folds"]] == ["wide", "thin"]
    assert Identifier.fit(tools, by="tool", estimate=False).trained["choice"] == {**choice, "in_folds": []}


def test_condition_that_cannot_be_held_out_is_refused(tools):
    with pytest.raises(ValueError, match="speed"):
        Identifier.fit(tools, "hfmh", by="speed")
    with pytest.raises(ValueError, match="tool"):
        Identifier.fit(tools.select(where=lambda r: r.meta["tool"] == "wide"), "hfmh", by="tool")


def test_material_of_one_tool_is_neither_trained_nor_tested_without_it(tools):
    """The model of the other tool does not know it, and is asked for its novelty all the same."""
    data = Dataset([r for r in tools if r.label != "oat" or r.meta["tool"] == "wide"])
    model = Identifier.fit(data, "hfmh", by="tool", target_error=0.3)
    assert list(model.trained["estimate"]["untested"]) == ["oat"]
    assert model.identify(data[0]).unknown is False
    assert [one.label for one in confidence_study(data, "hfmh", by="tool").unknown] == [
        "peas",
        "rice",
        "sugar",
    ]


def test_sessions_are_held_out_where_materials_have_several(data, training):
    held = training.held.held
    estimate = training.trained["estimate"]
    assert (estimate["by"], estimate["held_out"]) == ("session", "held-out sessions")
    for fold in held.folds:
        assert not {*data.sessions[fold.train]} & {*data.sessions[fold.test]}
    assert sorted(held.rows.tolist()) == list(range(32))


def test_held_out_answers_are_those_of_models_of_the_others(data, training):
    held, space = training.held, feature_spaces(rate_hz=500.0)["raw+hfmh"]
    assert held.n_seen[-1] == 60
    for k, fold in enumerate(held.held.folds):
        pipeline = make_pipeline(space.transformer, ECOCClassifier()).fit(
            data.X[fold.train], data.y[fold.train]
        )
        mine = held.held.fold == k
        assert held.held.rows[mine].tolist() == fold.test.tolist()
        answers = [LABELS[winner] for winner in held.winners[mine, -1]]
        assert answers == pipeline.predict(data.X[fold.test]).tolist()
    assert training.trained["estimate"]["accuracy"] == held.held.accuracy < 1


@pytest.mark.parametrize("n_sessions", [2, 3])
def test_estimate_is_that_of_an_evaluation(n_sessions):
    data = changed(
        make_data(9, separation=0.2), session=lambda r: f"day {int(r.name.split('_')[1]) % n_sessions}"
    )
    result = evaluate(data, "raw+hfmh", baselines=False, progress=False)
    estimate = train(data, "raw+hfmh").trained["estimate"]
    assert estimate["accuracy"] == result.accuracy("raw+hfmh")
    assert estimate["recall"] == pytest.approx(dict(zip(LABELS, result.recall().tolist(), strict=True)))
    assert (estimate["n_answers"], estimate["n_folds"]) == (36, n_sessions)
    if n_sessions == 2:  # an interval needs three
        assert estimate["interval_95"] is None
    else:
        assert estimate["interval_95"] == pytest.approx(list(result.interval("raw+hfmh")))


def test_material_of_one_session_is_not_tested_and_it_is_said(data):
    lone = Dataset([r for r in data if r.label != "oat" or r.session == "oat day 0"])
    training = train(lone, "hfmh", target_error=0.3)
    assert list(training.trained["estimate"]["untested"]) == ["oat"]
    lines = describe_performance(Identifier(training.core))
    assert any(line.startswith("  not tested: oat, ") for line in lines)


def test_one_recording_of_a_material_gives_no_estimate(data):
    few = Dataset([*data[:8], data[8]])
    training = train(few, "hfmh")
    assert (training.held, training.early, training.trained["estimate"]) == (None, None, None)
    why = training.trained["why_no_estimate"]
    with pytest.raises(ValueError, match=re.escape(why)):
        hold_out(few)
    model = Identifier(training.core)
    assert model.predict(few.X).tolist() == few.y.tolist()
    assert any(f"not known: {why}" in line for line in describe_performance(model))
    with pytest.raises(ValueError, match=re.escape(f"nothing can be held out: {why}")):
        accuracy_over_time(few, "hfmh")
    one_of_each = data[::8]
    assert Identifier.fit(one_of_each, "raw").predict(one_of_each.X).tolist() == list(LABELS)


# -- answers while samples arrive


def provisional_scores(core, wrench, n_seen):
    """Scores (L,) after some samples: unseen raw samples at their mean, counts scaled up to the whole length."""
    spec, n = core.spec, core.n_samples
    blocks = []
    if spec.raw:
        raw = (
            np.zeros((core.n_axes, n))
            if core.raw_mean is None
            else core.raw_mean.reshape(core.n_axes, n).copy()
        )
        raw[:, :n_seen] = wrench[:n_seen].T
        blocks.append(raw.ravel())
    if spec.hfmh:
        keywords = {**spec.__getnewargs_ex__()[1], "raw": False}
        counts = extract_features(wrench[:n_seen], **keywords)
        blocks.append(counts if spec.density else counts * n / n_seen)
    return core.intercept + core.coef @ np.concatenate(blocks)


def hinge_losses(core, scores):
    """Mean hinge loss (K,) of the classes, loss-weighted."""
    codes = core.coding_matrix.astype(float)
    losses = np.maximum(0.0, 1.0 - codes * scores) / 2.0 * np.abs(codes)
    return losses.sum(axis=1) / np.abs(codes).sum(axis=1)


@pytest.mark.parametrize("space", ["raw", "hfmh", "raw+hfmh"])
def test_provisional_answers_are_those_of_the_definition(data, space):
    core = Identifier.fit(data, space, estimate=False).core
    moments = [1, 7, 8, 41, 59, 60]
    winners, margins = provisional_answers(core, data.X[3], moments)
    for n, winner, margin in zip(moments, winners, margins, strict=True):
        losses = hinge_losses(core, provisional_scores(core, data.X[3], n))
        best, second = np.sort(losses)[:2]
        assert margin == pytest.approx(second - best, abs=1e-9)
        assert losses[winner] == pytest.approx(best, abs=1e-9)


@given(st.integers(1, 5000), st.integers(1, 300))
def test_moments_rise_to_the_end_evenly(n_samples, most):
    moments = checkpoints(n_samples, most)
    assert moments[-1] == n_samples
    assert len(moments) == min(n_samples, most)
    steps = np.diff(np.concatenate(([0], moments)))
    assert steps.min() >= 1
    assert steps.max() - steps.min() <= 1


# -- early answers


def test_early_rule_is_in_the_model_and_can_be_left_out(training, data):
    assert np.array_equal(training.core.early, training.early.table())
    known = training.trained["early"]
    assert known == training.early.to_dict(training.held, 500.0)
    assert known["target_error"] == 0.3
    without = train(data, "raw+hfmh", target_error=None)
    assert without.core.early is None
    assert without.trained["early"] is None
    assert without.trained["estimate"] == training.trained["estimate"]


# -- over time


def test_accuracy_over_time_counts_answers(training, data):
    course = accuracy_over_time(data, "raw+hfmh", target_error=0.3)
    held, rule = training.held, training.early
    assert course.seconds[-1] == pytest.approx(0.12)
    assert course.accuracy[-1] == pytest.approx(held.right[:, -1].mean())
    assert course.answered[-1] == pytest.approx((rule.stops >= 0).mean())
    assert (np.diff(course.answered) >= 0).all()
    n_answered = course.answered[-1] * course.n_answers
    with_one_more = (course.error[-1] * n_answered + 1) / (n_answered + 1)
    assert training.trained["early"]["error"] == pytest.approx(with_one_more)
    assert course.mean_seconds == pytest.approx(training.trained["early"]["mean_seconds"])
    assert (course.chance, course.n_answers, course.synthetic) == (0.25, 32, False)
    first = int(np.argmax(course.answered > 0))
    assert np.isnan(course.error[:first]).all()
    assert course.to_dict()["error"][:first] == [None] * first
    assert str(course).startswith("Accuracy over time\n")
    assert "aim: at most 30 %" in str(course)


def test_without_a_rule_accuracy_over_time_says_why(training):
    course = over_time(training.held, 500.0, None, synthetic=True)
    assert math.isnan(course.mean_seconds)
    assert course.answered.max() == 0
    assert "SYNTHETIC" in str(course)
    assert "no early answers: no early rule was asked for" in str(course)


def test_material_that_is_never_recognised_is_named(training):
    estimate = training.trained["estimate"] | {"recall": {"oat": 0.0, "peas": 1.0, "rice": None}}
    trained = training.trained | {"estimate": estimate}
    model = SimpleNamespace(
        core=training.core, trained=trained, synthetic=False, temperature=1.0, rate_hz=500.0
    )
    assert [line for line in describe_performance(model) if "least" in line] == [
        "  least recognised: oat 0 %"
    ]


def test_a_model_describes_itself_in_words(training):
    model = Identifier(training.core)
    text = "\n".join((*describe_model(model), *describe_performance(model)))
    for words in (
        "materials: 4: oat, peas, rice, sugar",
        "trained on: 32 recordings, 8 of each material, 8 sessions",
        "takes: 60 samples at 500 Hz (0.12 s) of fx fy fz tx ty tz",
        "6 learners, hinge loss",
        "accuracy, held-out sessions: ",
        "least recognised: ",
        "aim: at most 30 %",
    ):
        assert words in text, text
    assert "SYNTHETIC" not in text
    made = synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.3)
    simulated = Identifier.fit(made, "hfmh")
    assert describe_model(simulated)[0].startswith("SYNTHETIC: trained on simulated recordings")
    assert "(SYNTHETIC recordings)" in describe_performance(simulated)[0]


def test_the_figure_shows_what_was_counted(training, tmp_path):
    pytest.importorskip("matplotlib")
    from granular_id.plotting import plot_over_time

    course = over_time(training.held, 500.0, training.early, synthetic=True)
    figure = plot_over_time(course, path=tmp_path / "o.png")
    panel = figure.axes[0]
    line = next(line for line in panel.lines if line.get_label() == "provisional answers right")
    assert np.array_equal(line.get_ydata(), course.accuracy)
    assert np.array_equal(line.get_xdata(), course.seconds)
    assert "held-out sessions: 32 answers, SYNTHETIC recordings" in panel.get_title()
    names = panel.get_legend_handles_labels()[1]
    assert {"answered early", "of these wrong"} <= {*names}
    assert (tmp_path / "o.png").read_bytes().startswith(b"\x89PNG")
    without = plot_over_time(over_time(training.held, 500.0, None, synthetic=False)).axes[0]
    assert "answered early" not in without.get_legend_handles_labels()[1]
    assert "SYNTHETIC" not in without.get_title()

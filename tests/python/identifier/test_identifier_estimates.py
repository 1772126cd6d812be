"""What a model says about itself: held-out answers, early rule, accuracy over time."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from evaluation_cases import LABELS, changed, make_data
from granular_id import evaluate, extract_features, synthesize
from granular_id.identifier import (
    Identifier,
    Recipe,
    accuracy_over_time,
    describe_model,
    describe_performance,
)
from granular_id.identifier.rules import checkpoints, provisional_answers
from granular_id.identifier.time_course import over_time
from granular_id.identifier.training import train
from granular_id.recording import Dataset
from granular_id.splits import strictest_partitions


@pytest.fixture(scope="module")
def data():
    """Materials that differ in level, with some pushes off theirs."""
    rng = np.random.default_rng(0)

    def wrench(r):
        level = LABELS.index(r.label)
        return rng.normal(level + rng.normal(0, 0.3), 0.3, (60, 6))

    return Dataset([replace(r, wrench=wrench(r)) for r in make_data(8)])


@pytest.fixture(scope="module")
def training(data):
    return train(data, Recipe(space="raw+hfmh"), target_error=0.3)


# -- protocols


@pytest.fixture(scope="module")
def tools(data):
    """The same recordings: four of each material with each of two tools, beside sessions that both share."""
    return changed(data, meta=lambda r: {"tool": "wide" if int(r.name[-1]) < 4 else "thin"})


def test_a_condition_is_held_out_value_by_value_where_it_is_named(tools):
    held = train(tools, Recipe(space="hfmh"), hold_out="tool", target_error=0.3).held
    assert [part.description for part in held.partitions] == ["tool: wide", "tool: thin"]
    assert held.partitions[0].test.tolist() == [8 * k + i for k in range(4) for i in range(4)]
    model = Identifier.fit(tools, "hfmh", hold_out="tool", target_error=0.3)
    first, second = describe_performance(model)[:2]
    assert first.startswith("accuracy, another tool: ")
    assert second == "  tool: 2 values, held out one by one"


@pytest.mark.parametrize("estimate", [True, False])
def test_best_chooses_by_the_condition_that_is_held_out(tools, estimate):
    choice = Identifier.fit(tools, hold_out="tool", estimate=estimate).trained["choice"]
    assert choice["note"] == "2 folds of whole conditions"
    assert [one["partition"] for one in choice["in_partitions"]] == ["tool: wide", "tool: thin"] * estimate


def test_a_condition_that_cannot_be_held_out_is_refused(tools):
    with pytest.raises(ValueError, match="hold_out='speed' cannot be held out, as no recording states it"):
        Identifier.fit(tools, "hfmh", hold_out="speed")
    with pytest.raises(
        ValueError, match="hold_out='tool' has no use without an estimate where nothing is cho"
    ):
        Identifier.fit(tools, "hfmh", hold_out="tool", estimate=False)
    with pytest.raises(
        ValueError, match="hold_out='tool': 'oat' has one value of it only; record it with ano"
    ):
        Identifier.fit(tools[4:], "hfmh", hold_out="tool")


def test_sessions_are_held_out_where_every_class_has_several(data, training):
    held = training.held
    assert (training.trained["estimate"]["protocol"], held.held_out) == ("session", "held-out sessions")
    for partition in held.partitions:
        assert not {*data.sessions[partition.train]} & {*data.sessions[partition.test]}
    assert sorted(held.rows.tolist()) == list(range(32))


def test_else_halves_in_time_order_else_random_folds_and_it_is_said(data):
    untold = changed(data, session=lambda r: None)
    partitions, note = strictest_partitions(untold)
    assert [partition.protocol for partition in partitions] == ["chronological"] * 2
    assert note.startswith("chronological: by start time (session protocol left out: no recording says which")
    timeless = changed(untold, start_time=lambda r: 1e9 if r.name == "oat_0" else None)
    partitions, note = strictest_partitions(timeless, n_folds=4, seed=3)
    assert [partition.protocol for partition in partitions] == ["kfold"] * 4
    assert "kfold: 4 folds, seed 3 (session protocol left out" in note
    assert "chronological protocol left out: " in note


def test_held_out_answers_are_those_of_pipelines_fitted_on_the_others(data, training):
    held, wrong = training.held, 0
    assert held.n_seen[-1] == 60
    for fold, partition in enumerate(held.partitions):
        pipeline = (
            Recipe(space="raw+hfmh").pipeline(500.0).fit(data.X[partition.train], data.y[partition.train])
        )
        mine = held.folds == fold
        assert held.rows[mine].tolist() == partition.test.tolist()
        said = [LABELS[k] for k in held.winners[mine, -1]]
        assert said == pipeline.predict(data.X[partition.test]).tolist()
        wrong += np.mean(np.array(said) != data.y[partition.test])
    estimate = training.trained["estimate"]
    assert wrong > 0
    assert estimate["accuracy"] == pytest.approx(1 - wrong / len(held.partitions))


def test_the_estimate_is_that_of_an_evaluation(data, training):
    result = evaluate(data, "raw+hfmh", "session", controls=False, progress=False)
    estimate = training.trained["estimate"]
    assert estimate["accuracy"] == pytest.approx(result.mean_accuracy("raw+hfmh"), abs=1e-12)
    assert estimate["recall"] == pytest.approx(dict(zip(LABELS, result.recall().tolist(), strict=True)))
    assert (estimate["n_answers"], estimate["n_partitions"]) == (32, 2)
    assert estimate["interval_95"] is None


def test_an_interval_needs_three_partitions():
    data = changed(make_data(9, separation=0.2), session=lambda r: f"day {int(r.name.split('_')[1]) % 3}")
    result = evaluate(data, "raw+hfmh", "session", controls=False, progress=False)
    estimate = train(data, Recipe(space="raw+hfmh")).trained["estimate"]
    assert estimate["interval_95"] == pytest.approx(list(result.interval("raw+hfmh")))


def test_one_recording_of_a_class_gives_a_model_without_estimate(data):
    few = Dataset([*data[:8], data[8]])
    training = train(few, Recipe(space="hfmh"))
    assert (training.held, training.early, training.trained["estimate"]) == (None, None, None)
    why = "class 'peas' has 1 recording"
    assert why in training.trained["why_no_estimate"]
    model = Identifier(training.core)
    assert model.predict(few.X).tolist() == few.y.tolist()
    assert any(f"not known: {why}" in line for line in describe_performance(model))
    with pytest.raises(ValueError, match=f"nothing can be held out: {why}"):
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


def test_the_rule_is_in_the_model_and_can_be_left_out(training, data):
    assert np.array_equal(training.core.early, training.early.table())
    known = training.trained["early"]
    assert known == training.early.to_dict(training.held, 500.0)
    assert known["target_error"] == 0.3
    without = train(data, Recipe(space="raw+hfmh"), early=False)
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
    assert course.error[-1] == pytest.approx(training.trained["early"]["error"])
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


def test_a_model_describes_itself_in_words(training):
    model = Identifier(training.core)
    text = "\n".join((*describe_model(model), *describe_performance(model)))
    for words in (
        "materials: 4: oat, peas, rice, sugar",
        "trained on: 32 recordings, 8 of each material, 8 sessions",
        "takes: 60 samples at 500 Hz (0.12 s) of fx fy fz tx ty tz",
        "6 learners (onevsone), hinge loss",
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

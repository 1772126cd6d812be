"""Training: what is held out, the estimate that it gives, and what a model says of itself."""

import re

import numpy as np
import pytest

from evaluation_cases import LABELS, changed, make_data
from granular_id import confidence_study, evaluate, synthesize
from granular_id.identifier import Identifier, describe_model, describe_performance
from granular_id.recording import Dataset
from granular_id.splits import hold_out


@pytest.fixture(scope="module")
def tools(levels):
    """The same recordings: four of each material with each of two tools, beside sessions that both share."""
    return changed(levels, meta=lambda r: {"tool": "wide" if int(r.name[-1]) < 4 else "thin"})


def test_condition_is_held_out_value_by_value(tools):
    model = Identifier.fit(tools, "hfmh", by="tool", target_error=0.3)
    folds = model.held_.held.folds
    assert [fold.held_out for fold in folds] == ["wide", "thin"]
    assert folds.folds[0].test.tolist() == [8 * k + i for k in range(4) for i in range(4)]
    assert describe_performance(model)[0].startswith("accuracy, another tool: ")


def test_best_chooses_by_the_condition_that_is_held_out(tools):
    choice = Identifier.fit(tools, by="tool").trained["choice"]
    assert choice["note"] == "2 folds of whole conditions"
    assert [one["held_out"] for one in choice["in_folds"]] == ["wide", "thin"]
    assert Identifier.fit(tools, by="tool", estimate=False).trained["choice"] == {**choice, "in_folds": []}


@pytest.mark.filterwarnings("error")
def test_material_of_one_tool_is_neither_trained_nor_tested(tools):
    """The model of the other tool does not know it, and yields its novelty all the same."""
    data = Dataset([r for r in tools if r.label != "oat" or r.meta["tool"] == "wide"])
    model = Identifier.fit(data, "hfmh", by="tool", target_error=0.3)
    assert model.trained["estimate"]["untested"] == {"oat": "no other tool to train on"}
    assert model.identify(data[0]).unknown is False
    assert np.isfinite(model.trained["confidence"]["unknown"]["threshold"])
    held = model.held_
    assert (held.winners[:, -1] == held.held.predicted).all()
    assert not np.isin(held.winners[held.held.fold == 0], LABELS.index("oat")).any()
    study = confidence_study(data, "hfmh", by="tool")
    assert [one.label for one in study.unknown] == ["peas", "rice", "sugar"]


@pytest.mark.parametrize("n_sessions", [2, 3])
def test_estimate_is_that_of_an_evaluation(n_sessions):
    data = make_data(9, separation=0.2)
    data = changed(data, session=lambda r: f"day {int(r.name[-1]) % n_sessions}")
    result = evaluate(data, "raw+hfmh", baselines=False, progress=False)
    estimate = Identifier.fit(data, "raw+hfmh").trained["estimate"]
    assert estimate["accuracy"] == result.accuracy("raw+hfmh")
    assert estimate["recall"] == pytest.approx(dict(zip(LABELS, result.recall().tolist(), strict=True)))
    assert (estimate["n_answers"], estimate["n_folds"]) == (36, n_sessions)
    if n_sessions == 2:  # an interval needs three
        assert estimate["interval_95"] is None
    else:
        assert estimate["interval_95"] == pytest.approx(list(result.interval("raw+hfmh")))


def test_material_of_one_session_is_not_tested_and_named(levels):
    lone = Dataset([r for r in levels if r.label != "oat" or r.session == "oat day 0"])
    model = Identifier.fit(lone, "hfmh", target_error=0.3)
    assert list(model.trained["estimate"]["untested"]) == ["oat"]
    assert any(line.startswith("  not tested: oat, ") for line in describe_performance(model))


def test_one_recording_of_a_material_gives_no_estimate(levels):
    few = Dataset([*levels[:8], levels[8]])
    model = Identifier.fit(few, "hfmh")
    assert (model.held_, model.over_time_, model.trained["estimate"]) == (None, None, None)
    why = model.trained["why_no_estimate"]
    with pytest.raises(ValueError, match=re.escape(why)):
        hold_out(few)
    assert model.predict(few.X).tolist() == few.y.tolist()
    assert any(f"not known: {why}" in line for line in describe_performance(model))
    one_of_each = levels[::8]
    assert Identifier.fit(one_of_each, "raw").predict(one_of_each.X).tolist() == list(LABELS)


@pytest.mark.parametrize("n_long", [1, 4])
def test_windows_that_share_samples_are_held_out(n_long):
    """Of one long recording of a material no random folds can be drawn: the limit of refusal does without."""
    data = synthesize(["rice", "fine sugar"], n_long, duration_s=1.6).windows(0.5, 0.1)
    model = Identifier.fit(data, "hfmh")
    assert model.held_ is not None
    assert model.trained["confidence"]["unknown"]["threshold"] > 0


def test_model_describes_itself_in_words(leveled):
    text = "\n".join((*describe_model(leveled), *describe_performance(leveled)))
    about = (
        "oat, peas, rice, sugar",
        "32 recordings, 8 of each material, 8 sessions",
        "60 samples at 500 Hz",
    )
    for words in (
        *about,
        "6 learners, hinge loss",
        "held-out sessions: ",
        "least recognised: ",
        "at most 30 %",
    ):
        assert words in text, text
    assert "SYNTHETIC" not in text
    made = synthesize(["rice", "fine sugar"], n_per_class=4, duration_s=0.3)
    simulated = Identifier.fit(made, "hfmh")
    assert describe_model(simulated)[0].startswith("SYNTHETIC: trained on simulated recordings")
    assert "(SYNTHETIC recordings)" in describe_performance(simulated)[0]


def test_choice_is_stored_and_described(best):
    choice, lines = best.trained["choice"], describe_performance(best)
    assert (choice["held_out"], len(choice["machines"])) == ("sessions", 12)
    elsewhere = choice["in_folds"]
    assert len({one["held_out"] for one in elsewhere}) == best.trained["estimate"]["n_folds"]
    names = {machine["name"] for machine in choice["machines"]}
    for one in elsewhere:
        assert set(one["chosen"]) <= names
        assert "half of each class in order" in one["note"]  # of two sessions one trains
        assert one["accuracy_on_the_folds_that_chose"] > 0.5
    (best_one, *_) = choice["chosen"]
    assert any(best_one in line and " % held out, chosen " in line for line in lines)

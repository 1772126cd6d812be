"""evaluate(hold_out=...): each value of a condition is held out whole, beside as many at random, in one table."""

from dataclasses import replace

import numpy as np
import pytest

from evaluation_cases import LABELS, make_data
from granular_id.evaluation import evaluate, hold_out_tables
from granular_id.partitions import condition_partitions, matched_partitions
from granular_id.recording import Dataset
from granular_id.recording.conditions import conditions_in
from granular_id.spaces import BestClassifier, FeatureSpace, MultiBand, RawSignal

QUIET = {"controls": False, "progress": False}
TOOLS = ("wide", "thin", "long")


def with_tools(**meta):
    """Twelve recordings of each material, four with each tool; a tool has sessions of its own."""
    data = make_data(n=12)
    own = [TOOLS[k % 12 // 4] for k in range(len(data))]
    return Dataset(
        [
            replace(
                r,
                session=f"{tool} {k % 2}",
                meta={"source": {"tool": tool}, **{name: of(k, tool) for name, of in meta.items()}},
            )
            for k, (r, tool) in enumerate(zip(data, own, strict=True))
        ]
    )


@pytest.fixture(scope="module")
def data():
    return with_tools(depth_mm=lambda k, _: 10.0 * (k % 2), run=lambda k, _: k)


class Fixed:
    """Names everything the first class."""

    def predict(self, X):
        return np.zeros(len(X))


def own_space():
    return FeatureSpace("own", MultiBand(rate_hz=500), None, classifier=BestClassifier(relative_costs=(1.0,)))


@pytest.fixture(scope="module")
def result(data):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("granular_id.evaluation.scoring.adapted_classifier", lambda *_: Fixed())
        return evaluate(data, {"raw": RawSignal(), "own": own_space()}, hold_out="tool", **QUIET)


def test_each_value_is_held_out_whole(result, data):
    tools = conditions_in(data)["tool"]
    held = result.partitions["condition"]
    assert [p.description for p in held] == [f"tool: {tool}" for tool in TOOLS]
    for part, tool in zip(held, TOOLS, strict=True):
        np.testing.assert_array_equal(part.test, np.flatnonzero(tools == tool))
        np.testing.assert_array_equal(part.train, np.flatnonzero(tools != tool))


def test_as_many_of_each_class_are_drawn_at_random(result, data):
    for held, beside in zip(result.partitions["condition"], result.partitions["matched"], strict=True):
        for rows, others in ((held.train, beside.train), (held.test, beside.test)):
            assert sorted(data.y[rows]) == sorted(data.y[others])


def test_the_headline_is_the_condition(result):
    assert result.headline == "condition"
    assert result.protocol_name("condition") == "another tool"
    assert result.held_out == "tool"
    assert "with another tool" in str(result)


def test_balanced_accuracy_is_the_mean_recall_of_the_tested_classes(result, data):
    part, named = result.partitions["condition"][0], result.predicted["condition", "raw"][0]
    truth = result.truth[part.test]
    expected = np.mean([np.mean(named[truth == k] == k) for k in range(4)])
    assert result.balanced_accuracies("raw", "condition")[0] == pytest.approx(expected)


def test_the_table_has_a_row_a_value_the_mean_and_its_interval(result):
    table = result.hold_out_table("raw")
    assert [row[0] for row in table.rows] == [*TOOLS, "mean", "95 % interval"]
    assert table.header == ("tool", "train", "tested", "accuracy", "balanced", "at random", "gap")
    assert table.rows[0][1:3] == ("32", "16")
    mean = result.balanced_accuracies("raw", "condition").mean()
    assert table.rows[3][4] == f"{100 * mean:.1f} %"
    low, high = result.interval("raw", "condition")
    assert table.rows[4][3] == f"{100 * low:.0f} to {100 * high:.0f}"
    assert str(table) in str(result)


def test_a_classifier_that_can_be_adapted_has_its_accuracies_beside(result):
    assert result.hold_out_table("own").header[5:7] == ("adapted", "at random")
    np.testing.assert_allclose(result.adapted_accuracies("own"), 1 / 4)
    assert {int(code) for one in result.adapted["own"] for code in one} == {0}
    assert result.adapted_accuracies("raw") is None


def test_nothing_is_declared_of_materials_that_a_value_lacks(data):
    fewer = data[[k for k in range(len(data)) if not (data.y[k] == "oat" and k % 12 < 3)]]
    result = evaluate(fewer, {"own": own_space()}, hold_out="tool", **QUIET)
    assert result.adapted == {}


def test_json_holds_what_was_adapted(result):
    figures = result.to_dict()["spaces"][1]["protocols"]["condition"]
    assert figures["adapted_accuracies"] == [0.25] * 3
    assert result.to_dict()["settings"]["hold_out"] == "tool"


def test_the_call_repeats_it(result):
    assert "hold_out='tool'" in result.command
    assert "protocol=" not in result.command


def test_a_result_without_condition_has_no_table(data):
    result = evaluate(data, {"raw": RawSignal()}, "kfold", **QUIET)
    assert hold_out_tables(result) == ()
    with pytest.raises(ValueError, match="no condition was held out: pass hold_out= to evaluate"):
        result.hold_out_table()


def test_best_chooses_by_held_out_values(data):
    best = FeatureSpace("best", MultiBand(rate_hz=500), None, classifier=BestClassifier())
    result = evaluate(data, {"best": best}, hold_out="tool", **QUIET)
    assert {one.note for one in result.chosen["condition", "best"]} == {"2 folds of whole conditions"}


def test_groups_choose_where_each_class_has_two(data):
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(40, 5)), np.tile(["a", "b"], 20)
    groups = np.repeat(["one", "two"], 20)
    clf = BestClassifier().fit(X, y, sessions=np.arange(40) // 4, groups=groups)
    assert clf.choice_.held_out == "conditions"
    lone = BestClassifier().fit(X, y, sessions=np.arange(40) // 4, groups=["one"] * 40)
    assert lone.choice_.held_out == "sessions"
    with pytest.raises(ValueError, match="groups must name one group per row of X, 40, got 3"):
        BestClassifier().fit(X, y, groups=[1, 2, 3])


def test_materials_without_another_value_are_not_tested():
    y = np.array(["a", "b", "c"] * 4 + ["d"] * 2)
    values = np.array(["one"] * 6 + ["two"] * 8, dtype=object)
    drawn, notes = condition_partitions(y, "tool", values)
    assert [part.description for part in drawn] == ["tool: one", "tool: two"]
    assert "d" not in y[drawn[1].test]
    assert drawn[1].test.size == 6
    assert notes == ["tool 'two': d has no other value to train on; 2 recordings not tested there"]
    for held, beside in zip(drawn, matched_partitions(y, drawn), strict=True):
        assert sorted(y[held.test]) == sorted(y[beside.test])


def test_a_value_without_anything_to_compare_stays():
    y = np.array(["a", "b", "a", "b", "c", "c"])
    values = np.array(["one", "one", "two", "two", "three", "three"], dtype=object)
    drawn, notes = condition_partitions(y, "day", values)
    assert len(drawn) == 2
    assert notes == ["day 'three' is not held out: c has no other value"]


def test_one_material_that_is_left_trains_nothing():
    y = np.array(["a", "b", "a"])
    drawn, notes = condition_partitions(y, "day", np.array(["one", "one", "two"], dtype=object))
    assert [part.description for part in drawn] == ["day: two"]
    assert notes == ["day 'one' is not held out: only a is left to train on"]


def test_an_interval_without_spread_is_explained(result):
    perfect = {
        ("condition", "raw"): tuple(result.truth[part.test] for part in result.partitions["condition"])
    }
    table = replace(result, predicted={**result.predicted, **perfect}).hold_out_table("raw")
    assert table.rows[-1][3] == "-"
    assert any(note.endswith("; -: no spread to tell it from") for note in table.notes)


def test_two_values_have_no_interval(data):
    two = data[np.flatnonzero(conditions_in(data)["tool"] != "long")]
    table = evaluate(two, {"raw": RawSignal()}, hold_out="tool", **QUIET).hold_out_table()
    assert table.rows[-1][3:6] == ("-", "-", "-")
    assert any(note.startswith("no interval: 2 values") for note in table.notes)


def test_sessions_on_both_sides_are_told(data):
    result = evaluate(data, {"raw": RawSignal()}, hold_out="depth_mm", **QUIET)
    assert "sessions have several values" not in " ".join(result.notes)
    mixed = Dataset([replace(r, session="one day") for r in data])
    result = evaluate(mixed, {"raw": RawSignal()}, hold_out="tool", **QUIET)
    assert any(note.startswith("1 of 1 session has several values of tool") for note in result.notes)


def test_conditions_are_session_set_up_metadata_and_day(data):
    stated = Dataset(
        [replace(r, meta={"tool": "rod", "rig": {"speed_m_s": 0.03, "lid": True}}) for r in data]
    )
    known = conditions_in(stated)
    assert list(known) == ["session", "tool", "motion", "rig.speed_m_s", "rig.lid", "day"]
    assert {name: values[0] for name, values in known.items() if name != "session"} == {
        **{"tool": "rod", "motion": "0.03 m/s", "rig.speed_m_s": "0.03", "rig.lid": "True"},
        "day": "2001-09-09",
    }


def test_a_name_is_one_thing_for_all_recordings():
    some = [
        replace(r, session="own" if k else None, meta={"session": "noted"})
        for k, r in enumerate(make_data(2))
    ]
    assert conditions_in(Dataset(some))["session"].tolist() == [None, *["own"] * 7]
    none = Dataset([replace(r, session=None) for r in some])
    assert set(conditions_in(none)["session"]) == {"noted"}


def test_a_condition_with_a_colon_in_its_name_keeps_its_name(data):
    odd = Dataset([replace(r, meta={"rig: tool": r.meta["source"]["tool"]}) for r in data])
    result = evaluate(odd, {"raw": RawSignal()}, hold_out="rig: tool", **QUIET)
    assert result.held_out == result.settings["hold_out"] == "rig: tool"
    assert result.protocol_name("condition") == "another rig: tool"
    assert [row[0] for row in result.hold_out_table().rows[:3]] == list(TOOLS)


def test_the_end_of_a_path_is_enough():
    data = with_tools(rig=lambda k, _: {"depth_mm": 10.0 + k % 2})
    assert evaluate(data, {"raw": RawSignal()}, hold_out="depth_mm", **QUIET).held_out == "rig.depth_mm"


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("speed", "no recording states it; those that can be: session .6 values., tool .3 values., "),
        ("label", "the labels are what is told apart"),
        ("day", "all recordings have the same value, '2001-09-09'"),
        ("run", "it has 48 values in 48 recordings, each a training of its own: note a few rounded values"),
        ("robot", "47 of 48 recordings do not state it, the first is 'oat_1'"),
        ("kind", "each material has one value of it only .oat: 'oat'., and would not train when held out"),
        ("pair", "each material has one value of it only"),
        ("width", "it is several things: a.width, b.width"),
        ("a", "it is no single value: take one within it, such as 'a.width'"),
    ],
)
def test_what_cannot_be_held_out_is_refused_with_those_that_can(name, reason):
    data = with_tools(
        depth_mm=lambda k, _: 10.0 * (k % 2),
        run=lambda k, _: k,
        robot=lambda k, _: "left" if k == 0 else None,
        kind=lambda k, _: LABELS[k // 12],
        pair=lambda k, _: k // 24,
        a=lambda k, _: {"width": 1},
        b=lambda k, _: {"width": 2},
    )
    with pytest.raises(ValueError, match=rf"hold_out='{name}' cannot be held out, as {reason}") as caught:
        evaluate(data, "raw", hold_out=name, **QUIET)
    assert caught.value.argument == "hold_out"


def test_nothing_that_can_be_held_out_is_said():
    data = Dataset([replace(r, session=None) for r in make_data(n=3)])
    with pytest.raises(ValueError, match="these recordings state none that can be"):
        evaluate(data, "raw", hold_out="tool", **QUIET)


def test_another_type_is_refused(data):
    with pytest.raises(TypeError, match="hold_out must be the name of a condition, got 3"):
        evaluate(data, "raw", hold_out=3, **QUIET)


@pytest.mark.parametrize("other", [{"protocol": "kfold"}, {"n_folds": 3}])
def test_it_stands_alone(data, other):
    (name,) = other
    with pytest.raises(ValueError, match=f"hold_out takes each value of 'tool' in turn: leave out {name}"):
        evaluate(data, "raw", hold_out="tool", **other, **QUIET)


def test_the_page_shows_the_table(result, monkeypatch):
    monkeypatch.setattr("granular_id.report.page.pictures", lambda *_: [])
    from granular_id.report.page import html

    page = html(result)
    assert "<h2>Another tool</h2>" in page
    assert page.count("one tool after the other held out") >= 2

"""evaluate(by=...): each value of a condition is held out whole, and models adapt to half of it."""

from dataclasses import replace

import numpy as np
import pytest

from evaluation_cases import LABELS, QUIET, make_data
from granular_id.evaluation import evaluate
from granular_id.recording import Dataset
from granular_id.recording.conditions import conditions_in
from granular_id.spaces import BestClassifier, FeatureSpace, MultiBand, RawSignal
from granular_id.splits import hold_out

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


def own_space():
    return FeatureSpace("own", MultiBand(rate_hz=500), None, classifier=BestClassifier(relative_costs=(1.0,)))


def test_each_value_is_held_out_whole(data):
    tools, folds = conditions_in(data)["tool"], hold_out(data, "tool")
    assert [fold.held_out for fold in folds] == list(TOOLS)
    assert (folds.name, folds.strict, folds.sessions_apart) == ("another tool", True, True)
    for fold, tool in zip(folds, TOOLS, strict=True):
        np.testing.assert_array_equal(fold.test, np.flatnonzero(tools == tool))
        np.testing.assert_array_equal(fold.train, np.flatnonzero(tools != tool))


def test_condition_that_comes_with_its_session_is_noted(data):
    note = "each session has one tool: a loss may be that of other sessions"
    assert note in hold_out(data, "tool").notes
    assert note not in hold_out(Dataset([replace(r, session="one") for r in data]), "tool").notes
    assert note in str(evaluate(data, {"own": own_space()}, by="tool", baselines=False, progress=False))


# Adapted.


class Fixed:
    """Names everything the first class."""

    def predict(self, X):
        return np.full(len(X), LABELS[0])


def test_adapted_accuracy_never_tests_a_recording_that_it_saw(data):
    """Each model sees one half of what is held out and names the other; the halves take turns."""
    space, asked = own_space(), []

    class Spy(Fixed):
        def __init__(self, seen):
            self.seen = seen

        def predict(self, X):
            asked.append((self.seen, X))
            return super().predict(X)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "granular_id.evaluation.evaluating.adapted_classifier", lambda fitted, X, y, new: Spy(new)
        )
        more = Dataset([*data, *(replace(r, name=f"{r.name} again", wrench=r.wrench + 0.1) for r in data)])
        result = evaluate(more, {"raw": RawSignal(), "own": space}, by="tool", accept="duplicates", **QUIET)
    assert len(asked) == 2 * len(TOOLS)
    for seen, new in asked:
        assert not {row.tobytes() for row in seen} & {row.tobytes() for row in new}
        assert len(seen) + len(new) == 32
    assert set(result.adapted) == {"own"}
    np.testing.assert_allclose(result.adapted["own"], 1 / 4)
    assert result.to_dict()["spaces"]["own"]["adapted"] == [0.25] * 3


def test_adapted_accuracies_stand_in_the_details(data):
    more = Dataset([*data, *(replace(r, name=f"{r.name} again", wrench=r.wrench + 0.1) for r in data)])
    result = evaluate(more, {"own": own_space()}, by="tool", accept="duplicates", **QUIET)
    assert result.adapted["own"].shape == (3,)
    assert "adapted: to half of the held-out recordings" in result.details()


def test_nothing_is_declared_of_few_recordings_or_lacking_materials(data):
    assert evaluate(data, {"own": own_space()}, by="tool", **QUIET).adapted == {}


# What can be held out.


def test_best_chooses_by_held_out_values(data):
    best = FeatureSpace("best", MultiBand(rate_hz=500), None, classifier=BestClassifier())
    result = evaluate(data, {"best": best}, by="tool", **QUIET)
    assert {one.note for one in result.chosen["best"]} == {"2 folds of whole conditions"}


def test_a_material_without_another_value_is_not_tested_there():
    y = [*"abc" * 4, "d", "d"]
    some = make_data(n=4)[:14]
    tools = ["one"] * 6 + ["two"] * 8
    data = Dataset(
        [replace(r, label=y[k], session=None, meta={"tool": tools[k]}) for k, r in enumerate(some)]
    )
    folds = hold_out(data, "tool")
    assert "d" not in data.y[folds.folds[1].test]
    assert dict(folds.untested) == {"d": "no other tool to train on"}
    assert "tool 'two': d has no other value to train on, and is not tested there" in folds.notes


def test_sessions_with_several_values_are_a_note(data):
    mixed = Dataset([replace(r, session="one day") for r in data])
    notes = hold_out(mixed, "tool").notes
    assert any(note.startswith("1 session has several values of tool") for note in notes)
    assert not any("several values" in note for note in hold_out(data, "tool").notes)


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


@pytest.mark.parametrize("name", ["depth_mm", "rig.depth_mm"])
def test_the_end_of_a_path_is_enough(name):
    data = with_tools(rig=lambda k, _: {"depth_mm": 10.0 + k % 2})
    result = evaluate(data, "raw", by=name, **QUIET)
    assert (result.folds.by, result.folds.name) == ("rig.depth_mm", "another rig.depth_mm")
    assert f"by={name!r}" in result.command


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("speed", "no recording states it; those that can be: session .6 values., tool .3 values., "),
        ("label", "the labels are what is told apart"),
        ("day", "all recordings have the same value, '2001-09-09'"),
        ("run", "it has 48 values in 48 recordings, each a training of its own: note a few rounded values"),
        ("robot", "47 of 48 recordings do not state it, the first is 'oat_1'"),
        ("kind", "each material has one value of it only .oat: 'oat'., and would not train when held out"),
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
        a=lambda k, _: {"width": 1},
        b=lambda k, _: {"width": 2},
    )
    with pytest.raises(ValueError, match=rf"by='{name}' cannot be held out, as {reason}") as caught:
        evaluate(data, "raw", by=name, **QUIET)
    assert caught.value.argument == "by"


def test_nothing_that_can_be_held_out_is_said():
    data = Dataset([replace(r, session=None) for r in make_data(n=3)])
    with pytest.raises(ValueError, match="these recordings state none that can be"):
        hold_out(data, "tool")

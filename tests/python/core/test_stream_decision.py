"""Decision: a frozen value, its words and its JSON."""

import dataclasses
import json
import pickle

import pytest

from granular_id.identifier import Decision

RANKING = (("rice", 0.1), ("salt", 0.3))


def decided(**changes):
    known = {"probability": None, "final": True, "n_seen": 1600, "seconds": 3.2}
    return Decision("rice", RANKING, 0.2, **{**known, **changes})


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({}, "final: margin 0.200 ahead of salt"),
        ({"final": False, "sure": True}, "sure: margin 0.200 ahead of salt"),
        ({"final": False}, "provisional: margin 0.200 ahead of salt"),
        ({"probability": 0.875}, "final: margin 0.200 ahead of salt, probability 0.875"),
        ({"warnings": ("gap", "lag")}, "final: margin 0.200 ahead of salt (gap, lag)"),
    ],
)
def test_one_line(changes, line):
    assert str(decided(**changes)) == f"rice after 3.20 s, {line}"


def test_values_for_json_and_for_other_processes():
    decision = decided(probability=0.5, warnings=("gap",))
    again = pickle.loads(pickle.dumps(decision))
    assert again == decision
    stored = json.loads(json.dumps(decision.to_dict()))
    assert stored.pop("ranking") == [list(pair) for pair in RANKING]
    assert stored == {
        "label": "rice",
        "margin": 0.2,
        "probability": 0.5,
        "final": True,
        "sure": False,
        "n_seen": 1600,
        "seconds": 3.2,
        "warnings": ["gap"],
        "candidates": [],
        "unknown": None,
    }


def test_it_never_changes():
    decision = decided()
    with pytest.raises(dataclasses.FrozenInstanceError):
        decision.label = "salt"
    with pytest.raises(dataclasses.FrozenInstanceError):
        decision.probability = 1.0
    warned = dataclasses.replace(decision, warnings=("lag",))
    assert (warned.warnings, decision.warnings) == (("lag",), ())

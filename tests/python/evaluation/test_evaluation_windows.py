"""Evaluations of windows, of few partitions and of classes that are never tested."""

from __future__ import annotations

import numpy as np
import pytest

from granular_id.evaluation import evaluate, headline
from granular_id.evaluation.findings import refuse_copies
from granular_id.partitions import Partition
from granular_id.recording import Dataset, Finding, Recording

QUICK = {"controls": False, "progress": False}


def drives(sessions, *, n=400, seed=0):
    """Recordings of noise, some a class, each a session."""
    rng = np.random.default_rng(seed)
    return Dataset(
        [
            Recording(rng.normal(size=(n, 6)), 100.0, label=label, name=f"{label}{k}", session=f"{label}{k}")
            for label, n_sessions in sessions.items()
            for k in range(n_sessions)
        ]
    )


@pytest.mark.parametrize("sessions", [{"a": 3, "b": 3, "c": 1}, {"a": 2, "b": 2}])
def test_no_window_trains_that_shares_samples_with_a_tested_one(sessions):
    data = drives(sessions, n=1200).windows(1.0, 0.5)
    result = evaluate(data, "raw", **QUICK)
    starts = [(r.meta["window"]["recording"], r.meta["window"]["start_s"]) for r in data]
    for part in result.partitions["session"]:
        tested = [starts[row] for row in part.test]
        near = [
            (one, other)
            for one, at in (starts[row] for row in part.train)
            for other, when in tested
            if one == other and abs(at - when) < 1
        ]
        assert near == []
    assert result.spoiling == ()
    told = any("share samples with tested ones do not train" in note for note in result.notes)
    assert told == ("c" in sessions)


def test_overlapping_windows_on_both_sides_spoil_an_evaluation():
    data = drives({"a": 2, "b": 2}).windows(1.0, 0.5)
    result = evaluate(data, "raw", "kfold", **QUICK)
    assert [finding.code for finding in result.spoiling] == ["overlapping-windows"]
    known = evaluate(data, "raw", "kfold", accept="overlapping-windows", **QUICK)
    assert known.spoiling == ()


def test_chance_is_that_of_the_classes_that_are_tested():
    rng = np.random.default_rng(0)
    data = Dataset(
        [
            Recording(
                rng.normal(size=(60, 6)),
                100.0,
                label=label,
                name=f"{label}{k}",
                session=f"{label}{k % n_sessions}",
                start_time=None if (label, k) == ("c", 0) else 1.7e9 + k,
            )
            for label, n, n_sessions in (("a", 8, 4), ("b", 8, 4), ("c", 20, 1))
            for k in range(n)
        ]
    )
    result = evaluate(data, "raw", progress=False)
    assert "c" in result.exceptions
    assert {control.chance for control in result.controls} == {0.5}


@pytest.mark.parametrize("n_folds", [0, 1, -1, 2.5, "3"])
@pytest.mark.parametrize("protocol", ["auto", "kfold"])
def test_numbers_of_folds_that_are_none(n_folds, protocol):
    with pytest.raises((TypeError, ValueError), match="n_folds must be"):
        evaluate(drives({"a": 2, "b": 2}), "raw", protocol, n_folds=n_folds, **QUICK)


@pytest.mark.parametrize(("rate_hz", "first"), [(40.0, "raw"), (100.0, "raw+hfmh")])
def test_the_usual_spaces_suit_the_rate(rate_hz, first):
    rng = np.random.default_rng(0)
    data = Dataset(
        [
            Recording(rng.normal(size=(80, 6)), rate_hz, label=label, name=f"{label}{k}", session=str(k % 2))
            for label in "ab"
            for k in range(4)
        ]
    )
    result = evaluate(data, **QUICK)
    assert [space.name for space in result.spaces] == [first, "multiband", "best"]
    assert any("a high-pass at 23 Hz" in note for note in result.notes) == (rate_hz == 40)


def test_a_class_of_one_session_stands_in_the_headline():
    data = drives({"a": 3, "b": 3, "c": 1}).windows(1.0)
    assert "(but for c: one session only)" in headline(evaluate(data, "raw", **QUICK))


def test_all_kinds_of_copies_are_refused_at_once():
    part = Partition("kfold", 0, "fold 1", np.array([0, 1]), np.array([2, 3]))
    found = [
        Finding("error", code, "", ("a", "b"), pair, {"pairs": [pair]})
        for code, pair in (("duplicates", (0, 2)), ("near-duplicates", (1, 3)))
    ]
    with pytest.raises(ValueError, match=r"1 more such pair.*accept=\('duplicates', 'near-duplicates'\)"):
        refuse_copies(found, (), [part], ["a", "b", "c", "d"])
    refuse_copies(found, ("duplicates", "near-duplicates"), [part], ["a", "b", "c", "d"])

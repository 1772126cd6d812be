"""Recordings of others: what they measured on them, within a few points."""

import numpy as np
import pytest

from granular_id.evaluation import evaluate
from granular_id.io import load
from granular_id.spaces import feature_spaces, in_paper_order
from robot_failures import RATE_HZ, load_failures

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def sliding(data_dir):
    data = load(data_dir / "sliding_wrench").resample(100, max_gap_s=1.0).align("shortest")
    assert data.X.shape == (1000, 594, 6)
    return data


@pytest.fixture(scope="module")
def result(sliding):
    counts = {"n_partitions": 2, "train_per_class": 40, "test_per_class": 10}
    return evaluate(sliding, "raw", ["paper", "chronological"], **counts, progress=False)


def test_sliding_recordings_show_the_gap_that_others_found(result):
    """Others report 99.3 % for random partitions and 78 % for the first half against the second (raw)."""
    assert result.mean_accuracy("raw", "paper") == pytest.approx(0.993, abs=0.01)
    assert result.accuracies("raw", "chronological") == pytest.approx([0.78, 0.78], abs=0.03)
    assert result.gap("raw") is None  # 40 and 25 recordings of a class train


def test_a_clock_that_names_the_label_stands_above_the_figures(result):
    assert [finding.code for finding in result.spoiling] == ["leak-clock"]
    assert result.table().startswith("SPOILED by leak-clock: the clock alone names 100 % of the labels")


@pytest.fixture(scope="module")
def at_random(sliding):
    counts = {"n_partitions": 2, "train_per_class": 40, "test_per_class": 10}
    return evaluate(sliding, "raw", "paper", **counts, progress=False)


@pytest.mark.parametrize(("name", "others"), [("clock", 1.0), ("rest", 0.97)])
def test_controls_reach_without_the_method_what_others_found(at_random, name, others):
    """Each material was recorded in one session, so the clock alone, or the first 0.3 s, tells nearly all."""
    control = next(control for control in at_random.controls if control.name == name)
    assert control.accuracy == pytest.approx(others, abs=0.04)
    assert "random partitions" in control.verdict


def test_the_usual_evaluation_of_sliding_recordings_leads_with_halves_in_time(sliding):
    few = sliding.select(labels=[f"mat{k:02d}" for k in range(1, 21, 4)])
    result = evaluate(few, "raw", controls=False, progress=False, accept="leak-clock")
    assert result.protocols == ("chronological", "matched")
    assert result.spoiling == ()
    assert "held-out sessions left out: no recording says which session it is from" in result.notes
    assert result.gap("raw") is not None


COPIES = ("duplicates", "near-duplicates")

FAILURES = {
    "lp1": ([16, 17, 21, 34], 0.73),
    "lp2": ([5, 6, 7, 9, 20], 0.66),
    "lp3": ([3, 9, 15, 20], 0.56),
    "lp4": ([21, 24, 72], 0.84),
    "lp5": ([21, 26, 26, 44, 47], 0.62),
}


@pytest.mark.parametrize("name", FAILURES)
def test_unbalanced_classes_of_short_recordings_work_with_every_protocol_of_folds(data_dir, name):
    """One draw of folds of 15 samples at 47.6 Hz: others' folds differ, by a few points."""
    data = load_failures(data_dir / "robot_failures", name)
    counts, published = FAILURES[name]
    assert sorted(np.unique(data.y, return_counts=True)[1].tolist()) == counts
    protocols = ["kfold", "chronological", "session"]
    result = evaluate(data, "raw", protocols, controls=False, progress=False, accept=COPIES)
    assert result.mean_accuracy("raw", "kfold") == pytest.approx(published, abs=0.08)
    for protocol in protocols:
        tested = np.concatenate([p.test for p in result.partitions[protocol]])
        assert sorted(tested) == list(range(len(data)))
        assert all(set(data.y[p.train]) == set(data.y) for p in result.partitions[protocol])


@pytest.mark.filterwarnings("ignore:cutoff_hz=23 leaves nearly nothing")
def test_all_spaces_and_controls_over_folds(data_dir):
    data = load_failures(data_dir / "robot_failures", "lp2")
    spaces = feature_spaces(rate_hz=RATE_HZ, bin_range=(-100.0, 100.0))
    names = in_paper_order(spaces)
    result = evaluate(data, {name: spaces[name] for name in names}, "kfold", progress=False, accept=COPIES)
    assert [space.name for space in result.spaces] == names
    assert len(names) == 13
    majority = 20 / 47
    assert min(result.mean_accuracy(name) for name in names) > 0.3
    assert result.mean_accuracy("raw") > majority + 0.1
    controls = {control.name: control for control in result.controls}
    assert controls["rest"].verdict == "left out: 0.3 s are 14 of 15 samples"
    assert controls["clock"].verdict == "left out: no recording carries a start time"
    assert controls["clock"].chance == pytest.approx(majority, abs=0.02)

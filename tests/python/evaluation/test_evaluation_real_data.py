"""Recordings of others: what they measured on them, within a few points."""

import numpy as np
import pytest

from effort import kinds
from evaluation_cases import QUIET
from granular_id.evaluation import evaluate
from granular_id.io import load
from granular_id.recording import Dataset
from robot_failures import load_failures

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def sliding(data_dir):
    folders = sorted((data_dir / "sliding_wrench").glob("mat*"))
    some = Dataset.concatenate([load(folder) for folder in kinds(folders[:6], long=folders)])
    return some.resample(100, max_gap_s=1.0).align("shortest")


@pytest.fixture(scope="module")
def halves(sliding):
    return evaluate(sliding, "raw", by="time", progress=False)


def test_sliding_recordings_show_the_gap_that_others_found(halves, sliding):
    """Others report 99.3 % for random partitions and 78 % for the first half against the second (raw)."""
    at_random = evaluate(sliding, "raw", paper=(2, 40, 10), progress=False)
    assert at_random.accuracy() == pytest.approx(0.993, abs=0.01)
    assert halves.accuracy() == pytest.approx(0.78, abs=0.03)
    assert halves.gap.is_lost
    assert halves.gap.points > 0.15


def test_a_clock_that_names_the_label_stands_above_the_figures(halves):
    assert [finding.code for finding in halves.spoiling] == ["leak-clock"]
    assert str(halves).startswith("SPOILED by leak-clock: the clock alone names 100 % of the labels")


def test_the_clock_reaches_what_others_found(halves):
    """Each material was recorded in one session, so that the clock alone names nearly all of them."""
    (clock,) = [one for one in halves.baselines if one.name == "clock"]
    assert clock.held.accuracy == pytest.approx(0.85, abs=0.04)
    assert clock.at_random > 0.95


COPIES = ("duplicates", "near-duplicates")

FAILURES = {
    "lp1": ([16, 17, 21, 34], 0.73),
    "lp2": ([5, 6, 7, 9, 20], 0.66),
    "lp3": ([3, 9, 15, 20], 0.56),
    "lp4": ([21, 24, 72], 0.84),
    "lp5": ([21, 26, 26, 44, 47], 0.62),
}


@pytest.mark.parametrize("name", kinds(["lp1", "lp4"], long=list(FAILURES)))
def test_unbalanced_short_recordings_are_as_hard_as_published(data_dir, name):
    """One draw of folds of 15 samples at 47.6 Hz: others' folds differ, by a few points."""
    data = load_failures(data_dir / "robot_failures", name)
    counts, published = FAILURES[name]
    assert sorted(np.unique(data.y, return_counts=True)[1].tolist()) == counts
    for by in ("random", "time"):
        result = evaluate(data, "raw", by=by, accept=COPIES, **QUIET)
        assert sorted(result.headline.rows) == list(range(len(data)))
        if by == "random":
            assert result.headline.right.mean() == pytest.approx(published, abs=0.08)

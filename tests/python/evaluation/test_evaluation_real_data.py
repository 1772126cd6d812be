"""Recordings of others: what they measured on them, within a few points."""

import pytest

from effort import kinds
from granular_id.evaluation import evaluate
from granular_id.io import load
from granular_id.recording import Dataset

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

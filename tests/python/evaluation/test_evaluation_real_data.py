"""The shared sliding recordings: what others measured on them, within a few points."""

import pytest

from granular_id.evaluation import evaluate
from granular_id.io import load

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def result(data_dir):
    data = load(data_dir / "sliding_wrench").resample(100, max_gap_s=1.0).align("shortest")
    assert data.X.shape == (1000, 594, 6)
    counts = {"n_partitions": 3, "train_per_class": 40, "test_per_class": 10}
    return evaluate(data, "raw", **counts, progress=False)


def test_sliding_recordings_show_the_gap_that_others_found(result):
    """Others report 99.3 % for random partitions and 78 % for the first half against the second (raw)."""
    assert result.protocols == ("paper", "chronological")
    assert result.strictest == "chronological"
    assert "chronological: by start time" in result.notes
    assert "session protocol left out: no recording says which session it is from" in result.notes
    assert result.mean_accuracy("raw", "paper") == pytest.approx(0.993, abs=0.01)
    forward, backward = result.accuracies("raw", "chronological")
    assert forward == pytest.approx(0.78, abs=0.03)
    assert backward == pytest.approx(0.78, abs=0.03)
    assert result.gap("raw") == pytest.approx(0.21, abs=0.04)
    assert "when they come from different halves in time" in result.table()


@pytest.mark.parametrize(
    ("name", "others"), [("clock", 1.0), ("rest", 0.97), ("means", 0.97), ("shuffled", 1 / 20)]
)
def test_controls_reach_without_the_method_what_others_found(result, name, others):
    """Each material was recorded in one session, so the clock alone, or the first 0.3 s, tells nearly all."""
    control = next(control for control in result.controls if control.name == name)
    assert control.accuracies["paper"] == pytest.approx(others, abs=0.04)
    assert ("random partitions" in control.verdict) == (name != "shuffled")

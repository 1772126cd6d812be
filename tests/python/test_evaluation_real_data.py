"""The shared sliding recordings: what others measured on them, within a few points."""

import pytest

from granular_id.evaluation import evaluate
from granular_id.io import load

pytestmark = pytest.mark.data


def test_sliding_recordings_show_the_gap_that_others_found(data_dir):
    """Others report 99.3 % for random partitions and 78 % for the first half against the second (raw)."""
    data = load(data_dir / "sliding_wrench").resample(100, max_gap_s=1.0).align("shortest")
    result = evaluate(
        data,
        "raw",
        ["paper", "chronological"],
        n_partitions=3,
        train_per_class=40,
        test_per_class=10,
        progress=False,
    )
    assert data.X.shape == (1000, 594, 6)
    assert "chronological: by start time" in result.notes
    assert result.mean_accuracy("raw", "paper") == pytest.approx(0.993, abs=0.01)
    forward, backward = result.accuracies("raw", "chronological")
    assert forward == pytest.approx(0.78, abs=0.03)
    assert backward == pytest.approx(0.78, abs=0.03)
    assert "points less with training and test from different halves" in result.table()

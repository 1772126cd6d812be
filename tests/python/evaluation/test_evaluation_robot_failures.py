"""The robot-failure sets: 15 samples, 47.6 Hz, unbalanced classes of 3 to 72 recordings."""

import numpy as np
import pytest

from granular_id.evaluation import evaluate, in_paper_order
from granular_id.spaces import feature_spaces
from robot_failures import RATE_HZ, SETS, load_failures

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def folder(data_dir):
    return data_dir / "robot_failures"


@pytest.mark.parametrize(
    ("name", "counts", "published"),
    [
        ("lp1", [16, 17, 21, 34], 0.73),
        ("lp2", [5, 6, 7, 9, 20], 0.66),
        ("lp3", [3, 9, 15, 20], 0.56),
        ("lp4", [21, 24, 72], 0.84),
        ("lp5", [21, 26, 26, 44, 47], 0.62),
    ],
)
def test_raw_five_fold_is_near_what_others_found(folder, name, counts, published):
    """One draw of folds: others' folds differ, by a few points."""
    data = load_failures(folder, name)
    assert sorted(np.unique(data.y, return_counts=True)[1].tolist()) == counts
    result = evaluate(data, "raw", "kfold", controls=False, progress=False)
    assert result.mean_accuracy("raw") == pytest.approx(published, abs=0.08)


def test_all_spaces_and_controls_over_folds(folder):
    data = load_failures(folder, "lp2")
    spaces = feature_spaces(rate_hz=RATE_HZ, bin_range=(-100.0, 100.0))
    names = in_paper_order(spaces)
    result = evaluate(data, {name: spaces[name] for name in names}, "kfold", progress=False)
    assert [space.name for space in result.spaces] == names
    assert len(names) == 13
    majority = 20 / 47
    for name in names:
        assert result.mean_accuracy(name) > 0.3
    assert sum(p.test.size for p in result.partitions["kfold"]) == 47
    assert result.mean_accuracy("raw") > majority + 0.1
    controls = {control.name: control for control in result.controls}
    assert controls["rest"].verdict == "left out: 0.3 s are 14 of 15 samples"
    assert controls["clock"].verdict == "left out: no recording carries a start time"
    assert controls["shuffled"].chance == pytest.approx(majority, abs=0.02)
    assert controls["shuffled"].verdict == "not above chance, as it must be"


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("protocol", ["kfold", "chronological", "session"])
def test_unbalanced_classes_work_with_every_protocol_of_folds(folder, name, protocol):
    data = load_failures(folder, name)
    n_folds = 3
    result = evaluate(data, "raw", protocol, n_folds=n_folds, controls=False, progress=False)
    tested = np.concatenate([p.test for p in result.partitions[protocol]])
    assert sorted(tested) == list(range(len(data)))
    for partition in result.partitions[protocol]:
        assert set(data.y[partition.train]) == set(data.y)

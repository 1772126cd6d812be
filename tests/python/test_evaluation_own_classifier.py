"""Feature spaces that bring their own classifier: evaluated, stored, resumed, reported, refused where it cannot be."""

from __future__ import annotations

import functools
import json

import pytest

from cli_cases import ended_well, refused, saved
from granular_id.best import BestClassifier
from granular_id.confidence import assess
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import EvaluationResult, evaluate
from granular_id.evaluation.controls import plan_controls
from granular_id.evaluation.gram_engine import GramBank
from granular_id.evaluation.plan import plan_spaces
from granular_id.recording import Dataset, Recording
from granular_id.selection import select
from multiband_cases import louder

OURS = ["multiband", "best"]
COUNTS = {"n_partitions": 2, "train_per_class": 6, "test_per_class": 3}


@pytest.fixture(scope="module")
def data():
    return Dataset(
        [
            Recording(wrench, 500.0, label=str(label), session=f"day {number % 3}", name=f"{number:02d}")
            for number, (wrench, label) in enumerate(zip(*louder(), strict=True))
        ]
    )


def counted_fits(monkeypatch):
    fitted = []
    fit = BestClassifier.fit

    @functools.wraps(fit)  # who asks for its parameters finds them
    def counted(self, X, y, **known):
        fitted.append(known)
        return fit(self, X, y, **known)

    monkeypatch.setattr(BestClassifier, "fit", counted)
    return fitted


def test_kept_resumed_stored_and_reported(data, tmp_path, monkeypatch):
    fitted = counted_fits(monkeypatch)
    result = evaluate(
        data, OURS, ["paper", "session"], controls=False, checkpoint=tmp_path / "kept", **COUNTS
    )
    n_partitions = sum(len(each) for each in result.partitions.values())
    assert len(fitted) == len(OURS) * n_partitions
    assert all(set(known["sessions"]) <= {"day 0", "day 1", "day 2"} for known in fitted)
    held = [len(set(known["sessions"])) for known in fitted]
    assert min(held) == 2  # a session that is tested is not told
    again = evaluate(data, OURS, ["paper", "session"], controls=False, checkpoint=tmp_path / "kept", **COUNTS)
    assert len(fitted) == len(OURS) * n_partitions  # nothing was trained again
    for key, said in result.predicted.items():
        assert [one.tolist() for one in again.predicted[key]] == [one.tolist() for one in said]
    result.to_json(tmp_path / "result.json")
    read = EvaluationResult.from_json(tmp_path / "result.json")
    assert read.table() == result.table()
    settings = {space.name: space.settings for space in read.spaces}
    assert "BestClassifier" in json.dumps(settings["best"]["own_classifier"])


def test_shuffled_labels_are_learned_by_the_classifier_of_the_space(data):
    planned = plan_spaces("best", data.rate_hz)
    checks = plan_controls(data, planned, ECOCClassifier(), GramBank(data.X))
    (shuffled,) = (check.task for check in checks if check.name == "shuffled")
    assert isinstance(shuffled.classifier, BestClassifier)


def test_a_choice_of_costs_refuses_them(data):
    with pytest.raises(ValueError, match="'best' brings its own: evaluate"):
        select(data, spaces=["raw", "best"], n_outer=2, n_inner=2)


def test_confidence_is_that_of_the_classifier_of_the_space(data, tmp_path, monkeypatch):
    saved(data, tmp_path / "recordings")
    models = []

    def seen(data, model, **options):
        models.append(model)
        return assess(data, model, **options)

    monkeypatch.setattr("granular_id.confidence.assess", seen)
    ended_well("confidence", tmp_path / "recordings", "--space", "multiband", "--seeds", 1, "--levels", "0.5")
    assert isinstance(models[0][-1], BestClassifier)
    assert list(models[0][-1].blocks) == ["coupling", "quantiles", "envelope", "spectrum"]
    said = refused("confidence", tmp_path / "recordings", "--space", "multi-band")
    assert "there is no feature space 'multi-band'" in said

"""Feature spaces that bring their own classifier: evaluated, written, reported."""

from __future__ import annotations

import functools
from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from cli_cases import ended_well, saved, written
from granular_id.confidence import assess
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import evaluate
from granular_id.evaluation.arguments import plan_spaces
from granular_id.evaluation.tables import choice_tables
from granular_id.recording import Dataset, Recording
from granular_id.spaces import HFMH
from granular_id.spaces.best import BestClassifier, Chosen
from multiband_cases import louder

OURS = ["best", "multiband"]
ASKED = {"protocol": ["paper", "session"], "n_partitions": 2, "train_per_class": 6, "test_per_class": 3}


@pytest.fixture(scope="module")
def data():
    return Dataset(
        [
            Recording(wrench, 500.0, label=str(label), session=f"day {number % 3}", name=f"{number:02d}")
            for number, (wrench, label) in enumerate(zip(*louder(), strict=True))
        ]
    )


@pytest.fixture(scope="module")
def first(data):
    """Return an evaluation, and what each training of a model was told."""
    fitted, fit = [], BestClassifier.fit

    @functools.wraps(fit)  # who asks for its parameters finds them
    def counted(self, X, y, **known):
        fitted.append(known)
        return fit(self, X, y, **known)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(BestClassifier, "fit", counted)
        return evaluate(data, OURS, controls=False, **ASKED), fitted


@pytest.fixture(scope="module")
def result(first):
    return first[0]


def test_a_session_that_is_tested_is_not_told(first):
    result, fitted = first
    n_partitions = sum(len(each) for each in result.partitions.values())
    assert len(fitted) == len(OURS) * n_partitions
    days = [set(known["sessions"]) for known in fitted]
    assert all(told <= {"day 0", "day 1", "day 2"} for told in days)
    assert min(map(len, days)) == 2


def test_choices_are_written(result, tmp_path):
    result.to_json(tmp_path / "result.json")
    best = next(one for one in written(tmp_path / "result.json")["spaces"] if one["name"] == "best")
    chosen = [tuple(one["chosen"]) for one in best["protocols"]["session"]["chosen"]]
    assert chosen == [one.chosen for one in result.chosen["session", "best"]]
    assert "BestClassifier" in str(best["settings"]["own_classifier"])


def test_what_was_chosen_is_shown_for_each_partition_and_over_all(result):
    assert {space for _, space in result.chosen} == {"best"}  # multiband has one model, and no choice
    of_each = result.chosen["session", "best"]
    assert len(of_each) == len(result.partitions["session"])
    assert all(one.note == "2 folds of whole sessions" for one in of_each)
    (over_all,) = choice_tables(result)
    assert over_all.header[1:] == ("random partitions", "held-out sessions", "held-out accuracy")
    for k, row in enumerate(over_all.rows):
        assert row[0] == f"{k + 1} {of_each[0].machines[k]}"
        assert row[2] == f"{sum(k in one.chosen for one in of_each)} of 3"
    assert over_all.title in result.table()


def test_only_a_choice_of_ours_is_one(data):
    class Foreign(ECOCClassifier):
        choice_ = "of its own"

    class Namesake(ECOCClassifier):
        choice_ = SimpleNamespace(reduced="of its own")

    assert Chosen.of(Foreign()) is None
    assert Chosen.of(Namesake()) is None
    assert Chosen.of(ECOCClassifier()) is None
    X, y = data.X[:, :40, 0], data.y
    fitted = make_pipeline(StandardScaler(), BestClassifier(relative_costs=[1.0], n_folds=2)).fit(X, y)
    assert Chosen.of(fitted) == Chosen.of(fitted[-1])
    assert len(Chosen.of(fitted).machines) == 2


@pytest.mark.parametrize(
    ("axes", "space"),
    [(("fz",), "best"), (("x", "y", "z"), "hfmh"), (tuple(f"s{k}" for k in range(13)), "hfmh")],
)
def test_recordings_of_other_axes_are_evaluated_and_drawn(tmp_path, axes, space):
    random = np.random.default_rng(0)
    noise = [(1 + k % 2) * random.normal(size=(60, len(axes))) for k in range(12)]
    data = Dataset([Recording(x, 100.0, label="ab"[k % 2], axes=axes) for k, x in enumerate(noise)])
    spaces = {"best": plan_spaces("best", 100.0)[0], "hfmh": HFMH(rate_hz=100.0)}
    result = evaluate(data, {space: spaces[space]}, "kfold", n_folds=3, progress=False)
    assert set(result.report_data.axes) <= set(axes)
    assert (len(result.report_data.axes), result.report_data.n_axes) == (min(6, len(axes)), len(axes))
    result.report(tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert ("What best chose:" in page) == (space == "best")
    assert ("of the axes of one unit in which the materials differ most" in page) == (len(axes) > 2)
    assert ("Figures of signals show 6 of 13 axes" in page) == (len(axes) > 6)


def test_confidence_is_that_of_the_classifier_of_the_space(data, tmp_path, monkeypatch):
    models = []

    def seen(data, model, **options):
        models.append(model)
        return assess(data, model, **options)

    monkeypatch.setattr("granular_id.confidence.assess", seen)
    folder = saved(data[:12], tmp_path / "recordings")
    ended_well("confidence", folder, "--space", "multiband", "--seeds", 1, "--levels", "0.5")
    assert isinstance(models[0][-1], BestClassifier)
    assert list(models[0][-1].blocks) == ["coupling", "quantiles", "envelope", "spectrum"]

"""Feature spaces that bring their own classifier: evaluated, written, reported."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from cli_cases import written
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import evaluate
from granular_id.evaluation.result import choice_tables
from granular_id.recording import Dataset, Recording
from granular_id.report import write
from granular_id.spaces import HFMH, feature_spaces
from granular_id.spaces.best import BestClassifier, choice_of
from multiband_cases import louder

OURS = ["best", "multiband"]


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
        return evaluate(data, OURS, baselines=False), fitted


@pytest.fixture(scope="module")
def result(first):
    return first[0]


def test_a_session_that_is_tested_trains_nothing(first):
    result, fitted = first
    # the folds of both, then 19 draws of the one without a choice and one of the other
    assert len(fitted) == len(result.folds) * (2 + 19 + 1)
    days = [set(known["sessions"]) for known in fitted[: 2 * len(result.folds)]]
    assert {len(seen) for seen in days} == {2}


def test_choices_are_written_and_shown(result, tmp_path):
    result.to_json(tmp_path / "result.json")
    saved = written(tmp_path / "result.json")["spaces"]
    assert saved["multiband"]["chosen"] == []  # one model, and no choice
    of_each = result.chosen["best"]
    assert [tuple(one["chosen"]) for one in saved["best"]["chosen"]] == [one.names for one in of_each]
    assert {one.note for one in of_each} == {"2 folds of whole sessions"}
    (table,) = choice_tables(result)
    assert table.header == ("candidate", "taken in folds", "held-out accuracy")
    for k, row in enumerate(table.rows):
        assert row[0] == f"{k + 1} {of_each[0].machines[k].name}"
        assert row[1] == f"{sum(k in one.chosen for one in of_each)} of 3"
    assert str(table) in result.details()


def test_only_a_choice_of_ours_is_one(data):
    class Foreign(ECOCClassifier):
        choice_ = "of its own"

    X, y = data.X[:, :40, 0], data.y
    for other in (Foreign(), ECOCClassifier(), BestClassifier(shrinkages=[None], relative_costs=[1.0])):
        assert choice_of(make_pipeline(StandardScaler(), other).fit(X, y)) is None
    fitted = make_pipeline(StandardScaler(), BestClassifier(relative_costs=[1.0], n_folds=2)).fit(X, y)
    assert choice_of(fitted) is fitted[-1].choice_
    assert len(choice_of(fitted).machines) == 3


@pytest.mark.parametrize(
    ("axes", "space"),
    [(("fz",), "best"), (("x", "y", "z"), "hfmh"), (tuple(f"s{k}" for k in range(13)), "hfmh")],
)
def test_recordings_of_other_axes_are_evaluated_and_drawn(tmp_path, axes, space):
    random = np.random.default_rng(0)
    noise = [(1 + k % 2) * random.normal(size=(60, len(axes))) for k in range(12)]
    data = Dataset([Recording(x, 100.0, label="ab"[k % 2], axes=axes) for k, x in enumerate(noise)])
    spaces = {"best": feature_spaces(rate_hz=100.0)["best"], "hfmh": HFMH(rate_hz=100.0)}
    result = evaluate(data, {space: spaces[space]}, by="random", progress=False)
    assert set(result.report_data.axes) <= set(axes)
    assert (len(result.report_data.axes), result.report_data.n_axes) == (min(6, len(axes)), len(axes))
    write(result, tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert ("What best chose" in page) == (space == "best")
    assert ("Figures of signals show 6 of 13 axes" in page) == (len(axes) > 6)

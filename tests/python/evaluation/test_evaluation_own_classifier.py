"""Feature spaces that bring their own classifier: evaluated, stored, resumed, reported, refused where it cannot be."""

from __future__ import annotations

import functools
import json
from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.linear_model import LogisticRegression
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from cli_cases import ended_well, saved
from granular_id._progress import Ticker
from granular_id.confidence import assess
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import EvaluationResult, evaluate
from granular_id.evaluation.arguments import plan_spaces
from granular_id.evaluation.controls import plan_controls
from granular_id.evaluation.features import GramBank
from granular_id.evaluation.scoring import Task, answers_of
from granular_id.evaluation.selection import select
from granular_id.evaluation.tables import choice_tables
from granular_id.recording import Dataset, Recording
from granular_id.spaces import HFMH, FeatureSpace, feature_spaces
from granular_id.spaces.best import BestClassifier, Chosen
from granular_id.splits import groups_of, nested_folds
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


def evaluated_counting_fits(data, folder):
    """Return an evaluation with a checkpoint, and what each training of a model was told."""
    fitted, fit = [], BestClassifier.fit

    @functools.wraps(fit)  # who asks for its parameters finds them
    def counted(self, X, y, **known):
        fitted.append(known)
        return fit(self, X, y, **known)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(BestClassifier, "fit", counted)
        return evaluate(data, OURS, controls=False, checkpoint=folder, **ASKED), fitted


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory):
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def first(data, checkpoint):
    return evaluated_counting_fits(data, checkpoint)


@pytest.fixture(scope="module")
def result(first):
    return first[0]


def test_a_session_that_is_tested_is_not_told_and_nothing_is_trained_again(data, first, checkpoint):
    result, fitted = first
    n_partitions = sum(len(each) for each in result.partitions.values())
    assert (
        len(fitted) == len(OURS) * n_partitions + 1
    )  # one of all recordings, for the picture of its weights
    days = [set(known["sessions"]) for known in fitted]
    assert days[-1] == {"day 0", "day 1", "day 2"}
    assert all(told <= days[-1] for told in days)
    assert min(map(len, days)) == 2
    again, fitted_again = evaluated_counting_fits(data, checkpoint)
    assert len(fitted_again) == 1
    assert again.chosen == result.chosen
    for key, said in result.predicted.items():
        assert [one.tolist() for one in again.predicted[key]] == [one.tolist() for one in said]


def test_choices_are_stored(result, tmp_path):
    result.to_json(tmp_path / "result.json")
    read = EvaluationResult.from_json(tmp_path / "result.json")
    assert read.table() == result.table()
    assert read.chosen == result.chosen
    settings = {space.name: space.settings for space in read.spaces}
    assert "BestClassifier" in json.dumps(settings["best"]["own_classifier"])


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


def test_the_picture_of_weights_is_of_the_models_that_were_chosen(data, result, tmp_path):
    seen = result.report_data
    assert seen.looked_at == "best"
    model = BestClassifier(optional_blocks=["level"])
    space = clone(plan_spaces("best", data.rate_hz)[0].transformer).fit(data.X)
    model.set_params(blocks=space.block_sizes_)
    known = groups_of(data).fit_arguments(model, np.arange(len(data)))
    features = space.transform(data.X)
    model.fit(features, data.y, **known)
    assert all(model.choice_.machines[k].name in seen.looked_with for k in model.choice_.chosen)
    sizes = np.abs(model.coef_[0]) * features.std(axis=0)
    parts = np.split(sizes, np.cumsum([*space.block_sizes_.values()])[:-1])
    shares = dict(zip(space.block_sizes_, parts, strict=True))
    for block in seen.weights:
        assert block.shares.sum() == pytest.approx(shares[block.name].sum() / sizes.sum(), rel=1e-3)
    result.report(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"Weights of one linear model of best ({seen.looked_with})" in page
    assert "What best chose:" in page


class Nearest(KNeighborsClassifier):
    """Without weights; counts how often it is trained."""

    fits = 0

    def fit(self, X, y):
        Nearest.fits += 1
        return super().fit(X, y)


def test_what_has_no_weights_is_not_trained_for_a_picture(data, tmp_path, monkeypatch):
    monkeypatch.setattr(Nearest, "fits", 0)
    near = FeatureSpace("near", HFMH(cutoff_hz=40.0), None, classifier=Nearest(n_neighbors=1))
    line = FeatureSpace("line", HFMH(n_bins=7), None, classifier=LogisticRegression())

    def looked(*spaces, **options):
        named = {space.name: space for space in spaces}
        return evaluate(data, named, "session", controls=False, **options).report_data

    alone = looked(near, checkpoint=tmp_path)
    assert (alone.looked_at, alone.weights) == (None, ())
    assert Nearest.fits == 3  # once for each session held out
    assert alone.high_pass.settings["cutoff_hz"] == 40.0
    assert looked(near, checkpoint=tmp_path).looked_at is None
    assert Nearest.fits == 3
    both = looked(near, line)
    assert (both.looked_at, both.looked_with) == ("line", "")
    assert looked(line).weights[0].shares.tolist() == both.weights[0].shares.tolist()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"chosen": [8]}, "chosen must be among the 8 candidate models"),
        ({"accuracies": [1.0]}, "wanted an accuracy of each of 8 candidate models, got 1"),
        ({"chosen": [1.0, True]}, r"chosen\[0\] must be a whole number, got 1.0"),
    ],
)
def test_a_choice_that_does_not_fit_its_models_is_refused(result, tmp_path, change, message):
    wrong = json.loads(json.dumps(result.to_dict()))
    wrong["spaces"][0]["protocols"]["session"]["chosen"][0].update(change)
    (tmp_path / "wrong.json").write_text(json.dumps(wrong), encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        EvaluationResult.from_json(tmp_path / "wrong.json")


def test_a_choice_without_a_part_is_refused(result):
    choice = result.chosen["session", "best"][0]
    stored = json.loads(json.dumps(choice.to_dict()))
    assert Chosen.from_dict(stored) == choice
    with pytest.raises(ValueError, match="a choice must hold 'note'"):
        Chosen.from_dict({name: value for name, value in stored.items() if name != "note"})


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
    assert "Feature importance" in page
    assert ("of the axes of one unit in which the materials differ most" in page) == (len(axes) > 2)
    assert ("Figures of signals show 6 of 13 axes" in page) == (len(axes) > 6)


def test_shuffled_labels_are_learned_by_the_classifier_of_the_space(data):
    planned = plan_spaces("best", data.rate_hz)
    checks = plan_controls(data, planned, ECOCClassifier(), GramBank(data.X))
    (shuffled,) = (check.task for check in checks if check.name == "shuffled")
    assert isinstance(shuffled.classifier, BestClassifier)


def test_a_choice_takes_their_classifiers_as_they_are(data):
    selection = select(data, spaces=["raw", "multiband"], n_outer=2, n_inner=2, progress=False)
    known = feature_spaces(rate_hz=data.rate_hz)["multiband"]
    folds = nested_folds(data, 2, 2, 0).nested
    partitions = {"folds": [fold.outer for fold in folds]}
    labels, truth = np.unique(data.y, return_inverse=True)
    task = Task(known, known.classifier, GramBank(data.X), groups_of(data))
    answers, _ = answers_of(
        task,
        partitions=partitions,
        labels=labels,
        truth=truth,
        seed=0,
        n_jobs=1,
        ticker=Ticker(2, None),
        checkpoint=None,
    )
    hits = [
        np.mean(one.predicted == truth[fold.outer.test])
        for one, fold in zip(answers["folds"], folds, strict=True)
    ]
    multiband = selection.candidates[1]
    assert multiband.accuracies.tolist() == [[hit] * 5 for hit in hits]
    assert multiband.parts > selection.candidates[0].parts


def test_a_chosen_space_with_its_own_classifier_has_no_cost_and_fits(data):
    selection = select(data, spaces=["best"], n_outer=2, n_inner=2, progress=False)
    assert selection.C is None
    assert selection.verdict().startswith("Take best\n")
    assert (selection.to_train.space, selection.to_train.C) == ("best", None)
    model = selection.model().fit(data.X, data.y)
    assert model.predict(data.X[:3]).shape == (3,)


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

"""evaluate: equal to a plain loop, seeded, what it records, how it ends, and what it refuses."""

import json
import threading
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.dummy import DummyClassifier
from sklearn.ensemble import RandomForestClassifier
from sklearn.impute import SimpleImputer
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from sklearn.svm import SVC

from evaluation_cases import QUIET, THREE, Centroids, changed, flat, make_data, of_levels
from granular_id._estimators import describe_estimator
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import evaluate
from granular_id.recording import Dataset, Recording, SampleFlag
from granular_id.spaces import HFMH, RawHFMH, RawSignal, Tare, feature_spaces
from granular_id.splits import hold_out

PAPER = (3, 6, 3)


@pytest.mark.parametrize("name", THREE)
def test_answers_equal_a_plain_loop_over_folds_and_pairs(data, evaluated, name):
    y, held = data.y, evaluated.held[name]
    features = feature_spaces()[name].transformer.fit(data.X).transform(data.X)
    for k, (train, test, _) in enumerate(hold_out(data)):
        answers = np.array(evaluated.labels)[held.predicted[held.fold == k]]
        plain = ECOCClassifier().fit(features[train], y[train])
        np.testing.assert_array_equal(held.rows[held.fold == k], test)
        np.testing.assert_array_equal(answers, plain.predict(features[test]))
        np.testing.assert_allclose(held.values[held.fold == k], plain.decision_function(features[test]))
    assert 0.3 < held.accuracy < 1.0  # labels mean little where all are right


def test_headline_is_the_first_space_not_the_best(data, evaluated):
    worse, better = sorted(("raw", "hfmh"), key=evaluated.accuracy)
    assert evaluated.accuracy(worse) < evaluated.accuracy(better)
    result = evaluate(data, [worse, better], **QUIET)
    assert result.accuracy() == evaluated.accuracy(worse)
    assert str(result).startswith(f"{worse} names {100 * result.accuracy():.1f} % right with held-out")


def test_unbalanced_classes_have_balanced_accuracy_beside_chance():
    """An answer that never varies is at chance, however frequent one class is."""
    rng = np.random.default_rng(0)
    data = of_levels(rng.normal(size=(100, 6)), ["a"] * 90 + ["b"] * 10, [f"s{k % 3}" for k in range(100)])
    result = evaluate(data, "raw", classifier=DummyClassifier(), **QUIET)
    assert result.accuracy() == result.chance == 0.5
    assert result.headline.right.mean() == 0.9


def test_chance_counts_the_materials_that_are_tested():
    rng = np.random.default_rng(0)
    labels = ["a", "b"] * 6 + ["c"] * 6
    data = of_levels(rng.normal(size=(18, 6)), labels, [f"s{k // 4}" for k in range(12)] + ["own"] * 6)
    result = evaluate(data, "raw", classifier=Centroids(), **QUIET)
    assert result.chance == 0.5
    assert np.isnan(result.recall()[2])
    assert "not tested: c, one session" in str(result)


def test_a_random_classifier_is_seeded_by_fold(data):
    forest = RandomForestClassifier(n_estimators=2)
    settings = ({"n_jobs": 1}, {"n_jobs": 2}, {"random_state": 8})
    one, two, other = (evaluate(data, "raw", classifier=forest, **QUIET, **each) for each in settings)
    assert list(one.predictions()) == list(two.predictions()) != list(other.predictions())
    assert one.gap == two.gap
    assert forest.random_state is None
    assert not hasattr(forest, "classes_")


def test_values_of_pairs_are_not_taken_for_those_of_classes(data):
    of_pairs = evaluate(data, "raw", classifier=SVC(kernel="linear", decision_function_shape="ovo"), **QUIET)
    of_classes = evaluate(data, "raw", classifier=SVC(kernel="linear"), **QUIET)
    assert list(of_pairs.predictions()) == list(of_classes.predictions())
    assert (of_pairs.headline.values == np.eye(4)[of_pairs.headline.predicted]).all()


class Memory(TransformerMixin, BaseEstimator):
    """Remembers the sum of each array it was fitted on, across clones."""

    fitted_on: ClassVar[list[float]] = []

    def __init__(self, learns=True):
        self.learns = learns

    def fit(self, X, y=None):
        Memory.fitted_on.append(round(float(np.sum(X)), 6))
        return self

    def transform(self, X):
        return flat(X)


def test_steps_that_learn_are_fitted_on_training_rows_only(data):
    def total(rows):
        return round(float(np.sum(data.X[rows])), 6)

    Memory.fitted_on.clear()
    result = evaluate(data, {"mine": Memory()}, paper=PAPER, **QUIET)
    assert Memory.fitted_on == [total(fold.train) for fold in result.folds]
    assert (result.folds.name, result.gap) == ("random partitions", None)
    Memory.fitted_on.clear()
    same = evaluate(data, {"mine": Memory(learns=False)}, paper=PAPER, **QUIET)
    assert Memory.fitted_on == [total(slice(None))]
    assert list(same.predictions()) == list(result.predictions())


def test_settings_versions_and_command_are_recorded(evaluated):
    assert (evaluated.settings["seed"], evaluated.settings["by"]) == (0, "auto")
    assert evaluated.settings["classifier"]["C"] == 1.0
    assert set(evaluated.versions) >= {"granular_id", "numpy", "scikit-learn", "python"}
    assert (evaluated.data["n_recordings"], evaluated.data["rate_hz"]) == (40, 500.0)
    assert evaluated.paper_accuracies == {"raw+hfmh": 0.9705, "hfmh": 0.8705, "raw": 0.7614}
    assert [held.n_features for held in evaluated.held.values()] == [480 + 600, 600, 480]
    assert evaluated.folds.notes == ("8 sessions held out whole, in 2 folds",)
    call = "granular_id.evaluate(data, spaces=['raw+hfmh', 'hfmh', 'raw'], random_state=0)"
    assert evaluated.command == call


def test_history_marks_and_warnings_of_the_data_are_recorded():
    flags = np.where(np.arange(80) % 4 == 0, np.uint8(SampleFlag.GAP_FILLED), np.uint8(0))
    data = make_data(flags=flags, meta={"synthetic": True}).align(n_samples=60)
    result = evaluate(data, "raw", **QUIET)
    assert [step["step"] for step in result.data["history"]] == ["align"]
    assert result.synthetic
    assert "SYNTHETIC" in str(result).splitlines()[0]
    (gaps,) = [note for note in result.notes if "interpolated inside gaps" in note]
    assert gaps.startswith("warning: ")
    assert gaps[:40] in str(result)


def test_seed_none_draws_one_and_records_it(data):
    one, other = (evaluate(data, "raw", by="random", random_state=None, **QUIET) for _ in range(2))
    assert one.settings["seed"] != other.settings["seed"]
    again = evaluate(data, "raw", by="random", random_state=one.settings["seed"], **QUIET)
    assert list(again.predictions()) == list(one.predictions()) != list(other.predictions())


@pytest.mark.parametrize("clock", [True, False])
def test_progress_counts_every_fit_and_ends_at_its_total(data, clock):
    steps = []
    some = data if clock else changed(data, start_time=lambda r: None)
    evaluate(some, ["raw", "hfmh"], n_jobs=2, progress=lambda *step: steps.append(step))
    # two folds: two spaces and the clock, where it can be had, held out and at random, 18 more draws of the headline
    n_steps = 2 * (2 * (2 + clock) + 18)
    assert [step[:2] for step in steps] == [(done, n_steps) for done in range(1, n_steps + 1)]


@pytest.mark.parametrize(("rate_hz", "last"), [(40.0, "raw"), (100.0, "raw+hfmh")])
def test_usual_spaces_suit_the_rate(rate_hz, last):
    result = evaluate(changed(make_data(n=4), rate_hz=lambda r: rate_hz), **QUIET)
    assert result.spaces == ("best", "multiband", last)
    assert result.gap.space == "multiband"  # the same without a choice, and quicker to draw
    assert any("a high-pass at 23 Hz" in note for note in result.notes) == (rate_hz == 40)


@pytest.mark.parametrize(("error", "n_jobs"), [(KeyboardInterrupt, 1), (RuntimeError, 2)])
def test_an_exception_from_progress_ends_the_run(data, error, n_jobs):
    def stop(done, total, what):
        if done == 3:
            raise error

    before = threading.active_count()
    with pytest.raises(error):
        evaluate(data, "raw", n_jobs=n_jobs, baselines=False, progress=stop)
    assert threading.active_count() <= before + 2


def test_settings_of_any_estimator_become_json():
    imputer = SimpleImputer(missing_values=np.nan)
    function = FunctionTransformer(flat, inv_kw_args={"a": np.float64(np.inf)})
    described = describe_estimator(make_pipeline(function, imputer, SVC(C=np.float32(0.5))))
    text = json.dumps(described, allow_nan=False)
    assert '"missing_values": "nan"' in text
    assert '"C": 0.5' in text
    assert describe_estimator(function)["func"] == "evaluation_cases.flat"  # not where it lies in memory


def copied(data, session):
    """The recordings, and one of them again under the next name."""
    same = {"rate_hz": 500.0, "label": data[0].label, "session": session, "start_time": 2e9}
    return Dataset([*data, Recording(data[0].wrench, name="twin", **same)])


def test_copies_on_both_sides_of_a_split_stop_it(data):
    apart = next(one.session for one in data if one.label == data[0].label and one.session != data[0].session)
    message = r"'oat_0' and 'twin' share samples, and one trains .* pass accept=\('duplicates',\)"
    with pytest.raises(ValueError, match=message):
        evaluate(copied(data, apart), "raw", **QUIET)
    known = evaluate(copied(data, apart), "raw", accept="duplicates", **QUIET)
    assert [finding.code for finding in known.findings] == ["duplicates"]
    assert known.spoiling == ()
    assert "accepted: duplicates" in str(known)


def test_copies_within_a_held_out_session_stand_first(data):
    result = evaluate(copied(data, data[0].session), "raw", accept="leak-clok", **QUIET)
    assert [finding.code for finding in result.spoiling] == ["duplicates"]
    assert str(result).startswith("SPOILED by duplicates: 1 recording holds exactly the samples of another")
    assert "accept: the checks found nothing called 'leak-clok'" in result.notes


def test_no_session_is_asked_for_where_days_are_held_out(data):
    days = Dataset([replace(one, session=None, start_time=86400.0 * (k % 3)) for k, one in enumerate(data)])
    notes = {by: evaluate(days, "raw", by=by, **QUIET).notes for by in ("random", "day")}
    assert ["no recording says which session" in " ".join(notes[by]) for by in notes] == [True, False]


def with_gap(X):
    return np.where(np.arange(X[0].size) == 3, np.nan, flat(X))


OTHER_RATE = r"spaces\['mine'\]: .* has rate_hz=100, the recordings have 500 Hz"
SHORTER = Dataset([*make_data(), Recording(np.zeros((70, 6)), 500.0, label="oat", name="odd")])


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"data": np.zeros((4, 5, 6))}, TypeError, "data must be a granular_id.Dataset, got ndarray"),
        ({"data": SHORTER}, ValueError, r"differ in length .* call \.align\("),
        ({"spaces": "wavelets"}, ValueError, "spaces must be among 'all', 'paper', .*, got 'wavelets'"),
        ({"spaces": []}, ValueError, "at least one feature space, got none"),
        ({"spaces": StandardScaler()}, TypeError, "names or a mapping, .* got StandardScaler"),
        ({"spaces": ["raw", "raw"]}, ValueError, "each feature space once"),
        ({"spaces": {"mine": object()}}, TypeError, r"spaces\['mine'\] must have fit and transform"),
        ({"spaces": {"mine": make_pipeline(HFMH(), SVC())}}, TypeError, "classifier=, got Pipeline"),
        ({"spaces": {"": StandardScaler()}}, TypeError, "a name must be non-empty text"),
        ({"spaces": {"flat": FunctionTransformer()}}, ValueError, r"'flat' must give an array \(n, D\)"),
        ({"spaces": {"mine": RawHFMH(rate_hz=100.0)}}, ValueError, OTHER_RATE),
        (
            {"spaces": {"mine": FunctionTransformer(with_gap)}},
            ValueError,
            "'mine' must give finite .* nan in column 3",
        ),
        ({"by": "session", "paper": True}, ValueError, "by='session' has no use with paper"),
        ({"paper": True}, ValueError, r"pass paper=\(20, 8, 2\) \(--paper 20,8,2\)$"),
        ({"paper": (1, 2)}, TypeError, r"paper must be True or three numbers, .* got \(1, 2\)"),
        ({"classifier": SVC}, TypeError, "classifier must be a classifier of scikit-learn"),
        ({"classifier": SVC(), "spaces": "best"}, ValueError, "classifier has no use: best has one"),
        ({"baselines": "yes"}, TypeError, "baselines must be"),
        ({"accept": [3]}, TypeError, "accept must hold names as granular-id data check prints them, got 3"),
        ({"progress": "yes"}, TypeError, "progress must be a bool or callable, got str"),
        ({"random_state": -1}, ValueError, "random_state must be at least 0"),
    ],
)
def test_bad_arguments_are_refused(data, change, kind, message):
    arguments = {"data": data, "spaces": "raw", **QUIET, **change}
    with pytest.raises(kind, match=message) as caught:
        evaluate(arguments.pop("data"), **arguments)
    assert getattr(caught.value, "argument", next(iter(change))) in change


def test_the_counts_that_a_refusal_offers_fit(data):
    assert len(evaluate(data, "raw", paper=(2, 8, 2), **QUIET).folds) == 2


def test_transformers_take_the_rate_of_the_recordings():
    data = changed(make_data(n=4), rate_hz=lambda r: 100.0)
    pipeline = make_pipeline(Tare(tare_s=0.1), RawHFMH())
    result = evaluate(data, {"mine": pipeline, "raw": RawSignal()}, **QUIET)
    assert '"rate_hz": 100.0' in json.dumps(result.settings["transformers"])
    assert pipeline[0].rate_hz is None

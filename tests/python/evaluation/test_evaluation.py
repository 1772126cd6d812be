"""evaluate: equal to a plain loop, seeded, what it records, how it ends."""

import json
import sys
import threading
from typing import ClassVar

import numpy as np
import pytest
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.ensemble import RandomForestClassifier
from sklearn.impute import SimpleImputer
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from sklearn.svm import SVC

from evaluation_cases import SMALL, THREE, changed, flat, make_data
from granular_id._estimators import describe_estimator
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import evaluate
from granular_id.partitions import chronological_partitions, paper_partitions
from granular_id.recording import Dataset, Recording, SampleFlag
from granular_id.spaces import feature_spaces


def naive_labels(train, y_train, test):
    """One scikit-learn machine per pair, hinge losses averaged by hand, smallest loss wins."""
    labels = sorted(set(y_train.tolist()))
    losses = np.zeros((len(test), len(labels)))
    for a in range(len(labels)):
        for b in range(a + 1, len(labels)):
            pair = np.isin(y_train, [labels[a], labels[b]])
            machine = SVC(kernel="linear", tol=1e-8).fit(train[pair], y_train[pair] == labels[a])
            score = machine.decision_function(test)
            losses[:, a] += np.maximum(0, 1 - score) / 2
            losses[:, b] += np.maximum(0, 1 + score) / 2
    return np.array(labels)[losses.argmin(axis=1)]


@pytest.mark.parametrize("name", THREE)
def test_equals_a_plain_loop_over_partitions_and_over_pairs(data, evaluated, name):
    y = data.y
    features = feature_spaces()[name].transformer.fit(data.X).transform(data.X)
    made = {
        "paper": paper_partitions(y, n_partitions=3, train_per_class=6, test_per_class=3, seed=0),
        "chronological": chronological_partitions(y, np.argsort(data.start_times)),
    }
    for protocol, partitions in made.items():
        for j, partition in enumerate(partitions):
            train, test = partition.train, partition.test
            np.testing.assert_array_equal(evaluated.partitions[protocol][j].train, train)
            np.testing.assert_array_equal(evaluated.partitions[protocol][j].test, test)
            found = np.array(evaluated.labels)[evaluated.predicted[protocol, name][j]]
            plain = ECOCClassifier().fit(features[train], y[train]).predict(features[test])
            np.testing.assert_array_equal(found, plain)
            np.testing.assert_array_equal(found, naive_labels(features[train], y[train], features[test]))
            assert evaluated.accuracies(name, protocol)[j] == np.mean(found == y[test])
    # a comparison of labels means little where every label is right
    assert 0.3 < evaluated.mean_accuracy(name) < 1.0


def test_a_random_classifier_is_seeded_by_partition(data):
    forest = RandomForestClassifier(n_estimators=5)
    one, two, other = (
        evaluate(data, "raw", "paper", classifier=forest, **{**SMALL, **settings})
        for settings in ({"n_jobs": 1}, {"n_jobs": 2}, {"random_state": 8})
    )
    assert list(one.predictions()) == list(two.predictions())
    assert list(one.predictions()) != list(other.predictions())
    assert forest.random_state is None


def test_any_classifier_fits_training_rows_only(data):
    seen = []

    class Spy(SVC):
        def fit(self, X, y):
            seen.append((X.shape, np.bincount(y).tolist()))
            return super().fit(X, y)

    result = evaluate(data, "raw", "paper", classifier=Spy(kernel="linear"), **SMALL)
    assert seen == [((24, 480), [6, 6, 6, 6])] * 3
    features = flat(data.X.transpose(0, 2, 1))
    for said, partition in zip(result.predicted["paper", "raw"], result.partitions["paper"], strict=True):
        plain = SVC(kernel="linear").fit(features[partition.train], data.y[partition.train])
        expected = plain.predict(features[partition.test])
        np.testing.assert_array_equal(np.array(result.labels)[said], expected)


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


def test_what_learns_is_fitted_on_training_rows_and_the_rest_once(data):
    def total(rows):
        return round(float(np.sum(data.X[rows])), 6)

    Memory.fitted_on.clear()
    result = evaluate(data, {"mine": Memory()}, "paper", **SMALL)
    assert Memory.fitted_on == [total(p.train) for p in result.partitions["paper"]]
    assert result.space("mine").learns
    Memory.fitted_on.clear()
    same = evaluate(data, {"mine": Memory(learns=False)}, "paper", **SMALL)
    assert Memory.fitted_on == [total(slice(None))]
    assert [p.predicted for p in same.predictions()] == [p.predicted for p in result.predictions()]


def test_a_transformer_that_does_not_say_counts_as_learning(data):
    pipeline = make_pipeline(FunctionTransformer(flat), StandardScaler())
    space = evaluate(data, {"standardised": pipeline}, "paper", **SMALL).space("standardised")
    assert (space.learns, space.paper_accuracy, space.n_features) == (True, None, 480)


def test_what_is_recorded(evaluated):
    assert evaluated.settings["seed"] == 0
    assert evaluated.settings["classifier"]["class"] == "ECOCClassifier"
    assert evaluated.settings["classifier"]["C"] == 1.0
    assert set(evaluated.versions) >= {"granular_id", "numpy", "scikit-learn", "python"}
    assert (evaluated.data["n_recordings"], evaluated.data["rate_hz"]) == (40, 500.0)
    assert [space.name for space in evaluated.spaces] == ["raw+hfmh", "hfmh", "raw"]
    assert [space.paper_accuracy for space in evaluated.spaces] == [0.9705, 0.8705, 0.7614]
    assert [space.n_features for space in evaluated.spaces] == [480 + 600, 600, 480]
    for space in evaluated.spaces:
        assert set(space.seconds) == {"features", "gram", "training", "prediction"}
        assert min(space.seconds.values()) > 0
    assert "chronological: by start time" in evaluated.notes
    assert evaluated.command == (
        "granular_id.evaluate(data, spaces=['raw+hfmh', 'hfmh', 'raw'], protocol=['paper', 'chronological'], "
        "n_partitions=3, train_per_class=6, test_per_class=3, n_folds=3, random_state=0)"
    )
    assert evaluated.wall_s > 0
    assert not evaluated.synthetic


def test_history_marks_and_doubts_of_the_data_are_in_the_result():
    flags = np.where(np.arange(80) % 4 == 0, np.uint8(SampleFlag.GAP_FILLED), np.uint8(0))
    data = make_data(flags=flags, meta={"synthetic": True}, session="one of all").align(n_samples=60)
    result = evaluate(data, "raw", "paper", **SMALL)
    assert [step["step"] for step in result.data["history"]] == ["align"]
    assert result.data["n_samples"] == 60
    assert result.synthetic
    assert result.table().startswith("Accuracy on SYNTHETIC recordings")
    (gaps,) = [note for note in result.notes if "interpolated inside gaps" in note]
    assert gaps.startswith("warning: ")
    assert "(25 %)" in gaps
    confounded = changed(make_data(), session=lambda r: r.label)
    assert any("4 of 4 labels" in note for note in evaluate(confounded, "raw", "paper", **SMALL).notes)


def test_seed_none_draws_one_and_records_it(data):
    one, other = (evaluate(data, "raw", "paper", random_state=None, **SMALL) for _ in range(2))
    assert one.settings["seed"] != other.settings["seed"]
    again = evaluate(data, "raw", "paper", random_state=one.settings["seed"], **SMALL)
    assert list(again.predictions()) == list(one.predictions())
    assert list(again.predictions()) != list(other.predictions())


def test_progress_is_told_step_by_step(data):
    steps = []
    settings = {**SMALL, "progress": lambda *step: steps.append(step)}
    evaluate(data, ["raw", "hfmh"], "paper", n_jobs=2, **settings)
    assert [done for done, _, _ in steps] == list(range(1, 7))
    assert {total for _, total, _ in steps} == {6}
    assert "hfmh: partition 3" in [what for _, _, what in steps]


@pytest.mark.parametrize("terminal", [False, True])
def test_each_accuracy_is_a_line_with_or_without_a_terminal(data, capfd, monkeypatch, terminal):
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal)
    monkeypatch.setitem(sys.modules, "rich", None)
    evaluate(data, ["multiband", "raw"], **{**SMALL, "progress": True})
    out, err = capfd.readouterr()
    lines = [line.split("  ")[0] for line in err.splitlines() if "%" in line]
    assert out == ""
    assert lines == ["held-out sessions", "held-out sessions", "as many at random", "as many at random"]
    assert err.index(" raw ") < err.index(" multiband ")  # the cheapest first


def test_usual_spaces_and_partitions(data):
    result = evaluate(data, **SMALL)
    assert [space.name for space in result.spaces] == ["raw+hfmh", "multiband", "best"]
    assert result.protocols == ("session", "matched")
    assert result.gap("raw+hfmh") is not None
    note = (
        "n_partitions, train_per_class, test_per_class had no use: that is of the protocol 'paper' (--paper)"
    )
    assert any(line.startswith(note) for line in result.notes)


def copied(data, session):
    """The recordings, and one of them again under the next name."""
    twin = Recording(
        data[0].wrench, rate_hz=500.0, label=data[0].label, name="twin", session=session, start_time=2e9
    )
    return Dataset([*data, twin])


def test_copies_on_both_sides_of_a_split_stop_it(data):
    apart = next(one.session for one in data if one.label == data[0].label and one.session != data[0].session)
    message = r"'oat_0' and 'twin' share samples, and one trains .* pass accept=\('duplicates',\)"
    with pytest.raises(ValueError, match=message):
        evaluate(copied(data, apart), "raw", **SMALL)
    known = evaluate(copied(data, apart), "raw", **SMALL, accept="duplicates")
    assert [finding.code for finding in known.findings] == ["duplicates"]
    assert known.spoiling == ()


def test_an_accepted_name_that_nothing_has_is_told(data):
    result = evaluate(data, "raw", **SMALL, accept="leak-clok")
    assert "accept: the checks found nothing called 'leak-clok'" in result.notes


def test_copies_within_a_session_spoil_nothing_where_sessions_are_held_out(data):
    result = evaluate(copied(data, data[0].session), "raw", **SMALL)
    assert result.protocols == ("session", "matched")
    assert result.findings == ()


@pytest.mark.parametrize(("error", "n_jobs"), [(KeyboardInterrupt, 1), (RuntimeError, 2)])
def test_an_exception_from_progress_ends_the_run(data, error, n_jobs):
    def stop(done, total, what):
        if done == 3:
            raise error

    before = threading.active_count()
    with pytest.raises(error):
        evaluate(data, "raw", "paper", n_jobs=n_jobs, **{**SMALL, "progress": stop})
    assert threading.active_count() <= before + 2


def test_input_is_untouched(data):
    before = data.X.tobytes()
    classifier = ECOCClassifier()
    evaluate(data, THREE, "paper", classifier=classifier, **{**SMALL, "controls": True})
    assert data.X.tobytes() == before
    assert not hasattr(classifier, "classes_")


def test_settings_of_any_estimator_become_json():
    imputer = SimpleImputer(missing_values=np.nan)
    function = FunctionTransformer(flat, inv_kw_args={"a": np.float64(np.inf)})
    described = describe_estimator(make_pipeline(function, imputer, SVC(C=np.float32(0.5))))
    text = json.dumps(described, allow_nan=False)
    assert described["class"] == "Pipeline"
    assert '"missing_values": "nan"' in text
    assert '"C": 0.5' in text
    # where the function lies in memory is no setting
    assert describe_estimator(function)["func"] == "evaluation_cases.flat"

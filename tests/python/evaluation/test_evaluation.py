"""evaluate: equal to a plain loop, same numbers for any number of threads, clear errors."""

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
from granular_id.recording import SampleFlag
from granular_id.spaces import feature_spaces


@pytest.fixture(scope="module")
def data():
    return make_data()


@pytest.fixture(scope="module")
def both(data):
    return evaluate(data, THREE, ["paper", "chronological"], **SMALL)


def test_equals_a_plain_loop_over_the_estimator(data, both):
    y = data.y
    for name in THREE:
        features = feature_spaces()[name].transformer.fit(data.X).transform(data.X)
        made = {
            "paper": paper_partitions(y, n_partitions=3, train_per_class=6, test_per_class=3, seed=0),
            "chronological": chronological_partitions(y, np.argsort(data.start_times)),
        }
        for protocol, partitions in made.items():
            for j, partition in enumerate(partitions):
                np.testing.assert_array_equal(both.partitions[protocol][j].train, partition.train)
                np.testing.assert_array_equal(both.partitions[protocol][j].test, partition.test)
                plain = ECOCClassifier().fit(features[partition.train], y[partition.train])
                expected = plain.predict(features[partition.test])
                found = np.array(both.labels)[both.predicted[protocol, name][j]]
                np.testing.assert_array_equal(found, expected)
                share = np.mean(expected == y[partition.test])
                assert both.accuracies(name, protocol)[j] == share


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


def test_equals_a_naive_loop_over_pairs(data, both):
    for name in THREE:
        features = feature_spaces()[name].transformer.fit(data.X).transform(data.X)
        for protocol, partitions in both.partitions.items():
            for j, partition in enumerate(partitions):
                expected = naive_labels(
                    features[partition.train], data.y[partition.train], features[partition.test]
                )
                found = np.array(both.labels)[both.predicted[protocol, name][j]]
                np.testing.assert_array_equal(found, expected, err_msg=f"{name}, {protocol}, {j}")


def test_the_data_leave_room_for_mistakes(both):
    """A comparison of labels means little where every label is right."""
    for name in ("raw", "hfmh", "raw+hfmh"):
        assert 0.3 < both.mean_accuracy(name) < 1.0


@pytest.mark.parametrize("bin_range", [(-1.5, 1.5), "auto"])
def test_same_seed_same_numbers_for_any_number_of_threads(data, bin_range):
    spaces = {name: feature_spaces(bin_range=bin_range)[name] for name in THREE}
    results = [
        evaluate(data, spaces, ["paper", "chronological"], n_jobs=n_jobs, random_state=3, **SMALL)
        for n_jobs in (None, 1, 2, -1)
    ]
    for other in results[1:]:
        assert list(other.predictions()) == list(results[0].predictions())
    another = evaluate(data, spaces, "paper", n_jobs=2, random_state=4, **SMALL)
    assert list(another.predictions()) != [p for p in results[0].predictions() if p.protocol == "paper"]


def test_a_random_classifier_is_seeded_by_partition(data):
    forest = RandomForestClassifier(n_estimators=5)
    one, two = (
        evaluate(data, "raw", "paper", classifier=forest, n_jobs=n_jobs, **SMALL) for n_jobs in (1, 2)
    )
    assert list(one.predictions()) == list(two.predictions())
    assert forest.random_state is None
    other = evaluate(data, "raw", "paper", classifier=forest, **{**SMALL, "random_state": 8})
    assert list(other.predictions()) != list(one.predictions())


def test_any_classifier_fits_training_rows_only(data):
    seen = []

    class Spy(SVC):
        def fit(self, X, y):
            seen.append((X.shape, np.bincount(y).tolist()))
            return super().fit(X, y)

    result = evaluate(data, "raw", "paper", classifier=Spy(kernel="linear"), **SMALL)
    assert seen == [((24, 480), [6, 6, 6, 6])] * 3
    for j, partition in enumerate(result.partitions["paper"]):
        plain = SVC(kernel="linear").fit(
            flat(data.X.transpose(0, 2, 1))[partition.train], data.y[partition.train]
        )
        expected = plain.predict(flat(data.X.transpose(0, 2, 1))[partition.test])
        np.testing.assert_array_equal(np.array(result.labels)[result.predicted["paper", "raw"][j]], expected)


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
    for_portrait = total(slice(None))
    assert Memory.fitted_on == [*(total(p.train) for p in result.partitions["paper"]), for_portrait]
    assert result.space("mine").learns
    Memory.fitted_on.clear()
    same = evaluate(data, {"mine": Memory(learns=False)}, "paper", **SMALL)
    assert Memory.fitted_on == [total(slice(None)), for_portrait]
    assert [p.predicted for p in same.predictions()] == [p.predicted for p in result.predictions()]


def test_a_transformer_that_does_not_say_counts_as_learning(data):
    pipeline = make_pipeline(FunctionTransformer(flat), StandardScaler())
    result = evaluate(data, {"standardised": pipeline}, **SMALL)
    assert result.space("standardised").learns
    assert result.space("standardised").paper_accuracy is None
    assert result.space("standardised").n_features == 480


def test_shuffled_labels_are_at_chance():
    rng = np.random.default_rng(5)
    data = make_data(n=20, separation=3.0)
    shuffled = rng.permutation(data.y)
    relabel = iter(shuffled.tolist())
    mixed = changed(data, label=lambda r: next(relabel))
    counts = {"n_partitions": 10, "train_per_class": 12, "test_per_class": 8}
    true, chance = (evaluate(one, THREE, "paper", **{**SMALL, **counts}) for one in (data, mixed))
    for name in ("raw", "hfmh", "raw+hfmh"):
        # 320 predictions of 80 recordings at p = 1/4: SD about 0.05 were only the recordings independent.
        assert abs(chance.mean_accuracy(name) - 0.25) < 0.15
        assert true.mean_accuracy(name) > 0.6


def test_what_is_recorded(data, both):
    assert both.settings["seed"] == 0
    assert both.settings["classifier"]["class"] == "ECOCClassifier"
    assert both.settings["classifier"]["C"] == 1.0
    assert set(both.versions) >= {"granular_id", "numpy", "scikit-learn", "python"}
    assert both.data["n_recordings"] == 40
    assert both.data["rate_hz"] == 500.0
    assert [space.name for space in both.spaces] == ["raw+hfmh", "hfmh", "raw"]
    assert [space.paper_accuracy for space in both.spaces] == [0.9705, 0.8705, 0.7614]
    assert [space.n_features for space in both.spaces] == [480 + 600, 600, 480]
    for space in both.spaces:
        assert set(space.seconds) == {"features", "gram", "training", "prediction"}
        assert min(space.seconds.values()) > 0
    assert "chronological: by start time" in both.notes
    assert both.command == (
        "granular_id.evaluate(data, spaces=['raw+hfmh', 'hfmh', 'raw'], protocol=['paper', 'chronological'], "
        "n_partitions=3, train_per_class=6, test_per_class=3, n_folds=3, controls=False, random_state=0)"
    )
    assert both.wall_s > 0
    assert both.controls == ()
    assert not both.synthetic


def test_history_of_the_data_is_in_the_result(data):
    cropped = data.align(n_samples=60)
    result = evaluate(cropped, "raw", **SMALL)
    assert [step["step"] for step in result.data["history"]] == ["align"]
    assert result.data["n_samples"] == 60


def test_synthetic_recordings_are_marked():
    result = evaluate(make_data(meta={"synthetic": True}), "raw", **SMALL)
    assert result.synthetic
    assert result.table().startswith("Accuracy on SYNTHETIC recordings")


def test_a_session_per_class_is_warned_of():
    confounded = changed(make_data(), session=lambda r: r.label)
    assert any("4 of 4 labels" in note for note in evaluate(confounded, "raw", **SMALL).notes)


@pytest.mark.parametrize(("every", "warned"), [(4, True), (40, False)])
def test_many_samples_inside_gaps_are_warned_of(every, warned):
    flags = np.where(np.arange(80) % every == 0, np.uint8(SampleFlag.GAP_FILLED), np.uint8(0))
    notes = evaluate(make_data(flags=flags), "raw", **SMALL).notes
    about = [note for note in notes if "interpolated inside gaps, where high frequencies are lost" in note]
    assert [note.startswith("warning: ") and "(25 %)" in note for note in about] == [True] * warned


def test_seed_none_draws_one_and_records_it(data):
    fresh = [evaluate(data, "raw", random_state=None, **SMALL) for _ in range(2)]
    seeds = [result.settings["seed"] for result in fresh]
    assert seeds[0] != seeds[1]
    again = evaluate(data, "raw", random_state=seeds[0], **SMALL)
    assert list(again.predictions()) == list(fresh[0].predictions())


def test_progress_is_told_step_by_step(data):
    steps = []
    evaluate(
        data, ["raw", "hfmh"], "paper", n_jobs=2, **{**SMALL, "progress": lambda *step: steps.append(step)}
    )
    assert [done for done, _, _ in steps] == list(range(1, 9))
    assert {total for _, total, _ in steps} == {8}
    assert {what for _, _, what in steps} >= {"raw: ready", "hfmh: paper, partition 3"}


def test_silent_without_a_terminal(data, capfd):
    evaluate(data, "raw", "paper", **{**SMALL, "progress": True})
    assert capfd.readouterr() == ("", "")


def test_a_terminal_without_rich_is_silent(data, capfd, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setitem(sys.modules, "rich.progress", None)
    evaluate(data, "raw", "paper", **{**SMALL, "progress": True})
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError("stop")])
@pytest.mark.parametrize("n_jobs", [1, 2])
def test_an_exception_from_progress_ends_the_run(data, error, n_jobs):
    def stop(done, total, what):
        if done == 3:
            raise error

    before = threading.active_count()
    with pytest.raises(error if isinstance(error, type) else RuntimeError):
        evaluate(data, "raw", "paper", n_jobs=n_jobs, **{**SMALL, "progress": stop})
    assert threading.active_count() <= before + 2


def test_input_is_untouched(data):
    before = data.X.tobytes()
    classifier = ECOCClassifier()
    evaluate(data, THREE, classifier=classifier, **{**SMALL, "controls": True})
    assert data.X.tobytes() == before
    assert not hasattr(classifier, "classes_")


def test_settings_of_any_estimator_become_json():
    imputer = SimpleImputer(missing_values=np.nan)
    odd = make_pipeline(
        FunctionTransformer(flat, inv_kw_args={"a": np.float64(np.inf)}), imputer, SVC(C=np.float32(0.5))
    )
    described = describe_estimator(odd)
    text = json.dumps(described, allow_nan=False)
    assert described["class"] == "Pipeline"
    assert '"missing_values": "nan"' in text
    assert '"C": 0.5' in text

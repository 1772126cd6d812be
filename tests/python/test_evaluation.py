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

from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import evaluate
from granular_id.evaluation.describe import describe_estimator
from granular_id.evaluation.partitions import chronological_partitions, paper_partitions
from granular_id.recording import Dataset, Recording, SampleFlag
from granular_id.spaces import feature_spaces

LABELS = ("oat", "peas", "rice", "sugar")


def make_data(n=10, samples=80, separation=0.35, seed=0, **fields):
    """Recordings whose mean and roughness depend on the material, hard enough for mistakes."""
    rng = np.random.default_rng(seed)
    recordings = []
    for k, label in enumerate(LABELS):
        for i in range(n):
            wrench = rng.normal(separation * k * rng.normal(1, 0.5), 0.3 + 0.1 * k, (samples, 6))
            own = {
                "session": f"{label} day {i % 2}",
                "start_time": 1e9 + 60.0 * (i * len(LABELS) + k),
                "label": label,
                **fields,
            }
            recordings.append(Recording(wrench, rate_hz=500.0, name=f"{label}_{i}", **own))
    return Dataset(recordings)


def changed(data, **fields):
    """The same recordings with some fields computed anew, each by a function of the recording."""
    same = ("rate_hz", "label", "session", "start_time", "name")
    return Dataset(
        [
            Recording(
                r.wrench, **{**{f: getattr(r, f) for f in same}, **{f: get(r) for f, get in fields.items()}}
            )
            for r in data
        ]
    )


SMALL = {"n_partitions": 3, "train_per_class": 6, "test_per_class": 3, "progress": False}


@pytest.fixture(scope="module")
def data():
    return make_data()


@pytest.fixture(scope="module")
def both(data):
    return evaluate(data, protocol=["paper", "chronological"], **SMALL)


def flat(X):
    return X.reshape(len(X), -1)


def test_equals_a_plain_loop_over_the_estimator(data, both):
    y = data.y
    for name, space in feature_spaces(rate_hz=500.0).items():
        features = space.transformer.fit(data.X).transform(data.X)
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
    for name, space in feature_spaces(rate_hz=500.0).items():
        features = space.transformer.fit(data.X).transform(data.X)
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
    spaces = feature_spaces(rate_hz=500.0, bin_range=bin_range)
    results = [
        evaluate(data, spaces, ["paper", "chronological"], n_jobs=n_jobs, random_state=3, **SMALL)
        for n_jobs in (None, 1, 2, -1)
    ]
    for other in results[1:]:
        assert list(other.predictions()) == list(results[0].predictions())
    another = evaluate(data, spaces, n_jobs=2, random_state=4, **SMALL)
    assert list(another.predictions()) != [p for p in results[0].predictions() if p.protocol == "paper"]


def test_a_random_classifier_is_seeded_by_partition(data):
    forest = RandomForestClassifier(n_estimators=5)
    one, two = (evaluate(data, "raw", classifier=forest, n_jobs=n_jobs, **SMALL) for n_jobs in (1, 2))
    assert list(one.predictions()) == list(two.predictions())
    assert forest.random_state is None
    other = evaluate(data, "raw", classifier=forest, **{**SMALL, "random_state": 8})
    assert list(other.predictions()) != list(one.predictions())


def test_any_classifier_fits_training_rows_only(data):
    seen = []

    class Spy(SVC):
        def fit(self, X, y):
            seen.append((X.shape, np.bincount(y).tolist()))
            return super().fit(X, y)

    result = evaluate(data, "raw", classifier=Spy(kernel="linear"), **SMALL)
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
    result = evaluate(data, {"mine": Memory()}, **SMALL)
    assert sorted(Memory.fitted_on) == sorted(total(p.train) for p in result.partitions["paper"])
    assert result.space("mine").learns
    Memory.fitted_on.clear()
    same = evaluate(data, {"mine": Memory(learns=False)}, **SMALL)
    assert len(Memory.fitted_on) == 1
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
    true = evaluate(data, n_partitions=10, train_per_class=12, test_per_class=8, progress=False)
    chance = evaluate(mixed, n_partitions=10, train_per_class=12, test_per_class=8, progress=False)
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
    assert both.command.startswith("granular_id.evaluate(data, spaces=['raw+hfmh', 'hfmh', 'raw']")
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
    expected = "warning: 25 % of the samples were interpolated inside gaps, where high frequencies are lost"
    assert (expected in notes) == warned
    assert any("interpolated" in note for note in notes) == warned


def test_seed_none_draws_one_and_records_it(data):
    fresh = [evaluate(data, "raw", random_state=None, **SMALL) for _ in range(2)]
    seeds = [result.settings["seed"] for result in fresh]
    assert seeds[0] != seeds[1]
    again = evaluate(data, "raw", random_state=seeds[0], **SMALL)
    assert list(again.predictions()) == list(fresh[0].predictions())


def test_progress_is_told_step_by_step(data):
    steps = []
    evaluate(data, ["raw", "hfmh"], n_jobs=2, **{**SMALL, "progress": lambda *step: steps.append(step)})
    assert [done for done, _, _ in steps] == list(range(1, 9))
    assert {total for _, total, _ in steps} == {8}
    assert {what for _, _, what in steps} >= {"raw: ready", "hfmh: paper, partition 3"}


def test_silent_without_a_terminal(data, capfd):
    evaluate(data, "raw", **{**SMALL, "progress": True})
    assert capfd.readouterr() == ("", "")


def test_a_terminal_without_rich_is_silent(data, capfd, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setitem(sys.modules, "rich.progress", None)
    evaluate(data, "raw", **{**SMALL, "progress": True})
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError("stop")])
@pytest.mark.parametrize("n_jobs", [1, 2])
def test_an_exception_from_progress_ends_the_run(data, error, n_jobs):
    def stop(done, total, what):
        if done == 3:
            raise error

    before = threading.active_count()
    with pytest.raises(error if isinstance(error, type) else RuntimeError):
        evaluate(data, "raw", n_jobs=n_jobs, **{**SMALL, "progress": stop})
    assert threading.active_count() <= before + 2


def test_input_is_untouched(data):
    before = data.X.tobytes()
    classifier = ECOCClassifier()
    evaluate(data, classifier=classifier, **SMALL)
    assert data.X.tobytes() == before
    assert not hasattr(classifier, "classes_")


def cut(data, **labels):
    return data.select(
        indices=[i for i, r in enumerate(data) if int(r.name.split("_")[1]) < labels.get(r.label, 99)]
    )


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"data": np.zeros((4, 5, 6))}, TypeError, "data must be a granular_id.Dataset, got ndarray"),
        ({"spaces": "dft"}, ValueError, "spaces must be among 'paper', .*, got 'dft'"),
        ({"spaces": []}, ValueError, "at least one feature space, got none"),
        ({"spaces": ["raw", "raw"]}, ValueError, "each feature space once"),
        ({"spaces": {"mine": object()}}, TypeError, r"spaces\['mine'\] must have fit and transform"),
        ({"spaces": {"": StandardScaler()}}, TypeError, "a name must be non-empty text"),
        (
            {"spaces": {"flat": FunctionTransformer()}},
            ValueError,
            r"'flat' must give an array \(n, D\), got shape",
        ),
        (
            {"protocol": "session"},
            ValueError,
            "protocol must be one of 'paper', 'chronological', got 'session'",
        ),
        ({"protocol": []}, ValueError, "protocol must name one or more"),
        ({"protocol": ["paper", "paper"]}, ValueError, "each once"),
        ({"n_partitions": 0}, ValueError, "n_partitions must be at least 1, got 0"),
        ({"train_per_class": 1.5}, TypeError, "train_per_class must be a whole number"),
        (
            {"train_per_class": 9},
            ValueError,
            r"class 'oat' has 10 recordings, wanted 12 \(9 to train, 3 to test\)",
        ),
        ({"random_state": -1}, ValueError, "random_state must not be negative"),
        ({"random_state": "x"}, TypeError, "random_state must be a whole number or None, got str"),
        ({"progress": "yes"}, TypeError, "progress must be True, False or callable, got str"),
    ],
)
def test_bad_arguments(data, change, kind, message):
    arguments = {"data": data, "spaces": "raw", **SMALL, **change}
    with pytest.raises(kind, match=message):
        evaluate(arguments.pop("data"), **arguments)


def test_bad_data(data):
    with pytest.raises(ValueError, match="at least 2 classes, got only 'oat'"):
        evaluate(data.select(labels="oat"), "raw", **SMALL)
    with pytest.raises(ValueError, match=r"class 'rice' has 4 recordings, wanted 9.*; 3 \+ 1 would fit"):
        evaluate(cut(data, rice=4), "raw", **SMALL)
    with pytest.raises(ValueError, match=r"class 'rice' has 1 recording; the chronological protocol"):
        evaluate(cut(data, rice=1), "raw", "chronological", **SMALL)
    nameless = Dataset([*data, Recording(np.zeros((80, 6)), rate_hz=500.0, name="lost")])
    with pytest.raises(ValueError, match="have no label, the first is 'lost'"):
        evaluate(nameless, "raw", **SMALL)
    longer = Dataset([*data, Recording(np.zeros((81, 6)), rate_hz=500.0, label="oat", name="long")])
    with pytest.raises(ValueError, match=r"differ in length \(80 to 81 samples\)"):
        evaluate(longer, "raw", **SMALL)
    faster = Dataset([*data, Recording(np.zeros((80, 6)), rate_hz=501.0, label="oat", name="fast")])
    with pytest.raises(ValueError, match="differ in rate"):
        evaluate(faster, "raw", **SMALL)
    timed = Recording(np.zeros((3, 6)), time_s=[0.0, 0.1, 0.3], label="oat", name="irregular")
    with pytest.raises(ValueError, match="irregular"):
        evaluate(Dataset([*data, timed]), "raw", **SMALL)
    half_timed = changed(data, start_time=lambda r: None if r.name == "rice_3" else r.start_time)
    with pytest.raises(
        ValueError, match="no order for the chronological protocol: recording 'rice_3' has no start"
    ):
        evaluate(half_timed, "raw", "chronological", **SMALL)


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

"""evaluate: one clear error for each bad argument and each bad data set."""

import numpy as np
import pytest
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler

from evaluation_cases import SMALL, changed, flat, make_data
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import evaluate
from granular_id.evaluation.arguments import plan_spaces
from granular_id.recording import Dataset, Recording
from granular_id.spaces import HFMH, BlockUnion, RawHFMH, RawSignal, Tare, feature_spaces


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"data": np.zeros((4, 5, 6))}, TypeError, "data must be a granular_id.Dataset, got ndarray"),
        ({"spaces": "wavelets"}, ValueError, "spaces must be among 'all', 'paper', .*, got 'wavelets'"),
        ({"spaces": []}, ValueError, "at least one feature space, got none"),
        ({"spaces": ["raw", "raw"]}, ValueError, "each feature space once"),
        ({"spaces": {"mine": object()}}, TypeError, r"spaces\['mine'\] must have fit and transform"),
        ({"spaces": {"": StandardScaler()}}, TypeError, "a name must be non-empty text"),
        ({"spaces": {"flat": FunctionTransformer()}}, ValueError, r"'flat' must give an array \(n, D\)"),
        ({"protocol": "leave-one-out"}, ValueError, "protocol must be 'auto' or among .*'leave-one-out'"),
        ({"protocol": []}, ValueError, "protocol must name one or more"),
        ({"protocol": ["paper", "paper"]}, ValueError, "each once"),
        ({"protocol": "paper", "n_partitions": 0}, ValueError, "n_partitions must be at least 1, got 0"),
        ({"protocol": "paper", "train_per_class": 1.5}, TypeError, "train_per_class must be a whole number"),
        (
            {"protocol": "paper", "train_per_class": 9},
            ValueError,
            r"class 'oat' has 10 .* 12 \(9 to train, 3 to",
        ),
        ({"random_state": -1}, ValueError, "random_state must be at least 0"),
        ({"random_state": "x"}, TypeError, "random_state must be a whole number or None, got 'x'"),
    ],
)
def test_bad_arguments(data, change, kind, message):
    arguments = {"data": data, "spaces": "raw", **SMALL, **change}
    with pytest.raises(kind, match=message):
        evaluate(arguments.pop("data"), **arguments)


def test_bad_progress_is_refused(data):
    with pytest.raises(TypeError, match="progress must be a bool or callable, got str") as caught:
        evaluate(data, "raw", **{**SMALL, "progress": "yes"})
    assert caught.value.argument == "progress"


def another(samples=80, **fields):
    """Return the recordings and one that does not belong to them."""
    odd = Recording(np.zeros((samples, 6)), **{"rate_hz": 500.0, "name": "odd", **fields})
    return Dataset([*make_data(), odd])


WITHOUT_ONE_TIME = changed(make_data(), start_time=lambda r: None if r.name == "rice_3" else r.start_time)


@pytest.mark.parametrize(
    ("data", "protocol", "message"),
    [
        *[
            (make_data(n=4).select(labels="oat"), name, "at least 2 classes, got only 'oat'")
            for name in ("auto", "paper", "session", "chronological", "kfold")
        ],
        (
            make_data(n=4),
            "paper",
            "class 'oat' has 4 recordings, wanted 9.*: pass train_per_class=3, test_per",
        ),
        (another(), "auto", "has no label, the first is 'odd'"),
        (another(81, label="oat"), "auto", r"differ in length \(80 to 81 samples\)"),
        (another(label="oat", rate_hz=501.0), "auto", "differ in rate"),
        (another(3, label="oat", rate_hz=None, time_s=[0.0, 0.1, 0.3]), "auto", "irregular"),
        (WITHOUT_ONE_TIME, "chronological", "recording 'rice_3' has no start time .*: no order in time"),
    ],
)
def test_bad_data(data, protocol, message):
    with pytest.raises(ValueError, match=message):
        evaluate(data, "raw", protocol, **SMALL)


@pytest.mark.parametrize("classifier", ["svm", ECOCClassifier])
def test_what_is_no_classifier_is_refused(data, classifier):
    with pytest.raises(
        TypeError, match=r"classifier must be a classifier of scikit-learn such as LinearSVC\(\)"
    ):
        evaluate(data, "raw", classifier=classifier, **SMALL)


def test_transformers_that_leave_the_rate_open_take_that_of_the_recordings():
    pipeline = make_pipeline(Tare(), BlockUnion([("hfmh", HFMH()), ("raw", RawSignal(rate_hz=100.0))]))
    (planned,) = plan_spaces({"mine": pipeline}, 100.0)
    assert planned.transformer[0].rate_hz == planned.transformer[1].blocks[0][1].rate_hz == 100.0
    assert pipeline[0].rate_hz is None
    own = RawHFMH(rate_hz=100.0)
    assert plan_spaces({"mine": own}, 100.0)[0].transformer is own


@pytest.mark.parametrize(
    ("transformer", "kind"),
    [
        (feature_spaces(rate_hz=100.0)["raw+hfmh"], "RawHFMH"),
        (make_pipeline(make_pipeline(HFMH(rate_hz=100.0)), StandardScaler()), "HFMH"),
    ],
)
def test_a_transformer_of_another_rate_than_the_recordings_is_refused(data, transformer, kind):
    wanted = (
        rf"spaces\['mine'\]: {kind} has rate_hz=100, the recordings have 500 Hz: pass {kind}\(rate_hz=500\)$"
    )
    with pytest.raises(ValueError, match=wanted):
        evaluate(data, {"raw": RawSignal(), "mine": transformer}, **SMALL)


class Broken(TransformerMixin, BaseEstimator):
    def __init__(self, value=np.nan, learns=False):
        self.value = value
        self.learns = learns

    def fit(self, X, y=None):
        return self

    def transform(self, X):
        features = flat(X).copy()
        features[:, 3] = self.value
        return features


@pytest.mark.parametrize(("value", "learns"), [(np.nan, True), (np.nan, False), (np.inf, False)])
@pytest.mark.parametrize("classifier", [None, make_pipeline(ECOCClassifier())])
def test_features_that_are_not_finite_name_the_space(data, value, learns, classifier):
    wanted = f"feature space 'mine' must give finite features, got {value} in column 3"
    with pytest.raises(ValueError, match=wanted):
        evaluate(data, {"mine": Broken(value, learns)}, "paper", classifier=classifier, **SMALL)


def test_recordings_that_are_all_equal_are_named_by_the_space_that_cannot_be(data):
    equal = type(data)([type(r)(**{**vars(r), "wrench": data[0].wrench}) for r in data])
    with pytest.raises(ValueError, match=r"feature space 'pca': .*all rows are equal"):
        evaluate(equal, "pca", "paper", **SMALL, accept="duplicates")
    result = evaluate(equal, "raw", "paper", **SMALL, accept="duplicates")
    assert "hold exactly the samples of another" in result.findings[0].message
    assert result.mean_accuracy("raw") == 0.25  # whatever is said, it is said of all

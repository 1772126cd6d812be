"""explain: arguments and models that it refuses, by name."""

import numpy as np
import pytest
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MinMaxScaler
from sklearn.svm import SVC

from explain_cases import recordings
from granular_id.ecoc import ECOCClassifier
from granular_id.explanation import explain
from granular_id.recording import Dataset, Recording
from granular_id.spaces import (
    RawSignal,
    TimePermutation,
)


@pytest.fixture(scope="module")
def data():
    return recordings()


def test_bad_arguments(data):
    X, y = data
    model = make_pipeline(RawSignal(), ECOCClassifier()).fit(X, y)
    with pytest.raises(ValueError, match="second must be one of 'oat', 'peas', 'rice', got 'sand'"):
        explain(model, "oat", "sand", X, y)
    with pytest.raises(ValueError, match="first and second must be two materials, got 'oat' twice"):
        explain(model, "oat", "oat", X, y)
    with pytest.raises(ValueError, match="y has no 'rice'"):
        explain(model, "oat", "rice", X[y != "rice"], y[y != "rice"])
    with pytest.raises(ValueError, match="model names no recording of X 'rice'"):
        explain(model, "oat", "rice", X[y == "oat"])
    with pytest.raises(ValueError, match=r"y must have one label per recording of X, got 3 for X of shape"):
        explain(model, "oat", "rice", X, y[:3])
    with pytest.raises(ValueError, match=r"X must have shape \(n, 400, 6\) as in fit"):
        explain(model, "oat", "rice", X[:, :300], y)
    with pytest.raises(ValueError, match="n must be at least 0, got -1"):
        explain(model, "oat", "rice", X, y).regions(-1)
    with pytest.raises(TypeError, match=r"n must be a whole number, got 1\.5"):
        explain(model, "oat", "rice", X, y).top(1.5)
    with pytest.raises(ValueError, match="first must be one of 'oat', 'peas', 'rice', got array"):
        explain(model, np.array(["oat", "peas"]), "rice", X, y)
    with pytest.raises(ValueError, match=r"X must be recordings, an array \(n, T, C\), got Dataset"):
        explain(model, "oat", "rice", Dataset([Recording(one, 500.0) for one in X[:3]]))
    with pytest.raises(ValueError, match="X must be recordings of one shape"):
        explain(model, "oat", "rice", [[1.0, 2.0], [1.0]], ["oat", "rice"])


def test_models_that_cannot_be_explained(data):
    X, y = data
    with pytest.raises(NotFittedError):
        explain(make_pipeline(RawSignal(), ECOCClassifier()), "oat", "rice", X, y)
    with pytest.raises(TypeError, match="model must be a Pipeline of a feature space and an ECOCClassifier"):
        explain(ECOCClassifier(), "oat", "rice", X, y)
    with pytest.raises(TypeError, match="an ECOCClassifier or a BestClassifier, got LogisticRegression"):
        explain(make_pipeline(RawSignal(), LogisticRegression()).fit(X[:, :20], y), "oat", "rice", X, y)
    gram_only = make_pipeline(RawSignal(), ECOCClassifier()).fit(X, y)
    features = gram_only[:-1].transform(X)
    gram_only[-1].fit_gram(features @ features.T, y)
    with pytest.raises(TypeError, match=r"model must have linear learners.*has no coef_"):
        explain(gram_only, "oat", "rice", X, y)
    with pytest.raises(TypeError, match=r"model must have linear learners.*SVC\(\)\) has no coef_"):
        explain(make_pipeline(RawSignal(), ECOCClassifier(SVC())).fit(X, y), "oat", "rice", X, y)
    flat = X[:, :, 0]
    with pytest.raises(TypeError, match="nothing behind filters"):
        explain(make_pipeline(ECOCClassifier()).fit(flat, y), "oat", "rice", flat, y)
    for space, culprit in (
        (make_pipeline(RawSignal(), MinMaxScaler()), "got MinMaxScaler, which cannot be followed back"),
        (make_pipeline(TimePermutation(random_state=0), RawSignal()), "TimePermutation"),
    ):
        with pytest.raises(TypeError, match=culprit):
            explain(make_pipeline(space, ECOCClassifier()).fit(X, y), "oat", "rice", X, y)

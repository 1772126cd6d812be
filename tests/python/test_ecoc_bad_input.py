"""ECOCClassifier: one clear error for each kind of bad input."""

import numpy as np
import pytest
from sklearn.exceptions import NotFittedError

from granular_id.ecoc import ECOCClassifier


def blobs(n_classes, per_class=24, n_features=60):
    rng = np.random.default_rng(0)
    y = np.repeat(np.arange(n_classes), per_class)
    centres = rng.standard_normal((n_classes, n_features))
    return rng.standard_normal((len(y), n_features)) + centres[y], y


def test_bad_gram():
    X, y = blobs(n_classes=2)
    gram = X @ X.T
    clf = ECOCClassifier()
    with pytest.raises(ValueError, match=r"gram has shape \(48, 48\), but y has 47 labels"):
        clf.fit_gram(gram, y[:47])
    with pytest.raises(ValueError, match=r"square.*\(48, 60\)"):
        clf.fit_gram(X, y)
    with pytest.raises(ValueError, match="symmetric"):
        clf.fit_gram(gram + np.triu(np.ones_like(gram)), y)
    with pytest.raises(ValueError, match="NaN or inf"):
        clf.fit_gram(gram * np.nan, y)
    with pytest.raises(ValueError, match="standardize=True needs the features"):
        ECOCClassifier(standardize=True).fit_gram(gram, y)
    with pytest.raises(ValueError, match="one class only"):
        clf.fit_gram(gram, np.zeros(48, int))
    with pytest.raises(NotFittedError):
        ECOCClassifier().predict_gram(gram)
    with pytest.raises(ValueError, match=r"\(m, 48\), one column per training row, got shape \(48, 47\)"):
        clf.fit_gram(gram, y).predict_gram(gram[:, :47])
    with pytest.raises(ValueError, match="no shared Gram"):
        ECOCClassifier(standardize=True).fit(X, y).binary_scores_gram(gram)


@pytest.mark.parametrize(
    ("params", "kind", "message"),
    [
        ({"C": 0}, ValueError, "C must be positive and finite, got 0"),
        ({"C": -1.5}, ValueError, "C must be positive"),
        ({"C": np.inf}, ValueError, "hard_margin=True"),
        ({"C": np.nan}, ValueError, "C must be positive"),
        ({"C": "1"}, TypeError, "C must be a number, got '1'"),
        ({"C": True}, TypeError, "C must be a number, got True"),
        (
            {"loss": "quadratic"},
            ValueError,
            "loss='quadratic' does not fit the learners: their score is any real number.*'auto' or one of 'hinge'",
        ),
        ({"loss": "votes"}, ValueError, "loss must be one of 'auto', 'hinge', .*, got 'votes'"),
        ({"loss": None}, ValueError, "loss must be one of"),
        (
            {"decoding": "votes"},
            ValueError,
            "decoding must be one of 'loss_weighted', 'loss_based', got 'votes'",
        ),
        ({"hard_margin": 1}, TypeError, "hard_margin must be True or False, got 1"),
        ({"standardize": "yes"}, TypeError, "standardize must be True or False, got 'yes'"),
    ],
)
def test_bad_parameters(params, kind, message):
    X, y = blobs(n_classes=2)
    with pytest.raises(kind, match=message):
        ECOCClassifier(**params).fit(X, y)
    with pytest.raises(kind, match=message):
        ECOCClassifier(**params).fit_gram(X @ X.T, y)


def test_bad_data():
    X, y = blobs(n_classes=3)
    clf = ECOCClassifier()
    with pytest.raises(ValueError, match="y holds one class only"):
        clf.fit(X, np.full(len(y), "sand"))
    for bad in (np.nan, np.inf, -np.inf):
        spoiled = X.copy()
        spoiled[4, 7] = bad
        with pytest.raises(ValueError, match=r"NaN|infinity"):
            clf.fit(spoiled, y)
        with pytest.raises(ValueError, match=r"NaN|infinity"):
            ECOCClassifier().fit(X, y).predict(spoiled)
    with pytest.raises(ValueError, match="inconsistent"):
        clf.fit(X, y[:-1])
    with pytest.raises(ValueError, match="60 features"):
        ECOCClassifier().fit(X, y).predict(X[:, :-1])
    with pytest.raises(ValueError, match="range of float64"):
        clf.fit(X * 1e200, y)
    with pytest.raises(ValueError, match="sample_weight must not be negative, got -1"):
        clf.fit(X, y, sample_weight=-np.ones(len(y)))
    with pytest.raises(ValueError, match="sample_weight must not be zero for every row"):
        clf.fit(X, y, sample_weight=np.zeros(len(y)))
    with pytest.raises(NotFittedError):
        ECOCClassifier().predict(X)

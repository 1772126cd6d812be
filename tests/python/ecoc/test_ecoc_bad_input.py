"""ECOCClassifier on bad and odd input: an error that names the argument, or a result."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from ecoc_cases import blobs
from granular_id.ecoc import ECOCClassifier, svm
from granular_id.gram import linear_gram

X = np.random.default_rng(0).standard_normal((30, 5))
y = np.repeat(["oat", "rice", "sand"], 10)
GRAM = linear_gram(X)
LARGEST = GRAM / GRAM.max()


def with_value(value):
    spoiled = X.copy()
    spoiled[4, 3] = value
    return spoiled


@pytest.mark.parametrize(
    ("params", "kind", "message"),
    [
        ({"C": 0}, ValueError, "C must be positive and finite, got 0"),
        ({"C": np.inf}, ValueError, "C must be positive and finite"),
        ({"C": np.nan}, ValueError, "C must be positive"),
        ({"C": "1"}, TypeError, "C must be a number, got '1'"),
        ({"C": True}, TypeError, "C must be a number, got True"),
        ({"C": 10**400}, ValueError, "C must be positive and finite"),
        ({"C": np.complex128(1)}, TypeError, "C must be a number"),
        ({"loss": "votes"}, ValueError, "loss must be one of 'hinge', 'root', got 'votes'"),
        ({"loss": np.array(["root", "hinge"])}, ValueError, "loss must be one of"),
        ({"n_jobs": 0}, ValueError, "n_jobs must be None, positive, or negative .* got 0"),
        ({"n_jobs": "two"}, TypeError, "n_jobs must be None or a whole number, got 'two'"),
        ({"coding": "pairs"}, ValueError, "coding must be one of 'onevsone', 'onevsall', got 'pairs'"),
        ({"posterior": "platt"}, ValueError, "posterior must be one of .*'wu_lin_weng', got 'platt'"),
        ({"posterior": True}, ValueError, "posterior must be one of .* got True"),
        ({"random_state": "now"}, ValueError, "'now' cannot be used to seed"),
    ],
)
def test_bad_parameters(params, kind, message):
    with pytest.raises(kind, match=message):
        ECOCClassifier(**params).fit(X, y)
    with pytest.raises(kind, match=message):
        ECOCClassifier(**params).fit_gram(GRAM, y)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (["sand"] * 30, "y holds one class only"),
        ([None] * 15 + ["oat"] * 15, "y must hold a label for each row, got None"),
        (np.array([1] * 15 + ["oat"] * 15, dtype=object), "y must hold labels of one kind, .* got 1, 'oat'"),
        (np.linspace(0.0, 1.0, 30), "y must hold labels of one kind, text or whole numbers, got 0.0, 0.03"),
        (np.repeat([np.nan, 1.0], 15), "y .* NaN"),
    ],
)
def test_labels_that_are_no_classes(labels, message):
    with pytest.raises(ValueError, match=message):
        ECOCClassifier().fit(X, labels)
    with pytest.raises(ValueError, match=message):
        ECOCClassifier().fit_gram(GRAM, labels)


@pytest.mark.parametrize(
    ("rows", "labels", "message"),
    [
        (with_value(np.nan), y, "NaN"),
        (with_value(-np.inf), y, "infinity"),
        (X, y[:-1], "inconsistent"),
        (X * 1e200, y, "scalar products in the range of float64"),
        (np.sign(X) * 1e307, y, "X must be finite .* with scalar products in the range of float64"),
    ],
)
def test_bad_rows_to_learn_from(rows, labels, message):
    with pytest.raises(ValueError, match=message):
        ECOCClassifier().fit(rows, labels)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (with_value(np.inf), "infinity"),
        (X[:, :-1], "5 features"),
        (np.full((1, 5), 1.7e308), "X must be finite, with scores in the range of float64"),
    ],
)
def test_bad_rows_to_name(rows, message):
    with pytest.raises(ValueError, match=message):
        ECOCClassifier().fit(X, y).predict(rows)


@pytest.mark.parametrize(
    ("weights", "kind", "message"),
    [
        (["a"] * 30, ValueError, "sample_weight must be an array of numbers"),
        (np.full(30, 1j), TypeError, "sample_weight must hold real numbers, got complex128"),
        (-np.ones(30), ValueError, "sample_weight must not be negative, got -1"),
        (np.zeros(30), ValueError, "sample_weight must not be zero for every row"),
        (np.full(30, 1e308), ValueError, r"sample_weight must be 0 or from 1e-100 to 1e\+100, got 1e\+308"),
        (np.append(np.ones(29), 5e-324), ValueError, "sample_weight must be 0 or from 1e-100 .* got 4.9"),
    ],
)
def test_bad_weights(weights, kind, message):
    with pytest.raises(kind, match=message):
        ECOCClassifier().fit(X, y, sample_weight=weights)


@pytest.mark.parametrize(
    ("gram", "kind", "message"),
    [
        (GRAM[:29, :29], ValueError, r"gram has shape \(29, 29\), but y has 30 labels"),
        ([["a"]], ValueError, "gram must be an array of numbers"),
        ([[1, 2], [1]], ValueError, "gram must be an array of numbers"),
        (GRAM * 1j, TypeError, "gram must hold real numbers, got complex128"),
        (LARGEST * 1e308, ValueError, r"gram must be within 1e\+300, got up to 1"),
    ],
)
def test_bad_products_to_learn_from(gram, kind, message):
    with pytest.raises(kind, match=message):
        ECOCClassifier().fit_gram(gram, y)


@pytest.mark.parametrize(
    ("gram", "message"),
    [
        (GRAM[:, :29], r"\(m, 30\), one column per training row, got shape \(30, 29\)"),
        ([[1, 2], [1]], "gram must be an array of numbers"),
        (LARGEST * 1.7e308, "gram must be finite, with scores in the range of float64"),
    ],
)
def test_bad_products_to_name(gram, message):
    with pytest.raises(ValueError, match=message):
        ECOCClassifier().fit_gram(GRAM, y).predict_gram(gram)


def test_a_fit_that_failed_is_no_fit():
    clf = ECOCClassifier(coding="pairs")
    with pytest.raises(ValueError, match="coding must be"):
        clf.fit(np.ones((6, 2)), [0, 0, 0, 1, 1, 1])
    for use in (clf.predict, clf.decision_function, clf.predict_gram):
        with pytest.raises(NotFittedError):
            use(np.ones((6, 2)))


def test_a_class_of_very_light_rows():
    """Times so small a cost their weight is 0 in float64: libsvm would leave them out, and find one class only."""
    apart = X + 10.0 * (y == "rice")[:, None]
    weights = np.where(y == "rice", 1e-100, 1e100)
    two = y != "sand"
    clf = ECOCClassifier(C=1e-300).fit(apart[two], y[two], sample_weight=weights[two])
    assert np.isfinite(clf.decision_function(apart)).all()


@pytest.mark.filterwarnings("ignore:.*did not converge:sklearn.exceptions.ConvergenceWarning")
def test_the_largest_cost_is_as_good_as_the_next(monkeypatch):
    monkeypatch.setattr(svm, "_MAX_STEPS", 100_000)  # or it takes seconds
    assert np.isfinite(ECOCClassifier(C=1e308).fit(X[:20], y[:20]).coef_).all()


def test_seventy_classes_of_two_rows_work():
    truth = np.repeat(np.arange(70), 2)
    centres = 5.0 * np.random.default_rng(0).standard_normal((70, 12))
    rows = np.random.default_rng(1).standard_normal((140, 12)) * 0.3 + centres[truth]
    clf = ECOCClassifier().fit(rows, truth)
    assert clf.coef_.shape == (2415, 12)
    assert clf.score(rows, truth) > 0.99


@pytest.mark.parametrize("coding", ["onevsone", "onevsall"])
class TestPoorData:
    def test_a_class_of_one_row(self, coding):
        rows, truth = blobs(3, n_features=60)
        kept = np.flatnonzero((truth != 1) | (np.arange(len(truth)) == np.argmax(truth == 1)))
        clf = ECOCClassifier(coding)
        assert clf.fit(rows[kept], truth[kept]).score(rows[kept], truth[kept]) == 1.0

    def test_two_rows_in_all(self, coding):
        clf = ECOCClassifier(coding).fit([[0.0], [2.0]], ["a", "b"])
        assert clf.predict([[0.5], [1.5]]).tolist() == ["a", "b"]

    def test_equal_rows(self, coding):
        truth = np.repeat([0, 1, 2], [8, 4, 4])
        clf = ECOCClassifier(coding)
        assert np.isfinite(clf.fit(np.ones((16, 3)), truth).decision_function(np.ones((2, 3)))).all()
        assert len(set(clf.predict(np.ones((5, 3))))) == 1

    def test_constant_features_say_nothing(self, coding):
        rows, truth = blobs(3)
        wide = np.column_stack([rows, np.full(len(truth), 0.1), np.zeros(len(truth))])
        clf = ECOCClassifier(coding)
        expected = clone(clf).fit(rows, truth).decision_function(rows)
        np.testing.assert_allclose(clf.fit(wide, truth).decision_function(wide), expected, atol=1e-6)

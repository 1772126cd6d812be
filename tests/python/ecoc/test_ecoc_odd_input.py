"""ECOCClassifier on odd input: an error that names the argument or a result, and no warning from numpy."""

import numpy as np
import pytest

from granular_id.ecoc import ECOCClassifier
from granular_id.ecoc.decoding import decode
from granular_id.gram import linear_gram

X = np.random.default_rng(0).standard_normal((30, 5))
y = np.repeat(["oat", "rice", "sand"], 10)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ([None] * 15 + ["oat"] * 15, "y must hold labels of one kind, .* got None, 'oat'"),
        (np.array([1] * 15 + ["oat"] * 15, dtype=object), "y must hold labels of one kind, .* got 1, 'oat'"),
        (np.linspace(0.0, 1.0, 30), "y must hold labels of one kind, text or whole numbers, got 0.0, 0.03"),
    ],
)
def test_labels_that_are_no_classes(labels, message):
    with pytest.raises(ValueError, match=message):
        ECOCClassifier().fit(X, labels)
    with pytest.raises(ValueError, match=message):
        ECOCClassifier().fit_gram(linear_gram(X), labels)


def test_labels_of_nan():
    labels = np.repeat([np.nan, 1.0], 15)
    with pytest.raises(ValueError, match="y contains NaN"):
        ECOCClassifier().fit(X, labels)
    with pytest.raises(ValueError, match="y must hold a label for each row, got NaN"):
        ECOCClassifier().fit_gram(linear_gram(X), labels)


@pytest.mark.parametrize("standardize", [False, True])
@pytest.mark.parametrize(
    ("weights", "kind", "message"),
    [
        (["a"] * 30, ValueError, "sample_weight must be an array of numbers"),
        (np.full(30, 1j), TypeError, "sample_weight must hold real numbers, got complex128"),
        (
            np.full(30, 1e308),
            ValueError,
            r"sample_weight must be 0 or from 1e-100 to 1e\+100, got 1e\+308 to",
        ),
        (np.append(np.ones(29), 5e-324), ValueError, "sample_weight must be 0 or from 1e-100 .* got 4.9"),
    ],
)
def test_weights(weights, kind, message, standardize):
    with pytest.raises(kind, match=message):
        ECOCClassifier(standardize=standardize).fit(X, y, sample_weight=weights)


def test_a_class_of_very_light_rows():
    """Times so small a cost their weight is 0 in float64: libsvm would leave them out, and find one class only."""
    apart = X + 10.0 * (y == "rice")[:, None]
    weights = np.where(y == "rice", 1e-100, 1e100)
    two = y != "sand"
    clf = ECOCClassifier(C=1e-300).fit(apart[two], y[two], sample_weight=weights[two])
    assert np.isfinite(clf.decision_function(apart)).all()


@pytest.mark.filterwarnings("ignore:.*did not converge:sklearn.exceptions.ConvergenceWarning")
def test_the_largest_cost_is_as_good_as_the_next():
    clf = ECOCClassifier(C=1e308).fit(X[:20], y[:20])  # each pair of materials takes seconds
    assert np.isfinite(clf.coef_).all()


@pytest.mark.parametrize("given", [[["a"]], [[1, 2], [1]]])
def test_a_gram_matrix_of_no_numbers(given):
    with pytest.raises(ValueError, match="gram must be an array of numbers"):
        ECOCClassifier().fit_gram(given, ["oat"])
    with pytest.raises(ValueError, match="gram must be an array of numbers"):
        ECOCClassifier().fit_gram(linear_gram(X), y).predict_gram(given)


def test_a_gram_matrix_of_complex_numbers():
    with pytest.raises(TypeError, match="gram must hold real numbers, got complex128"):
        ECOCClassifier().fit_gram(linear_gram(X) * 1j, y)


def test_huge_values():
    gram = linear_gram(X)
    clf = ECOCClassifier().fit(X, y).fit_gram(gram, y)
    with pytest.raises(ValueError, match=r"gram must be within 1e\+300, got up to 1"):
        ECOCClassifier().fit_gram(gram / gram.max() * 1e308, y)
    with pytest.raises(ValueError, match="gram must be finite, with scores in the range of float64"):
        clf.predict_gram(gram / gram.max() * 1.7e308)
    with pytest.raises(ValueError, match=r"X must be finite .* with scalar products in the range of float64"):
        ECOCClassifier().fit(np.sign(X) * 1e307, y)
    with pytest.raises(ValueError, match="X is too large to standardize"):
        ECOCClassifier(standardize=True).fit(np.abs(X) * 7e307, y)
    with pytest.raises(ValueError, match="X must be finite, with scores in the range of float64"):
        ECOCClassifier().fit(X, y).predict(np.full((1, 5), 1.7e308))


def test_losses_of_huge_scores_are_finite_and_ordered():
    matrix = [[1, -1], [-1, 1]]
    values = decode([[1e3, -1e3], [1e9, -1e9], [1e300, -1e300]], matrix, "exponential")
    assert np.isfinite(values).all()
    assert (np.diff(values[:, 1]) < 0).all()

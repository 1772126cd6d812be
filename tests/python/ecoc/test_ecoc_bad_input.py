"""ECOCClassifier: one clear error for each kind of bad input."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.exceptions import NotFittedError

from granular_id.ecoc import ECOCClassifier, codings as random_codings


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
    with pytest.raises(ValueError, match="standardize=True needs the features"):
        ECOCClassifier(standardize=True).fit_gram(gram, y)
    with pytest.raises(NotFittedError):
        ECOCClassifier().predict_gram(gram)
    with pytest.raises(ValueError, match=r"\(m, 48\), one column per training row, got shape \(48, 47\)"):
        clf.fit_gram(gram, y).predict_gram(gram[:, :47])
    with pytest.raises(ValueError, match="needs the features"):
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
        ({"C": 10**400}, ValueError, "C must be positive and finite"),
        ({"C": np.complex128(1)}, TypeError, "C must be a number"),
        (
            {"loss": "quadratic"},
            ValueError,
            "loss='quadratic' does not fit the learners: their score is any real number.*'auto' or one of 'hinge'",
        ),
        ({"loss": "votes"}, ValueError, "loss must be one of 'auto', 'hinge', .*, got 'votes'"),
        ({"loss": None}, ValueError, "loss must be one of"),
        ({"loss": np.array(["auto"])}, ValueError, "loss must be one of"),
        ({"loss": np.array(["auto", "hinge"])}, ValueError, "loss must be one of"),
        (
            {"decoding": "votes"},
            ValueError,
            "decoding must be one of 'loss_weighted', 'loss_based', got 'votes'",
        ),
        ({"hard_margin": 1}, TypeError, "hard_margin must be True or False, got 1"),
        ({"standardize": "yes"}, TypeError, "standardize must be True or False, got 'yes'"),
        ({"n_jobs": 0}, ValueError, "n_jobs must be None, positive, or negative .* got 0"),
        ({"n_jobs": "two"}, TypeError, "n_jobs must be None or a whole number, got 'two'"),
        ({"coding": "pairs"}, ValueError, "coding must be one of 'onevsone', 'onevsall', .*, got 'pairs'"),
        ({"coding": None}, TypeError, "coding must be the name of a design or a matrix .* got None"),
        ({"coding": [[1, [2]], [1]]}, TypeError, "coding must be the name of a design or a matrix"),
        ({"coding": np.ones((3, 2))}, ValueError, "column 0 must hold both"),
        (
            {"coding": [[1], [-1], [-1]]},
            ValueError,
            r"coding must have 2 rows, one per class, got shape \(3, 1\)",
        ),
        ({"posterior": "platt"}, ValueError, "posterior must be one of .* got 'platt'"),
        ({"random_state": "now"}, ValueError, "'now' cannot be used to seed"),
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


@pytest.mark.parametrize("params", [{"coding": "pairs"}, {"hard_margin": True}])
def test_a_fit_that_failed_is_no_fit(params):
    X, y = np.ones((6, 2)), [0, 0, 0, 1, 1, 1]
    clf = ECOCClassifier(**params)
    with pytest.raises(ValueError, match=r"coding must be|cannot be separated"):
        clf.fit(X, y)
    for use in (clf.predict, clf.decision_function, clf.predict_gram, lambda _: clf.learners_):
        with pytest.raises(NotFittedError):
            use(X)


class TestTwoHundredClasses:
    def data(self):
        y = np.repeat(np.arange(200), 2)
        centres = 5.0 * np.random.default_rng(0).standard_normal((200, 12))
        return np.random.default_rng(1).standard_normal((400, 12)) * 0.3 + centres[y], y

    def test_pairs_work(self):
        X, y = self.data()
        clf = ECOCClassifier().fit(X, y)
        assert clf.coef_.shape == (19_900, 12)
        assert clf.score(X, y) > 0.99

    def test_few_learners_work(self, monkeypatch):
        monkeypatch.setattr(random_codings, "_DRAWS", 50)
        X, y = self.data()
        clf = ECOCClassifier(LinearDiscriminantAnalysis(), coding="denserandom", random_state=0).fit(X, y)
        assert clf.coding_matrix_.shape == (200, 77)
        assert clf.predict(X).shape == (400,)

    @pytest.mark.parametrize("coding", ["binarycomplete", "ternarycomplete"])
    def test_complete_designs_refuse(self, coding):
        with pytest.raises(
            ValueError, match=r"learners for K = 200 classes, more than 100,000; 'denserandom' needs 77"
        ):
            ECOCClassifier(coding=coding).fit(*self.data())


CODED = ["onevsone", "onevsall", "ordinal", "sparserandom"]


@pytest.mark.parametrize("coding", CODED)
@pytest.mark.parametrize("standardize", [False, True])
class TestPoorData:
    def test_a_class_of_one_row(self, coding, standardize):
        X, y = blobs(n_classes=3)
        kept = np.flatnonzero((y != 1) | (np.arange(len(y)) == np.argmax(y == 1)))
        clf = ECOCClassifier(coding=coding, standardize=standardize, random_state=0).fit(X[kept], y[kept])
        assert clf.score(X[kept], y[kept]) == 1.0

    def test_two_rows_in_all(self, coding, standardize):
        clf = ECOCClassifier(coding=coding, standardize=standardize).fit([[0.0], [2.0]], ["a", "b"])
        assert clf.predict([[0.5], [1.5]]).tolist() == ["a", "b"]

    def test_equal_rows(self, coding, standardize):
        y = np.repeat([0, 1, 2], [8, 4, 4])
        clf = ECOCClassifier(coding=coding, standardize=standardize, random_state=0).fit(np.ones((16, 3)), y)
        assert np.isfinite(clf.decision_function(np.ones((2, 3)))).all()
        assert len(set(clf.predict(np.ones((5, 3))))) == 1

    def test_constant_features_say_nothing(self, coding, standardize):
        X, y = blobs(n_classes=3)
        wide = np.column_stack([X, np.full(len(y), 0.1), np.zeros(len(y))])
        clf = ECOCClassifier(coding=coding, standardize=standardize, random_state=0)
        np.testing.assert_allclose(
            clone(clf).fit(wide, y).decision_function(wide),
            clone(clf).fit(X, y).decision_function(X),
            atol=1e-6,
        )

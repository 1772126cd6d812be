"""The contract of scikit-learn: its own checks, clones, pickles, processes, parameters, searches."""

import os
import pickle
import subprocess
import sys
import warnings

import joblib
import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.datasets import load_iris
from sklearn.model_selection import GridSearchCV, cross_val_score
from sklearn.utils.estimator_checks import parametrize_with_checks

from granular_id.ecoc import ECOCClassifier


def expected_failures(estimator):
    if estimator.posterior is None:
        return {}
    # One check, run on three inputs. It wants the likeliest class and the predicted class to be the same; labels come
    # from the losses of the scores, and where two classes are close another can be likelier (1 of 200 rows there).
    return {"check_classifiers_train": "predict decodes losses, predict_proba couples probabilities"}


@parametrize_with_checks(
    [
        ECOCClassifier(),
        ECOCClassifier("onevsall", loss="root"),
        ECOCClassifier(posterior="kullback_leibler"),
    ],
    expected_failed_checks=expected_failures,
)
def test_sklearn_contract(estimator, check):
    with warnings.catch_warnings():
        # A check of weights leaves a class with one row.
        warnings.filterwarnings("ignore", message="posterior needs 2 different rows", category=UserWarning)
        check(estimator)


X, y = load_iris(return_X_y=True)
VARIANTS = {
    "default": ECOCClassifier(),
    "own coding": ECOCClassifier(np.array([[1, 1], [-1, 1], [0, -1]]), n_jobs=2),
    "root": ECOCClassifier("onevsall", loss="root"),
    "kl": ECOCClassifier(posterior="kullback_leibler", random_state=0),
    "wlw": ECOCClassifier(posterior="wu_lin_weng", random_state=0),
}


def answers(clf, X):
    found = [clf.predict(X), clf.decision_function(X), clf.binary_scores(X)]
    return [*found, clf.predict_proba(X)] if hasattr(clf, "predict_proba") else found


def assert_same(ours, theirs):
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", VARIANTS)
def test_clone_pickle_and_repetition(name):
    clf = clone(VARIANTS[name]).fit(X, y)
    assert_same(answers(clf, X), answers(pickle.loads(pickle.dumps(clf)), X))
    again = clone(clf)
    assert not hasattr(again, "classes_")
    assert_same(answers(clf, X), answers(again.fit(X, y), X))
    # A fit leaves no trace of the one before.
    assert_same(answers(clf, X), answers(clf.fit(X[:, :2], y[::-1]).fit(X, y), X))


@pytest.mark.parametrize("name", ["own coding", "kl"])
@pytest.mark.parametrize("dtype", [str, object])
def test_labels_of_text_and_frames(name, dtype):
    kinds = np.array(["sand", "oats", "gravel"], dtype)
    frame = pd.DataFrame(X, columns=list("abcd"))
    order = np.argsort(np.argsort(kinds))  # class indices of the names
    expected = clone(VARIANTS[name]).fit(X, order[y])
    clf = clone(VARIANTS[name]).fit(frame, kinds[y])
    assert clf.feature_names_in_.tolist() == list("abcd")
    assert clf.n_features_in_ == 4
    np.testing.assert_array_equal(clf.predict(frame), np.sort(kinds)[expected.predict(X)])
    # A frame is laid out by columns: products round in their last bits as they like.
    values = expected.decision_function(X)
    np.testing.assert_allclose(clf.decision_function(frame), values, rtol=1e-9, atol=1e-9)
    with pytest.raises(ValueError, match="feature names should match"):
        clf.predict(frame[["b", "a", "c", "d"]])


def digest_of_answers():
    """Of fits that draw folds, and of one that draws nothing."""
    return joblib.hash([answers(clone(VARIANTS[name]).fit(X, y), X) for name in ("root", "kl", "wlw")])


@pytest.mark.thread_unsafe(reason="starts a process")
def test_another_process_gives_the_same_numbers():
    program = "import test_ecoc_sklearn as tests; print(tests.digest_of_answers())"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", program]
    child = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert child.stdout.strip() == digest_of_answers()


def test_unknown_parameter_is_refused():
    with pytest.raises(ValueError, match="Invalid parameter"):
        ECOCClassifier().set_params(cost=1.0)


def test_search_over_codings_and_losses_finds_probabilities():
    grid = {"coding": ["onevsone", "onevsall"], "loss": ["hinge", "root"]}
    search = GridSearchCV(ECOCClassifier(), grid, cv=3).fit(X, y)
    assert search.best_score_ > 0.95
    assert len(search.cv_results_["params"]) == 4
    # A string for `scoring` that needs probabilities finds them.
    losses = cross_val_score(VARIANTS["kl"], X, y, cv=3, scoring="neg_log_loss")
    assert (losses > -0.4).all()

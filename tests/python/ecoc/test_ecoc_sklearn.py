"""The contract of scikit-learn: its own checks, clones, pickles, frames, searches."""

import numpy as np
import pandas as pd
import pytest
from sklearn.datasets import load_iris
from sklearn.utils.estimator_checks import parametrize_with_checks

from granular_id.ecoc import ECOCClassifier

NOT_EXACT = "libsvm stops at a tolerance: as of scikit-learn's SVC, equal up to it, and not to 1e-7"


@parametrize_with_checks(
    [ECOCClassifier(), ECOCClassifier("onevsall", loss="root")],
    expected_failed_checks=lambda _: {"check_sample_weight_equivalence_on_dense_data": NOT_EXACT},
)
def test_sklearn_contract_holds(estimator, check):
    check(estimator)


X, y = load_iris(return_X_y=True)


@pytest.mark.parametrize("dtype", [str, object])
def test_frames_with_labels_of_text_are_taken(dtype):
    kinds = np.array(["sand", "oats", "gravel"], dtype)
    frame = pd.DataFrame(X, columns=list("abcd"))
    order = np.argsort(np.argsort(kinds))  # class indices of the names
    expected = ECOCClassifier().fit(X, order[y])
    clf = ECOCClassifier().fit(frame, kinds[y])
    assert clf.feature_names_in_.tolist() == list("abcd")
    np.testing.assert_array_equal(clf.predict(frame), np.sort(kinds)[expected.predict(X)])
    # A frame is laid out by columns: products round in their last bits as they like.
    values = expected.decision_function(X)
    np.testing.assert_allclose(clf.decision_function(frame), values, rtol=1e-9, atol=1e-9)
    with pytest.raises(ValueError, match="feature names should match"):
        clf.predict(frame[["b", "a", "c", "d"]])

"""The contract of scikit-learn for every feature space and what scales it: no expected failure."""

import numpy as np
import pytest
import sklearn
from sklearn.base import clone
from sklearn.pipeline import FeatureUnion, make_pipeline
from sklearn.utils import estimator_checks
from sklearn.utils.estimator_checks import parametrize_with_checks

from granular_id.spaces import HFMH, RawHFMH, RawSignal, Tare, TimePermutation
from spaces_cases import FILTERS, ROWS, SCALERS, SPACES, STATISTICS, recordings

EVERY = SPACES | STATISTICS | FILTERS | ROWS

# The checks give signals of a few samples on one axis, which might be one recording.
pytestmark = pytest.mark.filterwarnings("ignore:X of shape .* is taken as:UserWarning")


@parametrize_with_checks([clone(estimator) for estimator in (EVERY | SCALERS).values()])
def test_sklearn_contract_holds(estimator, check):
    check(estimator)


# scikit-learn runs these on its own estimators only.
BY_HAND = [
    "check_transformer_get_feature_names_out",
    "check_transformer_get_feature_names_out_pandas",
    "check_set_output_transform_pandas",
    "check_dataframe_column_names_consistency",
    "check_n_features_in_after_fitting",
]


@pytest.mark.filterwarnings("ignore:X .* feature names")  # the checks mix frames and arrays
@pytest.mark.parametrize("check", BY_HAND)
@pytest.mark.parametrize("name", [*SPACES, *STATISTICS, *ROWS, *SCALERS])
def test_sklearn_checks_of_names_and_frames_pass(name, check):
    getattr(estimator_checks, check)(name, clone((EVERY | SCALERS)[name]))


@pytest.mark.parametrize("in_front", [Tare(0.1), TimePermutation()])
def test_filters_pass_recordings_between_steps(in_front):
    X = recordings()
    pipeline = make_pipeline(in_front, RawHFMH()).set_output(transform="pandas")
    frame = pipeline.fit_transform(X)
    assert frame.columns.tolist() == pipeline.get_feature_names_out().tolist()
    with sklearn.config_context(transform_output="pandas"):
        assert isinstance(clone(in_front).fit_transform(X), np.ndarray)  # three dimensions: no frame
    union = FeatureUnion([("raw", RawSignal()), ("hfmh", HFMH())])
    np.testing.assert_array_equal(make_pipeline(in_front, union).fit_transform(X), frame)
    assert in_front.fit(X).get_feature_names_out().shape == (300,)

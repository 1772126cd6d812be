"""The contract of scikit-learn: no expected failure for any estimator."""

from sklearn.utils.estimator_checks import parametrize_with_checks

from granular_id.ecoc import ECOCClassifier
from granular_id.spaces import HFMH, RawHFMH, RawSignal


@parametrize_with_checks(
    [
        ECOCClassifier(),
        ECOCClassifier(standardize=True, decoding="loss_based", loss="logit"),
        RawSignal(),
        HFMH(),
        HFMH(bin_range="auto", initial="steady"),
        RawHFMH(),
    ]
)
def test_sklearn_contract(estimator, check):
    check(estimator)

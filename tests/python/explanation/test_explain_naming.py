"""explain: axes are called what the recordings call them, in whatever order they come."""

import pytest
from sklearn.pipeline import make_pipeline

from granular_id.ecoc import ECOCClassifier
from granular_id.explanation import explain
from granular_id.spaces import HFMH, MultiBand, RawSignal
from multiband_cases import louder

ORDER = [2, 1, 0, 3, 4, 5]
NAMES = ("fz", "fy", "fx", "tx", "ty", "tz")


def largest(shares):
    return max(shares, key=shares.get)


@pytest.mark.parametrize("space", [RawSignal(), HFMH(bin_range="auto"), MultiBand()])
def test_axes_in_another_order_keep_their_names(space):
    X, y = louder()
    model = make_pipeline(space, ECOCClassifier()).fit(X[..., ORDER], y)
    plain = explain(model, "rice", "oat", X[..., ORDER], y)
    seen = explain(model, "rice", "oat", X[..., ORDER], y, axes=NAMES)
    assert tuple(seen.by_axis()) == NAMES
    assert list(seen.by_axis().values()) == list(plain.by_axis().values())
    assert (largest(plain.by_axis()), largest(seen.by_axis())) == ("fx", "fz")
    assert "fz" in str(seen).lower()


def test_features_and_units_follow_the_names():
    X, y = louder()
    model = make_pipeline(MultiBand(), ECOCClassifier()).fit(X[..., ORDER], y)
    told = explain(model, "rice", "oat", X[..., ORDER], y, axes=NAMES).to_dict()
    assert any("_fz" in name for name in told["features"]["names"][:12])
    model = make_pipeline(RawSignal(), ECOCClassifier()).fit(X[..., :3], y)
    seen = explain(model, "rice", "oat", X[..., :3], y, axes=("left", "right", "up"))
    assert largest(seen.by_axis()) == "up"
    assert {region.axis for region in seen.regions(3)} <= {"left", "right", "up"}

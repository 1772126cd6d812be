"""explain: axes are called what the recordings call them, in whatever order they come."""

import pytest
from sklearn.pipeline import make_pipeline

from cli_cases import ended_well
from granular_id.ecoc import ECOCClassifier
from granular_id.explanation import explain
from granular_id.io import save
from granular_id.recording import Dataset, Recording
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


def test_the_command_takes_the_names_of_the_recordings(tmp_path):
    pytest.importorskip("matplotlib")
    X, y = louder()
    rows = zip(X[..., [2, 1, 0]], y, strict=True)
    data = Dataset(
        [
            Recording(wrench, 500.0, label=str(label), name=f"{k:02d}", axes=("up", "right", "left"))
            for k, (wrench, label) in enumerate(rows)
        ]
    )
    save(data, tmp_path / "recordings.npz")
    for space in ("raw", "multiband"):
        words = ("--space", space, "--figure", tmp_path / f"{space}.png")
        printed = ended_well("explain", tmp_path / "recordings.npz", "rice", "oat", *words)
        assert "up" in printed
        assert "axis0" not in printed
        assert (tmp_path / f"{space}.png").stat().st_size > 10_000

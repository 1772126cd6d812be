"""What feature spaces are not made of: the error names the parameter, what came and what is wanted."""

import numpy as np
import pytest
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline

from granular_id.spaces import (
    DFT,
    HFMH,
    RangeNormalizer,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    TimePermutation,
    feature_blocks,
)
from spaces_cases import recordings

LARGE = 10**400


@pytest.mark.parametrize("kind", [HFMH, RawHFMH, RawHistogram])
@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"bin_range": "automatic"}, "bin_range must be .* or 'auto', got 'automatic'"),
        ({"bin_range": [[-1, 1], [-2, 2]]}, "bin_range has 2 pairs, but X has 6 axes"),
        ({"bin_range": (1.0, -1.0)}, "bin_range"),
        ({"n_bins": 0}, "n_bins"),
        ({"n_bins": 0, "bin_range": "auto"}, "n_bins"),
        ({"outside": "keep"}, "outside"),
    ],
)
def test_bins(kind, parameters, message):
    with pytest.raises(ValueError, match=message):
        kind(**parameters).fit(recordings())


@pytest.mark.parametrize("kind", [HFMH, RawHFMH])
@pytest.mark.parametrize("bin_range", [(-1.5, 1.5), "auto"])
@pytest.mark.parametrize("parameters", [{"cutoff_hz": 250.0}, {"order": 0}, {"initial": "warm"}])
def test_filters(kind, bin_range, parameters):
    with pytest.raises(ValueError, match=next(iter(parameters))):
        kind(**parameters, bin_range=bin_range).fit(recordings())


@pytest.mark.parametrize(
    ("space", "error", "message"),
    [
        (RawSignal(rate_hz=0), ValueError, "rate_hz must be positive and finite, got 0"),
        (RangeNormalizer(rate_hz=0), ValueError, "rate_hz must be positive and finite, got 0"),
        (DFT(rate_hz=np.inf), ValueError, "rate_hz must be positive and finite, got inf"),
        (DFT(rate_hz="500"), TypeError, "rate_hz must be a number of hertz or None, got '500'"),
        (DFT("power"), ValueError, "kind must be one of 'complex', 'magnitude', .* got 'power'"),
        (DFT(np.array(["complex", "magnitude"])), ValueError, "kind must be one of"),
        (DFT(floor=0.0), ValueError, "floor must be positive and finite, got 0.0"),
        (DFT(floor="low"), TypeError, "floor must be a number, got 'low'"),
        (DFT(floor=LARGE), ValueError, "floor must be positive and finite, got inf"),
        (Tare(0.7), ValueError, "tare_s=0.7 at rate_hz=500 is 350 samples, must be from 1 to the 300"),
        (Tare(0.0001), ValueError, "is 0 samples"),
        (Tare(1e308, rate_hz=1e308), ValueError, r"is 1e\+300 samples, must be from 1 to"),
        (Tare(np.nan), ValueError, "tare_s must be positive"),
        (Tare(-(10**5000)), ValueError, "tare_s must be positive and finite, got -inf"),
        (Tare(None), TypeError, "tare_s must be a number of seconds, got None"),
        (Tare(rate_hz="500"), TypeError, "rate_hz must be a number of hertz or None, got '500'"),
        (Tare(rate_hz=-1), ValueError, "rate_hz must be positive"),
        (TimePermutation(random_state="now"), ValueError, "seed"),
    ],
)
def test_parameters(space, error, message):
    with pytest.raises(error, match=message):
        space.fit_transform(recordings())


@pytest.mark.parametrize(
    ("weights", "error", "message"),
    [
        ("equal", ValueError, "must be None, 'unit' or 2 numbers, of raw and hfmh, got 'equal'"),
        ((1.0,), ValueError, r"must be .* 2 numbers, .* got \(1.0,\)"),
        (1.0, ValueError, "must be"),
        ((1.0, 0.0), ValueError, "must be positive and finite"),
        ((1.0, np.nan), ValueError, "must be positive and finite"),
        ((1.0, object()), TypeError, "must be"),
        ((1e308, 1e308), ValueError, "must keep features in the range of float64"),
    ],
)
def test_weights(weights, error, message):
    X = recordings() * 1e3
    with pytest.raises(error, match=f"block_weights {message}"):
        RawHFMH(block_weights=weights).fit(X).transform(X)


@pytest.mark.parametrize(
    ("space", "signal", "message"),
    [
        (DFT(), [1e308] * 8, "Fourier transform in the range of float64"),
        (Tare(1.0, rate_hz=1.0), [-1.7e308, 1.7e308, 0.0], "X must stay in the range of float64"),
        (RawHistogram(), [-1.7e308, 1.7e308], "X must span a range that float64 can hold"),
    ],
)
def test_numbers_whose_features_float64_cannot_hold(space, signal, message):
    with pytest.raises(ValueError, match=message):
        space.fit_transform(np.array(signal)[None, :, None])


@pytest.mark.parametrize("space", [Tare(), TimePermutation()])
def test_recordings_have_no_feature_blocks(space):
    with pytest.raises(TypeError, match="gives recordings; ask the step behind it"):
        space.fit(recordings()).feature_blocks()


@pytest.mark.parametrize(
    "space",
    [
        make_pipeline(TimePermutation(), RawSignal()),
        make_pipeline(RawSignal(), PCA(2)),
        make_pipeline(Tare()),
        PCA(2),
    ],
)
def test_columns_that_stand_for_nothing_have_no_blocks(space):
    with pytest.raises(TypeError, match="columns that stand for instants, bins or frequencies"):
        feature_blocks(space)

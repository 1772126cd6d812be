"""What feature spaces are not made of: the error names the parameter, what came and what is wanted."""

import numpy as np
import pandas as pd
import pytest
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline

from granular_id.recording import AXES
from granular_id.spaces import (
    DFT,
    HFMH,
    MultiBand,
    RangeNormalizer,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    TimePermutation,
    feature_blocks,
)
from spaces_cases import recordings


@pytest.mark.parametrize(
    ("space", "message"),
    [
        (RawSignal(rate_hz=0), "rate_hz must be positive and finite, got 0"),
        (RangeNormalizer(rate_hz=0), "rate_hz must be positive and finite, got 0"),
        (DFT(rate_hz=np.inf), "rate_hz must be positive and finite, got inf"),
        (DFT(rate_hz="500"), "rate_hz must be a number of hertz or None, got '500'"),
        (DFT("power"), "kind='power'; wanted 'complex' or 'magnitude'"),
        (HFMH(bin_range="automatic"), "bin_range must be .* or 'auto', got 'automatic'"),
        (RawHistogram(bin_range=[[-1, 1], [-2, 2]]), "bin_range has 2 pairs, but X has 6 axes"),
        (RawHFMH(bin_range=(1.0, -1.0)), "bin_range"),
        (HFMH(n_bins=0), "n_bins"),
        (RawHistogram(n_bins=0), "n_bins"),
        (HFMH(cutoff_hz=250.0), "cutoff_hz"),
        (HFMH(order=0, bin_range="auto"), "order"),
        (HFMH(initial="warm", bin_range="auto"), "initial"),
        (RawHFMH(block_weights="equal"), "block_weights must be None, 'unit' or 2 positive numbers, .* got 'equal'"),
        (RawHFMH(block_weights=(1.0,)), r"block_weights must be .* got \(1.0,\)"),
        (RawHFMH(block_weights=(1.0, 0.0)), "block_weights must be .* 2 positive numbers"),
        (RawHFMH(block_weights=(1.0, np.nan)), "block_weights must be .* 2 positive numbers"),
        (RawHFMH(block_weights=(1.0, object())), "block_weights must be an array of numbers"),
        (MultiBand(blocks=["power"]), "blocks"),
        (Tare(0.7), "tare_s=0.7 at rate_hz=500 is 350 samples, must be from 1 to the 300"),
        (Tare(0.0001), "is 0 samples"),
        (Tare(np.nan), "tare_s must be positive"),
        (Tare(None), "tare_s must be a number of seconds, got None"),
        (Tare(rate_hz=-1), "rate_hz must be positive"),
        (TimePermutation(random_state="now"), "seed"),
    ],
)  # fmt: skip
def test_parameters_out_of_range_are_refused(space, message):
    with pytest.raises((TypeError, ValueError), match=message):
        space.fit(recordings())


def test_table_of_one_recording_is_refused():
    table = pd.DataFrame(recordings()[0], columns=AXES)
    with pytest.raises(ValueError, match=r"got one table with the columns fx .* tz: pass \[X\]"):
        RawSignal().fit(table)
    assert RawSignal().fit([table]).axes_in_ == AXES


@pytest.mark.parametrize(
    ("space", "message"),
    [
        (Tare(), "got nothing behind filters"),
        (MultiBand(), "columns of MultiBand have no one coordinate"),
        (make_pipeline(TimePermutation(), RawSignal()), "columns that stand for instants, bins or frequencies"),
        (make_pipeline(RawSignal(), PCA(2)), "columns that stand for"),
        (PCA(2), "got PCA"),
    ],
)  # fmt: skip
def test_columns_without_a_coordinate_have_no_blocks(space, message):
    with pytest.raises(TypeError, match=message):
        feature_blocks(space)

"""What feature spaces take (arrays of every layout, recordings at the edge), and what they refuse by name."""

import re

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline

from array_kinds import KINDS, digest
from granular_id.recording import AXES
from granular_id.rica import RICA
from granular_id.spaces import (
    DFT,
    HFMH,
    BlockScaler,
    MultiBand,
    RawHFMH,
    RawHistogram,
    RawSignal,
    Tare,
    TimePermutation,
    WithinClassWhitening,
    feature_blocks,
)
from spaces_cases import FILTERS, SPACES, STATISTICS, recordings

EVERY = SPACES | STATISTICS | FILTERS
# Those that stay three-dimensional arrays of numbers that scikit-learn takes.
LAYOUTS = [
    "read-only", "every other sample", "axes reversed", "Fortran order", "misaligned", "byte-swapped", "broadcast",
    "float16", "float32", "long double", "int8", "bool", "nested lists", "lists of arrays", "sliding windows",
]  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layout_and_width_change_no_bit(layout):
    made = KINDS[layout](recordings(n=3, n_samples=24))
    plain = np.ascontiguousarray(np.asarray(made), dtype=np.float64)
    before = digest(made)
    for name, transformer in EVERY.items():
        expected = clone(transformer).fit(plain).transform(plain)
        np.testing.assert_array_equal(clone(transformer).fit_transform(made), expected, err_msg=name)
        assert expected.dtype == np.float64
    assert digest(made) == before


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 1, 6), (1, 50, 1), (2, 3, 20)], ids=str)
@pytest.mark.parametrize("level", [0.0, 1.25, None], ids=["silent", "constant", "noise"])
def test_short_or_constant_recordings_have_features(name, shape, level):
    X = np.random.default_rng(0).normal(size=shape) if level is None else np.full(shape, level)
    transformer = clone(EVERY[name])
    features = transformer.fit(X).transform(X)
    assert np.isfinite(features).all()
    if name in FILTERS:
        assert features.shape == shape
    else:
        assert features.shape == (shape[0], len(transformer.get_feature_names_out()))
        assert level is None or (features == features[0]).all()


@pytest.mark.parametrize("name", EVERY)
def test_gaps_are_refused_with_their_place(name):
    X = recordings()
    transformer = clone(EVERY[name]).fit(X)
    X[1, 2, 3], X[4, 0, 0] = -np.inf, np.nan
    for call in (transformer.transform, transformer.fit):
        with pytest.raises(ValueError, match="finite, got -inf at recording 1, sample 2, axis 3"):
            call(X)


@pytest.mark.parametrize("name", ["raw", "multi-band", "tare"])
def test_other_shapes_are_refused(name):
    transformer, X = clone(EVERY[name]).fit(recordings()), recordings()
    for other in (X[:, :-1], X[:, :, :-1], X[:, :, 0]):
        shape = re.escape(str(other.shape))
        with pytest.raises(ValueError, match=rf"\(n, 300, 6\) as in fit, with any n, got {shape}$"):
            transformer.transform(other)
    with pytest.raises(ValueError, match=r"got \(300, 6\), of one recording: pass X\[np.newaxis\]"):
        transformer.transform(X[0])
    np.testing.assert_array_equal(transformer.transform(X[0][np.newaxis]), transformer.transform(X)[:1])
    for other, message in (
        (X[None], r"X must have shape \(n, T, C\) or \(n, T\), got 4 dimensions"),
        (X[0, :, 0], "2D array, got 1D"),
        (X[:, :0], "X must have at least one sample|minimum of 1"),
        (X[:, :, :0], "X must have .* at least one axis"),
        (X[:0], "minimum of 1"),
    ):
        with pytest.raises(ValueError, match=message):
            clone(transformer).fit(other)


@pytest.mark.parametrize("name", EVERY)
def test_two_dimensions_are_signals_of_one_axis(name):
    X = recordings(n_axes=1)
    deep, flat = clone(EVERY[name]).fit_transform(X), clone(EVERY[name]).fit_transform(X[:, :, 0])
    np.testing.assert_array_equal(flat, deep[:, :, 0] if name in FILTERS else deep)


@pytest.mark.parametrize(
    ("space", "message"),
    [
        (RawSignal(rate_hz=0), "rate_hz must be positive and finite, got 0"),
        (DFT(rate_hz=np.inf), "rate_hz must be positive and finite, got inf"),
        (DFT(rate_hz="500"), "rate_hz must be a number of hertz or None, got '500'"),
        (DFT("power"), "kind='power'; wanted 'complex' or 'magnitude'"),
        (HFMH(bin_range="automatic"), "bin_range must be .* or 'auto', got 'automatic'"),
        (RawHistogram(bin_range=[[-1, 1], [-2, 2]]), "bin_range has 2 pairs, but X has 6 axes"),
        (HFMH(cutoff_hz=250.0), "cutoff_hz"),
        (HFMH(initial="warm", bin_range="auto"), "initial"),
        (RawHFMH(block_weights="equal"), "block_weights must be None, 'unit' or 2 positive numbers, .* got 'equal'"),
        (RawHFMH(block_weights=(1.0,)), r"block_weights must be .* got \(1.0,\)"),
        (RawHFMH(block_weights=(1.0, np.nan)), "block_weights must be .* 2 positive numbers"),
        (MultiBand(blocks=["power"]), "blocks"),
        (Tare(0.7), "tare_s=0.7 at rate_hz=500 is 350 samples, must be from 1 to the 300"),
        (Tare(np.nan), "tare_s must be positive"),
        (TimePermutation(random_state="now"), "seed"),
    ],
)  # fmt: skip
def test_parameters_out_of_range_are_refused(space, message):
    with pytest.raises((TypeError, ValueError), match=message):
        space.fit(recordings())


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (BlockScaler({"a": 3, "b": 3}), r"blocks must add up to the 7 columns of X, got 6 \(a 3, b 3\)"),
        (BlockScaler({}), "add up to the 7 columns of X, got 0"),
        (BlockScaler({"a": 7, "b": 0}), r"blocks\['b'\] must be at least 1, got 0"),
        (BlockScaler({"a": 3.5, "b": 3.5}), "must be a whole number"),
        (BlockScaler([7]), r"blocks must be None or \{name: number of columns\}, got \[7\]"),
        (WithinClassWhitening(0), "shrinkage must be"),
        (WithinClassWhitening(np.nan), "shrinkage must be"),
        (WithinClassWhitening("a"), "shrinkage must be"),
        (WithinClassWhitening(), "Unknown label type"),
        (RICA(0), "n_components must be at least 1, got 0"),
        (RICA(3, max_iter=True), "max_iter must be a whole number, got True"),
        (RICA(3, alpha=-1.0), "alpha must not be negative, got -1"),
    ],
)
def test_parameters_of_steps_behind_spaces_are_refused(step, message):
    with pytest.raises((TypeError, ValueError), match=message):
        step.fit(recordings(n=9)[:, :7, 0], np.linspace(0, 1, 9))


def test_rows_without_components_are_refused():
    with pytest.raises(ValueError, match=r"every feature is zero \(n_samples = 4\)"):
        RICA(3).fit(np.zeros((4, 3)))


def test_table_of_one_recording_is_refused():
    table = pd.DataFrame(recordings()[0], columns=AXES)
    for given in (table, [table]):
        with pytest.raises(TypeError, match=r"with named columns; .* pass Dataset\.from_frames\("):
            RawSignal().fit(given)


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

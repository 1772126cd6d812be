"""Feature spaces as transformers, against scipy and numpy written out."""

import numpy as np
import pytest
import scipy.signal
from sklearn.pipeline import make_pipeline

from granular_id.features import extract_features, feature_names
from granular_id.spaces import (
    HFMH,
    MultiBand,
    RawHFMH,
    RawSignal,
    TimePermutation,
)
from spaces_cases import recordings


def high_passed(X, *, rate_hz=500.0, cutoff_hz=23.0, order=8, initial="zero"):
    sos = scipy.signal.butter(order, cutoff_hz, "high", fs=rate_hz, output="sos")
    out = np.empty_like(X)
    for i, k in np.ndindex(X.shape[0], X.shape[2]):
        state = scipy.signal.sosfilt_zi(sos) * (X[i, 0, k] if initial == "steady" else 0.0)
        out[i, :, k], _ = scipy.signal.sosfilt(sos, X[i, :, k], zi=state)
    return out


def counts(filtered, ranges, n_bins=100):
    rows = [
        [np.histogram(signal[:, k], n_bins, tuple(ranges[k]))[0] for k in range(signal.shape[1])]
        for signal in filtered
    ]
    return np.asarray(rows, dtype=float).reshape(len(filtered), -1)


PAPER_RANGE = np.tile([-1.5, 1.5], (6, 1))


def test_raw_is_axis_after_axis():
    X = recordings()
    expected = np.concatenate([X[:, :, k] for k in range(6)], axis=1)
    np.testing.assert_array_equal(RawSignal().fit_transform(X), expected)


def test_hfmh_is_the_histogram_of_the_high_passed_axes():
    X = recordings()
    np.testing.assert_array_equal(HFMH().fit_transform(X), counts(high_passed(X), PAPER_RANGE))


def test_raw_hfmh_is_both():
    X = recordings()
    both = np.concatenate([RawSignal().fit_transform(X), HFMH().fit_transform(X)], axis=1)
    np.testing.assert_array_equal(RawHFMH().fit_transform(X), both)


def test_parameters_reach_the_extraction():
    X = recordings(n_axes=3)
    parameters = {
        "rate_hz": 100.0,
        "cutoff_hz": 9.2,
        "order": 4,
        "n_bins": 7,
        "bin_range": [[-0.5, 0.5], [-0.2, 0.1], [-0.01, 0.01]],
        "outside": "clip",
        "density": True,
        "initial": "steady",
    }
    expected = extract_features(X, **parameters)
    transformer = RawHFMH(**parameters, threads=1)
    np.testing.assert_array_equal(transformer.fit_transform(X), expected)
    np.testing.assert_array_equal(transformer.bin_range_, parameters["bin_range"])
    assert not transformer.learns


@pytest.mark.parametrize("initial", ["zero", "steady"])
@pytest.mark.parametrize("kind", [HFMH, RawHFMH])
def test_automatic_range_is_learned_from_the_rows_of_fit(kind, initial):
    X, other = recordings(), recordings(seed=1) * 50
    # An odd number of bins: with a steady start the first values are 0 up to rounding, no place for an edge.
    transformer = kind(bin_range="auto", initial=initial, n_bins=25).fit(X)
    magnitude = np.abs(high_passed(X, initial=initial))
    reach = np.quantile(magnitude.reshape(-1, 6), 0.995, axis=0)
    np.testing.assert_allclose(transformer.bin_range_, np.column_stack([-reach, reach]), rtol=1e-9)
    assert transformer.learns
    before = transformer.bin_range_.copy()
    features = transformer.transform(other)[:, -150:]
    np.testing.assert_array_equal(transformer.bin_range_, before)
    np.testing.assert_array_equal(features, counts(high_passed(other, initial=initial), before, n_bins=25))


def test_automatic_range_of_a_silent_axis_is_that_of_the_paper():
    X = recordings(n_axes=2)
    X[:, :, 1] = 0.0
    transformer = HFMH(bin_range="auto").fit(X)
    np.testing.assert_array_equal(transformer.bin_range_[1], [-1.5, 1.5])
    assert transformer.transform(X)[:, 100:].sum() == 5 * 300


def test_names():
    X = recordings(n=2)
    raw, hfmh, both = (kind().fit(X).get_feature_names_out() for kind in (RawSignal, HFMH, RawHFMH))
    assert raw[[0, 299, 300, -1]].tolist() == ["fx_0000", "fx_0299", "fy_0000", "tz_0299"]
    assert hfmh[[0, 99, 100, -1]].tolist() == ["hfmh_fx_00", "hfmh_fx_99", "hfmh_fy_00", "hfmh_tz_99"]
    np.testing.assert_array_equal(both, np.concatenate([raw, hfmh]))
    assert both.tolist() == feature_names(n_samples=300)


def test_names_of_axes_are_no_input_names_and_the_message_says_so():
    with pytest.raises(
        ValueError, match=r"\(40\): .* instants, not the axes; got shape \(6,\)\. They can be left"
    ):
        RawSignal().fit(recordings(n=2, n_samples=40)).get_feature_names_out(list("abcdef"))


@pytest.mark.parametrize("kind", [RawSignal, RawHFMH, MultiBand, TimePermutation])
def test_one_recording_that_would_pass_for_many_is_told(kind):
    X = recordings(n=2, n_samples=40)
    told = r"\(40, 6\) is taken as 40 recordings of 6 samples on one axis\. .* pass X\[np\.newaxis\]; if not, X\["
    for call in (kind().fit, kind().fit_transform, make_pipeline(kind(), "passthrough").fit_transform):
        with pytest.warns(UserWarning, match=told) as heard:
            call(X[0])
        assert [warning.filename for warning in heard] == [__file__]
    assert kind().fit(X[:1]).n_axes_in_ == 6
    assert kind().fit(X[0][:, :, np.newaxis]).n_axes_in_ == 1  # no warning: pytest makes errors of them
    assert kind().fit(X[0].T).n_features_in_ == 40


@pytest.mark.parametrize(("n", "n_samples"), [(6, 6), (40, 1), (40, 13)])
def test_signals_that_are_no_recording_are_taken_in_silence(n, n_samples):
    assert RawSignal().fit(np.zeros((n, n_samples))).n_features_in_ == n_samples

"""Every feature space beside its twin in numpy and scipy; names of columns; one recording is no set of them."""

from functools import partial

import numpy as np
import pytest
import scipy.signal
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

from granular_id.features import extract_features, feature_names
from granular_id.spaces import HFMH, MultiBand, RawHFMH, RawSignal, TimePermutation
from spaces_cases import SPACES, data_set, recordings

# --- The twins: features of `X`, fitted on `fitted`


def by_axis(X):
    """(n, C, T)"""
    return np.asarray(X, np.float64).transpose(0, 2, 1)


def raw(_, X):
    return by_axis(X).reshape(len(X), -1)


def ranged(_, X):
    series = by_axis(X)
    low, high = series.min(2, keepdims=True), series.max(2, keepdims=True)
    return ((series - low) / (high - low)).reshape(len(X), -1)


def counts(X, ranges, n_bins):
    rows = [
        [np.histogram(one, n_bins, tuple(ranges[k]))[0] for k, one in enumerate(row)] for row in by_axis(X)
    ]
    return np.asarray(rows, float).reshape(len(X), -1)


def high_passed(X, *, rate_hz=500.0, cutoff_hz=23.0, order=8, initial="zero"):
    sos = scipy.signal.butter(order, cutoff_hz, "high", fs=rate_hz, output="sos")
    out = np.empty_like(X)
    for i, k in np.ndindex(X.shape[0], X.shape[2]):
        state = scipy.signal.sosfilt_zi(sos) * (X[i, 0, k] if initial == "steady" else 0.0)
        out[i, :, k], _ = scipy.signal.sosfilt(sos, X[i, :, k], zi=state)
    return out


def hfmh(fitted, X, *, n_bins=100, learned=False, **filtering):
    ranges = np.tile([-1.5, 1.5], (X.shape[2], 1))
    if learned:
        magnitude = np.abs(high_passed(fitted, **filtering)).reshape(-1, X.shape[2])
        ranges = np.quantile(magnitude, 0.995, axis=0)[:, None] * [-1, 1]
    return counts(high_passed(X, **filtering), ranges, n_bins)


def histogram(fitted, X, *, n_bins=100, ranges=None):
    """Given ranges take what is outside into the outermost bins; learned ones leave it out."""
    if ranges is None:
        return counts(X, np.column_stack([fitted.min((0, 1)), fitted.max((0, 1))]), n_bins)
    return counts(np.clip(X, *ranges), np.tile(ranges, (X.shape[2], 1)), n_bins)


def dft(_, X, kind="complex", floor=0.5):
    """Half of the spectrum; what stands for its mirror image too counts twice in scalar products."""
    n = X.shape[1]
    half = np.fft.fft(by_axis(X), axis=2)[:, :, : n // 2 + 1]
    mirrored = slice(1, (n + 1) // 2)
    weights = np.ones(half.shape[2])
    weights[mirrored] = np.sqrt(2)
    if kind == "complex":
        parts = [half.real * weights, (half.imag * weights)[:, :, mirrored]]
    elif kind == "magnitude":
        parts = [np.abs(half) * weights]
    else:
        parts = [np.log(np.maximum(np.abs(half), floor)) * weights]
    return np.concatenate([part.reshape(len(X), -1) for part in parts], axis=1)


def side_by_side(fitted, X, *, blocks, weights=None):
    """Without `weights`, each block counts so that its rows of `fitted` have a mean norm of 1."""
    if weights is None:
        weights = [1 / np.linalg.norm(block(fitted, fitted), axis=1).mean() for block in blocks]
    return np.concatenate([w * block(fitted, X) for w, block in zip(weights, blocks, strict=True)], axis=1)


TWINS = {
    "raw": raw,
    "range": ranged,
    "hfmh": hfmh,
    "hfmh, own range": partial(hfmh, learned=True, initial="steady", n_bins=25),
    "raw+hfmh": partial(side_by_side, blocks=[raw, hfmh], weights=[1, 1]),
    "raw+hfmh, weighted": partial(side_by_side, blocks=[raw, partial(hfmh, learned=True)]),
    "dft": dft,
    "dft magnitude": partial(dft, kind="magnitude"),
    "dft log magnitude": partial(dft, kind="log_magnitude"),
    "histogram": histogram,
    "histogram, own range": partial(histogram, n_bins=7, ranges=(-2.0, 2.0)),
    "union": partial(side_by_side, blocks=[ranged, dft], weights=[1, 1]),
    "union, weighted": partial(side_by_side, blocks=[raw, histogram]),
    "union of one kind": partial(
        side_by_side,
        blocks=[partial(hfmh, cutoff_hz=10.0, n_bins=10), partial(hfmh, cutoff_hz=60.0, n_bins=10)],
        weights=[0.5, 2.0],
    ),
}
ROUNDED = {"dft", "dft magnitude", "dft log magnitude", "union", "union, weighted", "raw+hfmh, weighted"}
LEARNING = {"hfmh, own range", "raw+hfmh, weighted", "histogram", "union, weighted"}


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("n_samples", [300, 33])
def test_features_are_those_of_the_twin(name, n_samples):
    X, other = recordings(n_samples=n_samples), 3 * recordings(n=3, n_samples=n_samples, seed=1)
    space = clone(SPACES[name]).fit(X)
    features, expected = space.transform(other), TWINS[name](X, other)
    if name in ROUNDED:
        np.testing.assert_allclose(features, expected, rtol=1e-12, atol=1e-11)
    else:
        np.testing.assert_array_equal(features, expected)
    np.testing.assert_array_equal(space.transform(X), clone(space).fit_transform(X))
    assert space.learns == (name in LEARNING)
    alone = space.transform(other[:1]) if space.learns else clone(space).fit(other[:1]).transform(other[:1])
    np.testing.assert_array_equal(alone, features[:1])


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
    transformer = RawHFMH(**parameters, threads=1)
    np.testing.assert_array_equal(transformer.fit_transform(X), extract_features(X, **parameters))
    np.testing.assert_array_equal(transformer.bin_range_, parameters["bin_range"])
    assert not transformer.learns


def test_automatic_range_of_a_silent_axis_is_that_of_the_paper():
    X = recordings(n_axes=2)
    X[:, :, 1] = 0.0
    transformer = HFMH(bin_range="auto").fit(X)
    np.testing.assert_array_equal(transformer.bin_range_[1], [-1.5, 1.5])
    assert transformer.transform(X)[:, 100:].sum() == 5 * 300


# --- Names


@pytest.mark.parametrize(
    ("name", "count", "some"),
    [
        ("raw", 1800, ["fx_0000", "fx_0299", "fy_0000", "tz_0299"]),
        ("hfmh", 600, ["hfmh_fx_00", "hfmh_fx_99", "hfmh_fy_00", "hfmh_tz_99"]),
        ("dft", 1800, ["dft_re_fx_0000", "dft_re_fx_0150", "dft_im_fx_0001", "dft_im_tz_0149"]),
        ("dft log magnitude", 906, ["dft_log_fx_0000", "dft_log_tz_0150"]),
        ("histogram", 600, ["hist_fx_00", "hist_fx_99", "hist_fy_00", "hist_tz_99"]),
    ],
)
def test_names_say_what_a_column_is_in_order(name, count, some):
    names = SPACES[name].fit(data_set(n=2)).get_feature_names_out().tolist()
    places = [names.index(one) for one in some]
    assert len(names) == count
    assert places == sorted(places)
    assert (places[0], places[-1]) == (0, count - 1)


def test_names_of_the_fast_path_are_those_of_the_extraction():
    assert RawHFMH().fit(data_set(n=2)).get_feature_names_out().tolist() == feature_names(n_samples=300)


def test_names_of_axes_are_refused_as_input_names():
    fitted = RawSignal().fit(recordings(n=2, n_samples=40))
    with pytest.raises(ValueError, match=r"\(40\): .* instants, not the axes; got shape \(6,\)\. They can"):
        fitted.get_feature_names_out(list("abcdef"))


# --- One recording


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

"""What a report draws of the recordings, against plain numpy and scipy."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import signal as scipy_signal
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline

from evaluation_cases import LABELS, changed, make_data
from granular_id import HFMH, ECOCClassifier, RawHFMH, RawSignal
from granular_id._files import json_value
from granular_id._schema import from_json
from granular_id.evaluation.report_data import ReportData, gather_report_data
from granular_id.evaluation.weights import POINTS, downsampled, rounded, weight_blocks

SAMPLES = 450


@pytest.fixture(scope="module")
def data():
    return make_data(n=4, samples=SAMPLES)


@pytest.fixture(scope="module")
def seen(data):
    return gather_report_data(data, {"raw+hfmh": RawHFMH(initial="steady", cutoff_hz=40.0, n_bins=20)})


def test_means_and_spreads_are_those_of_numpy_in_windows(data, seen):
    edges = np.arange(POINTS) * SAMPLES // POINTS
    windows = [slice(a, b) for a, b in zip(edges, [*edges[1:], SAMPLES], strict=True)]
    assert seen.labels == LABELS
    for k, label in enumerate(LABELS):
        own = data.X[data.y == label]
        for axis in range(6):
            for mine, whole in ((seen.mean, own.mean(axis=0)), (seen.sd, own.std(axis=0))):
                expected = [whole[window, axis].mean() for window in windows]
                np.testing.assert_allclose(mine[k, axis], expected, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(seen.time_s, [np.arange(SAMPLES)[w].mean() / 500 for w in windows], rtol=1e-4)


def test_residual_and_histogram_follow_the_settings_of_the_space(data, seen):
    sos = scipy_signal.butter(8, 40.0, "highpass", fs=500.0, output="sos")
    own = data.X[data.y == "peas"][:, :, 2]
    state = scipy_signal.sosfilt_zi(sos)[:, None, :] * own[:, :1]
    high, _ = scipy_signal.sosfilt(sos, own, axis=1, zi=state)
    part = seen.high_pass
    starts = np.arange(40) * SAMPLES // 40
    pieces = np.split(high, starts[1:], axis=1)
    np.testing.assert_allclose(
        part.residual[1, 2], [np.sqrt((piece**2).mean()) for piece in pieces], rtol=1e-4
    )
    counts = np.mean([np.histogram(row, bins=20, range=(-1.5, 1.5))[0] for row in high], axis=0)
    np.testing.assert_allclose(part.hfmh[1, 2], counts, rtol=1e-4)
    assert part.settings["cutoff_hz"] == 40.0
    assert part.bin_range.tolist() == [[-1.5, 1.5]] * 6
    assert part.time_s[0] == pytest.approx((starts[1] - 1) / 2 / 500)


def test_a_rate_too_low_for_the_filter_leaves_it_out():
    data = changed(make_data(n=3), rate_hz=lambda r: 10.0)
    slow = gather_report_data(data, {"raw": RawSignal()})
    assert slow.high_pass is None
    assert from_json(ReportData, json.loads(json.dumps(json_value(slow)))).high_pass is None


def test_influence_equals_that_of_the_weights_themselves(data):
    X, y = data.X, data.y
    space = RawHFMH(n_bins=30).fit(X)
    blocks = weight_blocks(X, y, space)
    F = space.transform(X)
    size = np.abs(ECOCClassifier().fit(F, y).coef_)
    share = size * F.std(axis=0)
    share = (share / share.sum(axis=1, keepdims=True)).mean(axis=0)
    assert [block.kind for block in blocks] == ["time", "magnitude"]
    for block, columns in zip(blocks, (slice(0, 6 * SAMPLES), slice(6 * SAMPLES, None)), strict=True):
        expected = share[columns].reshape(6, -1)
        np.testing.assert_allclose(block.shares, expected.sum(axis=1), rtol=1e-4)
        np.testing.assert_allclose(block.influence, downsampled(expected), rtol=1e-4, atol=1e-12)
        means = downsampled(size.mean(axis=0)[columns].reshape(6, -1))
        np.testing.assert_allclose(block.weights, means, rtol=1e-4, atol=1e-9)
        assert block.influence.shape[1] <= POINTS
    assert sum(block.shares.sum() for block in blocks) == pytest.approx(1.0, abs=1e-4)


def test_the_weights_lie_where_the_classes_differ():
    X = np.zeros((4, 3, 6))
    X[2:, 1, 0] = 1.0  # in Fx, in the second of three samples
    (raw,) = weight_blocks(X, np.array(["a", "a", "b", "b"]), RawSignal().fit(X))
    assert raw.axes[raw.shares.argmax()] == "fx"
    assert raw.influence[0].tolist() == [0.0, 1.0, 0.0]


def test_the_first_space_with_a_link_to_the_recording_is_looked_at(data):
    lost = make_pipeline(RawSignal(), PCA(3))
    assert gather_report_data(data, {"pca": lost, "hfmh": HFMH(n_bins=7)}).looked_at == "hfmh"
    nowhere = gather_report_data(data, {"pca": lost})
    assert (nowhere.looked_at, nowhere.weights) == (None, ())
    # the paper's filter stands in where no space has one
    assert nowhere.high_pass.settings["cutoff_hz"] == 23.0


def test_json_and_back_keeps_every_number(seen):
    text = json.dumps(json_value(seen), allow_nan=False)
    again = from_json(ReportData, json.loads(text))
    assert json_value(again) == json_value(seen)
    assert again.weights[0].influence.dtype == np.float64
    assert len(text) < 1_000_000


def test_short_curves_stay_as_they_are_and_rounding_keeps_five_digits():
    assert downsampled(np.array([1.0, 3.0, 5.0, 7.0]), most=2).tolist() == [2.0, 6.0]
    assert downsampled(np.array([1.0, 3.0])).tolist() == [1.0, 3.0]
    values = np.random.default_rng(0).normal(size=100) * 10.0 ** np.arange(-50, 50)
    np.testing.assert_allclose(rounded(values), values, rtol=5e-5)

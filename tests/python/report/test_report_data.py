"""What a report draws of the recordings, against plain numpy and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal as scipy_signal

from evaluation_cases import LABELS, changed, make_data
from granular_id import signal
from granular_id.evaluation.report_data import POINTS, report_data_of
from granular_id.plotting import plot_hfmh
from granular_id.recording import Dataset, Recording
from granular_id.spaces import HFMH, RawHFMH, RawSignal

SAMPLES = 450


@pytest.fixture(scope="module")
def data():
    return make_data(n=4, samples=SAMPLES)


@pytest.fixture(scope="module")
def seen(data):
    return report_data_of(data, [RawHFMH(initial="steady", cutoff_hz=40.0, n_bins=20)])


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


def test_histogram_follows_the_settings_of_the_space(data, seen):
    sos = scipy_signal.butter(8, 40.0, "highpass", fs=500.0, output="sos")
    own = data.X[data.y == "peas"][:, :, 2]
    state = signal.sosfilt_zi(sos)[:, None, :] * own[:, :1]
    high, _ = scipy_signal.sosfilt(sos, own, axis=1, zi=state)
    counts = np.mean([np.histogram(row, bins=20, range=(-1.5, 1.5))[0] for row in high], axis=0)
    np.testing.assert_allclose(seen.hfmh.counts[1, 2], counts, rtol=1e-4)
    assert seen.hfmh.cutoff_hz == 40.0
    assert seen.hfmh.bin_range.tolist() == [[-1.5, 1.5]] * 6


def drives(n_axes=9, units=True):
    """Two grounds that differ in the odd axes, the last of them most."""
    rng = np.random.default_rng(0)
    axes = tuple(f"s{k}" for k in range(n_axes))
    meta = {"units": dict.fromkeys(axes, "m/s2")} if units else {}
    level = np.arange(n_axes) * (np.arange(n_axes) % 2)
    signals = [rng.normal(size=(50, n_axes)) + level * (k % 2) for k in range(8)]
    fields = {"axes": axes, "meta": meta}
    return Dataset([Recording(one, 100.0, "ab"[k % 2], **fields) for k, one in enumerate(signals)])


def test_many_axes_those_that_differ_most_are_shown():
    data = drives()
    seen = report_data_of(data, [RawSignal()])
    assert (len(seen.axes), seen.units) == (6, ("m/s2",) * 6)
    assert {"s1", "s3", "s5", "s7"} <= set(seen.axes)
    alone = report_data_of(data.select(axes=seen.axes), [RawSignal()])
    np.testing.assert_array_equal(seen.mean, alone.mean)
    np.testing.assert_array_equal(seen.hfmh.counts, alone.hfmh.counts)


@pytest.mark.parametrize("known", [True, False])
def test_figures_of_other_axes_have_the_units_that_are_known(known):
    seen = report_data_of(drives(3, known), [HFMH(rate_hz=100, bin_range="auto")])
    label = plot_hfmh(seen, "s0").axes[0].get_xlabel()
    assert label == ("bin, m/s2" if known else "bin")


def test_without_a_filter_in_use_the_cutoff_follows_the_rate():
    data = changed(make_data(n=3), rate_hz=lambda r: 10.0)
    slow = report_data_of(data, [RawSignal()])
    assert slow.hfmh.cutoff_hz == 2.5

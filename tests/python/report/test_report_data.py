"""What a report draws of the recordings and of the weights of a model, against plain numpy and scipy."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal as scipy_signal
from sklearn.decomposition import PCA
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from evaluation_cases import LABELS, changed, make_data
from granular_id import signal
from granular_id._files import json_value
from granular_id._schema import from_json
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.report_data import ReportData, gather_report_data
from granular_id.evaluation.weights import POINTS, downsampled, is_traceable, rounded, weight_blocks
from granular_id.plotting import plot_hfmh, plot_residual, plot_weights
from granular_id.recording import Dataset, Recording
from granular_id.report.page import html
from granular_id.spaces import (
    HFMH,
    BlockScaler,
    MultiBand,
    RawHFMH,
    RawSignal,
    WithinClassWhitening,
)
from granular_id.spaces.multiband import band_columns
from multiband_cases import ALL, louder
from report_cases import result_of

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
    state = signal.sosfilt_zi(sos)[:, None, :] * own[:, :1]
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


def drives(n_axes=9, units=True):
    """Two grounds that differ in the odd axes, the last of them most."""
    rng = np.random.default_rng(0)
    axes = tuple(f"s{k}" for k in range(n_axes))
    meta = {"units": dict.fromkeys(axes, "m/s2")} if units else {}
    level = np.arange(n_axes) * (np.arange(n_axes) % 2)
    return Dataset(
        [
            Recording(
                rng.normal(size=(50, n_axes)) + level * (k % 2),
                100.0,
                label="ab"[k % 2],
                axes=axes,
                meta=meta,
            )
            for k in range(8)
        ]
    )


def test_of_many_axes_those_in_which_materials_differ_most_are_kept():
    seen = gather_report_data(drives(), {"raw": RawSignal()})
    assert (len(seen.axes), seen.n_axes, seen.units) == (6, 9, ("m/s2",) * 6)
    assert {"s1", "s3", "s5", "s7"} <= set(seen.axes)
    assert seen.mean.shape[1] == seen.high_pass.hfmh.shape[1] == seen.high_pass.residual.shape[1] == 6
    assert seen.weights[0].axes == drives().axes
    assert from_json(ReportData, json.loads(json.dumps(json_value(seen)))).axes == seen.axes


def test_numbers_of_kept_axes_are_those_of_all():
    data = drives()
    seen = gather_report_data(data, {"raw": RawSignal()})
    own = data.select(axes=seen.axes)
    alone = gather_report_data(own, {"raw": RawSignal()})
    np.testing.assert_array_equal(seen.mean, alone.mean)
    np.testing.assert_array_equal(seen.high_pass.residual, alone.high_pass.residual)
    np.testing.assert_array_equal(seen.high_pass.hfmh, alone.high_pass.hfmh)


@pytest.mark.parametrize("known", [True, False])
def test_figures_of_other_axes_have_the_units_that_are_known(known):
    seen = gather_report_data(drives(3, known), {"hfmh": HFMH(rate_hz=100, bin_range="auto")})
    unit = ", m/s2" if known else ""
    for plot, label in ((plot_hfmh, "bin"), (plot_weights, "bin")):
        labels = {panel.get_xlabel() for panel in plot(seen).axes} - {""}
        assert labels == {f"{label}{unit}"}
    keys = {panel.get_ylabel() for panel in plot_residual(seen).axes} - {""}
    assert keys == {f"RMS{unit}"}


def test_without_a_filter_in_use_the_cutoff_follows_the_rate():
    data = changed(make_data(n=3), rate_hz=lambda r: 10.0)
    slow = gather_report_data(data, {"raw": RawSignal()})
    assert slow.high_pass.settings["cutoff_hz"] == 2.5


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
    assert raw.axes[raw.shares.argmax()] == "axis0"
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


# -- the multi-band space


@pytest.fixture(scope="module")
def pushes():
    X, y = louder()
    y = np.where(np.arange(len(y)) % 5 == 4, "peas", y)
    return X, y


@pytest.fixture(scope="module")
def seen_bands(pushes):
    recordings = [Recording(wrench, 500.0, label=str(label)) for wrench, label in zip(*pushes, strict=True)]
    return gather_report_data(Dataset(recordings), {"multiband": MultiBand(blocks=ALL), "raw": RawSignal()})


@pytest.mark.parametrize("whitened", [False, True])
def test_influence_of_bands_equals_that_of_the_weights_themselves(pushes, whitened):
    X, y = pushes
    space = MultiBand(blocks=ALL).fit(X)
    columns = band_columns(space)
    sizes = [columns.of(block=block).size for block in columns.blocks]
    after = [BlockScaler(sizes), *([WithinClassWhitening(0.1)] if whitened else [])]
    model = make_pipeline(*after, ECOCClassifier()).fit(space.transform(X), y)
    coef = model[-1].coef_
    for _, step in model.steps[-2::-1]:
        coef = step.transform(coef) if isinstance(step, WithinClassWhitening) else coef * step.factor_
    share = np.abs(coef) * space.transform(X).std(axis=0)
    share = (share / share.sum(axis=1, keepdims=True)).mean(axis=0)
    # Without steps behind it a multi-band space is scaled block by block.
    fitted = make_pipeline(space, *model[:-1]) if whitened else space
    blocks = weight_blocks(X, y, fitted)
    assert [(block.name, block.kind) for block in blocks] == [
        ("coupling", "band"),
        ("quantiles", "band"),
        ("envelope", "band"),
        ("spectrum", "frequency"),
        ("level", "time"),
    ]
    assert sum(block.shares.sum() for block in blocks) == pytest.approx(1.0, abs=1e-4)
    for block in blocks:
        own = columns.of(block=block.name)
        assert block.shares.sum() == pytest.approx(share[own].sum(), rel=1e-4)
        assert block.influence.sum() == pytest.approx(share[own].sum(), rel=1e-3)
    quantiles = blocks[1]
    number = next(k for k, c in enumerate(quantiles.coordinates) if 15 < c < 31)
    named = [k for k, name in enumerate(columns.names) if name.startswith("b4_") and name.endswith("_axis2")]
    cell = [k for k in named if columns.columns[k].block == "quantiles"]
    assert len(cell) == 8
    assert quantiles.influence[2, number] == pytest.approx(share[cell].sum(), rel=1e-4)
    assert quantiles.weights[2, number] == pytest.approx(np.abs(coef).mean(axis=0)[cell].mean(), rel=1e-4)
    assert quantiles.coordinates[0] == 0
    assert (np.diff(quantiles.coordinates) > 0).all()


def test_scaled_columns_keep_their_place(pushes):
    X, y = pushes
    scaled = make_pipeline(RawSignal(), StandardScaler()).fit(X)
    assert is_traceable(scaled)
    (block,) = weight_blocks(X, y, scaled)
    assert (block.name, block.kind) == ("raw", "time")
    assert block.weights.sum() > 0


def test_the_report_data_holds_it_and_survives_json(seen_bands):
    assert seen_bands.looked_at == "multiband"
    again = from_json(ReportData, json.loads(json.dumps(json_value(seen_bands), allow_nan=False)))
    assert json_value(again) == json_value(seen_bands)


def test_it_is_drawn_and_reported(seen_bands):
    pytest.importorskip("jinja2")
    figure = plot_weights(seen_bands)
    figure.draw_without_rendering()
    titles = [panel.get_title() for panel in figure.axes if panel.get_title()]
    assert titles == list(ALL)
    panels = [panel for panel in figure.axes if panel.get_xlabel()]
    labels = [*["bands, Hz"] * 3, "frequency, Hz", "time, s"]
    assert [panel.get_xlabel() for panel in panels] == labels
    ticks = [tick.get_text() for tick in panels[0].get_xticklabels()]
    assert ticks[0] == "all"
    assert ticks[-3:] == ["61", "122", "245"]
    heights = [bar.get_height() for bar in figure.axes[0].patches]
    assert heights == pytest.approx(seen_bands.weights[0].influence[0].tolist())
    page = html(replace(result_of("four classes"), report_data=seen_bands))
    assert "Bars of bands add up all features of a band" in page
    assert "Influence in coupling by axis" in page

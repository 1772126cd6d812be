"""Figures of results: what they show is what the arrays hold."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.pipeline import FeatureUnion, make_pipeline

from granular_id.ecoc import ECOCClassifier
from granular_id.explanation import explain
from granular_id.plotting import (
    plot_accuracy,
    plot_answers,
    plot_confusion,
    plot_explanation,
    plot_hfmh,
    plot_recall,
)
from granular_id.recording import Recording
from granular_id.spaces import DFT, HFMH, MultiBand, RangeNormalizer, RawHFMH
from multiband_cases import ALL
from report_cases import result_of
from timeline_cases import timeline


@pytest.fixture(scope="module")
def result():
    return result_of("four classes")


def texts(panel):
    return [text.get_text().replace("\N{MINUS SIGN}", "-") for text in panel.texts]


def row_names(panel):
    return [label.get_text() for label in panel.get_yticklabels()]


def test_accuracy_has_a_row_a_space_and_a_baseline(result):
    panel = plot_accuracy(result).axes[0]
    assert row_names(panel) == ["raw", "hfmh", "(clock)"]
    held = [result.accuracy("raw"), result.accuracy("hfmh"), result.baselines[1].held.accuracy]
    assert texts(panel) == [f"{100 * share:.1f}" for share in held]
    drawn = {line.get_label(): line.get_xdata() for line in panel.lines}
    assert drawn["held-out sessions"] == pytest.approx(held)
    at_random = [*(np.mean(result.at_random[name]) for name in result.spaces), result.baselines[1].at_random]
    assert drawn["as many at random"] == pytest.approx(at_random)
    gaps, intervals = (lines.get_segments() for lines in panel.collections)
    assert gaps[0][:, 0] == pytest.approx((held[0], at_random[0]))
    assert intervals[0][:, 0] == pytest.approx(result.interval("raw"), nan_ok=True)


def test_the_papers_accuracies_are_marked_for_its_materials(monkeypatch, result):
    strokes = (0.7614, 0.8705)
    for shown in (True, False):
        monkeypatch.setattr("granular_id.plotting.evaluation.shows_paper", lambda _, shown=shown: shown)
        lines = [tuple(line.get_xdata()) for line in plot_accuracy(result).axes[0].lines]
        assert (strokes in lines) is shown


def test_recall_has_a_row_a_class(result):
    panel = plot_recall(result, "raw").axes[0]
    assert row_names(panel) == list(result.labels)
    assert any(np.array_equal(line.get_xdata(), result.recall("raw")) for line in panel.lines)


def test_confusion_is_per_cent_of_each_true_class(result, monkeypatch):
    counts = np.array([[199, 1, 0, 0], [0, 0, 0, 0], [1, 2, 1, 0], [0, 0, 0, 5]])
    monkeypatch.setattr(type(result), "confusion", lambda *_: counts)
    panel = plot_confusion(result).axes[0]
    shown = {text.get_position(): text.get_text() for text in panel.texts}
    # a class nobody tested keeps an empty row; rounding hides neither the last error nor the only hit
    of_last = {(0, 2): "25", (1, 2): "50", (2, 2): "25", (3, 3): "100"}
    assert shown == {(0, 0): ">99", (1, 0): "<1", **of_last}
    assert row_names(panel) == list(result.labels)


def test_histograms_of_a_unit_share_colours_and_bins(result):
    seen = result.report_data
    for unit in ("N", "N m"):
        own = [axis for axis, of in zip(seen.axes, seen.units, strict=True) if of == unit]
        panels = [plot_hfmh(seen, axis).axes[0] for axis in own]
        shown = np.array([panel.images[0].get_array().filled(0.0) for panel in panels])
        for axis, values in zip(own, shown, strict=True):
            assert values.sum() == pytest.approx(seen.hfmh.counts[:, seen.axes.index(axis)].sum())
        assert shown[..., 0].any()  # what stays empty in all is cut off
        assert shown[..., -1].any()
        ((low, high),) = {panel.get_xlim() for panel in panels}
        assert (high - low) / shown.shape[2] == pytest.approx(3.0 / 100)
        ((_, top),) = {panel.images[0].get_clim() for panel in panels}
        assert top == shown.max()


@pytest.fixture(scope="module")
def data():
    """Oat differs from rice by half a newton in fz, from 0.4 s to 0.6 s."""
    random = np.random.default_rng(0)
    y = np.repeat(["oat", "rice"], 8)
    X = random.normal(scale=0.1, size=(16, 400, 6))
    X[y == "oat", 200:300, 2] += 0.5
    return X, y


def explained(space, data, *after):
    X, y = data
    model = make_pipeline(space, *after, ECOCClassifier()).fit(X, y)
    return explain(model, "oat", "rice", X, y)


def curves(panel):
    return [line for line in panel.lines if len(line.get_xdata()) > 2]


def test_tables_and_curves_hold_all_of_the_difference(data):
    seen = explained(RawHFMH(), data)
    figure = plot_explanation(seen, title="SYNTHETIC recordings")
    assert figure.get_suptitle().startswith("SYNTHETIC recordings\noat against rice, mean scores +")
    assert figure.get_suptitle().endswith("in % of the difference")
    blocks, times, *along = figure.axes
    assert [panel.get_title() for panel in figure.axes] == ["by block", "by time", "raw", "hfmh"]
    for table in (blocks, times):
        assert table.images[0].get_array().sum() == pytest.approx(seen.difference)
        assert texts(table)[-1] == "100.0"
    sums = np.array(texts(blocks), dtype=float).reshape(3, 7)[-1, :6]
    wanted = [100 * value / seen.difference for value in seen.sums("axis").values()]
    assert sums == pytest.approx(wanted, abs=0.06)
    lines = [line for panel in along for line in curves(panel)]
    assert sum(line.get_ydata().sum() for line in lines) == pytest.approx(100)
    fz = curves(along[0])[2]
    assert 0.4 <= fz.get_xdata()[np.argmax(fz.get_ydata())] <= 0.6


@pytest.mark.parametrize(
    ("space", "labels"),
    [
        (HFMH(bin_range="auto"), ["bin, share of the range of its axis"]),
        (
            FeatureUnion([("norm", RangeNormalizer(rate_hz=500)), ("dft", DFT("magnitude", rate_hz=500))]),
            ["time, s", "frequency, Hz"],
        ),
        (MultiBand(blocks=ALL), ["frequency, Hz", "time, s"]),
        (MultiBand(blocks=["coupling"]), []),
    ],
)
def test_each_block_that_is_read_along_has_a_panel(data, space, labels):
    figure = plot_explanation(explained(space, data))
    along = [panel for panel in figure.axes if not panel.images]
    assert [panel.get_xlabel() for panel in along] == labels
    assert all(len(curves(panel)) == 6 for panel in along)


IMU = ("wx", "wy", "wz", "ax", "ay", "az")
UNITS = dict(zip(IMU, ["rad/s"] * 3 + ["m/s2"] * 3, strict=True))


def answers(classes=("asphalt", "grass", "gravel"), **fields):
    return timeline(np.random.default_rng(0).uniform(0, 1, (40, len(classes))), classes, **fields)


def recording(n=4100, units=UNITS):
    wrench = np.random.default_rng(1).normal(size=(n, 6))
    return Recording(wrench, rate_hz=100.0, axes=IMU, meta={"units": dict(units)})


def test_each_material_has_a_row_and_each_unit_a_panel():
    *signals, panel = plot_answers(answers(), recording()).axes
    assert row_names(panel) == ["asphalt", "grass", "gravel"]
    assert [panel.get_ylabel() for panel in signals] == ["rad/s\nless median", "m/s2\nless median"]
    stated = plot_answers(answers(units=("g",) * 6), recording(units={})).axes[0]
    assert stated.get_ylabel() == "g\nless median"


def test_the_bars_of_a_row_are_its_answers():
    losses = [[0.0, 1.0], [0.0, 1.0], [1.0, 0.0]]
    figure = plot_answers(timeline(losses, ("grass", "gravel"), duration_s=41.0), recording())
    bars = [path for bars in figure.axes[-1].collections for path in bars.get_paths()]
    assert [path.get_extents().intervalx.tolist() for path in bars] == [[0.0, 3.0], [3.0, 4.0]]


def test_unknown_label_and_candidates_are_marked():
    unknown = np.zeros(40, bool)
    unknown[5:9] = True
    candidates = (("grass", "gravel"),) * 40
    marked = answers(unknown=unknown, candidates=candidates, truth="grass", synthetic="SYNTHETIC recordings")
    figure = plot_answers(marked, recording())
    assert figure.get_suptitle() == "Answers over drive, SYNTHETIC recordings"
    assert row_names(figure.axes[-1])[-1] == "like none of them"
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == ["answer", "may be, or nearest", "like no known material", "label of the recording"]


@pytest.mark.parametrize(("n", "shown"), [(11, 11), (30, 15)])
def test_of_many_materials_the_most_named_are_shown(n, shown):
    figure = plot_answers(answers(tuple(f"material {i:02d}" for i in range(n))), recording())
    assert len(row_names(figure.axes[-1])) == shown
    assert ("15 materials that are named least" in figure.axes[-1].get_xlabel()) == (n > shown)


def test_a_long_signal_keeps_its_extremes():
    one = recording(n=90_000)
    line = plot_answers(answers(duration_s=900.0), one).axes[0].lines[0]
    assert len(line.get_xdata()) < 4000
    signal = one.wrench[:, 0] - np.median(one.wrench[:, 0])
    assert (line.get_ydata().min(), line.get_ydata().max()) == (signal.min(), signal.max())


def test_another_recording_is_refused():
    with pytest.raises(ValueError, match="lasts 10 s, the answers are about one of 41 s"):
        plot_answers(answers(), recording(n=1000))

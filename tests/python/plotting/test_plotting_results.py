"""Figures of results: what they show, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from granular_id._text import short
from granular_id.plotting import (
    plot_accuracy,
    plot_confusion,
    plot_gap,
    plot_hfmh,
    plot_mean_forces,
    plot_recall,
    plot_residual,
)
from granular_id.plotting.materials import shared_limits
from report_cases import HOSTILE, result_of, small_result


@pytest.fixture(scope="module")
def result():
    return small_result(protocol=("paper", "session", "chronological"), controls=False)


@pytest.fixture(scope="module")
def report_data(result):
    return result.report_data


def texts(panel):
    return [text.get_text() for text in panel.texts]


def row_names(panel):
    return [label.get_text() for label in panel.get_yticklabels()]


def flat_lines(panel, row):
    """Horizontal extents of the lines drawn into a row."""
    return [line.get_xdata() for line in panel.lines if set(np.asarray(line.get_ydata()).tolist()) == {row}]


def test_accuracy_bars_are_means_and_lines_their_intervals(result):
    panel = plot_accuracy(result).axes[0]
    assert row_names(panel) == ["raw", "hfmh"]
    widths = [bar.get_width() for bars in panel.containers for bar in bars]
    means = [
        result.mean_accuracy(space, protocol) for protocol in result.protocols for space in ("raw", "hfmh")
    ]
    assert widths == pytest.approx(means)
    assert texts(panel) == [f"{100 * mean:.1f}" for mean in means]
    drawn = [tuple(line.get_xdata()) for line in panel.lines]
    assert result.interval("raw", "paper") in drawn
    # two halves have no interval: their dots stand there instead
    assert tuple(result.accuracies("raw", "chronological")) in drawn


def test_the_papers_accuracies_are_marked_when_asked_for(result):
    marked = plot_accuracy(result, paper=True).axes[0]
    points = [tuple(line.get_xdata()) for line in marked.lines]
    assert (0.7614, 0.8705) in points
    assert (0.7614, 0.8705) not in [tuple(line.get_xdata()) for line in plot_accuracy(result).axes[0].lines]


def test_the_gap_lies_between_random_draws_and_the_strictest(result):
    panel = plot_gap(result, "hfmh").axes[0]
    assert row_names(panel) == ["random partitions", "held-out sessions", "halves in time order"]
    (stretch,) = panel.patches
    across = stretch.get_patch_transform().transform(stretch.get_path().vertices)[:, 0]
    ends = sorted(result.mean_accuracy("hfmh", protocol) for protocol in ("paper", "session"))
    assert [across.min(), across.max()] == pytest.approx(ends)
    for row, protocol in enumerate(result.protocols):
        assert any(np.array_equal(x, result.accuracies("hfmh", protocol)) for x in flat_lines(panel, row))
        assert f"{100 * result.mean_accuracy('hfmh', protocol):.1f} %" in texts(panel)


def test_the_gap_of_random_folds_is_shaded_too(result):
    folds = {"kfold": result.partitions["paper"], "session": result.partitions["session"]}
    predicted = result.predicted | {("kfold", "hfmh"): result.predicted["paper", "hfmh"]}
    panel = plot_gap(replace(result, partitions=folds, predicted=predicted), "hfmh").axes[0]
    assert len(panel.patches) == 1
    alone = replace(result, partitions={"paper": result.partitions["paper"]})
    assert len(plot_gap(alone).axes[0].patches) == 0


def test_recall_has_a_row_a_class_and_a_mark_a_protocol(result):
    panel = plot_recall(result, "raw").axes[0]
    assert row_names(panel) == list(result.labels)
    drawn = [
        np.asarray(line.get_xdata()) for line in panel.lines if len(line.get_xdata()) == len(result.labels)
    ]
    for protocol in result.protocols:
        assert any(np.array_equal(x, result.recall("raw", protocol)) for x in drawn)


@pytest.mark.parametrize("plot", [plot_gap, plot_recall])
def test_unknown_spaces_are_refused(result, plot):
    with pytest.raises(ValueError, match="space must be one of 'raw', 'hfmh', got 'nose'"):
        plot(result, "nose")


def maps(figure):
    return [panel for panel in figure.axes if panel.images]


def test_residual_maps_hold_the_report_data(report_data):
    panels = maps(plot_residual(report_data))
    assert [panel.get_title() for panel in panels] == ["$F_x$", "$F_y$", "$F_z$", "$T_x$", "$T_y$", "$T_z$"]
    for axis, panel in enumerate(panels):
        np.testing.assert_array_equal(panel.images[0].get_array(), report_data.high_pass.residual[:, axis])
        assert panel.get_xlim() == (0.0, report_data.n_samples / report_data.rate_hz)
        assert row_names(panel) == list(report_data.labels)


def test_histograms_of_a_unit_share_colours_and_range(report_data):
    panels = maps(plot_hfmh(report_data))
    for start in (0, 3):
        own = panels[start : start + 3]
        shown = np.array([panel.images[0].get_array().filled(0.0) for panel in own])
        for axis, values in enumerate(shown, start):
            assert values.sum() == pytest.approx(report_data.high_pass.hfmh[:, axis].sum())
        assert shown[..., 0].any()
        assert shown[..., -1].any()
        ((low, high),) = {panel.get_xlim() for panel in own}
        assert (high - low) / shown.shape[2] == pytest.approx(3.0 / 100)
        ((_, top),) = {panel.images[0].get_clim() for panel in own}
        assert top == shown.max()


def test_histograms_of_other_bins_share_nothing(report_data):
    ranges = report_data.high_pass.bin_range.copy()
    ranges[2] *= 2
    panels = maps(plot_hfmh(replace(report_data, high_pass=replace(report_data.high_pass, bin_range=ranges))))
    alone = report_data.high_pass.hfmh[:, 2]
    assert panels[2].images[0].get_clim()[1] == alone.max()
    used = np.flatnonzero(alone.any(axis=0))
    edges = np.linspace(*ranges[2], 101)
    assert panels[2].get_xlim() == pytest.approx((edges[used[0]], edges[used[-1] + 1]))
    assert panels[0].get_xlim() == panels[1].get_xlim()


def test_mean_forces_may_be_those_of_report_data(report_data):
    figure = plot_mean_forces(report_data, axes=("ty",))
    assert [panel.get_title() for panel in figure.axes] == list(report_data.labels)
    line = next(line for line in figure.axes[2].lines if len(line.get_xdata()) == len(report_data.time_s))
    np.testing.assert_array_equal(line.get_ydata(), report_data.mean[2, 4])
    assert figure.get_suptitle().startswith("Torque")
    some = replace(report_data, n_synthetic=3)
    assert plot_mean_forces(some).get_suptitle().startswith("3 of 40 recordings synthetic")


def test_figures_of_simulated_recordings_say_so(result, report_data):
    synthetic = replace(report_data, n_synthetic=40)
    for figure in (plot_residual(synthetic), plot_hfmh(synthetic)):
        assert "synthetic" in figure.get_suptitle().lower()
    assert "SYNTHETIC" in plot_gap(replace(result, synthetic=True)).axes[0].get_title()


@pytest.mark.filterwarnings("ignore:Glyph .* missing from")  # a label in Chinese: true of files
def test_names_that_look_like_mathematics_are_names():
    result = result_of("hostile names")
    for figure in (
        plot_recall(result),
        plot_mean_forces(result.report_data),
        plot_residual(result.report_data),
        plot_confusion(result.confusion(), result.labels),
    ):
        figure.draw_without_rendering()
        words = [text.get_text() for panel in figure.axes for text in (*panel.get_yticklabels(), panel.title)]
        assert short(HOSTILE["peas"]) in words


def test_limits_of_colours_hold_all_but_a_few():
    for values in ([0.0, 0.0], [0.0, 2.0], [1e-9, 1.0], [0.5, 0.6]):
        low, high = shared_limits(np.array(values))
        assert 0 < low < high
        assert high >= max(values)
        assert low >= 1e-4 * high
    values = np.full((10, 40), 0.1)
    values[:, 0] = 50.0
    assert shared_limits(values)[1] == 50.0
    assert shared_limits(values, share=0.97)[1] == pytest.approx(0.1)

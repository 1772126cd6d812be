"""Figures of results: what they show, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from granular_id._text import short
from granular_id.plotting import (
    plot_accuracy,
    plot_confusion,
    plot_hfmh,
    plot_mean_forces,
    plot_recall,
)
from granular_id.plotting.materials import shared_limits
from report_cases import HOSTILE, result_of, small_result


@pytest.fixture(scope="module")
def result():
    return small_result()


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


def test_accuracy_has_a_row_a_space_and_a_baseline(result):
    panel = plot_accuracy(result).axes[0]
    assert row_names(panel) == ["raw", "hfmh", "(clock)"]
    held = [result.accuracy("raw"), result.accuracy("hfmh"), result.baselines[1].held.accuracy]
    assert texts(panel) == [f"{100 * share:.1f}" for share in held]
    drawn = {line.get_label(): line.get_xdata() for line in panel.lines}
    assert drawn["held-out sessions"] == pytest.approx(held)
    at_random = [np.mean(result.at_random[name]) for name in ("raw", "hfmh")]
    assert drawn["as many at random"] == pytest.approx([*at_random, result.baselines[1].at_random])
    assert [tuple(x) for x in flat_lines(panel, 0)[:2]] == [
        pytest.approx((held[0], at_random[0])),
        pytest.approx(result.interval("raw"), nan_ok=True),
    ]


def test_the_papers_accuracies_are_marked_when_asked_for(result):
    points = [tuple(line.get_xdata()) for line in plot_accuracy(result, paper=True).axes[0].lines]
    assert (0.7614, 0.8705) in points
    assert (0.7614, 0.8705) not in [tuple(line.get_xdata()) for line in plot_accuracy(result).axes[0].lines]


def test_recall_has_a_row_a_class(result):
    panel = plot_recall(result, "raw").axes[0]
    assert row_names(panel) == list(result.labels)
    assert any(np.array_equal(line.get_xdata(), result.recall("raw")) for line in panel.lines)
    with pytest.raises(ValueError, match="space must be one of 'raw', 'hfmh', got 'nose'"):
        plot_recall(result, "nose")


def maps(figure):
    return [panel for panel in figure.axes if panel.images]


def test_histogram_maps_of_a_unit_share_colours_and_cut_off_what_stays_empty_in_all(report_data):
    panels = maps(plot_hfmh(report_data))
    for start in (0, 3):
        own = panels[start : start + 3]
        shown = np.array([panel.images[0].get_array().filled(0.0) for panel in own])
        for axis, values in enumerate(shown, start):
            assert values.sum() == pytest.approx(report_data.hfmh.counts[:, axis].sum())
        assert shown[..., 0].any()
        assert shown[..., -1].any()
        ((low, high),) = {panel.get_xlim() for panel in own}
        assert (high - low) / shown.shape[2] == pytest.approx(3.0 / 100)
        ((_, top),) = {panel.images[0].get_clim() for panel in own}
        assert top == shown.max()


def test_histograms_of_other_bins_share_nothing(report_data):
    ranges = report_data.hfmh.bin_range.copy()
    ranges[2] *= 2
    panels = maps(plot_hfmh(replace(report_data, hfmh=replace(report_data.hfmh, bin_range=ranges))))
    alone = report_data.hfmh.counts[:, 2]
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


def test_figures_of_simulated_recordings_say_so(report_data):
    synthetic = replace(report_data, n_synthetic=40)
    assert "synthetic" in plot_hfmh(synthetic).get_suptitle().lower()


@pytest.mark.filterwarnings("ignore:Glyph .* missing from")  # a label in Chinese: true of files
def test_names_that_look_like_mathematics_are_names():
    result = result_of("hostile names")
    for figure in (
        plot_recall(result),
        plot_mean_forces(result.report_data),
        plot_confusion(result.confusion(), result.labels),
    ):
        figure.draw_without_rendering()
        words = [text.get_text() for panel in figure.axes for text in (*panel.get_yticklabels(), panel.title)]
        assert short(HOSTILE["peas"]) in words


def test_limits_of_colours_hold_all():
    for values in ([0.0, 0.0], [0.0, 2.0], [1e-9, 1.0], [0.5, 0.6]):
        low, high = shared_limits(np.array(values))
        assert 0 < low < high
        assert high >= max(values)
        assert low >= 1e-4 * high

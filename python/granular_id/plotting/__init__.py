"""Figures, one function each; see `granular_id.plotting.style` for what they share.

Each takes an optional `path`, saves whole or not at all, and returns the ``matplotlib.figure.Figure``.
"""

from granular_id.plotting.confidence import plot_confidence
from granular_id.plotting.evaluation import (
    as_percent,
    draw_confusion,
    plot_accuracy,
    plot_confusion,
    plot_gap,
    plot_over_time,
    plot_recall,
)
from granular_id.plotting.explanation import blocks_with_weight, draw_weights, plot_explanation, plot_weights
from granular_id.plotting.onset import plot_onsets
from granular_id.plotting.recordings import (
    AXIS_LINES,
    Curves,
    curves_in,
    draw_hfmh,
    draw_mean_forces,
    draw_residual,
    plot_hfmh,
    plot_mean_forces,
    plot_recordings,
    plot_residual,
)
from granular_id.plotting.style import FAINT, INK, file_format, new_figure

__all__ = [
    "AXIS_LINES",
    "FAINT",
    "INK",
    "Curves",
    "as_percent",
    "blocks_with_weight",
    "curves_in",
    "draw_confusion",
    "draw_hfmh",
    "draw_mean_forces",
    "draw_residual",
    "draw_weights",
    "file_format",
    "new_figure",
    "plot_accuracy",
    "plot_confidence",
    "plot_confusion",
    "plot_explanation",
    "plot_gap",
    "plot_hfmh",
    "plot_mean_forces",
    "plot_onsets",
    "plot_over_time",
    "plot_recall",
    "plot_recordings",
    "plot_residual",
    "plot_weights",
]

"""Figures, one function each; see `granular_id.plotting.style` for what they share.

Each takes an optional `path`, saves whole or not at all, and returns the ``matplotlib.figure.Figure``.
"""

from granular_id.plotting.answers import plot_answers
from granular_id.plotting.confidence import plot_confidence
from granular_id.plotting.evaluation import (
    as_percent as as_percent,
    draw_confusion as draw_confusion,
    plot_accuracy,
    plot_confusion,
    plot_over_time,
    plot_recall,
)
from granular_id.plotting.explanation import plot_explanation
from granular_id.plotting.materials import (
    curves_in as curves_in,
    draw_hfmh as draw_hfmh,
    draw_mean_forces as draw_mean_forces,
    plot_hfmh,
    plot_mean_forces,
    telling_curves as telling_curves,
)
from granular_id.plotting.recordings import plot_onsets, plot_recordings
from granular_id.plotting.style import (
    FAINT as FAINT,
    INK as INK,
    axis_line as axis_line,
    file_format as file_format,
    new_figure as new_figure,
    quantity_of as quantity_of,
)

__all__ = [
    "plot_accuracy",
    "plot_answers",
    "plot_confidence",
    "plot_confusion",
    "plot_explanation",
    "plot_hfmh",
    "plot_mean_forces",
    "plot_onsets",
    "plot_over_time",
    "plot_recall",
    "plot_recordings",
]

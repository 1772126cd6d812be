"""Figures, one function each; see `granular_id.plotting.style` for what they share.

Each takes what a step of the analysis gives back and an optional `path`, saves whole or not at all, and returns the
``matplotlib.figure.Figure``.
"""

from granular_id.plotting.answers import plot_answers
from granular_id.plotting.confidence import plot_confidence
from granular_id.plotting.evaluation import plot_accuracy, plot_confusion, plot_over_time, plot_recall
from granular_id.plotting.explanation import plot_explanation
from granular_id.plotting.recordings import (
    Means as Means,
    draw_means as draw_means,
    means_of as means_of,
    plot_hfmh,
    plot_mean_forces,
    plot_onsets,
    plot_recordings,
    quantity_of as quantity_of,
)
from granular_id.plotting.style import (
    FAINT as FAINT,
    INK as INK,
    axis_line as axis_line,
    file_format as file_format,
    name_axes as name_axes,
    new_figure as new_figure,
    plain as plain,
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

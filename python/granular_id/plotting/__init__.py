"""Figures, one function each; see `granular_id.plotting.style` for what they share.

Each takes an optional `path`, saves whole or not at all, and returns the ``matplotlib.figure.Figure``.
"""

from granular_id.plotting.evaluation import (
    plot_accuracy,
    plot_confusion,
    plot_gap,
    plot_over_time,
    plot_recall,
)
from granular_id.plotting.explanation import plot_explanation, plot_weights
from granular_id.plotting.onset import plot_onsets
from granular_id.plotting.recordings import plot_hfmh, plot_mean_forces, plot_recordings, plot_residual

__all__ = [
    "plot_accuracy",
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

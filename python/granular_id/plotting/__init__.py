"""Figures, one function each; see `granular_id.plotting.style` for what they share.

Each takes an optional `path`, saves whole or not at all, and returns the ``matplotlib.figure.Figure``.
"""

from granular_id.plotting.accuracy import plot_accuracy
from granular_id.plotting.confusion import plot_confusion
from granular_id.plotting.explanation import plot_explanation
from granular_id.plotting.gap import plot_gap
from granular_id.plotting.hfmh import plot_hfmh
from granular_id.plotting.mean_forces import plot_mean_forces
from granular_id.plotting.onset import plot_onsets
from granular_id.plotting.over_time import plot_over_time
from granular_id.plotting.recall import plot_recall
from granular_id.plotting.recordings import plot_recordings
from granular_id.plotting.residual import plot_residual
from granular_id.plotting.weights import plot_weights

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

"""Figures, one function each; see `granular_id.plotting.style` for what they share.

Each takes an optional `path`, saves whole or not at all, and returns the ``matplotlib.figure.Figure``.
"""

from granular_id.plotting.confusion import plot_confusion
from granular_id.plotting.mean_forces import plot_mean_forces

__all__ = ["plot_confusion", "plot_mean_forces"]

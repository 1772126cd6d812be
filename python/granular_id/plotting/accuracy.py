"""Accuracy of each feature space under each protocol, with intervals."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id.plotting.protocols import looks
from granular_id.plotting.style import FAINT, INK, new_figure, quiet, row_names, save, share_axis

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation import EvaluationResult

__all__ = ["plot_accuracy"]

_PAPER = "the paper, on its own recordings"


def plot_accuracy(
    result: EvaluationResult, *, paper: bool = False, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Plot the mean accuracy of each feature space under each protocol, with intervals.

    Parameters
    ----------
    result : EvaluationResult
    paper : bool, default False
        Mark the accuracies that the paper reports for its own recordings, where a space has one.
    path : path-like, optional
        As in `granular_id.plotting.plot_mean_forces`.

    Returns
    -------
    matplotlib.figure.Figure
        A bar is a mean over partitions. Its line is the 95 % interval, corrected for the recordings that
        partitions share (`granular_id.evaluation.statistics.corrected_interval`); dots, one a partition, take
        its place where there are fewer than three. The dashed line is chance.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.

    Examples
    --------
    >>> from granular_id import evaluate, synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> result = evaluate(data, ["raw", "hfmh"], "paper", n_partitions=3, train_per_class=4, test_per_class=2)
    >>> [label.get_text() for label in plot_accuracy(result).axes[0].get_yticklabels()]
    ['raw', 'hfmh']
    """
    names = [space.name for space in result.spaces]
    shown = looks(result)
    figure = new_figure(4.7, 0.9 + len(names) * (0.18 + 0.15 * len(shown)))
    panel = figure.subplots()
    thickness = 0.78 / len(shown)
    for i, (protocol, look) in enumerate(shown.items()):
        rows = np.arange(len(names)) + (i - (len(shown) - 1) / 2) * thickness
        means = [result.mean_accuracy(name, protocol) for name in names]
        panel.barh(rows, means, 0.8 * thickness, color=look.colour, alpha=0.35, linewidth=0, label=look.name)
        for row, name, mean in zip(rows.tolist(), names, means, strict=True):
            draw_accuracy(panel, result, name, protocol, row, look.colour)
            panel.annotate(
                f"{100 * mean:.1f}",
                (1.0, row),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                fontsize=7.5,
                color=INK,
                annotation_clip=False,
            )
    if paper:
        known = [(space.paper_accuracy, k) for k, space in enumerate(result.spaces) if space.paper_accuracy]
        panel.plot(
            [share for share, _ in known],
            [k for _, k in known],
            linestyle="none",
            marker="|",
            markersize=11,
            markeredgewidth=1.6,
            color=INK,
            label=_PAPER,
        )
    panel.axvline(result.chance, color=INK, linewidth=0.8, linestyle="--", label="chance")
    share_axis(panel)
    row_names(panel, names)
    quiet(panel)
    panel.spines["left"].set_visible(False)
    panel.set_xlabel("accuracy", fontsize=9, color=INK)
    panel.grid(axis="x", color=FAINT, linewidth=0.4)
    panel.set_axisbelow(True)
    handles, words = panel.get_legend_handles_labels()
    # The protocols first: matplotlib puts lines before bars.
    order = sorted(range(len(words)), key=lambda i: words[i] in {"chance", _PAPER})
    figure.legend(
        [handles[i] for i in order],
        [words[i] for i in order],
        loc="outside upper left",
        ncols=2,
        frameon=False,
        fontsize=8,
        labelcolor=INK,
    )
    save(figure, path)
    return figure


def draw_accuracy(
    panel: Any, result: EvaluationResult, space: str, protocol: str, row: float, colour: str
) -> None:
    """Draw the interval of one accuracy into a row, or its partitions where there are too few for one."""
    low, high = result.interval(space, protocol)
    if np.isfinite(low):
        panel.plot([low, high], [row, row], color=colour, linewidth=2.2, solid_capstyle="butt")
    else:
        values = result.accuracies(space, protocol)
        panel.plot(
            values, np.full(values.shape, row), linestyle="none", marker="o", markersize=3, color=colour
        )

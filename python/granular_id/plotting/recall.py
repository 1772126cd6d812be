"""Which classes are recognised, under each protocol."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from granular_id.plotting.protocols import looks
from granular_id.plotting.style import FAINT, INK, new_figure, quiet, row_names, save, share_axis

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation import EvaluationResult

__all__ = ["plot_recall"]


def plot_recall(
    result: EvaluationResult, space: str | None = None, *, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Plot the recall of each class: the share of its recordings that was named rightly.

    Parameters
    ----------
    result : EvaluationResult
    space : str, optional
        Default: the best under random draws.
    path : path-like, optional
        As in `granular_id.plotting.plot_mean_forces`.

    Returns
    -------
    matplotlib.figure.Figure
        One row a class, one mark a protocol, joined by a line: its length is what the class loses.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For a space that was not evaluated.

    Examples
    --------
    >>> from granular_id import evaluate, synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=6, duration_s=0.5)
    >>> result = evaluate(data, "hfmh", "paper", n_partitions=3, train_per_class=4, test_per_class=2)
    >>> [label.get_text() for label in plot_recall(result).axes[0].get_yticklabels()]
    ['fine sugar', 'rice']
    """
    name = result.space(space).name if space is not None else result.best_space(result.random)
    shown = looks(result)
    recalls = {protocol: result.recall(name, protocol) for protocol in shown}
    rows = range(len(result.labels))
    figure = new_figure(4.7, 0.9 + 0.22 * len(rows))
    panel = figure.subplots()
    for row in rows:
        ends = [recall[row] for recall in recalls.values()]
        panel.plot([min(ends), max(ends)], [row, row], color=FAINT, linewidth=2, zorder=1)
    for protocol, look in shown.items():
        marks: dict[str, Any] = {
            "linestyle": "none",
            "marker": look.marker,
            "markersize": 6,
            "color": look.colour,
        }
        panel.plot(recalls[protocol], rows, label=look.name, alpha=0.9, clip_on=False, **marks)
    panel.axvline(result.chance, color=INK, linewidth=0.8, linestyle="--", label="chance")
    share_axis(panel)
    row_names(panel, result.labels)
    quiet(panel)
    panel.spines["left"].set_visible(False)
    panel.set_xlabel("recall", fontsize=9, color=INK)
    panel.grid(axis="x", color=FAINT, linewidth=0.4)
    panel.set_axisbelow(True)
    figure.legend(loc="outside upper left", ncols=3, frameon=False, fontsize=8, labelcolor=INK)
    save(figure, path)
    return figure

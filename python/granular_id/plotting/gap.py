"""The gap between random partitions and the strictest protocol, for one feature space."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id.plotting.protocols import looks
from granular_id.plotting.style import FAINT, INK, new_figure, quiet, save, share_axis, short

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation import EvaluationResult

__all__ = ["plot_gap"]

_GAP_COLOUR = "#E69F00"


def plot_gap(
    result: EvaluationResult, space: str | None = None, *, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Plot the accuracy of one feature space under every protocol on one scale, and the gap between them.

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
        One row a protocol: dots are partitions, the large mark is their mean, the line the 95 % interval
        (`EvaluationResult.interval`; none below three partitions). The shaded stretch is the gap between
        random draws and the strictest protocol; the dashed line is chance.

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
    >>> counts = {"n_partitions": 3, "train_per_class": 4, "test_per_class": 2}
    >>> result = evaluate(data, "hfmh", ["paper", "chronological"], **counts)
    >>> [label.get_text() for label in plot_gap(result).axes[0].get_yticklabels()]
    ['random partitions', 'halves in time order']
    """
    name = result.space(space).name if space is not None else result.best_space(result.random)
    shown = looks(result)
    figure = new_figure(5.2, 0.75 + 0.42 * len(shown))
    panel = figure.subplots()
    strictest = result.strictest
    if result.random is not None and strictest is not None:
        means = [result.mean_accuracy(name, protocol) for protocol in (result.random, strictest)]
        panel.axvspan(min(means), max(means), color=_GAP_COLOUR, alpha=0.3, linewidth=0)
    for row, (protocol, look) in enumerate(shown.items()):
        _draw_row(panel, result, name, protocol, row, look)
    panel.axvline(result.chance, color=INK, linewidth=0.8, linestyle="--")
    panel.annotate(
        "chance",
        (result.chance, len(shown) - 0.5),
        xytext=(3, 3),
        textcoords="offset points",
        fontsize=8,
        color=INK,
    )
    share_axis(panel)
    panel.set_yticks(range(len(shown)), [look.name for look in shown.values()])
    panel.set_ylim(len(shown) - 0.5, -0.5)
    quiet(panel)
    panel.tick_params(axis="y", length=0, labelsize=9)
    panel.spines["left"].set_visible(False)
    panel.grid(axis="x", color=FAINT, linewidth=0.4)
    panel.set_axisbelow(True)
    mark = ", SYNTHETIC recordings" if result.synthetic else ""
    panel.set_title(f"accuracy of {short(name, 40)}{mark}", fontsize=9, color=INK, parse_math=False)
    save(figure, path)
    return figure


def _draw_row(panel: Any, result: EvaluationResult, space: str, protocol: str, row: int, look: Any) -> None:
    values, mean = result.accuracies(space, protocol), result.mean_accuracy(space, protocol)
    low, high = result.interval(space, protocol)
    if np.isfinite(low):
        panel.plot([low, high], [row, row], color=look.colour, linewidth=5, alpha=0.35, solid_capstyle="butt")
    dots = {"linestyle": "none", "marker": ".", "markersize": 5, "markeredgewidth": 0, "clip_on": False}
    panel.plot(values, np.full(values.shape, float(row)), color=INK, alpha=0.55, **dots)
    panel.plot(
        [mean], [row], linestyle="none", marker=look.marker, markersize=8, color=look.colour, clip_on=False
    )
    # The number stands on the side that has room.
    left = mean > 0.5
    panel.annotate(
        f"{100 * mean:.1f} %",
        (min(values.min(), low if np.isfinite(low) else 1.0) if left else max(values.max(), mean), row),
        xytext=(-6 if left else 8, 0),
        textcoords="offset points",
        ha="right" if left else "left",
        va="center",
        fontsize=10,
        fontweight="bold",
        color=INK,
    )

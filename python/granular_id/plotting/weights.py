"""Where a linear model looks: influence over time, axis, bin and band."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._words import fixed
from granular_id.plotting.style import AXIS_COLOURS, FAINT, INK, TICKS, new_figure, pretty, quiet, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation.gaze import WeightBlock
    from granular_id.evaluation.portrait import Portrait

__all__ = ["blocks_with_weight", "draw_weights", "plot_weights"]

_ACROSS = {"time": "time", "magnitude": "bin", "frequency": "frequency", "band": "bands"}


def plot_weights(portrait: Portrait, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot which instants, axes, bins and bands weigh in the decisions of a linear model fitted on all recordings.

    Parameters
    ----------
    portrait : granular_id.evaluation.portrait.Portrait
        For instance ``result.portrait``.
    path : path-like, optional
        As in `granular_id.plotting.plot_mean_forces`.

    Returns
    -------
    matplotlib.figure.Figure
        One column a block of features, two of them side by side, one row an axis. Heights are the size of a
        weight times the standard deviation of its feature, mean over the binary learners, on one scale within a
        block; bars of bands add up all features of a band. The per cent are the share of an axis in all decisions.
        A block that the model does not use, as `level` where it was not chosen, is left out.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For a portrait without weights: no feature space kept a link to time, axis and bin.

    Examples
    --------
    >>> from granular_id import RawHFMH, synthesize
    >>> from granular_id.evaluation.portrait import portrait
    >>> seen = portrait(synthesize(["rice", "fine sugar"], n_per_class=3), {"raw+hfmh": RawHFMH()})
    >>> len(plot_weights(seen).axes)
    12
    """
    if not portrait.weights:
        raise ValueError("portrait has no weights: no feature space kept a link to time, axis and bin")
    blocks = blocks_with_weight(portrait)
    across = min(2, len(blocks))
    down = math.ceil(len(blocks) / across)
    rows = max(len(block.axes) for block in blocks)
    figure = new_figure(0.4 + 4.2 * across, 0.4 + down * (0.5 + 0.62 * rows))
    cells = figure.subfigures(down, across, squeeze=False).ravel()
    for block, cell in zip(blocks, cells, strict=False):
        column = cell.subplots(rows, 1, squeeze=False)[:, 0]
        draw_weights(column, block)
        column[0].set_title(block.name, fontsize=10, color=INK, parse_math=False)
    synthetic = ", SYNTHETIC recordings" if portrait.n_synthetic else ""
    title = f"Where the linear model of {portrait.looked_at} looks{synthetic}"
    figure.suptitle(title, fontsize=11, color=INK, parse_math=False)
    save(figure, path)
    return figure


def blocks_with_weight(portrait: Portrait) -> tuple[WeightBlock, ...]:
    """Blocks that the model uses; all of them where it uses none."""
    return tuple(block for block in portrait.weights if block.influence.any()) or portrait.weights


def draw_weights(panels: Any, block: WeightBlock) -> None:
    """Draw one block into a column of panels, one an axis; panels left over are removed."""
    top = float(block.influence.max()) or 1.0
    bands = block.kind == "band"
    left, right = _reach(block, top)
    for axis, panel in zip(block.axes, panels, strict=False):
        number = block.axes.index(axis)
        colour = AXIS_COLOURS[number % len(AXIS_COLOURS)]
        if bands:
            panel.bar(_places(block), block.influence[number], 0.94, color=colour, alpha=0.75, linewidth=0)
        else:
            panel.fill_between(
                block.coordinates, block.influence[number], color=colour, alpha=0.75, linewidth=0
            )
        panel.set_xlim(left, right if right > left else left + 1.0)
        panel.set_ylim(0.0, top)
        quiet(panel)
        panel.set_yticks([])
        panel.spines["left"].set_visible(False)
        share = 100 * float(block.shares[number])
        panel.set_ylabel(
            f"{pretty(axis)}\n{share:.1f} %", rotation=0, ha="right", va="center", fontsize=8.5, color=INK
        )
        last = number == len(block.axes) - 1
        if bands:
            _name_edges(panel, block)
        elif _is_geometric(block):
            panel.set_xscale("log")
            ticks = [tick for tick in TICKS if left <= tick <= right]
            panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            panel.minorticks_off()
        panel.tick_params(labelbottom=last, length=3 if last else 0, colors=INK)
        panel.spines["bottom"].set_color(FAINT)
    for unused in panels[len(block.axes) :]:
        unused.remove()
    what = _ACROSS.get(block.kind, block.kind)
    panels[len(block.axes) - 1].set_xlabel(
        f"{what}, {block.unit.replace(', ', ' or ')}", fontsize=8, color=INK
    )


def _reach(block: WeightBlock, top: float) -> tuple[float, float]:
    """Return the first and the last coordinate to show."""
    if block.kind == "band":
        places = _places(block)
        return float(places[0]) - 0.5, float(places[-1]) + 0.5
    left, right = float(block.coordinates.min()), float(block.coordinates.max())
    used = np.flatnonzero(block.influence.max(axis=0) > 0.01 * top)
    if block.kind != "time" and used.size > 1:  # most bins of a wide range stay empty, most bands silent
        left, right = block.coordinates[[used[0], used[-1]]].tolist()
    return left, right


def _is_geometric(block: WeightBlock) -> bool:
    """Whether frequencies lie closer below than above, as pooled ones do."""
    if block.kind != "frequency" or len(block.coordinates) < 3 or block.coordinates[0] <= 0:
        return False
    steps = np.diff(block.coordinates)
    return bool(steps[-1] > 2 * steps[0])


def _places(block: WeightBlock) -> NDArray[np.float64]:
    """Octaves side by side, and the whole signal half a place in front of them."""
    places = np.arange(len(block.coordinates), dtype=np.float64)
    places[block.coordinates == 0] -= 0.5
    return places


def _name_edges(panel: Any, block: WeightBlock) -> None:
    places, octaves = _places(block), block.coordinates > 0
    middles = block.coordinates[octaves]
    edges = [*(middles / np.sqrt(2)), *(middles[-1:] * np.sqrt(2))]
    at = [*(places[octaves] - 0.5), *(places[octaves][-1:] + 0.5)]
    panel.set_xticks(
        [*places[~octaves], *at],
        [
            *("all" for _ in places[~octaves]),
            *(fixed(edge, 0) if edge >= 9.5 else f"{edge:.2g}" for edge in edges),
        ],
        fontsize=7.5,
    )

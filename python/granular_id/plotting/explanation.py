"""The figure of what decides between two materials."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._core import AXES
from granular_id._text import short
from granular_id.evaluation import window_starts
from granular_id.plotting import style
from granular_id.plotting.style import INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.explanation import Explanation
    from granular_id.spaces import FeatureBlock

# Orange against purple, which differ to any colour vision. In a grey print signs and numbers do.
_COLOURS = "PuOr_r"
# Single samples jitter; sums over windows show where a difference is made, and still sum to all of it.
_WINDOWS = 80
_MINUS = "\N{MINUS SIGN}"


def plot_explanation(
    explanation: Explanation, *, title: str | None = None, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Plot how much each block, band, axis and time contributes to distinguishing two materials.

    Parameters
    ----------
    explanation : granular_id.explanation.Explanation
    title : str, optional
        First line of the heading, for instance "SYNTHETIC recordings".
    path : path-like, optional
        As in `granular_id.plotting.plot_recordings`.

    Returns
    -------
    matplotlib.figure.Figure
        Above, the tables of the explanation as heat maps with their numbers and sums, in per cent of the difference
        of the mean scores: orange what speaks for the first material, purple what speaks against. Where the model
        does not score the first material above the second, in units of the score. Below, a panel for each block that
        is read along time, frequency or bins, with a line an axis: of more than 80 instants or frequencies sums over
        80 windows. Bins and frequencies beyond which nothing reaches 1 % of the largest are not shown.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> from granular_id import ECOCClassifier, RawHFMH, synthesize
    >>> from granular_id import explain
    >>> from granular_id.plotting import plot_explanation
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=3)
    >>> model = make_pipeline(RawHFMH(), ECOCClassifier()).fit(data.X, data.y)
    >>> seen = explain(model, "rice", "fine sugar", data.X, data.y)
    >>> [panel.get_title() for panel in plot_explanation(seen, title="SYNTHETIC recordings").axes]
    ['by block', 'by time', 'raw', 'hfmh']
    """
    _, unit = explanation.scale()
    tables = explanation.tables()
    groups: dict[str, list[FeatureBlock]] = {}
    for block in explanation.columns.along:
        groups.setdefault(explanation.columns.blocks[block.columns][0], []).append(block)
    heights = [*(0.6 + 0.2 * len(table) for table in tables.values()), *[1.9] * len(groups)]
    figure = style.new_figure(max(6.4, 2.2 + 0.62 * len(explanation.columns.axes)), 1.0 + sum(heights))
    panels = figure.subplots(len(heights), 1, height_ratios=heights, squeeze=False).ravel()
    for panel, (by, table) in zip(panels, tables.items(), strict=False):
        _draw_table(panel, explanation, table)
        style.heading(panel, f"by {by}", 9)
    for panel, (name, blocks) in zip(panels[len(tables) :], groups.items(), strict=True):
        _draw_curves(panel, explanation, blocks)
        style.heading(panel, name, 9)
        style.name_axes(panel, up="%" if unit.startswith("%") else "score", size=8)
    if groups:
        keys = style.axis_keys(explanation.columns.axes, 1.1)
        style.legend(figure, "lower center", handles=keys, ncols=min(len(keys), 7))
    first, second = (short(str(label)) for label in (explanation.first, explanation.second))
    scores = " and ".join(f"{score:+.2g}" for score in explanation.scores).replace("-", _MINUS)
    above = "" if title is None else f"{title}\n"
    style.heading(figure, f"{above}{first} against {second}, mean scores {scores}\nin {unit}")
    style.save(figure, path)
    return figure


def _draw_table(panel: Any, explanation: Explanation, table: dict[str, dict[str, float]]) -> None:
    """Draw a heat map with its numbers, and sums beside and below."""
    axes = explanation.columns.axes
    values = np.array([list(row.values()) for row in table.values()])
    rows, across = values.shape
    limit = float(np.abs(values).max()) or 1.0
    panel.imshow(values, cmap=_COLOURS, vmin=-limit, vmax=limit, aspect="auto", interpolation="none")
    whole = np.block([[values, values.sum(axis=1, keepdims=True)], [values.sum(axis=0), values.sum()]])
    centred: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 7}
    for (row, column), value in np.ndenumerate(whole):
        inside = row < rows and column < across
        colour = "white" if inside and abs(value) > 0.6 * limit else INK
        text = explanation.shown(float(value)).replace("-", _MINUS)
        panel.text(column, row, text, color=colour, fontweight="normal" if inside else "bold", **centred)
    style.row_names(panel, [*table, "sum"])
    panel.set_xlim(-0.5, across + 0.5)
    turned = 90 if len(axes) > 3 and not set(axes) <= set(AXES) else 0
    panel.set_xticks(range(across + 1), [*map(style.pretty, axes), "sum"], rotation=turned)
    panel.tick_params(labelsize=8, colors=INK, length=0)
    panel.spines[:].set_visible(False)


def _draw_curves(panel: Any, explanation: Explanation, blocks: list[FeatureBlock]) -> None:
    """Draw the contributions of each axis over the coordinate of the blocks."""
    scale, _ = explanation.scale()
    own_range = len(blocks) > 1  # histograms with a range for each axis
    kind, reach = blocks[0].kind, 0.0
    for block in blocks:
        coordinates, values = block.coordinates, scale * explanation.along(block)
        if kind == "frequency":  # high ones tend to say nothing
            shown = coordinates <= _used(coordinates, values)
            coordinates, values = coordinates[shown], values[:, shown]
        if kind != "magnitude" and len(coordinates) > _WINDOWS:
            starts = window_starts(len(coordinates), _WINDOWS)
            values = np.add.reduceat(values, starts, axis=1)
            coordinates = np.add.reduceat(coordinates, starts) / np.diff(starts, append=len(coordinates))
        if own_range:
            coordinates = coordinates / (np.abs(coordinates).max() or 1.0)
        reach = max(reach, _used(coordinates, values))
        for axis, row in zip(block.axes, values, strict=True):
            look = style.axis_line(axis, explanation.columns.axes.index(axis))
            panel.plot(coordinates, row, linewidth=1.1, drawstyle="steps-mid", **look)
    style.curve_panel(panel)
    low, high = panel.get_xlim()
    if kind == "magnitude" and reach > 0:  # most bins of a wide range stay empty
        panel.set_xlim(max(low, -reach), min(high, reach))
    if kind == "frequency" and low > 0:
        panel.set_xscale("log")
        panel.set_xticks(*style.log_ticks(low, high))
        panel.minorticks_off()
    what = {"magnitude": "bin"}.get(kind, kind)
    label = "bin, share of the range of its axis" if own_range else style.with_unit(what, blocks[0].unit)
    style.name_axes(panel, label, size=8)


def _used(coordinates: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Return how far from zero anything to speak of is contributed."""
    size = np.abs(values).max(axis=0)
    return 1.1 * float(np.abs(coordinates[size >= 1e-2 * size.max()]).max())

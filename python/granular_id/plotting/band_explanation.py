"""What decides between two materials in the multi-band space: bands and axes, couplings, spectrum and level."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._core import AXES
from granular_id.plotting.style import (
    FAINT,
    INK,
    TICKS,
    axis_line,
    middles_to_edges,
    new_figure,
    number_text,
    pretty,
    quiet,
    row_names,
    share_bars,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.explanation import BandExplanation, ExplainedBlock
    from granular_id.spaces.band_columns import Band

__all__ = ["draw_band_explanation"]

Floats = NDArray[np.float64]

# Orange against purple: told apart with any colour vision. In a grey print signs and numbers tell.
_COLOURS = "PuOr_r"
_MATRICES = 3


def draw_band_explanation(explanation: BandExplanation) -> Figure:
    """Draw the parts of a figure that has no heading yet: see `granular_id.plotting.plot_explanation`."""
    per_cent = explanation.difference > 0
    scale, unit, digits = (
        (100.0 / explanation.difference, "% of the difference", 1)
        if per_cent
        else (1.0, "units of the score", 3)
    )
    table = explanation.by_band_and_axis()
    n_axes = len(explanation.columns.axes)
    strongest = _strongest(explanation)
    along = [part for part in explanation.blocks if part.contributions.any()]
    heights = [
        0.7 + 0.21 * (len(table) + 1),
        *([3.6] if strongest else []),
        *([0.75 + 0.3 * n_axes] if along else []),
    ]
    figure = new_figure(6.6, 0.5 + sum(heights))
    parts = iter(figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False).ravel())

    left, right = next(parts).subplots(1, 2, width_ratios=(3.2, 1.0))
    _draw_table(left, table, explanation, scale, digits)
    left.set_title(f"Bands and axes, {unit}", fontsize=9, color=INK)
    _draw_bars(right, {block: scale * total for block, total in explanation.by_block().items()}, digits)
    right.set_title("Blocks", fontsize=9, color=INK)
    if strongest:
        _draw_couplings(next(parts), explanation, strongest, scale, unit)
    if along:
        _draw_along(next(parts), along, scale, unit)
    return figure


def _strongest(explanation: BandExplanation) -> list[Band]:
    """Bands of the strongest couplings, then those whose couplings hold most; from the highest down."""
    columns = explanation.columns
    totals = {
        band: float(explanation.contributions[members].sum())
        for band in columns.bands
        if (members := columns.of(block="coupling", band=band.number)).size
    }
    named = [one.band for one in explanation.strongest_couplings() if one.band is not None]
    order = [*named, *sorted(totals, key=lambda band: -totals[band])]
    strongest = list(dict.fromkeys(order))[:_MATRICES]
    return sorted(strongest, key=lambda band: band.number)


def _draw_table(
    panel: Any, table: dict[str, dict[str, float]], explanation: BandExplanation, scale: float, digits: int
) -> None:
    """Draw a heat map with its numbers, and sums beside and below."""
    axes = explanation.columns.axes
    values = scale * np.array([[of_axis[axis] for axis in axes] for of_axis in table.values()])
    rows, across = values.shape
    limit = float(np.abs(values).max()) or 1.0
    panel.imshow(values, cmap=_COLOURS, vmin=-limit, vmax=limit, aspect="auto", interpolation="none")
    sums = [(across, row, total) for row, total in enumerate(values.sum(axis=1).tolist())]
    sums += [(column, rows, total) for column, total in enumerate(values.sum(axis=0).tolist())]
    sums.append((across, rows, float(values.sum())))
    inside = [(column, row, float(values[row, column])) for row in range(rows) for column in range(across)]
    for column, row, value in [*inside, *sums]:
        dark = column < across and row < rows and abs(value) > 0.6 * limit
        panel.text(
            column,
            row,
            number_text(value, digits if max(rows, across) < 14 else 0),
            ha="center",
            va="center",
            fontsize=7.5 if across < 8 else 5.5,
            color="white" if dark else INK,
            fontweight="normal" if column < across and row < rows else "bold",
        )
    panel.set_xlim(-0.5, across + 0.5)
    row_names(panel, [*(name.removeprefix("the ") for name in table), "sum"])
    panel.set_xticks(range(across + 1), [*map(pretty, axes), "sum"], rotation=_turned(axes))
    panel.tick_params(labelsize=8, colors=INK, length=0, top=False)
    for spine in panel.spines.values():
        spine.set_visible(False)


def _turned(axes: Sequence[str]) -> int:
    """Turn names that are no short symbols, where there are many."""
    return 90 if len(axes) > 3 and not set(axes) <= set(AXES) else 0


def _draw_bars(panel: Any, shares: dict[str, float], digits: int) -> None:
    share_bars(panel, shares, ["#0072B2"] * len(shares), digits)
    panel.margins(x=0.35)
    panel.set_xticks([])
    for side in ("left", "bottom"):
        panel.spines[side].set_visible(False)


def _draw_couplings(
    figure: Any, explanation: BandExplanation, bands: list[Band], scale: float, unit: str
) -> None:
    """Draw two matrices a band: both axes at one instant, and the second one earlier."""
    axes = explanation.columns.axes
    n = len(axes)
    matrices = np.full((2, len(bands), n, n), np.nan)
    for place, band in enumerate(bands):
        for (first, second, lag), total in explanation.by_pair(band.number).items():
            matrices[int(lag > 0), place, axes.index(first), axes.index(second)] = scale * total
    limit = float(np.nanmax(np.abs(matrices))) or 1.0
    panels = figure.subplots(2, len(bands), squeeze=False)
    earlier = max(key[2] for key in explanation.by_pair())
    for (row, place), panel in np.ndenumerate(panels):
        values, band = matrices[row, place], bands[place]
        image = panel.imshow(values, cmap=_COLOURS, vmin=-limit, vmax=limit, interpolation="none")
        for down, across in np.argwhere(values < -0.1 * limit).tolist():
            colour = "white" if values[down, across] < -0.6 * limit else INK
            panel.text(across, down, "\N{MINUS SIGN}", ha="center", va="center", fontsize=7, color=colour)
        panel.set_xticks(range(n), map(pretty, axes), rotation=_turned(axes))
        panel.set_yticks(range(n), map(pretty, axes) if place == 0 else [""] * n)
        panel.tick_params(labelsize=7.5 if n <= 8 else 5.5, colors=INK, length=0)
        for spine in panel.spines.values():
            spine.set_color(FAINT)
        if row == 0:
            panel.set_title(str(band).removeprefix("the "), fontsize=9, color=INK)
            panel.set_xlabel("at the same instant", fontsize=8, color=INK)
        else:
            panel.set_xlabel(f"columns {1e3 * earlier / band.rate_hz:.3g} ms earlier", fontsize=8, color=INK)
    bar = figure.colorbar(image, ax=panels, pad=0.02, aspect=30, shrink=0.9)
    bar.solids.set_rasterized(True)  # else a path for each of 256 colours
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=7.5, colors=INK, length=2)
    bar.set_label(unit, fontsize=8, color=INK)
    figure.suptitle("Couplings, in the bands of the strongest", fontsize=9, color=INK)


def _draw_along(figure: Any, parts: list[ExplainedBlock], scale: float, unit: str) -> None:
    """Draw one row of steps an axis: upward what speaks for the first material."""
    axes = parts[0].block.axes
    panels = figure.subplots(
        len(axes), len(parts), squeeze=False, sharex="col", width_ratios=[2.0, 1.0][: len(parts)]
    )
    for number, part in enumerate(parts):
        block, column = part.block, panels[:, number]
        edges = middles_to_edges(block.coordinates)
        largest = scale * float(np.abs(part.contributions).max()) or 1.0
        for place, (axis, panel) in enumerate(zip(axes, column, strict=True)):
            colour = axis_line(axis, place)["color"]
            panel.stairs(scale * part.contributions[place], edges, fill=True, color=colour)
            panel.axhline(0.0, color=FAINT, linewidth=0.6)
            panel.set_ylim(min(0.0, scale * float(part.contributions.min())), largest)
            quiet(panel)
            panel.set_yticks([])
            for side in ("left", "bottom"):
                panel.spines[side].set_visible(side == "bottom" and place == len(axes) - 1)
            panel.tick_params(bottom=place == len(axes) - 1, labelbottom=place == len(axes) - 1)
            if number == 0:
                panel.set_ylabel(pretty(axis), rotation=0, ha="right", va="center", fontsize=8.5, color=INK)
        if block.kind == "frequency" and edges[0] > 0:
            column[0].set_xscale("log")
            ticks = [tick for tick in TICKS if edges[0] <= tick <= edges[-1]]
            column[-1].set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            column[-1].minorticks_off()
        column[-1].set_xlim(edges[0], edges[-1])
        column[0].set_title(
            f"{block.name.capitalize()}: tallest {largest:.2g} {'%' if unit.startswith('%') else unit}",
            fontsize=9,
            color=INK,
        )
        column[-1].set_xlabel(f"{block.kind}, {block.unit}", fontsize=8, color=INK)

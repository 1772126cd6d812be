"""Figures of what decides between two materials."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._core import AXES
from granular_id._text import short
from granular_id.evaluation import window_starts
from granular_id.plotting.style import (
    FAINT,
    INK,
    axis_line,
    colour_bar,
    curve_panel,
    heading,
    legend,
    log_axis,
    middles_to_edges,
    name_row,
    new_figure,
    note,
    number_text,
    pretty,
    quiet,
    row_names,
    save,
    with_unit,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.explanation import BandExplanation, ExplainedBlock, Explanation
# Orange against purple: told apart with any colour vision. In a grey print signs and numbers tell.
_COLOURS = "PuOr_r"
# Single samples jitter; sums over windows show where a difference is made, and still sum to all of it.
_WINDOWS = 80


def plot_explanation(
    explanation: Explanation, *, title: str | None = None, path: str | os.PathLike[str] | None = None
) -> Figure:
    """Plot which instants, bins, frequencies or bands of which axes decide between two materials.

    Parameters
    ----------
    explanation : granular_id.explanation.Explanation
    title : str, optional
        First line of the heading, for instance "SYNTHETIC recordings".
    path : path-like, optional
        As in `granular_id.plotting.plot_mean_forces`.

    Returns
    -------
    matplotlib.figure.Figure
        One row a block of features. Curves: contributions to the difference of the mean scores, above zero what
        speaks for the first material; of more than 80 instants or frequencies, sums over 80 windows. Bins and
        frequencies beyond which nothing reaches 1 % of the largest are not shown. Bars: share of each axis in
        the difference; all bars of the figure sum to 100 %. Where the model does not score the first
        material above the second, bars are in units of the score.

        Of the multi-band space: a table of bands and axes as a heat map, which with its sums is all of the
        difference; the share of each block; coupling matrices of the three bands in which they say most, orange
        what speaks for the first material, purple and a minus what speaks against; contributions over
        frequency and, where the level counts, over time.

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
    >>> [panel.get_title() for panel in plot_explanation(seen, title="SYNTHETIC recordings").axes[::2]]
    ['raw', 'hfmh']
    """
    from granular_id.explanation import BandExplanation  # it knows no figures, and loads much

    figure = (
        _draw_bands(explanation) if isinstance(explanation, BandExplanation) else _draw_blocks(explanation)
    )
    first, second = (short(str(label)) for label in (explanation.first, explanation.second))
    above = "" if title is None else f"{title}\n"
    scores = " and ".join(f"{score:+.2g}".replace("-", "\N{MINUS SIGN}") for score in explanation.scores)
    heading(figure, f"{above}What tells {first} from {second}: mean scores {scores}")
    save(figure, path)
    return figure


def _draw_blocks(explanation: Explanation) -> Figure:
    """Draw one row a block: curves and bars."""
    groups: dict[str, list[ExplainedBlock]] = {}
    for part in explanation.blocks:
        groups.setdefault(part.group, []).append(part)
    by_axis = explanation.by_block_and_axis()
    scale, unit, digits = _units(explanation)
    figure = new_figure(8.4, 1.1 + 2.3 * len(groups))
    panels = figure.subplots(len(groups), 2, width_ratios=(3.0, 1.0), squeeze=False)
    handles: dict[str, Any] = {}
    for (name, parts), (wide, narrow) in zip(groups.items(), panels, strict=True):
        handles |= _draw_curves(wide, parts)
        heading(wide, name, 10)
        _draw_axis_shares(narrow, {axis: scale * value for axis, value in by_axis[name].items()}, digits)
        narrow.set_xlabel(unit, fontsize=8, color=INK)
    low = min(0.0, *(panel.get_xlim()[0] for panel in panels[:, 1]))
    high = max(0.0, *(panel.get_xlim()[1] for panel in panels[:, 1]))
    for panel in panels[:, 1]:
        panel.set_xlim(low, high)
    names = [pretty(axis) for axis in handles]
    legend(figure, "lower left", size=9, handles=list(handles.values()), labels=names, ncols=len(names))
    return figure


def _units(explanation: Explanation) -> tuple[float, str, int]:
    """Return what contributions are multiplied with, their unit and their digits; no share of nothing."""
    if explanation.difference > 0:
        return 100.0 / explanation.difference, "% of the difference", 1
    return 1.0, "units of the score", 3


def _draw_curves(panel: Any, parts: list[ExplainedBlock]) -> dict[str, Any]:
    """Draw the contributions of each axis, and return the line of each."""
    block = parts[0].block
    lines: dict[str, Any] = {}
    reach = 0.0
    for part in parts:
        coordinates, contributions = part.block.coordinates, part.contributions
        if block.kind == "frequency":  # high ones tend to say nothing
            shown = coordinates <= _used(coordinates, contributions)
            coordinates, contributions = coordinates[shown], contributions[:, shown]
        if block.kind != "magnitude" and len(coordinates) > _WINDOWS:
            starts = window_starts(len(coordinates), _WINDOWS)
            contributions = np.add.reduceat(contributions, starts, axis=1)
            coordinates = np.add.reduceat(coordinates, starts) / np.diff(starts, append=len(coordinates))
        if len(parts) > 1:  # each axis has a range of its own
            coordinates = coordinates / (np.abs(coordinates).max() or 1.0)
        reach = max(reach, _used(coordinates, contributions))
        for axis, values in zip(part.block.axes, contributions, strict=True):
            style = {"linewidth": 1.1, "drawstyle": "steps-mid"}
            (lines[axis],) = panel.plot(coordinates, values, **axis_line(axis, len(lines)), **style)
    curve_panel(panel)
    if block.kind == "magnitude" and reach > 0:  # most bins of a wide range stay empty
        panel.set_xlim(max(panel.get_xlim()[0], -reach), min(panel.get_xlim()[1], reach))
    panel.set_ylabel("contribution", fontsize=8, color=INK)
    panel.set_xlabel(_coordinate(block.kind, block.unit, own_range=len(parts) > 1), fontsize=8, color=INK)
    return lines


def _draw_shares(panel: Any, shares: Mapping[str, float], colours: Sequence[str], digits: int) -> None:
    """Draw a horizontal bar for each share, with its name and its number in `digits` digits."""
    for row, (share, colour) in enumerate(zip(shares.values(), colours, strict=True)):
        panel.barh(row, share, 0.7, color=colour, linewidth=0)
        note(panel, number_text(share, digits), (max(share, 0.0), row), (3, 0), va="center", fontsize=7.5)
    panel.axvline(0.0, color=FAINT, linewidth=0.8, zorder=0)
    row_names(panel, list(shares))
    quiet(panel)


def _draw_axis_shares(panel: Any, shares: dict[str, float], digits: int) -> None:
    _draw_shares(
        panel, shares, [axis_line(axis, place)["color"] for place, axis in enumerate(shares)], digits
    )
    panel.margins(x=0.2)
    panel.spines["left"].set_visible(False)


def _used(coordinates: NDArray[np.float64], contributions: NDArray[np.float64]) -> float:
    """Return how far from zero bins contribute anything to speak of."""
    size = np.abs(contributions).max(axis=0)
    used = size >= 1e-2 * size.max()
    return 1.1 * float(np.abs(coordinates[used]).max())


def _coordinate(kind: str, unit: str, *, own_range: bool) -> str:
    if own_range:
        return "bin, share of the range of its axis"
    what = {"time": "time", "magnitude": "bin", "frequency": "frequency"}.get(kind, kind)
    return with_unit(what, unit)


def _draw_bands(explanation: BandExplanation) -> Figure:
    """Draw a table of bands and axes, the couplings of the strongest bands, and spectrum and level."""
    from granular_id.explanation import coupled_bands  # it loads much

    scale, unit, digits = _units(explanation)
    table = explanation.by_band_and_axis()
    n_axes = len(explanation.columns.axes)
    strongest = coupled_bands(explanation)
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
    heading(left, f"Bands and axes, {unit}", 9)
    _draw_block_shares(
        right, {block: scale * total for block, total in explanation.by_block().items()}, digits
    )
    heading(right, "Blocks", 9)
    if strongest:
        _draw_couplings(next(parts), explanation, strongest, scale, unit)
    if along:
        _draw_along(next(parts), along, scale, unit)
    return figure


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
    panel.spines[:].set_visible(False)


def _turned(axes: Sequence[str]) -> int:
    """Turn names that are no short symbols, where there are many."""
    return 90 if len(axes) > 3 and not set(axes) <= set(AXES) else 0


def _draw_block_shares(panel: Any, shares: dict[str, float], digits: int) -> None:
    _draw_shares(panel, shares, ["#0072B2"] * len(shares), digits)
    panel.margins(x=0.35)
    panel.set_xticks([])
    panel.spines[:].set_visible(False)


def _draw_couplings(
    figure: Any, explanation: BandExplanation, bands: list[int], scale: float, unit: str
) -> None:
    """Draw two matrices a band: both axes at one instant, and the second one earlier."""
    axes = explanation.columns.axes
    n = len(axes)
    matrices = np.full((2, len(bands), n, n), np.nan)
    for place, number in enumerate(bands):
        for (first, second, lag), total in explanation.by_pair(number).items():
            matrices[int(lag > 0), place, axes.index(first), axes.index(second)] = scale * total
    limit = float(np.nanmax(np.abs(matrices))) or 1.0
    panels = figure.subplots(2, len(bands), squeeze=False)
    for (row, place), panel in np.ndenumerate(panels):
        values, band = matrices[row, place], explanation.columns.bands[bands[place]]
        image = panel.imshow(values, cmap=_COLOURS, vmin=-limit, vmax=limit, interpolation="none")
        for down, across in np.argwhere(values < -0.1 * limit).tolist():
            colour = "white" if values[down, across] < -0.6 * limit else INK
            panel.text(across, down, "\N{MINUS SIGN}", ha="center", va="center", fontsize=7, color=colour)
        panel.set_xticks(range(n), map(pretty, axes), rotation=_turned(axes))
        panel.set_yticks(range(n), map(pretty, axes) if place == 0 else [""] * n)
        panel.tick_params(labelsize=7.5 if n <= 8 else 5.5, colors=INK, length=0)
        panel.spines[:].set_color(FAINT)
        if row == 0:
            panel.set_title(str(band).removeprefix("the "), fontsize=9, color=INK)
            panel.set_xlabel("at the same instant", fontsize=8, color=INK)
        else:
            earlier = max(key[2] for key in explanation.by_pair(bands[place]))
            panel.set_xlabel(f"columns {1e3 * earlier / band.rate_hz:.3g} ms earlier", fontsize=8, color=INK)
    colour_bar(figure, image, panels, unit, aspect=30, shrink=0.9)
    heading(figure, "Couplings, in the bands of the strongest", 9)


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
            last = place == len(axes) - 1
            quiet(panel, "left", *(() if last else ("bottom",)))
            panel.set_yticks([])
            panel.tick_params(bottom=last, labelbottom=last)
            if number == 0:
                name_row(panel, pretty(axis))
        if block.kind == "frequency" and edges[0] > 0:
            log_axis(column[-1], edges[0], edges[-1])
        column[-1].set_xlim(edges[0], edges[-1])
        tallest = f"{largest:.2g} {'%' if unit.startswith('%') else unit}"
        heading(column[0], f"{block.name.capitalize()}: tallest {tallest}", 9)
        column[-1].set_xlabel(with_unit(block.kind, block.unit), fontsize=8, color=INK)

"""What decides between two materials: contributions over time, bins and frequencies, and share of each axis."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id.evaluation.thinning import window_starts
from granular_id.plotting.band_explanation import draw_band_explanation
from granular_id.plotting.style import (
    FAINT,
    INK,
    axis_line,
    new_figure,
    pretty,
    quiet,
    save,
    share_bars,
    short,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.explanation import ExplainedBlock, Explanation

__all__ = ["plot_explanation"]

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
    >>> from granular_id.explanation import explain
    >>> from granular_id.plotting import plot_explanation
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=3)
    >>> model = make_pipeline(RawHFMH(), ECOCClassifier()).fit(data.X, data.y)
    >>> seen = explain(model, "rice", "fine sugar", data.X, data.y)
    >>> [panel.get_title() for panel in plot_explanation(seen, title="SYNTHETIC recordings").axes[::2]]
    ['raw', 'hfmh']
    """
    from granular_id.explanation import BandExplanation  # noqa: PLC0415 (it knows no figures, and loads much)

    figure = (
        draw_band_explanation(explanation)
        if isinstance(explanation, BandExplanation)
        else _drawn(explanation)
    )
    first, second = (short(str(label)) for label in (explanation.first, explanation.second))
    heading = "" if title is None else f"{title}\n"
    scores = " and ".join(f"{score:+.2g}".replace("-", "\N{MINUS SIGN}") for score in explanation.scores)
    figure.suptitle(
        f"{heading}What tells {first} from {second}: mean scores {scores}",
        fontsize=11,
        color=INK,
        parse_math=False,
    )
    save(figure, path)
    return figure


def _drawn(explanation: Explanation) -> Figure:
    """Draw one row a block: curves and bars."""
    groups: dict[str, list[ExplainedBlock]] = {}
    for part in explanation.blocks:
        groups.setdefault(part.group, []).append(part)
    by_axis = explanation.by_block_and_axis()
    scale, unit, digits = (
        (100.0 / explanation.difference, "% of the difference", 1)
        if explanation.difference > 0
        else (1.0, "units of the score", 3)
    )
    figure = new_figure(8.4, 1.1 + 2.3 * len(groups))
    panels = figure.subplots(len(groups), 2, width_ratios=(3.0, 1.0), squeeze=False)
    handles: dict[str, Any] = {}
    for (name, parts), (wide, narrow) in zip(groups.items(), panels, strict=True):
        handles |= _draw_curves(wide, parts)
        wide.set_title(name, fontsize=10, color=INK, parse_math=False)
        _draw_bars(narrow, {axis: scale * value for axis, value in by_axis[name].items()}, digits)
        narrow.set_xlabel(unit, fontsize=8, color=INK)
    low = min(0.0, *(panel.get_xlim()[0] for panel in panels[:, 1]))
    high = max(0.0, *(panel.get_xlim()[1] for panel in panels[:, 1]))
    for panel in panels[:, 1]:
        panel.set_xlim(low, high)
    figure.legend(
        handles=list(handles.values()),
        labels=[pretty(axis) for axis in handles],
        loc="outside lower left",
        ncols=len(handles),
        frameon=False,
        fontsize=9,
    )
    return figure


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
    panel.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
    panel.margins(x=0)
    if block.kind == "magnitude" and reach > 0:  # most bins of a wide range stay empty
        panel.set_xlim(max(panel.get_xlim()[0], -reach), min(panel.get_xlim()[1], reach))
    quiet(panel)
    panel.set_ylabel("contribution", fontsize=8, color=INK)
    panel.set_xlabel(_coordinate(block.kind, block.unit, own_range=len(parts) > 1), fontsize=8, color=INK)
    return lines


def _draw_bars(panel: Any, shares: dict[str, float], digits: int) -> None:
    share_bars(panel, shares, [axis_line(axis, place)["color"] for place, axis in enumerate(shares)], digits)
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
    return f"{what}, {unit.replace(', ', ' or ')}" if unit else what

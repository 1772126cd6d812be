"""Single recordings over time, one panel a material: what the sensor saw, as it was stored."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._core import AXES
from granular_id.plotting.style import (
    FAINT,
    INK,
    axis_line,
    evenly,
    material_panels,
    pretty,
    quiet,
    save,
    short,
)
from granular_id.recording import Dataset, Recording
from granular_id.recording._values import checked_index
from granular_id.recording.axes import unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot_recordings"]

_FLAG_COLOUR = "#CC3311"
_NO_LABEL = "no label"


def plot_recordings(
    dataset: Dataset,
    path: str | os.PathLike[str] | None = None,
    *,
    axes: Sequence[str] | None = None,
    n: int = 5,
) -> Figure:
    """Plot some recordings of each material over time, as they are: of any length and rate, also irregular.

    Parameters
    ----------
    dataset : Dataset
        Need not be resampled or aligned.
    path : path-like, optional
        Where to save; the ending chooses the format (png, svg, pdf). Whole or not at all.
    axes : sequence of str, optional
        Axes to draw, all of one unit; the forces by default, or all where recordings have other axes.
    n : int, default 5
        Recordings per material, spread evenly over the material's recordings.

    Returns
    -------
    matplotlib.figure.Figure
        One panel a material, in the order in which they first appear. Red marks at the foot of a panel stand where
        a sample carries a flag (filled gap, saturation, bad status, repaired time). Triggers are small triangles.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    TypeError, ValueError
        An axis that recordings do not have, or axes of different units; `n` below 1.

    Examples
    --------
    >>> from granular_id.plotting import plot_recordings
    >>> from granular_id.synthetic import synthesize
    >>> figure = plot_recordings(synthesize(["rice", "fine sugar"], n_per_class=3))
    >>> [panel.get_title() for panel in figure.axes]
    ['rice (3 of 3)', 'fine sugar (3 of 3)']
    """
    if checked_index(n, "n") < 1:
        raise ValueError(f"n must be at least 1, got {n}")
    wanted, unit = _chosen(dataset, axes)
    groups: dict[str, list[Recording]] = {}
    for recording in dataset:
        groups.setdefault(recording.label or _NO_LABEL, []).append(recording)
    figure, panels = material_panels(len(groups))
    handles: list[Any] = []
    for (label, group), panel in zip(groups.items(), panels, strict=True):
        shown = [group[i] for i in evenly(len(group), n)]
        handles = _draw(panel, shown, wanted)
        title = f"{short(label)} ({len(shown)} of {len(group)})"
        panel.set_title(title, fontsize=10, color=INK, parse_math=False)
    synthetic = dataset.is_synthetic
    figure.supxlabel("time from the first sample, s", fontsize=10, color=INK)
    figure.supylabel(unit, fontsize=10, color=INK)
    title = "Synthetic recordings as they are stored" if synthetic else "Recordings as they are stored"
    figure.suptitle(title, fontsize=11, color=INK)
    figure.legend(handles=handles, loc="outside lower right", ncols=len(handles), frameon=False, fontsize=9)
    save(figure, path)
    return figure


def _chosen(dataset: Dataset, axes: Sequence[str] | None) -> tuple[tuple[str, ...], str]:
    """Return the axes to draw and their unit."""
    have = dataset.axes
    if axes is None:
        axes = AXES[:3] if have == AXES else have
    wanted = (axes,) if isinstance(axes, str) else tuple(axes)
    unknown = [axis for axis in wanted if axis not in have]
    if unknown or not wanted or len(set(wanted)) < len(wanted):
        raise ValueError(f"axes={list(wanted)!r}; wanted some of {', '.join(have)}, each once")
    units = {unit_of(axis, dataset[0].meta) for axis in wanted}
    if len(units) > 1:
        raise ValueError(f"axes mixes units ({', '.join(sorted(units))}), got {', '.join(wanted)}")
    return wanted, units.pop()


def _draw(panel: Any, recordings: Sequence[Recording], axes: Sequence[str]) -> list[Any]:
    """Draw the recordings of one material; return one line per axis for a legend."""
    first_lines: list[Any] = []
    for recording in recordings:
        time_s = recording.times()
        for k, axis in enumerate(axes):
            style = {**axis_line(axis, k), "linewidth": 0.7, "alpha": 0.7}
            column = recording.wrench[:, recording.axes.index(axis)]
            lines = panel.plot(time_s, column, label=pretty(axis), **style)
            if len(first_lines) < len(axes):
                first_lines += lines
        if recording.flags is not None:
            at = time_s[recording.flags > 0]
            foot = panel.get_xaxis_transform()
            panel.plot(at, np.full(len(at), 0.02), "|", color=_FLAG_COLOUR, markersize=4, transform=foot)
        if recording.trigger_index is not None:
            top = panel.get_xaxis_transform()
            panel.plot(time_s[recording.trigger_index], 0.98, "v", color=INK, markersize=3, transform=top)
    panel.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
    panel.margins(x=0)
    quiet(panel)
    return first_lines

"""Mean and spread of the forces over time, one panel a material: the paper's figure."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id._core import AXES, UNITS
from granular_id.plotting.style import AXIS_COLOURS, AXIS_DASHES, FAINT, INK, new_figure, quiet, save
from granular_id.recording import Dataset

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot_mean_forces"]


def plot_mean_forces(
    dataset: Dataset, *, axes: Sequence[str] = ("fx", "fz"), path: str | os.PathLike[str] | None = None
) -> Figure:
    """Plot the mean and spread over time of each material, one panel a material.

    Parameters
    ----------
    dataset : Dataset
        Recordings of equal length and rate, with labels.
    axes : sequence of str, default ("fx", "fz")
        Which of fx fy fz (N) or of tx ty tz (N m); not both kinds, their units differ.
    path : path-like, optional
        Where to save; the ending chooses the format (png, svg, pdf). Written under a temporary name and
        renamed, so that a reader never sees half a file.

    Returns
    -------
    matplotlib.figure.Figure
        Lines are means over the recordings, bands one standard deviation to either side. All panels share
        their scales. The title says "synthetic" when recordings are.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For unknown, repeated or mixed axes, recordings of unequal length or without labels.

    Examples
    --------
    >>> from granular_id.plotting import plot_mean_forces
    >>> from granular_id.synthetic import synthesize
    >>> figure = plot_mean_forces(synthesize(["rice", "fine sugar"], n_per_class=3))
    >>> [panel.get_title() for panel in figure.axes]
    ['rice', 'fine sugar']
    """
    columns, unit = _chosen_axes(axes)
    X, y = dataset.X, dataset.y
    time_s = np.arange(X.shape[1]) / dataset.rate_hz
    # In the order in which materials first appear: the user's own order, not the alphabet's.
    labels = list(dict.fromkeys(y.tolist()))

    n_columns = min(4, len(labels))
    n_rows = math.ceil(len(labels) / n_columns)
    figure = new_figure(1.2 + 2.5 * n_columns, 1.4 + 1.9 * n_rows)
    panels = figure.subplots(n_rows, n_columns, sharex=True, sharey=True, squeeze=False).ravel()
    handles: list[Any] = []
    for label, panel in zip(labels, panels, strict=False):
        recordings = X[y == label]
        handles = []
        for axis, column in columns.items():
            colour, dash = AXIS_COLOURS[column], AXIS_DASHES[column]
            mean, spread = recordings[:, :, column].mean(axis=0), recordings[:, :, column].std(axis=0)
            panel.fill_between(time_s, mean - spread, mean + spread, color=colour, alpha=0.25, linewidth=0)
            style = {"color": colour, "linestyle": dash, "linewidth": 1.3}
            (line,) = panel.plot(time_s, mean, label=_pretty(axis), **style)
            handles.append(line)
        panel.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        panel.set_title(label, fontsize=10, color=INK)
        panel.margins(x=0)
        quiet(panel)
    for unused in panels[len(labels) :]:
        unused.remove()
    # The lowest panel of each column carries the time axis, also where the last row is not full.
    for index, panel in enumerate(panels[: len(labels)]):
        panel.tick_params(labelbottom=index + n_columns >= len(labels))
    quantity = "force" if unit == "N" else "torque"
    figure.supxlabel("time, s", fontsize=10, color=INK)
    figure.supylabel(f"{quantity}, {unit}", fontsize=10, color=INK)
    figure.suptitle(_title(dataset, quantity), fontsize=11, color=INK)
    figure.legend(handles=handles, loc="outside lower right", ncols=len(handles), frameon=False, fontsize=9)
    save(figure, path)
    return figure


def _chosen_axes(axes: Sequence[str]) -> tuple[dict[str, int], str]:
    wanted = [axes] if isinstance(axes, str) else list(axes)
    unknown = [axis for axis in wanted if axis not in AXES]
    if unknown or not wanted:
        what = f"{unknown[0]!r}" if unknown else "nothing"
        raise ValueError(f"axes must name some of {', '.join(AXES)}, got {what}")
    if len(set(wanted)) < len(wanted):
        raise ValueError(f"axes names an axis twice: {', '.join(wanted)}")
    columns = {axis: AXES.index(axis) for axis in wanted}
    units = {UNITS[column] for column in columns.values()}
    if len(units) > 1:
        raise ValueError(f"axes mixes forces (N) and torques (N m), got {', '.join(wanted)}")
    return columns, units.pop()


def _title(dataset: Dataset, quantity: str) -> str:
    synthetic = sum(bool(recording.meta.get("synthetic")) for recording in dataset)
    if synthetic == 0:
        kind = ""
    elif synthetic == len(dataset):
        kind = "Synthetic recordings: "
    else:
        kind = f"{synthetic} of {len(dataset)} recordings synthetic: "
    text = f"{kind}{quantity} per material, mean \N{PLUS-MINUS SIGN} standard deviation"
    return text[0].upper() + text[1:]


def _pretty(axis: str) -> str:
    return f"${axis[0].upper()}_{axis[1]}$"

"""Mean and spread of the forces over time, one panel a material: the paper's figure."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._core import AXES, UNITS
from granular_id.plotting.style import (
    AXIS_DASHES,
    FAINT,
    INK,
    axis_line,
    material_panels,
    pretty,
    quiet,
    save,
    short,
)
from granular_id.recording import Dataset

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation.portrait import Portrait

__all__ = ["AXIS_LINES", "Curves", "curves_in", "draw_mean_forces", "plot_mean_forces"]


def plot_mean_forces(
    dataset: Dataset | Portrait,
    *,
    axes: Sequence[str] = ("fx", "fz"),
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """Plot the mean and spread over time of each material, one panel a material.

    Parameters
    ----------
    dataset : Dataset or granular_id.evaluation.portrait.Portrait
        Recordings of equal length and rate, with labels; or ``result.portrait``, which keeps their curves.
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
    curves = curves_of(dataset, columns) if isinstance(dataset, Dataset) else curves_in(dataset, columns)
    figure, panels = material_panels(len(curves))
    for curve, panel in zip(curves, panels, strict=True):
        handles = draw_mean_forces(panel, curve)
    quantity = "force" if unit == "N" else "torque"
    figure.supxlabel("time, s", fontsize=10, color=INK)
    figure.supylabel(f"{quantity}, {unit}", fontsize=10, color=INK)
    figure.suptitle(_title(dataset, quantity), fontsize=11, color=INK)
    figure.legend(handles=handles, loc="outside lower right", ncols=len(handles), frameon=False, fontsize=9)
    save(figure, path)
    return figure


AXIS_LINES = tuple(
    (axis, axis[1], AXES.index(axis), {"-": "", "--": "6 4", ":": "2 3"}[AXIS_DASHES[AXES.index(axis)]])
    for axis in ("fx", "fz")
)
"""The lines of the default axes for a legend outside a figure: name, index, colour number, dashes of SVG."""


class Curves(NamedTuple):
    """Mean and standard deviation over time of one material, per axis name."""

    label: str
    time_s: NDArray[np.float64]
    mean: dict[str, NDArray[np.float64]]
    sd: dict[str, NDArray[np.float64]]


def curves_of(dataset: Dataset, columns: Mapping[str, int]) -> list[Curves]:
    """Compute the curves of recordings, in the order in which materials first appear: the user's own."""
    X, y = dataset.X, dataset.y
    time_s = np.arange(X.shape[1]) / dataset.rate_hz
    curves = []
    for label in dict.fromkeys(y.tolist()):
        own = X[y == label]
        mean = {axis: own[:, :, column].mean(axis=0) for axis, column in columns.items()}
        sd = {axis: own[:, :, column].std(axis=0) for axis, column in columns.items()}
        curves.append(Curves(label, time_s, mean, sd))
    return curves


def curves_in(portrait: Portrait, columns: Mapping[str, int]) -> list[Curves]:
    """Take the curves from a portrait, in the order of its labels."""
    return [
        Curves(
            label,
            portrait.time_s,
            {axis: portrait.mean[k, column] for axis, column in columns.items()},
            {axis: portrait.sd[k, column] for axis, column in columns.items()},
        )
        for k, label in enumerate(portrait.labels)
    ]


def draw_mean_forces(panel: Any, curves: Curves) -> list[Any]:
    """Draw one material; return the lines for a legend."""
    lines = []
    for axis, mean in curves.mean.items():
        style = {**axis_line(axis), "linewidth": 1.3}
        low, high = mean - curves.sd[axis], mean + curves.sd[axis]
        panel.fill_between(curves.time_s, low, high, color=style["color"], alpha=0.25, linewidth=0)
        lines += panel.plot(curves.time_s, mean, label=pretty(axis), **style)
    panel.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
    # A label with $ in it is a label, no mathematics.
    panel.set_title(short(curves.label), fontsize=10, color=INK, parse_math=False)
    panel.margins(x=0)
    quiet(panel)
    return lines


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


def _title(dataset: Dataset | Portrait, quantity: str) -> str:
    if isinstance(dataset, Dataset):
        synthetic = sum(recording.is_synthetic for recording in dataset)
        total = len(dataset)
    else:
        synthetic, total = dataset.n_synthetic, sum(dataset.counts)
    if synthetic == 0:
        kind = ""
    elif synthetic == total:
        kind = "Synthetic recordings: "
    else:
        kind = f"{synthetic} of {total} recordings synthetic: "
    text = f"{kind}{quantity} per material, mean \N{PLUS-MINUS SIGN} standard deviation"
    return text[0].upper() + text[1:]

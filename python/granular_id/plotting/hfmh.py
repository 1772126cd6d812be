"""Mean high-frequency magnitude histograms, per material and axis."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from granular_id.plotting.heat import axis_unit, draw_heat, plot_six, shared_limits
from granular_id.plotting.residual import high_pass_of
from granular_id.plotting.style import INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation.portrait import Portrait

__all__ = ["draw_hfmh", "plot_hfmh"]


def plot_hfmh(portrait: Portrait, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot the mean histogram of the high-passed signal, one panel an axis, one row a material.

    Parameters
    ----------
    portrait : granular_id.evaluation.portrait.Portrait
        For instance ``result.portrait``.
    path : path-like, optional
        As in `granular_id.plotting.plot_mean_forces`.

    Returns
    -------
    matplotlib.figure.Figure
        Colours on a log scale. Axes of one unit and the same bins share colours and bins, so that one that says
        nothing looks like it; bins that stay empty on all of them, in all materials, are cut off at both ends.

    Raises
    ------
    ImportError
        Without matplotlib, saying what to install.
    ValueError
        For a portrait without high-pass: the sampling rate was too low for the cut-off.

    Examples
    --------
    >>> from granular_id import RawHFMH, synthesize
    >>> from granular_id.evaluation.portrait import portrait
    >>> seen = portrait(synthesize(["rice", "fine sugar"], n_per_class=3), {"raw+hfmh": RawHFMH()})
    >>> figure = plot_hfmh(seen)
    >>> [panel.get_xlabel() for panel in figure.axes if panel.get_title()][3:]
    ['bin, N m', 'bin, N m', 'bin, N m']
    """
    part = high_pass_of(portrait)
    synthetic = "synthetic recordings, " if portrait.n_synthetic else ""
    title = f"Histograms of the signal above {part.settings['cutoff_hz']:g} Hz: {synthetic}mean of a material"
    return plot_six(
        lambda panel, axis: draw_hfmh(panel, portrait, axis), portrait.axes, len(portrait.labels), title, path
    )


def draw_hfmh(panel: Any, portrait: Portrait, axis: int) -> None:
    """Draw the heat map of one axis, by its number."""
    part = high_pass_of(portrait)
    values, (low, high) = part.hfmh[:, axis], part.bin_range[axis].tolist()
    unit = axis_unit(portrait.axes[axis])
    alike = [
        other
        for other, name in enumerate(portrait.axes)
        if axis_unit(name) == unit and part.bin_range[other].tolist() == [low, high]
    ]
    edges = np.linspace(low, high, values.shape[1] + 1)
    used = np.flatnonzero(part.hfmh[:, alike].any(axis=(0, 1)))
    first, last = (int(used[0]), int(used[-1]) + 1) if used.size else (0, values.shape[1])
    draw_heat(
        panel,
        values[:, first:last],
        across=(float(edges[first]), float(edges[last])),
        labels=portrait.labels,
        limits=shared_limits(part.hfmh[:, alike]),
        key="density" if part.settings.get("density") else "samples in a bin",
    )
    panel.locator_params(axis="x", nbins=5)
    panel.set_xlabel(f"bin, {unit}", fontsize=8, color=INK)

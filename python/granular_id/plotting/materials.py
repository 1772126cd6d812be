"""Figures of materials: their mean forces, histograms and what lies above the cut-off."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._text import short
from granular_id.evaluation import most_different
from granular_id.plotting.recordings import chosen_axes
from granular_id.plotting.style import (
    INK,
    axis_line,
    curve_panel,
    heading,
    legend_of_axes,
    material_panels,
    new_figure,
    pretty,
    quantity_of,
    row_names,
    save,
    with_unit,
)
from granular_id.recording import Dataset, common_units

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_id.evaluation import ReportData
_MOST_MEANS = 2  # with their bands


def plot_mean_forces(
    dataset: Dataset | ReportData,
    *,
    axes: Sequence[str] | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """Plot the mean and spread over time of each material, one panel a material.

    Parameters
    ----------
    dataset : Dataset or ReportData
        Recordings of equal length and rate, with labels; or ``result.report_data``, which keeps their curves.
    axes : sequence of str, optional
        Axes to draw, all of one unit. Default: fx and fz of a wrench; of other axes two of one unit, the one in which
        the materials differ most over their own spread, and the next of its unit.
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
    >>> from granular_id import synthesize
    >>> figure = plot_mean_forces(synthesize(["rice", "fine sugar"], n_per_class=3))
    >>> [panel.get_title() for panel in figure.axes]
    ['rice', 'fine sugar']
    """
    units = common_units(dataset) if isinstance(dataset, Dataset) else dataset.units
    unit = None if axes is None else chosen_axes(axes, dataset.axes, units)[1]
    curves = curves_in(dataset, dataset.axes if axes is None else axes)
    if unit is None:
        curves, unit = telling_curves(curves, dict(zip(dataset.axes, units, strict=True)))
    figure, panels = material_panels(len(curves))
    for curve, panel in zip(curves, panels, strict=True):
        handles = draw_mean_forces(panel, curve)
    quantity = quantity_of(curves[0].mean, unit)
    figure.supxlabel("time, s", fontsize=10, color=INK)
    figure.supylabel(quantity, fontsize=10, color=INK)
    heading(figure, _title(dataset, quantity.partition(",")[0]))
    legend_of_axes(figure, handles)
    save(figure, path)
    return figure


class Curves(NamedTuple):
    """Mean and standard deviation over time of one material, per axis name."""

    label: str
    time_s: NDArray[np.float64]
    mean: dict[str, NDArray[np.float64]]
    sd: dict[str, NDArray[np.float64]]


def curves_in(data: Dataset | ReportData, axes: Sequence[str]) -> list[Curves]:
    """Return the curves of each material: of recordings in the order in which materials first appear."""
    columns = [data.axes.index(axis) for axis in axes]
    if isinstance(data, Dataset):
        X, y = data.X[:, :, columns], data.y
        labels, time_s = tuple(dict.fromkeys(y.tolist())), np.arange(X.shape[1]) / data.rate_hz
        mean, sd = (
            np.array([spread(X[y == one], axis=0).T for one in labels]) for spread in (np.mean, np.std)
        )
    else:
        labels, time_s, mean, sd = data.labels, data.time_s, data.mean[:, columns], data.sd[:, columns]
    return [
        Curves(label, time_s, dict(zip(axes, means, strict=True)), dict(zip(axes, spreads, strict=True)))
        for label, means, spreads in zip(labels, mean, sd, strict=True)
    ]


def telling_curves(curves: Sequence[Curves], units: Mapping[str, str]) -> tuple[list[Curves], str]:
    """Keep the curves of the axes that are drawn by default, and return the unit that they share."""
    names = list(curves[0].mean)
    chosen = ["fx", "fz"]
    if not set(chosen) <= set(names):
        mean = np.array([[curve.mean[axis] for axis in names] for curve in curves])
        sd = np.array([[curve.sd[axis] for axis in names] for curve in curves])
        ranked = [names[place] for place in most_different(mean, sd)]
        chosen = [axis for axis in ranked if units[axis] == units[ranked[0]]][:_MOST_MEANS]
    shown = [axis for axis in names if axis in chosen]
    own = [
        Curves(one.label, one.time_s, {a: one.mean[a] for a in shown}, {a: one.sd[a] for a in shown})
        for one in curves
    ]
    return own, units[shown[0]]


def draw_mean_forces(panel: Any, curves: Curves) -> list[Any]:
    """Draw one material; return the lines for a legend."""
    lines = []
    for place, (axis, mean) in enumerate(curves.mean.items()):
        style = {**axis_line(axis, place), "linewidth": 1.3}
        low, high = mean - curves.sd[axis], mean + curves.sd[axis]
        panel.fill_between(curves.time_s, low, high, color=style["color"], alpha=0.25, linewidth=0)
        lines += panel.plot(curves.time_s, mean, label=pretty(axis), **style)
    curve_panel(panel)
    heading(panel, short(curves.label), 10)
    return lines


def _title(dataset: Dataset | ReportData, quantity: str) -> str:
    if isinstance(dataset, Dataset):
        synthetic = sum(recording.is_synthetic for recording in dataset)
        total = len(dataset)
    else:
        synthetic, total = dataset.n_synthetic, sum(dataset.counts)
    some = f"{synthetic} of {total} recordings synthetic: "
    kind = {0: "", total: "Synthetic recordings: "}.get(synthetic, some)
    if not kind and quantity in ("force", "torque", "signal"):  # names of axes stay as they are
        quantity = quantity.capitalize()
    return f"{kind}{quantity} per material, mean \N{PLUS-MINUS SIGN} standard deviation"


def plot_hfmh(report_data: ReportData, *, path: str | os.PathLike[str] | None = None) -> Figure:
    """Plot the mean histogram of the high-passed signal, one panel an axis, one row a material.

    Parameters
    ----------
    report_data : ReportData
        Summary of the data set that an evaluation keeps: ``result.report_data``.
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

    Examples
    --------
    >>> from granular_id import evaluate, synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=4, sessions=2)
    >>> result = evaluate(data, "raw+hfmh", baselines=False, progress=False)
    >>> figure = plot_hfmh(result.report_data)
    >>> [panel.get_xlabel() for panel in figure.axes if panel.get_title()][3:]
    ['bin, N m', 'bin, N m', 'bin, N m']
    """
    n_axes = len(report_data.axes)
    across = min(3, n_axes)
    down = math.ceil(n_axes / across)
    figure = new_figure(max(4.0 * across, 6.0), down * (1.0 + 0.17 * len(report_data.labels)) + 0.5)
    panels = figure.subplots(down, across, squeeze=False).ravel()
    for number, panel in enumerate(panels[:n_axes]):
        draw_hfmh(panel, report_data, number)
        panel.set_title(pretty(report_data.axes[number]), fontsize=10, color=INK)
    for unused in panels[n_axes:]:
        unused.remove()
    what = f"Histograms of the signal above {report_data.hfmh.cutoff_hz:g} Hz"
    synthetic = "synthetic recordings, " if report_data.n_synthetic else ""
    heading(figure, f"{what}: {synthetic}mean of a material")
    save(figure, path)
    return figure


def draw_hfmh(panel: Any, report_data: ReportData, axis: int) -> None:
    """Draw the heat map of one axis, by its number."""
    part = report_data.hfmh
    values, (low, high) = part.counts[:, axis], part.bin_range[axis].tolist()
    units = report_data.units
    alike = [
        other
        for other, unit in enumerate(units)
        if unit == units[axis] and part.bin_range[other].tolist() == [low, high]
    ]
    edges = np.linspace(low, high, values.shape[1] + 1)
    used = np.flatnonzero(part.counts[:, alike].any(axis=(0, 1)))
    first, last = (int(used[0]), int(used[-1]) + 1) if used.size else (0, values.shape[1])
    draw_heat(
        panel,
        values[:, first:last],
        across=(float(edges[first]), float(edges[last])),
        labels=report_data.labels,
        limits=shared_limits(part.counts[:, alike]),
        key="density" if part.density else "samples in a bin",
    )
    panel.locator_params(axis="x", nbins=5)
    panel.set_xlabel(with_unit("bin", units[axis]), fontsize=8, color=INK)


# Dark to light in an order that survives any colour vision and a grey print.
_COLOURS = "cividis"


def draw_heat(
    panel: Any,
    values: NDArray[np.float64],
    *,
    across: tuple[float, float],
    labels: Sequence[str],
    limits: tuple[float, float],
    key: str,
) -> None:
    """Draw one heat map with its colour key; what is zero stays empty."""
    from matplotlib.colors import LogNorm  # an extra

    image = panel.imshow(
        np.ma.masked_less_equal(values, 0.0),
        cmap=_COLOURS,
        norm=LogNorm(*limits),
        aspect="auto",
        interpolation="none",  # one pixel a value in an SVG, which stays small
        extent=(*across, len(values) - 0.5, -0.5),
    )
    row_names(panel, labels)
    panel.tick_params(labelsize=7.5, colors=INK)
    panel.spines[:].set_visible(False)
    beyond = "max" if values.max() > limits[1] else "neither"
    bar = panel.figure.colorbar(image, ax=panel, pad=0.02, aspect=25, extend=beyond)
    bar.solids.set_rasterized(True)  # else a path for each of 256 colours
    bar.outline.set_visible(False)
    bar.set_label(key, fontsize=8, color=INK)
    bar.set_ticks(ticks := _ticks(limits), labels=[f"{tick:g}" for tick in ticks])
    bar.ax.tick_params(labelsize=7.5, colors=INK, length=2)
    bar.ax.minorticks_off()


def _ticks(limits: tuple[float, float]) -> list[float]:
    """Powers of ten within limits; where there are fewer than three, more steps between them."""
    low, high = limits
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in ((1,), (1, 2, 5), (1, 2, 3, 4, 5, 6, 8)):
        inside = [step * 10.0**e for e in exponents for step in steps if low <= step * 10.0**e <= high]
        if len(inside) > 2:
            break
    return inside


def shared_limits(values: NDArray[np.float64]) -> tuple[float, float]:
    """Limits of the colours: the largest value, and at most four decades below it."""
    top = float(values.max())
    if top <= 0:
        return 0.1, 1.0
    smallest = float(values[values > 0].min())
    return max(min(smallest, 0.5 * top), top * 1e-4), top

"""What the two heat maps share: one row a material, one panel an axis, size as colour on a log scale."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._core import AXES, UNITS
from granular_id.plotting.style import INK, new_figure, pretty, row_names, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["axis_unit", "draw_heat", "plot_six", "shared_limits"]

# Dark to light in an order that survives any colour vision and a grey print.
_COLOURS = "cividis"


def axis_unit(axis: str) -> str:
    """Return the unit of an axis, N or N m."""
    return UNITS[AXES.index(axis)]


def draw_heat(
    panel: Any,
    values: NDArray[np.float64],
    *,
    across: tuple[float, float],
    labels: Sequence[str],
    limits: tuple[float, float],
    key: str,
) -> None:
    """Draw one heat map with its colour key; what is zero stays empty.

    Parameters
    ----------
    panel : matplotlib axes
    values : (K, m) float array
        One row a material, not negative.
    across : (float, float)
        Left and right edge of the columns.
    labels : sequence of K str
    limits : (float, float)
        Values with the first and the last colour, positive and ascending.
    key : str
        What the colours mean.
    """
    from matplotlib.colors import LogNorm  # noqa: PLC0415  # an extra

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
    for spine in panel.spines.values():
        spine.set_visible(False)
    beyond = "max" if values.max() > limits[1] else "neither"
    bar = panel.figure.colorbar(image, ax=panel, pad=0.02, aspect=25, extend=beyond)
    bar.solids.set_rasterized(True)  # else a path for each of 256 colours
    bar.outline.set_visible(False)
    bar.set_ticks(ticks := _ticks(limits), labels=[f"{tick:g}" for tick in ticks])
    bar.ax.minorticks_off()
    bar.ax.tick_params(labelsize=7.5, colors=INK, length=2)
    bar.set_label(key, fontsize=8, color=INK)


def _ticks(limits: tuple[float, float]) -> list[float]:
    """Powers of ten within limits; where there are fewer than three, more steps between them."""
    low, high = limits
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in ((1,), (1, 2, 5), (1, 2, 3, 4, 5, 6, 8)):
        inside = [step * 10.0**e for e in exponents for step in steps if low <= step * 10.0**e <= high]
        if len(inside) > 2:
            break
    return inside


def shared_limits(
    values: NDArray[np.float64], decades: float = 4.0, share: float = 1.0
) -> tuple[float, float]:
    """Limits of the colours: the value that this share does not exceed, and at most so many decades below it.

    Where the largest values are a few, such as a filter's first response to an offset, a share below 1 leaves
    the colours to the rest.
    """
    top = float(np.quantile(values, share))
    if top <= 0:
        return 0.1, 1.0
    smallest = float(values[values > 0].min())
    return max(min(smallest, 0.5 * top), top * 10.0**-decades), top


def plot_six(
    draw: Callable[[Any, int], None],
    axes: Sequence[str],
    n_rows: int,
    title: str,
    path: str | os.PathLike[str] | None,
) -> Figure:
    """Lay out one panel an axis, forces above torques, each filled by ``draw(panel, axis number)``."""
    figure = new_figure(12.0, 2 * (1.0 + 0.17 * n_rows) + 0.5)
    for number, panel in enumerate(figure.subplots(2, 3).ravel()):
        draw(panel, number)
        panel.set_title(f"{pretty(axes[number])}", fontsize=10, color=INK)
    figure.suptitle(title, fontsize=11, color=INK)
    save(figure, path)
    return figure

"""What all figures share: colours, a figure without a backend, quiet axes, saving.

matplotlib is loaded on first use (``pip install 'granular-id[app]'``), and only its ``Figure`` objects: no
backend is chosen, no window opened and no global state touched, so plotting is safe in scripts,
notebooks, servers and threads alike.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._core import AXES
from granular_id._files import whole_file
from granular_id._text import fixed, short
from granular_id.recording import AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXIS_DASHES = ("-", ":", "--", ":", "-", "--")
"""Dashes as well as colours: the lines must stay apart in black and white."""

INK, FAINT = "#333333", "#BBBBBB"
"""Text and marks; lines that only guide the eye."""

TICKS = tuple(step * 10.0**power for power in range(-3, 5) for step in (1, 2, 5))
"""Ticks of a logarithmic axis that few decades need."""


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure of `width` x `height` inches, or raise the ImportError that says what to install."""
    try:
        from matplotlib.figure import Figure  # an extra: only those who plot need it
    except ImportError as error:
        raise ImportError("plotting needs matplotlib: pip install 'granular-id[app]'") from error
    return Figure(figsize=(width, height), layout="constrained")


def material_panels(n: int) -> tuple[Figure, list[Any]]:
    """Make a figure of `n` small panels that share their scales, up to four in a row."""
    n_columns = min(4, n)
    n_rows = math.ceil(n / n_columns)
    figure = new_figure(max(1.2 + 2.5 * n_columns, 7.0), 1.4 + 1.9 * n_rows)  # room for label and legend
    panels = figure.subplots(n_rows, n_columns, sharex=True, sharey=True, squeeze=False).ravel()
    for unused in panels[n:]:
        unused.remove()
    # The lowest panel of each column carries the time axis, also where the last row is not full.
    for index, panel in enumerate(panels[:n]):
        panel.tick_params(labelbottom=index + n_columns >= n)
    return figure, list(panels[:n])


def quiet(panel: Any) -> None:
    """Keep the two axes that carry numbers, faintly, and small tick labels."""
    panel.tick_params(labelsize=8, colors=INK)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        panel.spines[side].set_color(FAINT)


def save(figure: Figure, path: str | os.PathLike[str] | None) -> None:
    """Save whole or not at all; the ending chooses the format. Nothing happens when `path` is None."""
    if path is None:
        return
    form = file_format(path)
    with whole_file(path) as draft:
        figure.savefig(draft, format=form, dpi=150)


def file_format(path: str | os.PathLike[str], name: str = "path") -> str:
    """Return the format that the ending of a path chooses, or say which work; `name` is that of the argument."""
    target = Path(path)
    form = target.suffix.removeprefix(".").lower()
    # Of matplotlib's, which depend on its version: without bare pixels, and what needs a TeX installation to be drawn.
    known = set(new_figure(1, 1).canvas.get_supported_filetypes()) - {"raw", "rgba", "pgf"}
    if form not in known:
        others = ", ".join(f".{other}" for other in sorted(known - {"png", "svg", "pdf"}))
        raise ValueError(f"{name} must end in .png, .svg or .pdf ({others} work too), got {str(target)!r}")
    return form


def pretty(axis: str) -> str:
    """Return the name of an axis of a wrench as mathematics, ``$F_x$`` for fx; any other name as it is."""
    return f"${axis[0].upper()}_{axis[1]}$" if axis in AXES else axis


def middles_to_edges(middles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return edges half way between neighbours, and as far beyond the first and the last."""
    if len(middles) < 2:
        return np.array([middles[0] - 0.5, middles[0] + 0.5])
    half = np.diff(middles) / 2
    return np.concatenate([[middles[0] - half[0]], middles[:-1] + half, [middles[-1] + half[-1]]])


def number_text(value: float, digits: int) -> str:
    """Round for a figure, with a true minus and no minus before zero."""
    return fixed(round(value, digits) + 0.0, digits).replace("-", "\N{MINUS SIGN}")


def axis_line(axis: str, place: int = 0) -> dict[str, Any]:
    """Return colour and dashes of an axis, for ``plot``: those of a wrench have their own in every figure."""
    number = AXES.index(axis) if axis in AXES else place % len(AXIS_COLOURS)
    return {"color": AXIS_COLOURS[number], "linestyle": AXIS_DASHES[number]}


def evenly(total: int, n: int) -> NDArray[np.intp]:
    """Choose `n` of `total` places, or all where there are fewer, evenly from the first to the last."""
    chosen: NDArray[np.intp] = np.unique(
        np.linspace(0, max(total - 1, 0), min(n, total)).round().astype(np.intp)
    )
    return chosen


def share_axis(panel: Any) -> None:
    """Make the horizontal axis one of shares from 0 to 100 %."""
    panel.set_xlim(0.0, 1.0)
    panel.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0 %", "25 %", "50 %", "75 %", "100 %"])


def row_names(panel: Any, names: Sequence[str]) -> None:
    """Name the rows 0, 1, 2, ... of a panel, the first on top, with room above and below."""
    # A name with $ in it is a name, no mathematics.
    panel.set_yticks(range(len(names)), [short(name) for name in names], parse_math=False)
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.tick_params(axis="y", length=0)

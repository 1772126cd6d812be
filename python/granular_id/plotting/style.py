"""What all figures share: colours, a figure without a backend, quiet axes, saving.

matplotlib (of the extra ``app``) is loaded on first use, and only its ``Figure`` objects: no
backend is chosen, no window opened and no global state touched, so plotting is safe in scripts,
notebooks, servers and threads alike.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_id._core import AXES
from granular_id._files import whole_file
from granular_id._text import fixed, install, short
from granular_id.recording import AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXIS_DASHES = ("-", ":", "--", ":", "-", "--")
"""Dashes as well as colours: the lines must stay apart in black and white."""

INK, FAINT = "#333333", "#BBBBBB"
"""Text and marks; lines that only guide the eye."""

_TICKS = tuple(step * 10.0**power for power in range(-3, 5) for step in (1, 2, 5))
"""Ticks of a logarithmic axis that few decades need."""

SHARE_TICKS = ([0.0, 0.25, 0.5, 0.75, 1.0], ["0 %", "25 %", "50 %", "75 %", "100 %"])


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure of `width` x `height` inches, or raise the ImportError that says what to install."""
    try:
        from matplotlib.figure import Figure  # an extra: only those who plot need it
    except ImportError as error:
        raise ImportError(f"plotting needs matplotlib: {install('app')}") from error
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


def quiet(panel: Any, *hidden: str) -> None:
    """Keep the two axes that carry numbers, faintly, and small tick labels; `hidden` sides go too."""
    panel.tick_params(labelsize=8, colors=INK)
    panel.spines[["left", "bottom"]].set_color(FAINT)
    panel.spines[["top", "right", *hidden]].set_visible(False)


def curve_panel(panel: Any) -> None:
    """Finish a panel of curves: a line at zero, and no room before the first and after the last sample."""
    panel.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
    panel.margins(x=0)
    quiet(panel)


def grid(panel: Any, axis: str = "both") -> None:
    """Draw faint lines behind everything else, across an axis or both."""
    panel.grid(axis=axis, color=FAINT, linewidth=0.4)
    panel.set_axisbelow(True)


def chance_line(panel: Any, chance: float, label: str | None = None) -> None:
    """Mark the accuracy of chance on the horizontal axis."""
    panel.axvline(chance, color=INK, linewidth=0.8, linestyle="--", label=label)


def note(panel: Any, text: str, at: tuple[float, float], away: tuple[float, float], **style: Any) -> None:
    """Write a few words `away` points from a place of the panel."""
    panel.annotate(
        text, at, xytext=away, textcoords="offset points", **({"fontsize": 8, "color": INK} | style)
    )


def heading(target: Any, text: str, size: float = 11) -> None:
    """Write the heading of a figure, or the title of a panel; a name with $ in it is a name, no mathematics."""
    write = target.set_title if hasattr(target, "set_title") else target.suptitle
    write(text, fontsize=size, color=INK, parse_math=False)


def legend(figure: Any, side: str, *, size: float = 8, **options: Any) -> None:
    """Put one legend of all panels outside of them, for instance at the side "upper left"."""
    figure.legend(loc=f"outside {side}", frameon=False, fontsize=size, labelcolor=INK, **options)


def legend_of_axes(figure: Any, handles: Sequence[Any]) -> None:
    """Name the axes below the panels or, where they would run into the label there, on their right."""
    few = len(handles) <= 3
    legend(
        figure,
        "lower right" if few else "right upper",
        size=9,
        handles=handles,
        ncols=len(handles) if few else 1,
    )


def log_axis(panel: Any, low: float, high: float) -> None:
    """Make the horizontal axis logarithmic, with round numbers between two limits."""
    panel.set_xscale("log")
    ticks = [tick for tick in _TICKS if low <= tick <= high]
    panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.minorticks_off()


def synthetic_mark(synthetic: object) -> str:
    """Return what the title of a figure adds for synthetic recordings."""
    return ", SYNTHETIC recordings" if synthetic else ""


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
    """Return the name of an axis of a wrench as mathematics, ``$F_x$`` for fx; any other name as it stands."""
    return f"${axis[0].upper()}_{axis[1]}$" if axis in AXES else axis.replace("$", r"\$")


def with_unit(what: str, unit: str) -> str:
    """Return the label of an axis of a figure: what it shows and, where known, in which units."""
    return f"{what}, {unit.replace(', ', ' or ')}" if unit else what


def quantity_of(axes: Iterable[str], unit: str) -> str:
    """Say what is drawn, with its unit: force or torque of a wrench, a single axis by its name, else the signal."""
    names = list(axes)
    if set(names) <= set(AXES) and unit in ("N", "N m"):
        return f"{'force' if unit == 'N' else 'torque'}, {unit}"
    return with_unit(names[0] if len(names) == 1 else "signal", unit)


def number_text(value: float, digits: int) -> str:
    """Round for a figure, with a true minus and no minus before zero."""
    return fixed(round(value, digits) + 0.0, digits).replace("-", "\N{MINUS SIGN}")


def axis_line(axis: str, place: int) -> dict[str, Any]:
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
    panel.set_xticks(*SHARE_TICKS)


def share_rows(panel: Any, names: Sequence[str]) -> None:
    """Make a panel of shares, one named row each."""
    share_axis(panel)
    row_names(panel, names)
    quiet(panel, "left")
    panel.tick_params(axis="y", labelsize=8)
    grid(panel, "x")


def row_names(panel: Any, names: Sequence[str]) -> None:
    """Name the rows 0, 1, 2, ... of a panel, the first on top, with room above and below."""
    # A name with $ in it is a name, no mathematics.
    panel.set_yticks(range(len(names)), [short(name) for name in names], parse_math=False)
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.tick_params(axis="y", length=0)

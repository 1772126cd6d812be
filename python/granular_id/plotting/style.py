"""What all figures share: colours, a figure without a backend, quiet axes, saving.

matplotlib (of the extra ``app``) is loaded on first use, and only its ``Figure`` objects: no
backend is chosen, no window opened and no global state touched, so plotting is safe in scripts,
notebooks, servers and threads alike.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granular_id._core import AXES, GranularIdError
from granular_id._files import PICTURES, whole_file
from granular_id._text import install, short
from granular_id.recording import AXIS_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXIS_DASHES = ("-", ":", "--", ":", "-", "--")
"""Dashes as well as colours: the lines must stay apart in black and white."""

INK, FAINT = "#333333", "#BBBBBB"
"""Text and marks; lines that only guide the eye."""

SHARE_TICKS = ([0.0, 0.25, 0.5, 0.75, 1.0], ["0 %", "25 %", "50 %", "75 %", "100 %"])


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure of `width` x `height` inches, or raise the ImportError that says what to install."""
    try:
        from matplotlib.figure import Figure  # an extra: only those who plot need it
    except ImportError as error:
        raise ImportError(f"plotting needs matplotlib: {install('app')}") from error
    return Figure(figsize=(width, height), layout="constrained")


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


def note(panel: Any, text: str, at: tuple[float, float], away: tuple[float, float], **style: Any) -> None:
    """Write a few words `away` points from a place of the panel."""
    panel.annotate(
        text, at, xytext=away, textcoords="offset points", **({"fontsize": 8, "color": INK} | style)
    )


def name_axes(panel: Any, across: str = "", up: str = "", size: float = 9) -> None:
    """Write what the two axes of a panel show."""
    if across:
        panel.set_xlabel(across, fontsize=size, color=INK)
    if up:
        panel.set_ylabel(up, fontsize=size, color=INK)


def heading(target: Any, text: str, size: float = 11) -> None:
    """Write the heading of a figure, or the title of a panel; a name with $ in it is a name, no mathematics."""
    write = target.set_title if hasattr(target, "set_title") else target.suptitle
    write(text, fontsize=size, color=INK, parse_math=False)


def legend(figure: Any, side: str, *, size: float = 8, **options: Any) -> None:
    """Put one legend of all panels outside of them, for instance at the side "upper left"."""
    figure.legend(loc=f"outside {side}", frameon=False, fontsize=size, labelcolor=INK, **options)


def log_ticks(low: float, high: float, most: int = 9) -> tuple[list[float], list[str]]:
    """Return round numbers between two limits with their texts, in steps of 1, 2 and 5 unless these are too many."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks: list[float] = []
    for steps in ((1, 2, 5), (1,)):
        ticks = [step * 10.0**decade for decade in decades for step in steps]
        ticks = [tick for tick in ticks if low <= tick <= high]
        if len(ticks) <= most:
            break
    return ticks, [f"{tick:g}" for tick in ticks]


def synthetic_mark(synthetic: object) -> str:
    """Return what the title of a figure adds for synthetic recordings."""
    return ", SYNTHETIC recordings" if synthetic else ""


def save(figure: Figure, path: str | os.PathLike[str] | None) -> None:
    """Save whole or not at all; the ending chooses the format. Nothing happens when `path` is None."""
    if path is None:
        return
    form = file_format(path)
    made_by = {"Software" if form == "png" else "Creator": "granular_id"}
    with whole_file(path) as draft:
        figure.savefig(draft, format=form, dpi=150, metadata=made_by)


def file_format(path: str | os.PathLike[str], name: str = "path") -> str:
    """Return the format that the ending of a path chooses, or refuse it; `name` is that of the argument."""
    target = Path(path)
    if target.suffix.lower() not in PICTURES:
        raise GranularIdError(f"{name} must end in .png, .svg or .pdf, got {str(target)!r}")
    return target.suffix.removeprefix(".").lower()


def pretty(axis: str) -> str:
    """Return the name of an axis of a wrench as mathematics, ``$F_x$`` for fx; any other name as it stands."""
    return f"${axis[0].upper()}_{axis[1]}$" if axis in AXES else axis.replace("$", r"\$")


def plain(axis: str) -> str:
    """Return the name of an axis where nothing is read as mathematics: Fx for fx."""
    return axis.capitalize() if axis in AXES else axis


def with_unit(what: str, unit: str) -> str:
    """Return the label of an axis of a figure: what it shows and, where known, in which units."""
    return f"{what}, {unit.replace(', ', ' or ')}" if unit else what


def axis_line(axis: str, place: int) -> dict[str, Any]:
    """Return colour and dashes of an axis, for ``plot``: those of a wrench have their own in every figure."""
    number = AXES.index(axis) if axis in AXES else place % len(AXIS_COLOURS)
    return {"color": AXIS_COLOURS[number], "linestyle": AXIS_DASHES[number]}


def axis_keys(axes: Sequence[str], linewidth: float) -> list[Any]:
    """Return a line of each axis for a legend."""
    from matplotlib.lines import Line2D  # an extra

    return [
        Line2D([], [], label=pretty(axis), linewidth=linewidth, **axis_line(axis, place))
        for place, axis in enumerate(axes)
    ]


def share_axis(panel: Any) -> None:
    """Make the horizontal axis one of shares from 0 to 100 %."""
    panel.set_xlim(0.0, 1.0)
    panel.set_xticks(*SHARE_TICKS)


def row_names(panel: Any, names: Sequence[str]) -> None:
    """Name the rows 0, 1, 2, ... of a panel, the first on top, with room above and below."""
    # A name with $ in it is a name, no mathematics.
    panel.set_yticks(range(len(names)), [short(name) for name in names], parse_math=False)
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.tick_params(axis="y", length=0, labelsize=8)

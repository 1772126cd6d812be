"""One screen of the terminal view. Loaded only where rich is there."""

from __future__ import annotations

import math
from io import StringIO
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.align import Align
from rich.cells import cell_len
from rich.console import Console, Group
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from granular_id._text import fixed, short
from granular_id.live.wording import (
    GIVEN,
    SYNTHETIC,
    figures_of,
    history_of,
    printable,
    score_of,
    shown_of,
)
from granular_id.recording import AXIS_COLOURS

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from rich.console import RenderableType

    from granular_id.identifier import Decision
    from granular_id.live.snapshot import Snapshot
    from granular_id.live.wording import Shown

__all__ = ["screen"]

_LEVELS = "▁▂▃▄▅▆▇█"
_ASCII_LEVELS = "_.-~=+*#"
_STYLES = {"none": "white", "provisional": "cyan", "final": "green", "unknown": "yellow", "failed": "red"}
_NARROW = 64  # below this many columns there is one trace per axis, not two
_MOST_OUTCOMES = 8


def screen(snapshot: Snapshot, width: int, height: int, *, ascii_only: bool = False) -> RenderableType:
    """Draw a snapshot for a terminal of so many columns and lines.

    What must not be missed stands on top: the mark of synthetic sources, the answer, the health of the stream and
    warnings. Where lines are few, ranking and history are cut; where columns are few, the high-passed traces are left
    out.

    Parameters
    ----------
    snapshot : Snapshot
    width, height : int
        Size of the terminal.
    ascii_only : bool
        No block characters: the terminal's encoding has none.
    """
    parts: list[RenderableType] = []
    if snapshot.synthetic:
        mark = SYNTHETIC if width >= len(SYNTHETIC) else SYNTHETIC.partition(":")[0]
        parts.append(Text(mark, style="bold black on yellow", justify="center"))
    shown = shown_of(snapshot)
    parts += [_head(snapshot), _answer(shown, ascii_only=ascii_only), _health(snapshot)]
    parts += [Text(f"! {text}", style="bold yellow") for text in shown.warnings]
    parts += [Text(), _axes(snapshot, width, ascii_only=ascii_only)]
    used = len(Console(width=width, file=StringIO()).render_lines(Group(*parts)))
    lines = height - used
    wanted = 2 + min(len(snapshot.history), _MOST_OUTCOMES) if snapshot.history else 0
    below = min(wanted, lines // 2) if shown.decision is not None else min(wanted, lines)
    # Below an empty line and a heading.
    if shown.decision is not None and lines - below >= 4:
        parts += [Text(), _ranking(shown.decision, width, lines - below - 2, ascii_only=ascii_only)]
    if below >= 3:
        parts += [Text(), _history(snapshot, below - 2)]
    return Group(*parts)


def _head(snapshot: Snapshot) -> RenderableType:
    line = Table.grid(expand=True, padding=(0, 1))
    line.add_column(ratio=1, no_wrap=True)
    line.add_column(justify="right", no_wrap=True)
    where = " · ".join(part for part in (printable(snapshot.source), f"{snapshot.rate_hz:g} Hz") if part)
    line.add_row(Text(f"granular_id live · {where}", style="dim"), Text(score_of(snapshot)))
    return line


def _answer(shown: Shown, *, ascii_only: bool) -> RenderableType:
    answer = shown.answer
    style = _STYLES[answer.kind]
    provisional = answer.kind == "provisional"
    strong = style if provisional else f"bold reverse {style}" if answer.kind in GIVEN else f"bold {style}"
    title = f"{answer.title} so far ..." if provisional else f"  {answer.title.upper()}  "
    words = Group(
        Align.center(Text(title, style=strong)),
        Text(answer.stage, style="bold", justify="center"),
        Text(answer.detail, justify="center"),
    )
    return Panel(
        words,
        title=Text(shown.state),
        border_style=style,
        box=box.ASCII if ascii_only else box.SQUARE if provisional else box.HEAVY,
        padding=(0, 1),
    )


def _health(snapshot: Snapshot) -> RenderableType:
    line = Text()
    for name, value, alarm in figures_of(snapshot):
        line.append(f"{name} ", style="dim").append(
            f"{value}{' !' * alarm}", style="bold red" if alarm else "bold"
        )
        line.append("   ")
    return line


def _axes(snapshot: Snapshot, width: int, *, ascii_only: bool) -> RenderableType:
    wide = width >= _NARROW
    room = max(8, (width - 46) // 2 if wide else width - 22)
    table = Table.grid(padding=(0, 1))
    for justify in ("left", "right", "left", "left", "right", "left", "right"):
        table.add_column(justify=justify, no_wrap=True)
    heads = ["", "", "", "last seconds", "from to", f"above {snapshot.cutoff_hz:g} Hz", "at most"]
    table.add_row(*(Text(head, style="dim") for head in heads[: 7 if wide else 4]))
    for i, (axis, unit, value) in enumerate(zip(snapshot.axes, snapshot.units, snapshot.latest, strict=True)):
        colour = AXIS_COLOURS[i % len(AXIS_COLOURS)]
        cells = [
            Text(axis, style="bold"),
            Text("-" if math.isnan(value) else fixed(value, 3 if unit == "N" else 4), style="bold"),
            Text(unit, style="dim"),
            Text(_bars(snapshot.wrench[:, i], room, ascii_only=ascii_only), style=colour),
        ]
        if wide:
            size = abs(snapshot.residual[:, i])
            cells += [
                Text(_range(snapshot.wrench[:, i]), style="dim"),
                Text(_bars(size, room, ascii_only=ascii_only), style=colour),
                Text(_range(size).rpartition(" ")[2], style="dim"),
            ]
        table.add_row(*cells)
    return table


def _range(values: NDArray[np.float64]) -> str:
    known = values[np.isfinite(values)]
    return f"{known.min():.2g} {known.max():.2g}" if len(known) else ""


def _bars(values: NDArray[np.float64], room: int, *, ascii_only: bool) -> str:
    """Draw the largest value of each piece of time, between the smallest and the largest of all; gaps are blank."""
    levels = _ASCII_LEVELS if ascii_only else _LEVELS
    if not len(values):
        return ""
    edges = np.linspace(0, len(values), min(room, len(values)) + 1).astype(int)
    high = np.fmax.reduceat(values, edges[:-1])
    known = high[np.isfinite(high)]
    if not len(known):
        return ""
    low, span = float(known.min()), float(known.max() - known.min()) or 1.0
    return "".join(
        " " if math.isnan(value) else levels[min(int((value - low) / span * len(levels)), len(levels) - 1)]
        for value in high
    )


def _ranking(decision: Decision, width: int, lines: int, *, ascii_only: bool) -> RenderableType:
    ranking = decision.ranking
    shown = ranking if len(ranking) <= lines else ranking[: lines - 1]
    largest = max((loss for _, loss in ranking if math.isfinite(loss)), default=1.0) or 1.0
    room = max(6, min(60, width - 38))
    table = Table.grid(padding=(0, 1))
    for justify in ("left", "right", "left"):
        table.add_column(justify=justify, no_wrap=True)
    table.add_row(*(Text(head, style="dim") for head in ("material", "mean loss", "the shorter the better")))
    for place, (name, loss) in enumerate(shown):
        style = "bold green" if place == 0 else "default" if place == 1 else "dim"
        bar = round(room * min(loss, largest) / largest)
        table.add_row(
            Text(_fitted(printable(name)), style=style),
            Text(fixed(loss, 3), style=style),
            Text(("#" if ascii_only else "━") * bar, style=style),
        )
    if len(shown) < len(ranking):
        table.add_row(Text(f"and {len(ranking) - len(shown)} more", style="dim"))
    return table


def _history(snapshot: Snapshot, lines: int) -> RenderableType:
    table = Table.grid(padding=(0, 1), expand=True)
    for justify in ("right", "left", "left"):
        table.add_column(justify=justify, no_wrap=True)
    table.add_column(no_wrap=True, ratio=1)
    table.add_row(*(Text(head, style="dim") for head in ("push", "at", "answer")))
    for entry in history_of(snapshot)[:lines]:
        more = Text(entry.detail)
        for text in entry.warnings:
            more.append(f"  ! {text}", style="bold yellow")
        name = Text(_fitted(entry.title), style=f"bold {_STYLES[entry.kind]}")
        table.add_row(str(entry.number), entry.clock, name, more)
    return table


def _fitted(name: str, room: int = 24) -> str:
    """Shorten a name to so many columns: letters of some scripts take two."""
    return next(text for most in range(room, 0, -1) if cell_len(text := short(name, most)) <= room)

"""The terminal view: a screen that is drawn again and again, or plain lines where there is no terminal."""

from __future__ import annotations

import math
from io import StringIO
from typing import TYPE_CHECKING

import numpy as np

from granular_id._text import install, short
from granular_id.live.snapshot import GIVEN, SYNTHETIC
from granular_id.live.view import BackgroundView
from granular_id.recording import AXIS_COLOURS

try:
    from rich import box
    from rich.align import Align
    from rich.cells import cell_len
    from rich.console import Console, Group, RenderableType
    from rich.live import Live
    from rich.panel import Panel
    from rich.table import Table
    from rich.text import Text
except ImportError as error:
    raise ImportError(f"rich is needed to show a session on a terminal: {install('app')}") from error

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from granular_id.live.snapshot import Snapshot, Words

__all__ = ["TerminalView", "screen"]

_LINE_EVERY_S = 1.0  # of the device: a log that is read later needs no more
_LEVELS = "▁▂▃▄▅▆▇█"
_ASCII_LEVELS = "_.-~=+*#"
_STYLES = {"none": "white", "provisional": "cyan", "final": "green", "unknown": "yellow", "failed": "red"}
_NARROW = 64  # below this many columns there is one trace per axis, not two
_MOST_OUTCOMES = 8


class TerminalView(BackgroundView):
    """Shows snapshots on a terminal; where the output is none, one line per change and at most one a second.

    A thread of its own draws, so a terminal that is stopped or slow holds up nobody.

    Parameters
    ----------
    console : rich.console.Console, optional
        Default: standard output.
    max_hz : float, default 10
        Redraws per second: terminals flicker, and numbers cannot be read faster.

    Raises
    ------
    ImportError
        Without rich, saying what to install.

    Examples
    --------
    >>> import io
    >>> from rich.console import Console
    >>> from granular_id.live import Snapshot, TerminalView
    >>> output = io.StringIO()
    >>> with TerminalView(Console(file=output)) as view:
    ...     view.publish(Snapshot("armed", time_s=1.5, hint="push now"))
    >>> print(output.getvalue().strip())
    1.500 s  Armed: push now  |  lag -, lost 0
    """

    def __init__(self, console: Console | None = None, *, max_hz: float = 10.0) -> None:
        self._console = Console() if console is None else console
        self._live: Live | None = None
        self._told: object = None
        self._told_s = -math.inf
        # A log must have every change of state; of the screen only the newest picture is of interest.
        super().__init__("terminal view", max_hz=max_hz, waiting=1 if self._console.is_terminal else 256)

    def show(self, snapshot: Snapshot) -> None:
        """Draw the screen, or print a line where there is something new to say."""
        if not self._console.is_terminal:
            self._tell(snapshot)
            return
        console = self._console
        drawn = screen(snapshot, console.width, console.height, ascii_only=console.options.ascii_only)
        if self._live is None:
            self._live = Live(drawn, console=console, auto_refresh=False)
            self._live.start(refresh=True)
        else:
            self._live.update(drawn, refresh=True)

    def finish(self) -> None:
        """Leave the last screen where it stands."""
        if self._live is not None:
            self._live.stop()

    def _tell(self, snapshot: Snapshot) -> None:
        answer = snapshot.words.answer
        change = (snapshot.state, snapshot.hint, answer.kind, answer.title, snapshot.warnings)
        now = -math.inf if snapshot.time_s is None else snapshot.time_s
        if change == self._told and now - self._told_s < _LINE_EVERY_S:
            return
        self._told, self._told_s = change, now
        self._console.print(snapshot.words.line, markup=False, highlight=False, soft_wrap=True)


def screen(snapshot: Snapshot, width: int, height: int, *, ascii_only: bool = False) -> RenderableType:
    """Draw a snapshot for a terminal of so many columns and lines.

    What must not be missed stands on top: the mark of synthetic sources, the answer, the health of the stream and
    warnings. Where lines are few, ranking and history are cut; where columns are few, the high-passed traces are left
    out.
    """
    words = snapshot.words
    parts: list[RenderableType] = []
    if snapshot.synthetic:
        mark = SYNTHETIC if width >= len(SYNTHETIC) else SYNTHETIC.partition(":")[0]
        parts.append(Text(mark, style="bold black on yellow", justify="center"))
    parts += [_head(words), _answer(words, ascii_only=ascii_only), _health(words)]
    parts += [Text(f"! {text}", style="bold yellow") for text in words.warnings]
    parts += [Text(), _axes(snapshot, width, ascii_only=ascii_only)]
    used = len(Console(width=width, file=StringIO()).render_lines(Group(*parts)))
    lines = height - used
    wanted = 2 + min(len(words.history), _MOST_OUTCOMES) if words.history else 0
    below = min(wanted, lines // 2) if words.ranking else min(wanted, lines)
    # Below an empty line and a heading.
    if words.ranking and lines - below >= 4:
        parts += [Text(), _ranking(words, width, lines - below - 2, ascii_only=ascii_only)]
    if below >= 3:
        parts += [Text(), _history(words, below - 2)]
    return Group(*parts)


def _grid(*justify: str, heads: tuple[str, ...] = (), expand: bool = False) -> Table:
    table = Table.grid(padding=(0, 1), expand=expand)
    for side in justify:
        table.add_column(justify="right" if side == ">" else "left", no_wrap=True)
    if heads:
        table.add_row(*(Text(head, style="dim") for head in heads))
    return table


def _head(words: Words) -> RenderableType:
    line = _grid(expand=True)
    line.add_column(ratio=1, no_wrap=True)
    line.add_column(justify="right", no_wrap=True)
    line.add_row(Text(f"granular_id live · {words.source}", style="dim"), Text(words.score))
    return line


def _answer(words: Words, *, ascii_only: bool) -> RenderableType:
    kind, title, stage, detail = words.answer
    style = _STYLES[kind]
    provisional = kind == "provisional"
    strong = style if provisional else f"bold reverse {style}" if kind in GIVEN else f"bold {style}"
    lines = Group(
        Align.center(Text(f"{title} so far ..." if provisional else f"  {title.upper()}  ", style=strong)),
        Text(stage, style="bold", justify="center"),
        Text(detail, justify="center"),
    )
    edge = box.ASCII if ascii_only else box.SQUARE if provisional else box.HEAVY
    return Panel(lines, title=Text(words.state), border_style=style, box=edge, padding=(0, 1))


def _health(words: Words) -> RenderableType:
    line = Text()
    for name, value, alarm in words.figures:
        line.append(f"{name} ", style="dim")
        line.append(f"{value}{' !' * alarm}", style="bold red" if alarm else "bold").append("   ")
    return line


def _axes(snapshot: Snapshot, width: int, *, ascii_only: bool) -> RenderableType:
    wide = width >= _NARROW
    room = max(8, (width - 46) // 2 if wide else width - 22)
    heads = ("", "", "", "last seconds", "from to", f"above {snapshot.cutoff_hz:g} Hz", "at most")
    table = _grid(*"<><<><>", heads=heads[: 7 if wide else 4])
    for i, (axis, unit, value) in enumerate(
        zip(snapshot.axes, snapshot.units, snapshot.words.values, strict=True)
    ):
        trace, size = snapshot.wrench[:, i], abs(snapshot.residual[:, i])
        colour = AXIS_COLOURS[i % len(AXIS_COLOURS)]
        cells = [
            Text(axis, style="bold"),
            Text(value, style="bold"),
            Text(unit, style="dim"),
            Text(_bars(trace, room, ascii_only=ascii_only), style=colour),
        ]
        if wide:
            cells += [
                Text(_range(trace), style="dim"),
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
    if not np.isfinite(values).any():
        return ""
    edges = np.linspace(0, len(values), min(room, len(values)) + 1).astype(int)
    high = np.fmax.reduceat(values, edges[:-1])
    known = high[np.isfinite(high)]
    low, span = float(known.min()), float(known.max() - known.min()) or 1.0
    return "".join(
        " " if math.isnan(value) else levels[min(int((value - low) / span * len(levels)), len(levels) - 1)]
        for value in high
    )


def _ranking(words: Words, width: int, lines: int, *, ascii_only: bool) -> RenderableType:
    assert words.decision is not None
    losses = [loss for _, loss in words.decision.ranking]
    n_shown = len(losses) if len(losses) <= lines else lines - 1
    largest = max((loss for loss in losses if math.isfinite(loss)), default=1.0) or 1.0
    room = max(6, min(60, width - 38))
    table = _grid(*"<><", heads=("material", "mean loss", "the shorter the better"))
    for place, ((name, told), loss) in enumerate(zip(words.ranking[:n_shown], losses, strict=False)):
        style = "bold green" if place == 0 else "default" if place == 1 else "dim"
        bar = ("#" if ascii_only else "━") * round(room * min(loss, largest) / largest)
        table.add_row(Text(_fitted(name), style=style), Text(told, style=style), Text(bar, style=style))
    if n_shown < len(losses):
        table.add_row(Text(f"and {len(losses) - n_shown} more", style="dim"))
    return table


def _history(words: Words, lines: int) -> RenderableType:
    table = _grid(*"><<", expand=True)
    table.add_column(no_wrap=True, ratio=1)
    table.add_row(*(Text(head, style="dim") for head in ("no.", "at", "answer")))
    for number, clock, kind, title, detail, warnings in words.history[:lines]:
        more = Text(detail)
        for text in warnings:
            more.append(f"  ! {text}", style="bold yellow")
        table.add_row(str(number), clock, Text(_fitted(title), style=f"bold {_STYLES[kind]}"), more)
    return table


def _fitted(name: str, room: int = 24) -> str:
    """Shorten a name to so many columns: letters of some scripts take two."""
    return next(text for most in range(room, 0, -1) if cell_len(text := short(name, most)) <= room)

"""The terminal view: a screen that is drawn again and again, or plain lines where there is no terminal."""

from __future__ import annotations

import math
from textwrap import wrap
from typing import TYPE_CHECKING, Literal

import numpy as np

from granular_id._text import fixed, install
from granular_id.live.snapshot import GIVEN, SYNTHETIC
from granular_id.recording import AXIS_COLOURS

try:
    from rich import box
    from rich.align import Align
    from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
    from rich.live import Live
    from rich.panel import Panel
    from rich.progress_bar import ProgressBar
    from rich.table import Column, Table
    from rich.text import Text
except ImportError as error:
    raise ImportError(f"rich is needed to show a session on a terminal: {install('app')}") from error

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from granular_id.identifier import Decision
    from granular_id.live.snapshot import Snapshot, Words

__all__ = ["TerminalView", "screen"]

_LINE_EVERY_S = 1.0  # of the device: a log that is read later needs no more
_COLUMNS = 80  # of such a log
_STYLES = {"none": "white", "provisional": "cyan", "final": "green", "unknown": "yellow", "failed": "red"}
_NARROW = 64  # below this many columns there is one trace per axis, not two


class TerminalView:
    """Shows snapshots on a terminal; where the output is none, one line per change and at most one a second.

    `console` is a ``rich.console.Console``; default: standard output.

    Examples
    --------
    >>> import io
    >>> from rich.console import Console
    >>> from granular_id.live import TerminalView
    >>> from granular_id.live.snapshot import Snapshot
    >>> output = io.StringIO()
    >>> TerminalView(Console(file=output)).show(Snapshot("armed", time_s=1.5, hint="push now"))
    >>> print(output.getvalue().strip())
    1.500 s  Armed: push now  |  lag -, lost 0
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = Console() if console is None else console
        self._live: Live | None = None
        self._printed: object = None
        self._printed_s = -math.inf

    def show(self, snapshot: Snapshot) -> None:
        """Draw the screen, or print a line where there is something new."""
        console = self._console
        if not console.is_terminal:
            self._print(snapshot)
        elif self._live is None:
            drawn = screen(snapshot, console.width)
            self._live = Live(drawn, console=console, auto_refresh=False, vertical_overflow="crop")
            self._live.start(refresh=True)
        else:
            self._live.update(screen(snapshot, console.width), refresh=True)

    def close(self) -> None:
        """Leave the last screen where it stands."""
        if self._live is not None:
            self._live.stop()

    def _print(self, snapshot: Snapshot) -> None:
        words, now_s = snapshot.words, -math.inf if snapshot.time_s is None else snapshot.time_s
        change = (snapshot.state, snapshot.hint, words.answer[:2], words.warnings)
        if change != self._printed or now_s - self._printed_s >= _LINE_EVERY_S:
            self._printed, self._printed_s = change, now_s
            lines = wrap(words.line, _COLUMNS, subsequent_indent="  ", break_long_words=False)
            self._console.print(Text("\n").join(map(_text, lines)), soft_wrap=True)


def screen(snapshot: Snapshot, width: int) -> RenderableType:
    """Draw a snapshot for a terminal of so many columns; what must not be missed stands on top."""
    words, wide = snapshot.words, width >= _NARROW
    columns = Column(ratio=1, no_wrap=True), Column(justify="right", no_wrap=True)
    head = Table.grid(*columns, padding=(0, 1), expand=True)
    head.add_row(_text(words.source, "dim"), _text(words.score))
    mark = SYNTHETIC if width >= len(SYNTHETIC) else SYNTHETIC.partition(":")[0]
    tables = [] if words.decision is None else [_ranking(words.decision)]
    if words.history:
        tables.append(_history(words))
    below = Table.grid(*[Column(ratio=1) for _ in tables], padding=(0, 2), expand=True)
    below.add_row(*tables)
    return Group(
        *[Text(mark, style="bold black on yellow", justify="center")] * snapshot.synthetic,
        head,
        _answer(words),
        _health(words),
        *(_text(f"! {text}", "bold yellow") for text in words.warnings),
        Text(),
        _axes(snapshot, wide=wide),
        Text(),
        *([below] if wide else tables),
    )


def _text(text: str, style: str = "") -> Text:
    """Return text in which nothing steers the terminal."""
    return Text("".join(c if c.isprintable() else "\ufffd" for c in text), style=style)


def _table(*heads: str, right: int, wide: tuple[int, ...]) -> Table:
    table = Table.grid(padding=(0, 1), expand=True)
    for k in range(len(heads)):
        justify: Literal["left", "right"] = "right" if k == right else "left"
        table.add_column(justify=justify, no_wrap=True, ratio=1 if k in wide else None)
    table.add_row(*(Text(head, style="dim") for head in heads))
    return table


def _answer(words: Words) -> RenderableType:
    kind, title, stage, detail = words.answer
    style, provisional = _STYLES[kind], kind == "provisional"
    strong = style if provisional else f"bold reverse {style}" if kind in GIVEN else f"bold {style}"
    lines = Group(
        Align.center(_text(f"{title} so far ..." if provisional else f"  {title.upper()}  ", strong)),
        Align.center(_text(stage, "bold")),
        Align.center(_text(detail)),
    )
    edge = box.SQUARE if provisional else box.HEAVY
    return Panel(lines, title=_text(words.state), border_style=style, box=edge, padding=(0, 1))


def _health(words: Words) -> RenderableType:
    line = Text()
    for name, value, alarm in words.figures:
        line.append(f"{name} ", style="dim")
        line.append(f"{value}{' !' * alarm}", style="bold red" if alarm else "bold").append("   ")
    return line


def _axes(snapshot: Snapshot, *, wide: bool) -> RenderableType:
    heads = ("", "", "", "last seconds", f"above {snapshot.cutoff_hz:g} Hz")
    table = _table(*heads[: 5 if wide else 4], right=1, wide=(3, 4))
    named = zip(snapshot.axes, snapshot.words.values, snapshot.units, strict=True)
    for i, (axis, value, unit) in enumerate(named):
        traces = [snapshot.wrench[:, i], abs(snapshot.residual[:, i])][: 2 if wide else 1]
        bars = (_Trace(trace, AXIS_COLOURS[i % len(AXIS_COLOURS)]) for trace in traces)
        table.add_row(_text(axis, "bold"), _text(value, "bold"), _text(unit, "dim"), *bars)
    return table


class _Trace:
    """The largest value of each piece of time, between the smallest and the largest of all; gaps are blank."""

    def __init__(self, values: NDArray[np.float64], style: str) -> None:
        self._values, self._style = values, style

    def __rich_console__(self, _: Console, options: ConsoleOptions) -> RenderResult:
        values, levels = self._values, "_.-~=+*#" if options.ascii_only else "▁▂▃▄▅▆▇█"
        edges = np.linspace(0, len(values), min(options.max_width, len(values)) + 1).astype(int)
        high = np.fmax.reduceat(values, edges[:-1]) if len(values) else values
        known = high[np.isfinite(high)]
        low, span = (known.min(), np.ptp(known) or 1.0) if len(known) else (0.0, 1.0)
        places = np.clip((high - low) / span * len(levels), 0, len(levels) - 1)
        yield Text("".join(" " if math.isnan(x) else levels[int(x)] for x in places), style=self._style)


def _ranking(decision: Decision) -> Table:
    most = max(loss for _, loss in decision.ranking)
    table = _table("material", "mean loss", "the shorter the better", right=1, wide=(2,))
    table.columns[0].max_width = 24
    for place, (name, loss) in enumerate(decision.ranking):
        style = "bold green" if place == 0 else "default" if place == 1 else "dim"
        bar = ProgressBar(most, loss, complete_style=style, finished_style=style, style="black")
        table.add_row(_text(name, style), _text(fixed(loss, 3), style), bar)
    return table


def _history(words: Words) -> Table:
    table = _table("no.", "at", "answer", right=0, wide=(2,))
    for number, clock, kind, title, detail, warnings in words.history:
        what = _text(title, f"bold {_STYLES[kind]}").append_text(_text(f" {detail}", "not bold default"))
        for text in warnings:
            what.append_text(_text(f"  ! {text}", "bold yellow"))
        table.add_row(str(number), clock, what)
    return table

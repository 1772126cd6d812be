"""The terminal view: a screen that is drawn again and again, or plain lines where there is no terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from granular_id._text import fixed
from granular_id.io.extras import need
from granular_id.live.view import BackgroundView
from granular_id.live.wording import (
    GIVEN,
    SYNTHETIC,
    answer_of,
    figures_of,
    printable,
    score_of,
    state_of,
    warnings_of,
)

if TYPE_CHECKING:
    from rich.console import Console
    from rich.live import Live

    from granular_id.live.snapshot import Snapshot

__all__ = ["TerminalView", "line_of"]

_LINE_EVERY_S = 1.0  # of the device: a log that is read later needs no more


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
    >>> from granular_id.live.snapshot import Snapshot
    >>> from granular_id.live.terminal import TerminalView
    >>> output = io.StringIO()
    >>> with TerminalView(Console(file=output)) as view:
    ...     view.publish(Snapshot("armed", time_s=1.5, hint="push now"))
    >>> print(output.getvalue().strip())
    1.500 s  Armed: push now  |  lag -, lost 0
    """

    def __init__(self, console: Console | None = None, *, max_hz: float = 10.0) -> None:
        rich = need("rich.console", extra="app", why="to show a session on a terminal")
        self._console: Console = rich.Console() if console is None else console
        self._live: Live | None = None
        self._told = ""
        self._told_s = float("-inf")
        # A log must have every change of state; of the screen only the newest picture is of interest.
        super().__init__("terminal view", max_hz=max_hz, waiting=1 if self._console.is_terminal else 256)

    def show(self, snapshot: Snapshot) -> None:
        """Draw the screen, or print a line where there is something new to say."""
        if self._console.is_terminal:
            self._draw(snapshot)
        else:
            self._tell(snapshot)

    def finish(self) -> None:
        """Leave the last screen where it stands."""
        if self._live is not None:
            self._live.stop()

    def _draw(self, snapshot: Snapshot) -> None:
        from granular_id.live.terminal_screen import screen  # rich is an extra

        drawn = screen(
            snapshot, self._console.width, self._console.height, ascii_only=self._console.options.ascii_only
        )
        if self._live is None:
            live: Any = need("rich.live", extra="app", why="to show a session on a terminal")
            self._live = live.Live(drawn, console=self._console, auto_refresh=False)
            self._live.start(refresh=True)
        else:
            self._live.update(drawn, refresh=True)

    def _tell(self, snapshot: Snapshot) -> None:
        answer = answer_of(snapshot)
        change = "\n".join((snapshot.state, snapshot.hint, answer.kind, answer.title, *snapshot.warnings))
        now = snapshot.time_s if snapshot.time_s is not None else float("-inf")
        if change == self._told and now - self._told_s < _LINE_EVERY_S:
            return
        self._told, self._told_s = change, now
        self._console.print(line_of(snapshot), markup=False, highlight=False, soft_wrap=True)


def line_of(snapshot: Snapshot) -> str:
    """Put a snapshot into one line.

    Examples
    --------
    >>> from granular_id.live.snapshot import Snapshot
    >>> from granular_id.live.terminal import line_of
    >>> line_of(Snapshot("failed", hint="12 rows are missing", synthetic=True, counters={"missing": 12}))
    'SYNTHETIC  Failed: 12 rows are missing  |  lag -, lost 12 (!)'
    """
    answer = answer_of(snapshot)
    state = state_of(snapshot)
    if answer.kind in GIVEN:
        said = (
            f"{state}: {answer.title} ({', '.join(part for part in (answer.stage, answer.detail) if part)})"
        )
    else:
        said = f"{state}: {printable(snapshot.hint)}" if snapshot.hint else state
    begin = [SYNTHETIC.partition(" ")[0]] if snapshot.synthetic else []
    if snapshot.time_s is not None:
        begin.append(f"{fixed(snapshot.time_s, 3)} s")
    health = ", ".join(f"{name} {value}{' (!)' * alarm}" for name, value, alarm in figures_of(snapshot))
    parts = ["  ".join([*begin, said]), health, score_of(snapshot)]
    parts += [f"warning: {text}" for text in warnings_of(snapshot)]
    return "  |  ".join(part for part in parts if part)

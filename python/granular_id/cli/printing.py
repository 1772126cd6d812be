"""What commands print: lines, tables, the files written, the command that repeats it all."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from granular_id._text import Table


def show(text: str, style: str = "", *, err: bool = False) -> None:
    """Print a text as it stands, without markup or wrapping."""
    Console(stderr=err).print(Text(text, style=style), soft_wrap=True)


def warn_of_setups(differences: Sequence[str], *, err: bool = False) -> None:
    """Warn of what recordings or a sensor have otherwise than the training of a model."""
    from granular_id.recording import other_setup

    for difference in differences:
        show(f"warning: {other_setup(difference)}", "bold yellow", err=err)


def print_table(table: Table, *, strong: bool = False, tight: bool = False) -> None:
    """Print one table with its title above and its notes below."""
    console = Console(highlight=False)
    console.print()
    console.print(Text(table.title, style="bold yellow" if strong else "bold"))
    if table.rows:
        drawn = RichTable(
            box=box.SIMPLE_HEAD,
            show_edge=False,
            pad_edge=False,
            padding=(0, 0) if tight else (0, 0, 0, 1),
            header_style="bold",
        )
        for i, name in enumerate(table.header):
            drawn.add_column(Text(name), justify="right" if i else "left", no_wrap=tight)
        for row in table.rows:
            drawn.add_row(*(Text(cell) for cell in row))
        console.print(drawn)
    for note in table.notes:
        console.print(Text(note))


def fits(table: Table) -> bool:
    """Whether a table with a blank between columns is no wider than the terminal."""
    rows = (table.header, *table.rows)
    widths = (max(len(row[i]) for row in rows) + 1 for i in range(len(table.header)))
    return sum(widths) - 1 <= Console().width


def say_written(written: Sequence[Path | None], *, repeat: bool = False) -> None:
    """Name the files that were written (None is no file) and, to `repeat`, what to type for all of it."""
    paths = [path for path in written if path is not None]
    if paths or repeat:
        show("")
    for path in paths:
        show(f"wrote {path}")
    if repeat:
        command = repeated_command()
        show(f"repeat with: {command}{' --force' if paths and '--force' not in sys.argv else ''}")


def repeated_command() -> str:
    """Return what to type to repeat this run, by the name under which the program was started."""
    started = Path(sys.argv[0])
    if started.name in {"granular-id", "granular-id.exe"}:
        found = shutil.which(started.name)
        elsewhere = started.exists() and not (found and Path(found).samefile(started))
        program = [str(started) if elsewhere else started.name]
    else:
        by_package = started.name == "__main__.py" and started.parent.name == "granular_id"
        program = ["python", "-m", "granular_id" if by_package else "granular_id.cli"]
    return shlex.join([*program, *sys.argv[1:]])

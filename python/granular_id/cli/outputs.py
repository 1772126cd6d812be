"""What commands print, on one screen, and the checks of what they write: nothing unasked is replaced."""

from __future__ import annotations

import re
import shlex
import sys
import textwrap
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from granular_id._core import GranularIdError
from granular_id._files import JSON, MODELS, PAGES, PICTURES, TABLES, check_target
from granular_id._text import Table

COLUMNS = 80
"""No line is wider, piped or not, unless a single word is."""

_MOST_ROWS = 12


def show(
    text: str, style: str = "", *, err: bool = False, most: int | None = None, rest: str = "--details"
) -> None:
    """Print a text without markup, broken between words; of more than `most` lines the first, and what has the rest."""
    console = Console(stderr=err)
    width = min(COLUMNS, console.width)
    lines: list[str] = []
    for line in text.splitlines() or [""]:
        lines += [line] if len(line) <= width else _broken(line, width)
    if most is not None and len(lines) > most:
        lines[most - 1 :] = [f"... {len(lines) - most + 1} more lines{rest and f': {rest}'}"]
    console.print(Text("\n".join(lines), style=style), soft_wrap=True)


def _broken(line: str, width: int) -> list[str]:
    """Break a line; one that is to be typed goes on after a backslash."""
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    typed = line.lstrip().startswith("granular-id ")
    pieces = textwrap.wrap(
        line, width - 2 * typed, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    return [*(piece + " \\" * typed for piece in pieces[:-1]), pieces[-1]]


def warn_of_setups(differences: Iterable[str], *, err: bool = False) -> None:
    """Warn of what recordings or a sensor have otherwise than the training of a model."""
    from granular_id.recording import setup_mismatch

    for difference in differences:
        show(f"warning: {setup_mismatch(difference)}", "bold yellow", err=err)


def print_table(table: Table, *, strong: bool = False, details: bool = True) -> None:
    """Print one table with its title above and its notes below; without details its first rows only."""
    n_more = 0 if details else len(table.rows) - _MOST_ROWS
    if n_more > 0:
        more = f"... {n_more} more rows: --details"
        table = replace(table, rows=table.rows[:_MOST_ROWS], notes=(more, *table.notes))
    console = Console(highlight=False)
    console.width = min(COLUMNS, console.width)
    show(table.title, "bold yellow" if strong else "bold")
    if table.rows:
        drawn = RichTable(
            box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 0, 0, 1), header_style="bold"
        )
        for i, name in enumerate(table.header):
            justify: Literal["left", "right"] = "right" if i else "left"
            drawn.add_column(Text(name), justify=justify, overflow="fold")
        for row in table.rows:
            drawn.add_row(*(Text(cell) for cell in row))
        console.print(drawn)
    for note in table.notes:
        show(note)


def write_files(*outputs: tuple[Path | None, Callable[[Path], object]]) -> None:
    """Write the files that were asked for, each by its function, and name them."""
    for path, write in outputs:
        if path is not None:
            write(path)
            show(f"wrote {path}")


def repeated_command() -> str:
    """Return what to type to repeat this run, by the name under which the program was started."""
    started = Path(sys.argv[0]).name
    program = ["granular-id"] if started.startswith("granular-id") else ["python", "-m", "granular_id"]
    return shlex.join([*program, *sys.argv[1:]])


# Files, checked before any work.


class Kind(NamedTuple):
    """A kind of output: what it is called, the endings it may have, and how its files begin (a pattern of bytes)."""

    name: str
    endings: tuple[str, ...]
    begins: bytes


JSON_FILE = Kind("a JSON file", JSON, rb"\s*[{\[]")
PAGE = Kind("an HTML page", PAGES, rb"\s*<(!doctype\s+)?html")
MODEL = Kind("a model", MODELS, rb".{8}\{")
PREDICTIONS = Kind("a table of predictions", TABLES, rb"space,fold,")
ANSWERS = Kind("a table of answers", TABLES, rb"recording,(label,margin|from_s,to_s),")
LIVE_ANSWERS = Kind("a file of live answers", (".jsonl", ".ndjson", *JSON), rb"\s*\{")
DATA_SET = Kind("a data set", (".npz",), rb"PK")
PICTURE = Kind("a picture", (), rb"\x89PNG|%PDF|\s*<(\?xml|svg)")
"""Its ending chooses the format, and so is asked for; matplotlib knows more of them than begin like this."""

Output = tuple[str, Path | None, Kind]
"""An option, the file that it names, and what will be written there; None is no file."""


def check_outputs(*outputs: Output, source: Path | None = None, force: bool = False) -> None:
    """Refuse, before any work, outputs that would not be what their name says, or would replace what is there.

    These are: what cannot be written, belongs to `source`, which is read, or would be written twice; a name that ends
    like no file of its kind; a file of another kind, by how it begins; without `force` any file that is not empty.
    """
    named = [(name, check_target(path), kind) for name, path, kind in outputs if path is not None]
    if not named:
        return
    _refuse_overlaps([path for _, path, _ in named], source)
    for name, path, kind in named:
        if kind is PICTURE:
            from granular_id.plotting import file_format

            file_format(path, name)
        elif path.suffix.lower() not in kind.endings and re.search("[a-z]", path.suffix.lower()):
            # rice_0.5 is no kind of file
            wanted = f"must end in {' or '.join(kind.endings)}, or have no ending"
            raise GranularIdError(f"{name} writes {kind.name}: it {wanted}, got {path.name!r}")
    for name, path, kind in named:
        if not path.exists() or not path.stat().st_size:
            continue
        known = kind is not PICTURE or path.suffix.lower() in PICTURES
        with path.open("rb") as stream:
            if known and not re.match(kind.begins, stream.read(4096), re.IGNORECASE | re.DOTALL):
                raise GranularIdError(f"{name} {path}: what is there is not {kind.name}; give another name")
        if not force:
            raise FileExistsError(f"{name} {path}: there is such a file already; add --force to replace it")


def _refuse_overlaps(targets: list[Path], source: Path | None) -> None:
    places = [target.resolve() for target in targets]
    for k, place in enumerate(places):
        if place in places[:k]:
            raise GranularIdError(f"{targets[k]} would be written twice: give each output a file of its own")
        if source is not None and place.exists() and source.resolve() in (place, *place.parents):
            raise GranularIdError(
                f"{targets[k]} belongs to {source}, which is read: give the output another name"
            )

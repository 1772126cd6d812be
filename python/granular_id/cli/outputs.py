"""What commands print, and the checks of what they write: nothing of another kind is replaced, and nothing unasked."""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from granular_id._core import GranularIdError
from granular_id._files import JSON, MODELS, PAGES, PICTURES, TABLES, check_target
from granular_id._text import Table


def show(text: str, style: str = "", *, err: bool = False) -> None:
    """Print a text as it stands, without markup or wrapping."""
    Console(stderr=err).print(Text(text, style=style), soft_wrap=True)


def show_sentence(text: str, style: str = "") -> None:
    """Print a text without markup, on a terminal broken between words; elsewhere a line is a line."""
    console = Console()
    console.print(Text(text, style=style), soft_wrap=not console.is_terminal)


def warn_of_setups(differences: Iterable[str], *, err: bool = False) -> None:
    """Warn of what recordings or a sensor have otherwise than the training of a model."""
    from granular_id.recording import setup_mismatch

    for difference in differences:
        show(f"warning: {setup_mismatch(difference)}", "bold yellow", err=err)


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
            justify: Literal["left", "right"] = "right" if i else "left"
            drawn.add_column(Text(name), justify=justify, no_wrap=tight, overflow="fold")
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


def write_files(*outputs: tuple[Path | None, Callable[[Path], object]]) -> None:
    """Write the files that were asked for, each by its function, and name them."""
    for path, write in outputs:
        if path is not None:
            write(path)
    say_written([path for path, _ in outputs])


def repeated_command() -> str:
    """Return what to type to repeat this run, by the name under which the program was started."""
    return shlex.join([*_program(), *sys.argv[1:]])


def typed_command(*words: object) -> str:
    """Return what to type for another command, by the name under which the program was started."""
    return shlex.join([*_program(), *map(str, words)])


def _program() -> list[str]:
    started = Path(sys.argv[0])
    if started.name in {"granular-id", "granular-id.exe"}:
        found = shutil.which(started.name)
        elsewhere = started.exists() and not (found and Path(found).samefile(started))
        return [str(started) if elsewhere else started.name]
    by_package = started.name == "__main__.py" and started.parent.name == "granular_id"
    return ["python", "-m", "granular_id" if by_package else "granular_id.cli"]


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

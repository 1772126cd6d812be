"""What commands print, on one screen, and the checks of what they write: nothing unasked is replaced."""

from __future__ import annotations

import re
import shlex
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from granular_id._core import GranularIdError
from granular_id._files import (
    JSON,
    MODELS,
    PAGES,
    PICTURES,
    RECORDINGS,
    TABLES,
    check_source,
    check_target,
    write_json,
)
from granular_id._text import Table, counted

COLUMNS = 80
"""No line is wider, piped or not, unless a single word is."""

ROOM = 20
"""Of a screen of 24 lines: what is left below the 4 in which a command says what it has read."""

_LEAST_ROWS = 3


def show(
    text: str, style: str = "", *, err: bool = False, most: int | None = None, rest: str = "--details"
) -> int:
    """Print a text without markup, broken between words; of more than `most` lines the first, and what has the rest.

    Return how many lines it took.
    """
    console = Console(stderr=err)
    width = min(COLUMNS, console.width)
    lines: list[str] = []
    for line in text.splitlines() or [""]:
        lines += [line] if len(line) <= width else _broken(line, width)
    if most is not None and len(lines) > most:
        n_more, below = len(lines) - most + 1, list[str]()
        if len(rest) > width - len(f"... {n_more} more lines: "):
            below, rest = _broken(rest, width), ""
        more = f"... {n_more + len(below)} more lines{':' * bool(rest or below)} {rest}".rstrip()
        lines[max(2, most - 1 - len(below)) :] = [more, *below]
    console.print(Text("\n".join(lines), style=style), soft_wrap=True)
    return len(lines)


def _broken(line: str, width: int) -> list[str]:
    """Break a line; one that is to be typed goes on after a backslash, and code in quotes is whole."""
    if line.startswith("python -c "):
        return [line]
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    typed = line.lstrip().startswith("granular-id ")
    if typed:  # a shell takes a break within quotes for part of the word
        line = re.sub(r"'[^']*'|\"[^\"]*\"", lambda quoted: quoted[0].replace(" ", "\0"), line)
    pieces = textwrap.wrap(
        line, width - 2 * typed, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )
    pieces = [piece.replace("\0", " ") for piece in pieces]
    return [*(piece + " \\" * typed for piece in pieces[:-1]), pieces[-1]]


def warn_of_setups(differences: Iterable[str], *, err: bool = False) -> None:
    """Warn of what recordings or a sensor have otherwise than the training of a model."""
    from granular_id.recording import setup_mismatch

    for difference in differences:
        show(f"warning: {setup_mismatch(difference)}", "bold yellow", err=err)


def print_table(table: Table, *, strong: bool = False, details: bool = True, room: int = ROOM) -> int:
    """Print one table with its title above and its notes below, without details on `room` lines by its first rows.

    Return how many lines it took.
    """
    n_lines, rows = show(table.title, "bold yellow" if strong else "bold"), table.rows
    room -= n_lines + 1 + sum(len(note) // COLUMNS + 1 for note in table.notes)
    if not details:  # a row takes a line or more, and drawing takes time
        rows = rows[: max(room, _LEAST_ROWS)]
    drawn = _drawn(table, rows)
    while not details and len(rows) > _LEAST_ROWS and len(drawn) > room:
        rows = rows[:-1]
        drawn = _drawn(table, rows)
    if rows:
        n_lines += show("\n".join(drawn))
    n_more = len(table.rows) - len(rows)
    more = [f"... {counted(n_more, 'more row')}: --details"] * bool(n_more)
    return n_lines + sum(show(note) for note in (*more, *table.notes))


def _drawn(table: Table, rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Draw header and rows of a table, as text."""
    console = Console(highlight=False)
    console.width = min(COLUMNS, console.width)
    looks: dict[str, Any] = {"box": box.SIMPLE_HEAD, "show_edge": False, "pad_edge": False}
    drawn = RichTable(**looks, padding=(0, 0, 0, 1), header_style="none")
    for i, name in enumerate(table.header):
        justify: Literal["left", "right"] = "right" if i else "left"
        drawn.add_column(Text(name), justify=justify, overflow="fold")
    for row in rows:
        drawn.add_row(*(Text(cell) for cell in row))
    with console.capture() as captured:
        console.print(drawn)
    return [line.rstrip() for line in captured.get().splitlines()]


def write_files(*outputs: tuple[Path | None, Callable[[Path], object]]) -> None:
    """Write the files that were requested, each by its function, and name them."""
    for path, write in outputs:
        if path is not None:
            write(path)
            show(f"wrote {path}")


def drawing(name: str, *given: Any, **options: Any) -> Callable[[Path], None]:
    """Return what draws a figure into a file, with a function of `granular_id.plotting`, slow to import."""

    def draw(path: Path) -> None:
        from granular_id import plotting

        getattr(plotting, name)(*given, path=path, **options)

    return draw


def repeated_command() -> str:
    """Return what to type to repeat this run, by the name under which the program was started."""
    started = Path(sys.argv[0]).name
    program = ["granular-id"] if started.startswith("granular-id") else ["python", "-m", "granular_id"]
    return shlex.join([*program, *sys.argv[1:]])


# Files, checked before any work.


class Kind(NamedTuple):
    """A kind of output: its name, the endings it may have, and a pattern of what only files written here hold."""

    name: str
    endings: tuple[str, ...]
    mark: bytes


def json_of(name: str) -> Kind:
    """Return the kind of the JSON files of a command: their first entry is their format."""
    return Kind(
        f"a JSON file (granular_id.{name})", JSON, rb'\s*\{\s*"format": "granular_id\.%s/' % name.encode()
    )


def numbers(name: str, content: Callable[[], Mapping[str, object]]) -> Callable[[Path], None]:
    """Return what writes such a file."""
    return lambda path: write_json(path, {"format": f"granular_id.{name}/1", **content()})


PAGE = Kind("a report", PAGES, rb'<!doctype html>.*<meta name="generator" content="granular_id ')
MODEL = Kind("a model", MODELS, rb'.{8}\{"__metadata__":\{.*"format":"granular_id\.identifier"')
PREDICTIONS = Kind("a table of predictions", TABLES, b"space,fold,row,recording,session,label,predicted,")
ANSWERS = Kind("a table of answers", TABLES, b"recording,(label,margin|from_s,to_s,label),")
LIVE_ANSWERS = json_of("live")._replace(endings=(".jsonl", ".ndjson", *JSON))
DATA_SET = Kind(
    "a data set", (".npz",), rb"PK.{28}format\.npy.*" + re.escape("granular_id".encode("utf-32-le"))
)
PICTURE = Kind(
    "a picture of granular-id",
    PICTURES,
    rb"(\x89PNG.*Software\0|%PDF.*/Creator \(|<\?xml.*<dc:title>)granular_id",
)

_MARKED_BYTES = 1 << 16
"""At the beginning and at the end of a file: there its mark stands, whatever its size."""

Output = tuple[str, Path | None, Kind]
"""An option, the file that it names, and what will be written there; None is no file."""


def check_outputs(*outputs: Output, source: Path | None = None, force: bool = False) -> None:
    """Refuse, before any work, a `source` that is not there, and outputs that are not what they say, or not to be lost.

    These are: what cannot be written, belongs to `source`, which is read, or would be written twice; a name that ends
    like no file of its kind; a file that no such command has written; without `force` any file that is not empty.
    """
    named = [(name, check_target(path), kind) for name, path, kind in outputs if path is not None]
    _refuse_overlaps([path for _, path, _ in named], source)
    for name, path, kind in named:
        # rice_0.5 is no kind of file; the ending of a picture chooses its format
        plain = kind is not PICTURE and not re.search("[a-z]", path.suffix.lower())
        if path.suffix.lower() not in kind.endings and not plain:
            wanted = " or ".join(kind.endings) + ", or have no ending" * (kind is not PICTURE)
            raise GranularIdError(f"{name} writes {kind.name}: it must end in {wanted}, got {path.name!r}")
    for name, path, kind in named:
        if not path.exists() or not path.stat().st_size:
            continue
        if not _is_of(kind, path):
            raise GranularIdError(f"{name} {path}: what is there is not {kind.name}; give another name")
        if not force:
            raise FileExistsError(f"{name} {path}: there is such a file already; add --force to replace it")
    if source is not None:
        check_source(source)


def _is_of(kind: Kind, path: Path) -> bool:
    """Whether a file holds the mark of its kind."""
    with path.open("rb") as stream:
        held = stream.read(_MARKED_BYTES)
        stream.seek(max(len(held), path.stat().st_size - _MARKED_BYTES))
        held += stream.read(_MARKED_BYTES)
    return re.match(kind.mark, held, re.IGNORECASE | re.DOTALL) is not None


def _refuse_overlaps(targets: list[Path], source: Path | None) -> None:
    places = [target.resolve() for target in targets]
    for k, place in enumerate(places):
        if place in places[:k]:
            raise GranularIdError(f"{targets[k]} would be written twice: give each output a file of its own")
        if source is None or source.resolve() not in (place, *place.parents):
            continue
        # A report or a model that an earlier run wrote there is no recording.
        if place == source.resolve() or place.suffix.lower() in RECORDINGS:
            how = "belongs to" if place.exists() else "would be taken for a recording of"
            raise GranularIdError(f"{targets[k]} {how} {source}, which is read: give the output another name")

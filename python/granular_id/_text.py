"""Text: numbers, plurals, lists, shares as per cent, and tables."""

from __future__ import annotations

import ast
import math
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from types import MappingProxyType
from typing import Any


def counted(number: int, noun: str = "recording") -> str:
    """Return a number with its noun."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def fixed(value: float, decimals: int = 0) -> str:
    """Return a number with so many decimals, or in powers of ten where that were a row of digits."""
    if abs(value) < 1e12 and decimals <= 15:
        return f"{value:.{decimals}f}"
    # A whole number may be beyond float64.
    return f"{Decimal(value) if isinstance(value, int) else value:.4g}"


def listed(words: Sequence[str]) -> str:
    """Return words with commas, and an "and" before the last."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def verb(number: int, singular: str, plural: str) -> str:
    """Choose the form of a verb."""
    return singular if number == 1 else plural


def whole_percent(value: float) -> str:
    """Round so that neither the last error of a class nor its only hit is hidden."""
    if 0.0 < value < 1.0:
        return "<1"
    if 99.0 < value < 100.0:
        return ">99"
    return f"{value:.0f}"


def in_columns(rows: Sequence[Sequence[str]], *, right: bool = False) -> list[str]:
    """Lay out rows of text in columns: the first to the left, the others to the left or right; lines of one length."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        padded = [cell.rjust(w) if right else cell.ljust(w) for cell, w in zip(cells, widths, strict=True)]
        return "  ".join((cells[0].ljust(widths[0]), *padded[1:]))

    return [line(row) for row in rows]


@dataclass(frozen=True)
class Table:
    """A title, a header, rows of text (first column left, others right aligned) and notes below."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        lines = in_columns((self.header, *self.rows), right=True)
        rule = "-" * len(lines[0])
        header, *rows = (line.rstrip() for line in lines)
        return "\n".join((self.title, rule, header, rule, *rows, rule, *self.notes))


def percent(share: float | None, digits: int = 1) -> str:
    """Format a share of 1 as percent; ``-`` when there is none."""
    return "-" if share is None or math.isnan(share) else f"{100 * share:.{digits}f} %"


def points(difference: float) -> str:
    """Format a difference of shares in points; the last bit of a mean decides nothing."""
    return f"{round(100 * difference, 9) + 0.0:.1f}"


def short(text: str, most: int = 24) -> str:
    """Shorten a long name in the middle: names of a series differ at their ends."""
    tail = (most - 1) // 2
    return text if len(text) <= most else f"{text[: most - 1 - tail]}…{text[-tail:]}"


def known_label(name: str, known: Iterable[str]) -> str:
    """Return the known label that is meant: one with blanks may be typed with underscores; else the name as it is."""
    every = list(known)
    alike = [label for label in every if label.replace(" ", "_") == name.replace(" ", "_")]
    return alike[0] if name not in every and len(alike) == 1 else name


class Unknown(str):
    """What stands for a value that only the user knows: it is printed as it is, and no command is made of it."""

    __slots__ = ()
    __repr__ = str.__str__


RATE, UNITS = Unknown("RATE"), Unknown("UNITS")


class WayOut(str):
    """A way out as a message says it: `options`, or `code` that makes ``data``, and `why` it may be so."""

    options: Mapping[str, Any] = MappingProxyType({})
    code: str = ""
    why: str = ""

    @property
    def plain(self) -> str:
        """The words without those of the command line."""
        return ", ".join(f"{name}={value!r}" for name, value in self.options.items())


def in_both(**options: Any) -> WayOut:
    """Name options of `load` as in Python and, in brackets, as typed: ``csv={'skiprows': 7} (--csv skiprows=7)``."""
    bracketed = typed(**options)
    way = WayOut(f"{bracketed.plain} {bracketed}".removesuffix(" ()"))
    way.options = options
    return way


def typed(**options: Any) -> WayOut:
    """Name options of ``data convert``, in brackets: ``(--resample-hz 500)``."""
    way = WayOut(f"({command_words(options)})")
    way.options = options
    return way


def is_unknown(options: Mapping[str, Any]) -> bool:
    """Whether a value is one that only the user knows."""
    return any(isinstance(value, Unknown) for value in options.values())


def alternatives(ways: Iterable[str]) -> list[str]:
    """Put an "or" between ways out, as parts of a message."""
    return [part for way in ways for part in (" or ", way)][1:]


def command_words(options: Mapping[str, Any]) -> str:
    """Return options, called as those of `load`, as they are typed."""
    words = []
    for name, value in options.items():
        if isinstance(value, Mapping):
            texts = [f"{key}={_typed(each)}" for key, each in value.items()]
        elif isinstance(value, (list, tuple)):
            texts = [",".join(map(str, value))]
        else:
            texts = [f"{value:.9g}" if isinstance(value, float) else str(value)]
        if name != PYTHON_ONLY:
            option = _OPTIONS.get(name, name.replace("_", "-"))
            words += [f"--{option} {shlex.quote(text)}" for text in texts]
    return " ".join(words)


PYTHON_ONLY = "on_time_error"
"""What `load` takes, and no command."""

_OPTIONS = {"rate_hz": "recorded-hz"}
"""Options that are not called like the argument of `load`."""


def _typed(value: Any) -> str:
    """Return a value of `--csv`, which is one of Python where it looks so, else a text."""
    try:
        is_text = isinstance(value, str) and ast.literal_eval(value) is None
    except (ValueError, SyntaxError):
        is_text = isinstance(value, str)
    written = repr(value)
    return str(value) if is_text else written if '"' in written else written.replace("'", '"')


def install(extra: str) -> str:
    """Return what to type to install the libraries of an extra, by their names: it works however this copy came here.

    ``granular-id[app]`` would ask an index for the package itself, which may be on none.
    """
    from importlib.metadata import PackageNotFoundError, requires

    try:
        stated = requires("granular-id") or []
    except PackageNotFoundError:  # a copy of the files alone
        stated = []
    marked = re.compile(rf"extra\s*==\s*['\"]{re.escape(extra)}['\"]")
    libraries = [line.partition(";")[0].strip() for line in stated if marked.search(line)]
    return (
        f"pip install {shlex.join(libraries)}" if libraries else f"see the extra {extra!r} in pyproject.toml"
    )

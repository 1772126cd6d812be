"""Numbers as texts write them, words that agree with what they count, and lists."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING


def counted(number: int, noun: str = "recording") -> str:
    """Return a number with its noun.

    Examples
    --------
    >>> from granular_id._text import counted
    >>> counted(1), counted(3, "label")
    ('1 recording', '3 labels')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"


def fixed(value: float, decimals: int = 0, sign: str = "") -> str:
    """Return a number with so many decimals, or in powers of ten where that were a row of digits.

    Parameters
    ----------
    value : float
    decimals : int, default 0
    sign : str
        "+": with its sign.

    Examples
    --------
    >>> from granular_id._text import fixed
    >>> fixed(12.345, 1), fixed(1e300, 1), fixed(2, 0, "+")
    ('12.3', '1e+300', '+2')
    """
    if abs(value) < 1e12 and decimals <= 15:
        return f"{value:{sign}.{decimals}f}"
    # A whole number may be beyond float64.
    return f"{Decimal(value) if isinstance(value, int) else value:{sign}.4g}"


def listed(words: Sequence[str]) -> str:
    """Return words with commas, and an "and" before the last.

    Examples
    --------
    >>> from granular_id._text import listed
    >>> listed([]), listed(["a"]), listed(["a", "b", "c"])
    ('', 'a', 'a, b and c')
    """
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def verb(number: int, singular: str, plural: str) -> str:
    """Choose the form of a verb.

    Examples
    --------
    >>> from granular_id._text import verb
    >>> verb(1, "has", "have")
    'has'
    """
    return singular if number == 1 else plural


# Per cent without digits, for cells of a matrix.


def whole_percent(value: float) -> str:
    """Round so that neither the last error of a class nor its only hit is hidden.

    Parameters
    ----------
    value : float
        Per cent, in (0, 100].

    Returns
    -------
    str

    Examples
    --------
    >>> whole_percent(0.2), whole_percent(87.5), whole_percent(99.7), whole_percent(100.0)
    ('<1', '88', '>99', '100')
    """
    if value < 1.0:
        return "<1"
    if 99.0 < value < 100.0:
        return ">99"
    return f"{value:.0f}"


# Tables of text, and shares as per cent.

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class Table:
    """A title, a header, rows of text (first column left, others right aligned) and notes below."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        widths = [max(len(row[i]) for row in (self.header, *self.rows)) for i in range(len(self.header))]

        def line(cells: tuple[str, ...]) -> str:
            first = cells[0].ljust(widths[0])
            rest = (cell.rjust(width) for cell, width in zip(cells[1:], widths[1:], strict=True))
            return "  ".join((first, *rest)).rstrip()

        rule = "-" * (sum(widths) + 2 * (len(widths) - 1))
        return "\n".join(
            (self.title, rule, line(self.header), rule, *map(line, self.rows), rule, *self.notes)
        )


def percent(share: float | None, digits: int = 1) -> str:
    """Format a share of 1 as percent; ``-`` when there is none."""
    return "-" if share is None or math.isnan(share) else f"{100 * share:.{digits}f} %"


def short(text: str, most: int = 24) -> str:
    """Shorten a long name in the middle: names of a series differ at their ends.

    Examples
    --------
    >>> short("sunflower seeds"), short("sunflower seeds, roasted and salted", 20)
    ('sunflower seeds', 'sunflower …nd salted')
    """
    tail = (most - 1) // 2
    return text if len(text) <= most else f"{text[: most - 1 - tail]}…{text[-tail:]}"

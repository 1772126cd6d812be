"""Numbers as texts write them, words that agree with what they count, and lists."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

__all__ = ["counted", "fixed", "listed", "verb"]


def counted(number: int, noun: str = "recording") -> str:
    """Return a number with its noun.

    Examples
    --------
    >>> from granular_id._words import counted
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
    >>> from granular_id._words import fixed
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
    >>> from granular_id._words import listed
    >>> listed([]), listed(["a"]), listed(["a", "b", "c"])
    ('', 'a', 'a, b and c')
    """
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def verb(number: int, singular: str, plural: str) -> str:
    """Choose the form of a verb.

    Examples
    --------
    >>> from granular_id._words import verb
    >>> verb(1, "has", "have")
    'has'
    """
    return singular if number == 1 else plural

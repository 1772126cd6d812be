"""Numbers and verbs that agree with what they count, and lists."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["counted", "listed", "verb"]


def counted(number: int, noun: str = "recording") -> str:
    """Return a number with its noun.

    Examples
    --------
    >>> from granular_id._words import counted
    >>> counted(1), counted(3, "label")
    ('1 recording', '3 labels')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"


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

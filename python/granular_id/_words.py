"""Numbers and verbs that agree with what they count."""

from __future__ import annotations

__all__ = ["counted", "verb"]


def counted(number: int, noun: str = "recording") -> str:
    """Return a number with its noun.

    Examples
    --------
    >>> from granular_id._words import counted
    >>> counted(1), counted(3, "label")
    ('1 recording', '3 labels')
    """
    return f"{number} {noun}{'' if number == 1 else 's'}"


def verb(number: int, singular: str, plural: str) -> str:
    """Choose the form of a verb.

    Examples
    --------
    >>> from granular_id._words import verb
    >>> verb(1, "has", "have")
    'has'
    """
    return singular if number == 1 else plural

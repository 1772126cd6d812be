"""JSON in files from outside: how much of it becomes objects, told before any does."""

from __future__ import annotations

from collections.abc import Iterable

_MOST_PARTS = 200_000
"""Lists, objects and eighths of items; each takes about 100 bytes and 4 microseconds to become a frozen tree."""

_PARTS_PER_RECORDING = 64
_ITEMS_PER_PART = 8


def check_parts(texts: Iterable[str], name: str, n_recordings: int = 0) -> None:
    """Refuse JSON that would become many times its size in memory: ``[{},{},{}, ...]`` becomes thirty times.

    Parameters
    ----------
    texts : iterable of str
        All that is about to be parsed.
    name : str
        What errors call it.
    n_recordings : int
        Recordings that it describes: of many, more may be said.

    Raises
    ------
    ValueError
        More than 200,000 lists and objects, and more than 64 for each recording; an item of them counts an eighth.

    Examples
    --------
    >>> check_parts(['{"tool": "cylinder"}'], "meta")
    >>> check_parts(["[" + "{}," * 300_000 + "{}]"], "meta")
    Traceback (most recent call last):
    ...
    ValueError: meta holds 300002 lists and objects with 300000 items; wanted at most 200000 lists and objects
    """
    parts = items = 0
    for text in texts:
        parts += text.count("{") + text.count("[")
        items += text.count(",") + text.count(":")
    most = max(_MOST_PARTS, _PARTS_PER_RECORDING * n_recordings)
    if parts + items // _ITEMS_PER_PART > most:
        came = f"{name} holds {parts} lists and objects with {items} items"
        raise ValueError(f"{came}; wanted at most {most} lists and objects")

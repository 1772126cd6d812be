"""JSON in files from outside: how much of it becomes objects, told before any does."""

from __future__ import annotations

from collections.abc import Iterable

_MOST_PARTS = 200_000
"""Lists, objects and eighths of items; each takes about 100 bytes and 4 microseconds to become a frozen tree."""

_PARTS_PER_RECORDING = 64
_ITEMS_PER_PART = 8


def check_parts(texts: Iterable[str], name: str, n_recordings: int = 0) -> None:
    """Refuse JSON that would become many times its size in memory: ``[{},{},{}, ...]`` becomes thirty times."""
    parts = items = 0
    for text in texts:
        parts += text.count("{") + text.count("[")
        items += text.count(",") + text.count(":")
    most = max(_MOST_PARTS, _PARTS_PER_RECORDING * n_recordings)
    if parts + items // _ITEMS_PER_PART > most:
        came = f"{name} holds {parts} lists and objects with {items} items"
        raise ValueError(f"{came}; wanted at most {most} lists and objects")

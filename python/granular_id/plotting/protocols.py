"""What a protocol is called in front of a reader, and how it looks in a figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from granular_id.evaluation import EvaluationResult
    from granular_id.evaluation.partitions import Partition

__all__ = ["Look", "looks", "protocol_name"]

_NAMES = {
    "paper": "random partitions",
    "session": "held-out sessions",
    "chronological": "halves in time order",
    "kfold": "random folds",
}
_MARKS = {
    "paper": ("#0072B2", "o"),
    "session": ("#D55E00", "s"),
    "chronological": ("#CC79A7", "D"),
    "kfold": ("#009E73", "^"),
}


class Look(NamedTuple):
    """Name for a reader, Okabe & Ito's colour, and a marker, so that colour is never alone."""

    name: str
    colour: str
    marker: str


def protocol_name(protocol: str, partitions: Sequence[Partition]) -> str:
    """Name a protocol in words; blocks in time that stand in for sessions are called blocks."""
    if protocol == "session" and partitions and partitions[0].description.startswith("block"):
        return "blocks in time order"
    return _NAMES.get(protocol, protocol)


def looks(result: EvaluationResult) -> dict[str, Look]:
    """Return name, colour and marker of each protocol that ran, in order."""
    return {
        protocol: Look(protocol_name(protocol, partitions), *_MARKS.get(protocol, ("#666666", "v")))
        for protocol, partitions in result.partitions.items()
    }

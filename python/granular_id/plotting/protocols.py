"""How a protocol looks in a figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from granular_id.evaluation.protocol_names import protocol_name

if TYPE_CHECKING:
    from granular_id.evaluation import EvaluationResult

__all__ = ["Look", "looks"]

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


def looks(result: EvaluationResult) -> dict[str, Look]:
    """Return name, colour and marker of each protocol that ran, in order."""
    return {
        protocol: Look(protocol_name(protocol, partitions), *_MARKS.get(protocol, ("#666666", "v")))
        for protocol, partitions in result.partitions.items()
    }

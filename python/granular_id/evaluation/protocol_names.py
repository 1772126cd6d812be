"""What protocols and their partitions are called in front of a reader."""

from __future__ import annotations

from collections.abc import Sequence

from granular_id.evaluation.partition import Partition

__all__ = ["are_blocks", "block_name", "protocol_name"]

_NAMES = {
    "paper": "random partitions",
    "session": "held-out sessions",
    "chronological": "halves in time order",
    "kfold": "random folds",
}


def block_name(block: int, n_blocks: int) -> str:
    """Describe the partition that holds out a block in time, `block` counted from 0."""
    return f"block {block + 1} of {n_blocks}"


def are_blocks(partitions: Sequence[Partition]) -> bool:
    """Whether the partitions of a protocol hold out blocks in time, and not sessions, whatever those are called."""
    return [partition.description for partition in partitions] == [
        block_name(block, len(partitions)) for block in range(len(partitions))
    ]


def protocol_name(protocol: str, partitions: Sequence[Partition]) -> str:
    """Name a protocol in words; blocks in time that stand in for sessions are called blocks.

    Examples
    --------
    >>> from granular_id.evaluation.partitions import block_partitions, session_partitions
    >>> y = ["oat", "rice", "oat", "rice"]
    >>> protocol_name("session", session_partitions(y, ["block 1", "block 1", "block 2", "block 2"]))
    'held-out sessions'
    >>> protocol_name("session", block_partitions(y, range(4), n_folds=2))
    'blocks in time order'
    """
    if protocol == "session" and are_blocks(partitions):
        return "blocks in time order"
    return _NAMES.get(protocol, protocol)

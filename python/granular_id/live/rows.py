"""Rows as they leave a buffer, cut and joined: what captures and triggers look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from granular_id.recording import SampleFlag

__all__ = ["BlockLike", "Rows"]

_COLUMNS = ("wrench", "time_s", "host_ns", "flags", "missing_before")


class BlockLike(Protocol):
    """What `WrenchReader.read` returns, as far as a capture needs it."""

    @property
    def wrench(self) -> NDArray[np.float64]:
        """N and N m, shape (n, 6)."""

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Device time, shape (n,)."""

    @property
    def host_ns(self) -> NDArray[Any]:
        """When each row came in, by the host's monotonic clock, shape (n,)."""

    @property
    def flags(self) -> NDArray[np.uint8]:
        """Bits of `SampleFlag`, shape (n,)."""

    @property
    def missing_before(self) -> NDArray[Any]:
        """Instants without a row since the row before, shape (n,)."""

    @property
    def epoch(self) -> int:
        """How often device time has begun anew; one value for the whole block."""

    @property
    def missed(self) -> int:
        """Rows overwritten before this block, because it was read too late."""

    def __len__(self) -> int: ...


@dataclass(frozen=True)
class Rows:
    """Some rows in order: a piece of one block, or several joined.

    Attributes
    ----------
    wrench : ndarray, shape (n, 6)
    time_s : ndarray, shape (n,)
        Device time.
    host_ns : ndarray of int64, shape (n,)
        When each row came in.
    flags : ndarray of uint8, shape (n,)
    missing_before : ndarray of int64, shape (n,)
    """

    wrench: NDArray[np.float64]
    time_s: NDArray[np.float64]
    host_ns: NDArray[np.int64]
    flags: NDArray[np.uint8]
    missing_before: NDArray[np.int64]

    @classmethod
    def of(cls, block: BlockLike) -> Rows:
        """Take the rows of a block."""
        return cls(
            block.wrench,
            block.time_s,
            np.asarray(block.host_ns).astype(np.int64),
            block.flags,
            np.asarray(block.missing_before).astype(np.int64),
        )

    @classmethod
    def none(cls) -> Rows:
        """Return no rows."""
        empty = np.zeros(0)
        return cls(
            np.zeros((0, 6)), empty, empty.astype(np.int64), empty.astype(np.uint8), empty.astype(np.int64)
        )

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """Put parts behind one another."""
        if not parts:
            return cls.none()
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS))

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, rows: slice) -> Rows:
        return Rows(*(getattr(self, name)[rows] for name in _COLUMNS))

    def has(self, flag: SampleFlag) -> NDArray[np.bool_]:
        """Tell for each row whether it carries a flag, shape (n,)."""
        carried: NDArray[np.bool_] = (self.flags & np.uint8(flag)) != 0
        return carried


def filled(before: Rows, rows: Rows, max_gap: int) -> Rows:
    """Put a straight line into gaps of at most `max_gap` instants, flagged ``GAP_FILLED``.

    What is saturated or of bad status at either end is so in between.

    Parameters
    ----------
    before : Rows
        The row before the first one; none at all where nothing may be joined to it.
    rows : Rows
    max_gap : int

    Returns
    -------
    Rows
        With the filled instants in between; longer gaps stay as they are.
    """
    small = (rows.missing_before > 0) & (rows.missing_before <= max_gap)
    if not len(before) and len(small):
        small[0] = False
    where = np.flatnonzero(small)
    if not len(where):
        return rows
    line = Rows.joined([before, rows])
    shift = len(before)
    parts, done = [], 0
    for at in where.tolist():
        left, right = line[at + shift - 1 : at + shift], line[at + shift : at + shift + 1]
        parts += [rows[done:at], _between(left, right, int(rows.missing_before[at]))]
        done = at
    parts.append(rows[done:])
    whole = Rows.joined(parts)
    still = whole.missing_before > max_gap
    return Rows(
        whole.wrench, whole.time_s, whole.host_ns, whole.flags, np.where(still, whole.missing_before, 0)
    )


_PASSED_ON = np.uint8(SampleFlag.SATURATED | SampleFlag.BAD_STATUS)


def _between(left: Rows, right: Rows, n: int) -> Rows:
    share = np.arange(1, n + 1) / (n + 1)
    return Rows(
        left.wrench + share[:, np.newaxis] * (right.wrench - left.wrench),
        left.time_s + share * (right.time_s - left.time_s),
        np.repeat(right.host_ns, n),
        np.repeat((left.flags | right.flags) & _PASSED_ON | np.uint8(SampleFlag.GAP_FILLED), n),
        np.zeros(n, dtype=np.int64),
    )

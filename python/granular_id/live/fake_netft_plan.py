"""Records of the fake box on their way into datagrams, and what happens to them there."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id.live.fake_netft_faults import FATES, STATUSES, Faults, Injected

__all__ = ["RECORD", "Datagram", "FaultPlan"]

RECORD = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("counts", ">i4", (6,))])
"""A record as it is sent, 36 bytes."""

MALFORMED_BYTES = (0, 1, 8, 35, 37, 71, 73, 1439, 1441, 1476)
"""Lengths that no datagram of 1 to 40 records has."""

PROTECTED = 3
"""Datagrams left alone at the beginning and end of a stream: what is lost at its end, nobody can count."""


class Datagram(NamedTuple):
    """Bytes to be sent when the record with number `due` (from 0) is taken."""

    due: int
    delay_s: float
    data: bytes | memoryview


class FaultPlan:
    """Turns the records of a box into datagrams, with faults.

    Parameters
    ----------
    faults : Faults
    step : int
        Samples of the sensor per record.
    first_ft : int
        Number of the first sample.
    per_datagram : int, default 1
        Records in each.
    n_records : int, optional
        Length of the stream; the last datagrams are left alone.
    seed : int, default 0
    injected : Injected, optional
        Counts to go on with.
    """

    def __init__(
        self,
        faults: Faults,
        *,
        step: int,
        first_ft: int,
        per_datagram: int = 1,
        n_records: int | None = None,
        seed: int = 0,
        injected: Injected | None = None,
    ) -> None:
        self.faults, self.step, self.per_datagram, self.n_records = faults, step, per_datagram, n_records
        self.injected = Injected() if injected is None else injected
        self._rng = np.random.default_rng(seed)
        self._rdt, self._ft = 1, first_ft
        if faults.wrap:
            self._rdt, self._ft = 2**32 - faults.wrap, 2**32 - faults.wrap * step + step // 2
        self._n = 0
        self._of_stream = 0
        self._held: bytes | None = None
        self._before = ""
        self._shares = np.cumsum([getattr(faults, name) for name in FATES])
        self._is_plain = not (
            self._shares[-1] or faults.jitter_s or any(getattr(faults, n) for n in STATUSES)
        )

    @property
    def next_ft(self) -> int:
        """Number of the sample of the next record."""
        return self._ft

    def datagrams(self, counts: NDArray[np.int32]) -> Iterator[Datagram]:
        """Give records their numbers, and what happens to them on the way.

        Parameters
        ----------
        counts : ndarray of int32, shape (n, 6)
            `per_datagram` to each; only the last datagram of a stream may have fewer.
        """
        for start in range(0, len(counts), self.per_datagram):
            part = counts[start : start + self.per_datagram]
            if self.faults.restart and self._of_stream and self._of_stream % self.faults.restart == 0:
                self._restart()
            records = self._numbered(part)
            due = self._n - 1
            if self._is_plain:
                self.injected.sent += len(records)
                yield Datagram(due, 0.0, records.tobytes())
            else:
                yield from self._send(due, records)

    def _numbered(self, counts: NDArray[np.int32]) -> NDArray[np.void]:
        n = len(counts)
        records = np.zeros(n, RECORD)
        ahead = np.arange(n, dtype=np.int64)
        records["rdt"] = (self._rdt + ahead) % 2**32
        records["ft"] = (self._ft + ahead * self.step) % 2**32
        records["counts"] = counts
        self._rdt, self._ft = (self._rdt + n) % 2**32, (self._ft + n * self.step) % 2**32
        self._n += n
        self._of_stream += n
        return records

    def _restart(self) -> None:
        self.injected.restarts += 1
        # power comes and goes: the sensor counts anew, and never twice from the same sample
        self._rdt, self._ft = 1, 3 * self.injected.restarts
        self._of_stream = 0

    def _is_protected(self, n: int) -> bool:
        margin = PROTECTED * self.per_datagram
        left = self.n_records - self._n if self.n_records is not None else margin
        if self.faults.restart:
            left = min(left, self.faults.restart - self._of_stream)
        return self._of_stream - n < margin or left < margin

    def _send(self, due: int, records: NDArray[np.void]) -> Iterator[Datagram]:
        n = len(records)
        fate = "" if self._is_protected(n) else self._fate()
        # the sample of a record that was not seen right before would be a new one
        if fate == "stale" and self._before:
            fate = ""
        if fate == "stale":
            records["ft"][0] = (int(records["ft"][0]) - self.step) % 2**32
            self.injected.stale += 1
        elif fate != "loss":
            self._mark(records)
        self._before = fate
        delay_s = self._delay()
        data = records.tobytes()
        if fate == "loss":
            self.injected.lost += n
            return
        self.injected.sent += n
        if fate == "reorder" and self._held is None:
            self.injected.reordered += n
            self._held = data
            return
        if fate == "garbage":
            self.injected.malformed += 1
            yield Datagram(due, delay_s, self._rng.bytes(int(self._rng.choice(MALFORMED_BYTES))))
        if fate == "forged":
            self.injected.implausible += 1
            yield Datagram(due, delay_s, self._forged(records))
        if fate == "absurd":
            self.injected.out_of_range += 1
            yield Datagram(due, delay_s, data[:12] + struct.pack(">6i", *[2**31 - 2] * 6))
        yield Datagram(due, delay_s, data)
        if self._held is not None:
            yield Datagram(due, delay_s, self._held)
            self._held = None
        if fate == "duplicate":
            self.injected.duplicates += n
            yield Datagram(due, delay_s, data)

    def _fate(self) -> str:
        drawn = int(np.searchsorted(self._shares, self._rng.random(), side="right"))
        return FATES[drawn] if drawn < len(FATES) else ""

    def _mark(self, records: NDArray[np.void]) -> None:
        shares = np.cumsum([getattr(self.faults, name) for name in STATUSES])
        if not shares[-1]:
            return
        words = np.array([*STATUSES.values(), 0], dtype=np.uint32)
        drawn = np.searchsorted(shares, self._rng.random(len(records)), side="right")
        records["status"] = words[drawn]
        bad, saturated, warnings, _ = np.bincount(drawn, minlength=len(words))
        # a saturated record has the bit of an error too
        self.injected.bad_status += int(bad + saturated)
        self.injected.saturated += int(saturated)
        self.injected.warnings += int(warnings)

    def _delay(self) -> float:
        if not self.faults.jitter_s:
            return 0.0
        self.injected.delayed += 1
        return float(self._rng.uniform(0, self.faults.jitter_s))

    def _forged(self, records: NDArray[np.void]) -> bytes:
        # half the numbers away, so that it cannot pass for a record by chance
        away = 2**31 + int(self._rng.integers(2**29))
        rdt, ft = ((int(records[name][0]) + away) % 2**32 for name in ("rdt", "ft"))
        return struct.pack(">3I", rdt, ft, 0) + bytes(24)

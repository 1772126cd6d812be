"""What goes wrong with the fake box, and how often it did: exact numbers to compare a client with."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import finite_number

__all__ = ["Faults", "Injected"]

_FATES = ("loss", "duplicate", "reorder", "stale", "garbage", "forged", "absurd")
"""Faults of a whole datagram, of which it has one at most."""

_STATUSES = {"bad_status": 0x8000_0001, "saturation": 0x8002_0000, "warning": 0x8001_0000}
"""Status words of a Net F/T: supply voltage, saturation, threshold latched."""

RECORD = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("counts", ">i4", (6,))])
"""A record as it is sent, 36 bytes."""

_MALFORMED_BYTES = (0, 1, 8, 35, 37, 71, 73, 1439, 1441, 1476)
"""Lengths that no datagram of 1 to 40 records has."""

_PROTECTED = 3
"""Datagrams left alone at the beginning and end of a stream: what is lost at its end, nobody can count."""


@dataclass(frozen=True)
class Faults:
    """What is to go wrong; all off by default.

    Parameters
    ----------
    loss, duplicate, reorder, stale, garbage, forged, absurd : float
        Share of datagrams that are lost, sent twice, sent after the next one, sent with the sample number of the
        record before; and before which a datagram of a wrong length, a record that continues nothing, or one with
        forces at the end of 32 bits is sent. At most one of these happens to a datagram.
    bad_status, saturation, warning : float
        Share of records with such a status word.
    jitter_s : float
        Datagrams are sent up to so much late, never out of order.
    drift : float
        The box's clock runs fast by this share: 1e-4 is 100 ppm.
    wrap : int
        Both sequence numbers wrap after so many records.
    restart : int
        The box starts anew after so many records, again and again.
    stall : int
        After so many records nothing is sent for `stall_s`, then everything at once.
    stall_s : float, default 0.3
    second_client : int
        After so many records another client has the stream.
    deaf : int
        So many requests for the stream are lost.

    Raises
    ------
    ValueError
        A number outside its range, or shares that add up to more than 1.

    Examples
    --------
    >>> from granular_id.testing import Faults
    >>> Faults.parse(["loss=0.01", "wrap=100"])
    Faults(loss=0.01, wrap=100)
    >>> Faults.parse(["los=0.01"])
    Traceback (most recent call last):
    ...
    ValueError: fault 'los=0.01' is none; known: loss, duplicate, reorder, stale, garbage, forged, absurd, \
bad_status, saturation, warning, jitter_s, drift, wrap, restart, stall, stall_s, second_client, deaf
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    stale: float = 0.0
    garbage: float = 0.0
    forged: float = 0.0
    absurd: float = 0.0
    bad_status: float = 0.0
    saturation: float = 0.0
    warning: float = 0.0
    jitter_s: float = 0.0
    drift: float = 0.0
    wrap: int = 0
    restart: int = 0
    stall: int = 0
    stall_s: float = 0.3
    second_client: int = 0
    deaf: int = 0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = finite_number(field.name, getattr(self, field.name))
            low, high = (-0.5, 0.5) if field.name == "drift" else (0.0, 1.0)
            if isinstance(field.default, int):
                if value < 0 or value != int(value):
                    raise ValueError(f"{field.name} must be a whole number of at least 0, got {value:g}")
                object.__setattr__(self, field.name, int(value))
            elif not low <= value <= high:
                raise ValueError(f"{field.name} must be from {low:g} to {high:g}, got {value:g}")
        for names in (_FATES, tuple(_STATUSES)):
            total = sum(getattr(self, name) for name in names)
            if total > 1:
                raise ValueError(f"{', '.join(names)} are shares and must add up to 1 at most, got {total:g}")

    @classmethod
    def parse(cls, texts: Iterable[str]) -> Faults:
        """Read ``name=value`` texts, as the command line gives them."""
        given: dict[str, float] = {}
        for text in texts:
            name, _, value = text.partition("=")
            known = [field.name for field in fields(cls)]
            if name not in known:
                raise ValueError(f"fault {text!r} is none; known: {', '.join(known)}")
            try:
                given[name] = float(value)
            except ValueError:
                raise ValueError(f"fault {text!r} has no number; wanted {name}=NUMBER") from None
        return cls(**given)  # type: ignore[arg-type]  # whole numbers are checked above

    def __repr__(self) -> str:
        changed = (f.name for f in fields(self) if getattr(self, f.name) != f.default)
        return f"Faults({', '.join(f'{name}={getattr(self, name)!r}' for name in changed)})"


@dataclass
class Injected:
    """What was sent and what went wrong, in the words of the client's counters.

    Attributes
    ----------
    lost, duplicates, reordered, stale, malformed, implausible, out_of_range : int
        Of the faults loss, duplicate, reorder, stale, garbage, forged and absurd of `Faults`.
    bad_status, saturated, warnings : int
        Records with such a status word.
    restarts, stalls : int
        How often the box started anew, and stalled.
    """

    sent: int = 0
    """Records that were sent at least once."""
    lost: int = 0
    duplicates: int = 0
    reordered: int = 0
    stale: int = 0
    malformed: int = 0
    implausible: int = 0
    out_of_range: int = 0
    bad_status: int = 0
    saturated: int = 0
    warnings: int = 0
    restarts: int = 0
    delayed: int = 0
    """Datagrams sent late on purpose, which no client can count."""
    stalls: int = 0

    @property
    def rows(self) -> int:
        """Records that a client is to hand on."""
        return self.sent - self.stale


class Datagram(NamedTuple):
    """Bytes to be sent when the record with number `due` (from 0) is taken."""

    due: int
    delay_s: float
    data: bytes


class RecordStream:
    """Numbers records, puts them into datagrams and lets happen to these what `faults` say."""

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
        self.injected = Injected() if injected is None else injected
        self.next_ft = first_ft
        self._faults, self._step, self._per_datagram, self._n_records = faults, step, per_datagram, n_records
        self._rdt = 1
        if faults.wrap:
            self._rdt, self.next_ft = 2**32 - faults.wrap, 2**32 - faults.wrap * step + step // 2
        self._n = self._since_start = 0
        self._held: bytes | None = None
        self._before = ""
        self._rng = np.random.default_rng(seed)
        self._fates = np.cumsum([getattr(faults, name) for name in _FATES])
        self._statuses = np.cumsum([getattr(faults, name) for name in _STATUSES])
        self._words = np.array([*_STATUSES.values(), 0], dtype=np.uint32)

    def datagrams(self, counts: NDArray[np.int32]) -> Iterator[Datagram]:
        """Send records, shape (n, 6); only the last datagram of a stream may have fewer than the others."""
        for start in range(0, len(counts), self._per_datagram):
            if self._faults.restart and self._since_start and self._since_start % self._faults.restart == 0:
                self._restart()
            yield from self._sent(self._numbered(counts[start : start + self._per_datagram]))

    def _numbered(self, counts: NDArray[np.int32]) -> NDArray[np.void]:
        n = len(counts)
        records = np.zeros(n, RECORD)
        ahead = np.arange(n, dtype=np.int64)
        records["rdt"] = (self._rdt + ahead) % 2**32
        records["ft"] = (self.next_ft + ahead * self._step) % 2**32
        records["counts"] = counts
        self._rdt, self.next_ft = (self._rdt + n) % 2**32, (self.next_ft + n * self._step) % 2**32
        self._n += n
        self._since_start += n
        return records

    def _restart(self) -> None:
        self.injected.restarts += 1
        # power comes and goes: the sensor counts anew, and never twice from the same sample
        self._rdt, self.next_ft = 1, 3 * self.injected.restarts
        self._since_start = 0

    def _sent(self, records: NDArray[np.void]) -> Iterator[Datagram]:
        n, due, made = len(records), self._n - 1, self.injected
        fate = self._fate(n)
        if fate == "stale":
            records["ft"][0] = (int(records["ft"][0]) - self._step) % 2**32
            made.stale += 1
        elif fate != "loss":
            self._mark(records)
        delay_s = self._delay()
        if fate == "loss":
            made.lost += n
            return
        made.sent += n
        data = records.tobytes()
        if fate == "reorder" and self._held is None:
            made.reordered += n
            self._held = data
            return
        if fate == "garbage":
            made.malformed += 1
            yield Datagram(due, delay_s, self._rng.bytes(int(self._rng.choice(_MALFORMED_BYTES))))
        elif fate == "forged":
            made.implausible += 1
            yield Datagram(due, delay_s, self._forged(records))
        elif fate == "absurd":
            made.out_of_range += 1
            yield Datagram(due, delay_s, data[:12] + struct.pack(">6i", *[2**31 - 2] * 6))
        yield Datagram(due, delay_s, data)
        if self._held is not None:
            yield Datagram(due, delay_s, self._held)
            self._held = None
        if fate == "duplicate":
            made.duplicates += n
            yield Datagram(due, delay_s, data)

    def _fate(self, n: int) -> str:
        margin = _PROTECTED * self._per_datagram
        left = margin if self._n_records is None else self._n_records - self._n
        if self._faults.restart:
            left = min(left, self._faults.restart - self._since_start)
        if not self._fates[-1] or self._since_start - n < margin or left < margin:
            fate = ""
        else:
            drawn = int(np.searchsorted(self._fates, self._rng.random(), side="right"))
            fate = [*_FATES, ""][drawn]
        # the sample of a record that was not seen right before would be a new one
        if fate == "stale" and self._before:
            fate = ""
        self._before = fate
        return fate

    def _mark(self, records: NDArray[np.void]) -> None:
        if not self._statuses[-1]:
            return
        drawn = np.searchsorted(self._statuses, self._rng.random(len(records)), side="right")
        records["status"] = self._words[drawn]
        bad, saturated, warnings, _ = np.bincount(drawn, minlength=len(self._words))
        # a saturated record has the bit of an error too
        self.injected.bad_status += int(bad + saturated)
        self.injected.saturated += int(saturated)
        self.injected.warnings += int(warnings)

    def _delay(self) -> float:
        if not self._faults.jitter_s:
            return 0.0
        self.injected.delayed += 1
        return float(self._rng.uniform(0, self._faults.jitter_s))

    def _forged(self, records: NDArray[np.void]) -> bytes:
        # half the numbers away, so that it cannot pass for a record by chance
        away = 2**31 + int(self._rng.integers(2**29))
        rdt, ft = ((int(records[name][0]) + away) % 2**32 for name in ("rdt", "ft"))
        return struct.pack(">3I", rdt, ft, 0) + bytes(24)

"""What is to go wrong with the fake box, and how often it did: exact numbers to compare a client with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

from granular_id._checks import finite_number

__all__ = ["FATES", "STATUSES", "Faults", "Injected"]

FATES = ("loss", "duplicate", "reorder", "stale", "garbage", "forged", "absurd")
"""Faults of a whole datagram, of which it has one at most."""

STATUSES = {"bad_status": 0x8000_0001, "saturation": 0x8002_0000, "warning": 0x8001_0000}
"""Status words of a Net F/T: supply voltage, saturation, threshold latched."""


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

    Examples
    --------
    >>> from granular_id.live.fake_netft_faults import Faults
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
        for names in (FATES, tuple(STATUSES)):
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
    """What was sent and what went wrong, in the words of the client's counters."""

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

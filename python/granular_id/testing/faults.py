"""What goes wrong with the fake box, and how often it did: exact numbers to compare a client with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

from granular_id._checks import finite_number

__all__ = ["Faults", "Injected"]


@dataclass(frozen=True)
class Faults:
    """What is to go wrong; all off by default.

    Parameters
    ----------
    loss, duplicate, reorder : float
        Share of datagrams that are lost, sent twice, or sent after the next one. At most one of these happens to a
        datagram; the first three and the last three of a stream are left alone.
    bad_status : float
        Share of records whose status word tells an error.

    Raises
    ------
    ValueError
        A number outside its range, or shares of datagrams that add up to more than 1.

    Examples
    --------
    >>> from granular_id.testing import Faults
    >>> Faults.parse(["loss=0.01", "reorder=0.1"])
    Faults(loss=0.01, duplicate=0.0, reorder=0.1, bad_status=0.0)
    >>> Faults.parse(["los=0.01"])
    Traceback (most recent call last):
    ...
    ValueError: fault 'los=0.01' is none; known: loss, duplicate, reorder, bad_status
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    bad_status: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = finite_number(field.name, getattr(self, field.name))
            if not 0 <= value <= 1:
                raise ValueError(f"{field.name} must be from 0 to 1, got {value:g}")
        total = self.loss + self.duplicate + self.reorder
        if total > 1:
            raise ValueError(
                f"loss, duplicate, reorder are shares and must add up to 1 at most, got {total:g}"
            )

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
        return cls(**given)


@dataclass
class Injected:
    """What was sent and what went wrong, in the words of the client's counters.

    Attributes
    ----------
    sent : int
        Records that were sent at least once.
    lost, duplicates, reordered : int
        Records of the datagrams with the faults loss, duplicate and reorder of `Faults`.
    bad_status : int
        Records whose status word told an error.
    """

    sent: int = 0
    lost: int = 0
    duplicates: int = 0
    reordered: int = 0
    bad_status: int = 0

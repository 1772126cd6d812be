"""What a method of `accuracy.py` is made from, and of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


class NotAvailableError(RuntimeError):
    """A method that cannot run here; the message says why."""


@dataclass(frozen=True)
class Setting:
    """What a method may know before it sees recordings: rate in Hz, samples T, seed."""

    rate_hz: float
    n_samples: int
    seed: int = 0


Stages = tuple[Any, Any]
"""Features and classifier, not fitted."""

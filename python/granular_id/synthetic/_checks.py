"""The few parameter checks that every part of the model shares."""

from __future__ import annotations

from granular_id._checks import finite_number as real
from granular_id._checks import non_negative_number as non_negative
from granular_id._checks import sampling_rate as rate

__all__ = ["non_negative", "positive", "rate", "real"]


def positive(name: str, value: object) -> float:
    """Return ``value`` as float; raise unless it is finite and above zero."""
    number = real(name, value)
    if number <= 0:
        raise ValueError(f"{name} must be positive, got {number:g}")
    return number

"""The few parameter checks that every part of the model shares."""

from __future__ import annotations

from granular_id._numbers import finite_number as real
from granular_id._numbers import non_negative_number as non_negative

__all__ = ["MAX_RATE_HZ", "non_negative", "positive", "rate", "real"]


def positive(name: str, value: object) -> float:
    """Return ``value`` as float; raise unless it is finite and above zero."""
    number = real(name, value)
    if number <= 0:
        raise ValueError(f"{name} must be positive, got {number:g}")
    return number


# Beyond this no force-torque sensor samples, and a mistyped rate would only fill the memory.
MAX_RATE_HZ = 50_000.0


def rate(name: str, value: object) -> float:
    """Return ``value`` as float; raise unless it is a sampling rate in (0, 50 kHz]."""
    number = positive(name, value)
    if number > MAX_RATE_HZ:
        raise ValueError(f"{name} must be at most {MAX_RATE_HZ:g}, got {number:g}")
    return number

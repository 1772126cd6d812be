"""The few parameter checks that every part of the model shares."""

from __future__ import annotations

import math

from granular_id._numbers import real_number


def real(name: str, value: object) -> float:
    """Return ``value`` as float; raise unless it is a finite real number."""
    number = real_number(name, value, "a real number")
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number}")
    return number


def positive(name: str, value: object) -> float:
    """Return ``value`` as float; raise unless it is finite and above zero."""
    number = real(name, value)
    if number <= 0:
        raise ValueError(f"{name} must be positive, got {number:g}")
    return number


def non_negative(name: str, value: object) -> float:
    """Return ``value`` as float; raise unless it is finite and at least zero."""
    number = real(name, value)
    if number < 0:
        raise ValueError(f"{name} must not be negative, got {number:g}")
    return number


# Beyond this no force-torque sensor samples, and a mistyped rate would only fill the memory.
MAX_RATE_HZ = 50_000.0


def rate(name: str, value: object) -> float:
    """Return ``value`` as float; raise unless it is a sampling rate in (0, 50 kHz]."""
    number = positive(name, value)
    if number > MAX_RATE_HZ:
        raise ValueError(f"{name} must be at most {MAX_RATE_HZ:g}, got {number:g}")
    return number

"""Arguments that must be single numbers."""

from __future__ import annotations

import math
from numbers import Integral, Real

import numpy as np

from granular_id._words import fixed

__all__ = [
    "finite_number",
    "non_negative_number",
    "positive_number",
    "real_number",
    "sampling_rate",
    "whole_number",
]

# Beyond this no force-torque sensor samples, and a mistyped rate would only fill the memory.
_MAX_RATE_HZ = 50_000.0


def real_number(name: str, value: object, wanted: str = "a number") -> float:
    """Return an argument as a float, or name it in an error.

    Parameters
    ----------
    name : str
        Its name, for the message.
    value : object
        True and False are no numbers. A whole number beyond float64 becomes infinite: the caller, who knows the
        range, refuses it as any other infinity.
    wanted : str
        What it must be, with its unit.

    Raises
    ------
    TypeError
        It is no real number.

    Examples
    --------
    >>> from granular_id._numbers import real_number
    >>> real_number("tare_s", 1), real_number("tare_s", 10**400)
    (1.0, inf)
    """
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, Real):
        raise TypeError(f"{name} must be {wanted}, got {value!r:.60}")
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf  # type: ignore[operator]  # Real knows it, its stub does not


def finite_number(name: str, value: object, wanted: str = "a real number") -> float:
    """Return an argument as a finite float, or name it in an error; see `real_number`.

    Raises
    ------
    TypeError, ValueError
        It is no real number; it is infinite or NaN.
    """
    number = real_number(name, value, wanted)
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number}")
    return number


def non_negative_number(name: str, value: object, wanted: str = "a real number") -> float:
    """Return an argument as a finite float of at least 0, or name it in an error; see `real_number`.

    Raises
    ------
    TypeError, ValueError
        It is no real number; it is infinite, NaN or below 0.
    """
    number = finite_number(name, value, wanted)
    if number < 0:
        raise ValueError(f"{name} must not be negative, got {number:g}")
    return number


def positive_number(name: str, value: object, wanted: str = "a number") -> float:
    """Return an argument as a positive finite float, or name it in an error; see `real_number`.

    Raises
    ------
    TypeError, ValueError
        It is no real number; it is not positive and finite.
    """
    number = real_number(name, value, wanted)
    if not 0 < number < math.inf:
        raise ValueError(f"{name} must be positive and finite, got {number!r}")
    return number


def sampling_rate(name: str, value: object) -> float:
    """Return an argument as the rate of something that is to be simulated, up to 50 kHz; see `real_number`.

    Raises
    ------
    TypeError, ValueError
        It is no real number; it is not positive, or beyond what sensors sample at.
    """
    number = finite_number(name, value)
    if number <= 0:
        raise ValueError(f"{name} must be positive, got {number:g}")
    if number > _MAX_RATE_HZ:
        raise ValueError(f"{name} must be at most {_MAX_RATE_HZ:g}, got {number:g}")
    return number


def whole_number(name: str, value: object, least: int = 1) -> int:
    """Return an argument as an int, or name it in an error.

    Raises
    ------
    TypeError, ValueError
        It is no whole number; it is below `least`.
    """
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise TypeError(f"{name} must be a whole number, got {value!r:.60}")
    if value < least:
        raise ValueError(f"{name} must be at least {least}, got {fixed(int(value))}")
    return int(value)

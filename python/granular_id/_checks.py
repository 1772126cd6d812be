"""Arguments that must be single numbers."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Mapping
from numbers import Integral, Real
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from granular_id._text import fixed

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
    >>> from granular_id._checks import real_number
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


def named(table: Mapping[str, Any], argument: str, name: object) -> Any:
    """Return the entry of a table of options, or raise a ValueError that lists their names."""
    if not isinstance(name, str) or name not in table:
        raise ValueError(f"{argument} must be one of {', '.join(map(repr, table))}, got {name!r}")
    return table[name]


def checked_flag(argument: str, value: object) -> bool:
    """Return True or False as a bool, or raise a TypeError for anything else (1 and "yes" included)."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{argument} must be True or False, got {value!r}")
    return bool(value)


def checked_n_jobs(n_jobs: object) -> int | None:
    """Return the number of threads as joblib takes it, or say in an error what is wrong with it."""
    if n_jobs is None:
        return None
    if isinstance(n_jobs, bool) or not isinstance(n_jobs, (int, np.integer)):
        raise TypeError(f"n_jobs must be None or a whole number, got {n_jobs!r}")
    if n_jobs == 0:
        raise ValueError(
            "n_jobs must be None, positive, or negative to leave processors out (-1: none), got 0"
        )
    return int(n_jobs)


# Arguments that must be numbers, as float64 arrays.


def float_array(argument: str, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return an argument as float64, or name it in an error.

    Parameters
    ----------
    argument : str
        Its name, for the message.
    values : array-like
        Numbers. float64 arrays come back as they are, without a copy.

    Raises
    ------
    TypeError
        Complex numbers, whose imaginary part numpy would drop.
    ValueError
        No array of numbers: text, objects, rows of different lengths.

    Examples
    --------
    >>> from granular_id._checks import float_array
    >>> float_array("gram", [[1, 2]])
    array([[1., 2.]])
    """
    try:
        given = np.asarray(values)
        if given.dtype.kind != "c":
            return given.astype(np.float64, copy=False)
    except (TypeError, ValueError) as reason:
        raise ValueError(f"{argument} must be an array of numbers: {reason}") from None
    raise TypeError(f"{argument} must hold real numbers, got {given.dtype}")


# Checked and frozen values: JSON trees and arrays that nobody can change afterwards.

FloatArray = NDArray[np.float64]

_PLAIN = frozenset((type(None), bool, int, str))
"""Types whose values a tree holds as they are; asked first, as nearly all values are of one of them."""


def freeze(value: object, name: str) -> Any:
    """Copy a JSON-like tree into one that cannot be changed (mappings become read-only, lists tuples)."""
    if type(value) in _PLAIN:
        return value
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"{name} is {value}; numbers must be finite")
        return value
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise TypeError(f"{name} has the key {key!r}; keys must be str")
        # most items are plain, and making a name for each would take longer than everything else
        tree = {
            str(key): item if _is_plain(item) else freeze(item, f"{name}[{key!r}]")
            for key, item in value.items()
        }
        return MappingProxyType(tree)
    if isinstance(value, (list, tuple)):
        return tuple(
            item if _is_plain(item) else freeze(item, f"{name}[{i}]") for i, item in enumerate(value)
        )
    raise TypeError(
        f"{name} is a {type(value).__name__}; wanted None, bool, int, float, str, lists or mappings of them"
    )


def _is_plain(item: object) -> bool:
    kind = type(item)
    return kind in _PLAIN or (kind is float and math.isfinite(item))  # type: ignore[arg-type]


def thaw(value: Any) -> Any:
    """Turn a frozen tree back into plain dicts and lists, ready for ``json.dumps``."""
    if isinstance(value, Mapping):
        return {key: thaw(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [thaw(item) for item in value]
    return value


_CONTROLS = ("Cc", "Cs", "Zl", "Zp")
OVERRIDES = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
"""They turn the order of letters around, so that a text reads as another one."""


def checked_text(value: object, name: str, *, empty: bool = False, spaced: bool = True) -> str:
    """Return a str of printable, encodable characters, or say which argument is not one."""
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a str, got {type(value).__name__}")
    text = str(value)
    if not text and not empty:
        raise ValueError(f"{name} is empty; give a text or leave it out (None)")
    if not text.isprintable():  # asked of all texts; which character it is, of those few that are not
        bad = next((c for c in text if unicodedata.category(c) in _CONTROLS or c in OVERRIDES), None)
        if bad is not None:
            raise ValueError(f"{name} {text[:40]!r} holds the control character {bad!r}")
    if not spaced and text != text.strip():
        raise ValueError(f"{name} {text[:40]!r} begins or ends with a space: it would not equal its own name")
    return text


def checked_number(value: object, name: str) -> float:
    """Return a finite float, or say which argument is not one."""
    number = real_number(name, value)
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number:g}")
    return number


def checked_rate(value: object, name: str = "rate_hz") -> float:
    """Return a positive finite sampling rate in Hz."""
    rate = checked_number(value, name)
    if rate <= 0:
        raise ValueError(f"{name} must be positive, got {rate:g}")
    return rate


def checked_index(value: object, name: str) -> int:
    """Return an int that is not a bool."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name} must be an int, got {type(value).__name__}")
    return int(value)


def as_floats(value: object, name: str, wanted: str) -> FloatArray:
    """Convert to float64, refusing what would lose meaning (complex, text, objects, masks)."""
    if isinstance(value, np.ma.MaskedArray):
        raise TypeError(f"{name} is a masked array; wanted {wanted}: fill or drop the masked samples first")
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name} is not a rectangular array; wanted {wanted}") from error
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{name} has dtype {array.dtype}; wanted {wanted}")
    with np.errstate(over="ignore"):  # what overflows becomes infinite and is refused by the caller's check
        return np.asarray(array, dtype=np.float64, order="C")


def locked(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array read-only, copied unless nobody can hold a writable view of it."""
    base = array.base
    private = not array.flags.writeable and (
        base is None or (isinstance(base, np.ndarray) and not base.flags.writeable and base.base is None)
    )
    if not private:
        array = array.copy(order="C")
        array.flags.writeable = False
    return array

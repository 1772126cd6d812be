"""Checked and frozen values: JSON trees and arrays that nobody can change afterwards."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._numbers import real_number

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

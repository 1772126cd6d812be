"""Checks of arguments: numbers, choices, texts, arrays, trees that nobody can change afterwards.

Each error begins with the argument's name, and holds it as `argument`, so that the command line can say its option.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral, Real
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from granular_id._core import GranularIdError
from granular_id._text import WayOut, fixed

FloatArray = NDArray[np.float64]

ArgumentError = TypeVar("ArgumentError", bound=Exception)
Item = TypeVar("Item")

# Beyond this no force-torque sensor samples, and a mistyped rate would only fill the memory.
_MAX_RATE_HZ = 50_000.0


def argument_error(kind: type[ArgumentError], argument: str, problem: str) -> ArgumentError:
    """Return a ValueError or TypeError that begins with the name of an argument, and holds it as `error.argument`.

    A problem that begins with one of ``=[:`` or a blank follows the name at once: ``"='x'; wanted 'raise' or 'skip'"``.
    """
    error = kind(f"{argument}{'' if problem[0] in '=[: ' else ' '}{problem}")
    error.argument = argument  # type: ignore[attr-defined]
    return error


class WayOutError(GranularIdError):
    """A refusal that says how to go on: of its `parts` each `WayOut` is one way, the best first."""

    def __init__(self, *parts: str) -> None:
        super().__init__("".join(parts))
        self.parts = parts

    @property
    def problem(self) -> str:
        """What came and what is wanted, with the ways out."""
        return "".join(self.parts)

    @property
    def ways(self) -> list[Mapping[str, Any]]:
        """The options of each way out."""
        return [part.options for part in self.parts if isinstance(part, WayOut) and part.options]

    @property
    def in_python(self) -> bool:
        """Whether lines of Python are a way out."""
        return any(isinstance(part, WayOut) and part.code for part in self.parts)


def parts_of(problem: str | Sequence[str]) -> tuple[str, ...]:
    """Return the parts of a message, which may be one text."""
    return (problem,) if isinstance(problem, str) else tuple(problem)


# Numbers. True and False are none.


def real_number(name: str, value: object, wanted: str = "a number") -> float:
    """Return a float; a whole number beyond float64 is infinite, and so refused by whoever knows the range."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, Real):
        raise argument_error(TypeError, name, f"must be {wanted}, got {value!r:.60}")
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf  # type: ignore[operator]  # Real knows it, its stub does not


def finite_number(
    name: str,
    value: object,
    *,
    positive: bool = False,
    least: float = -math.inf,
    most: float = math.inf,
) -> float:
    """Return a finite float within bounds."""
    number = real_number(name, value)
    if not math.isfinite(number):
        raise argument_error(GranularIdError, name, f"must be finite, got {number:g}")
    if positive and number <= 0:
        raise argument_error(GranularIdError, name, f"must be positive, got {number:g}")
    if number < least:
        bound = "not be negative" if least == 0 else f"be at least {least:g}"
        raise argument_error(GranularIdError, name, f"must {bound}, got {number:g}")
    if number > most:
        raise argument_error(GranularIdError, name, f"must be at most {most:g}, got {number:g}")
    return number


def positive_number(name: str, value: object, wanted: str = "a number") -> float:
    """Return a positive finite float."""
    number = real_number(name, value, wanted)
    if not 0 < number < math.inf:
        raise argument_error(GranularIdError, name, f"must be positive and finite, got {number!r}")
    return number


def checked_share(name: str, value: object) -> float:
    """Return a float in (0, 1)."""
    number = finite_number(name, value)
    if not 0 < number < 1:
        raise argument_error(GranularIdError, name, f"must lie between 0 and 1, got {number:g}")
    return number


def sampling_rate(name: str, value: object) -> float:
    """Return the rate of something that is to be simulated, up to 50 kHz."""
    return finite_number(name, value, positive=True, most=_MAX_RATE_HZ)


def whole_number(name: str, value: object, least: int = 1, or_else: str = "") -> int:
    """Return an int of at least `least`; `or_else` is what else would do, for the message."""
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise argument_error(TypeError, name, f"must be a whole number{or_else}, got {value!r:.60}")
    if value < least:
        raise argument_error(GranularIdError, name, f"must be at least {least}, got {fixed(int(value))}")
    return int(value)


def checked_n_jobs(n_jobs: object) -> int | None:
    """Return the number of threads as joblib takes it."""
    if n_jobs is None:
        return None
    if isinstance(n_jobs, bool) or not isinstance(n_jobs, Integral):
        raise argument_error(TypeError, "n_jobs", f"must be None or a whole number, got {n_jobs!r}")
    if n_jobs == 0:
        wanted = "None, positive, or negative to leave processors out (-1: none)"
        raise argument_error(GranularIdError, "n_jobs", f"must be {wanted}, got 0")
    return int(n_jobs)


# Choices and texts.


def named(table: Mapping[str, Any], argument: str, name: object) -> Any:
    """Return the entry of a table of choices, or list their names in the error."""
    if not isinstance(name, str) or name not in table:
        from difflib import get_close_matches  # seldom needed

        known, close = ", ".join(map(repr, table)), get_close_matches(str(name), table, 1)
        meant = f"; did you mean {close[0]!r}?" if close else ""
        raise argument_error(GranularIdError, argument, f"must be one of {known}, got {name!r}{meant}")
    return table[name]


def checked_choice(argument: str, value: object, *choices: str) -> None:
    """Refuse a setting that is none of a few choices."""
    if value not in choices:
        raise argument_error(
            GranularIdError, argument, f"={value!r}; wanted {' or '.join(map(repr, choices))}"
        )


def checked_flag(argument: str, value: object) -> bool:
    """Return True or False as a bool; 1 and "yes" are neither."""
    if not isinstance(value, (bool, np.bool_)):
        raise argument_error(TypeError, argument, f"must be True or False, got {value!r}")
    return bool(value)


_CONTROLS = ("Cc", "Cs", "Zl", "Zp")
OVERRIDES = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
"""They turn the order of letters around, so that a text reads as another one."""


def checked_text(value: object, name: str, *, empty: bool = False, spaced: bool = True) -> str:
    """Return a str of printable, encodable characters."""
    if not isinstance(value, str):
        raise argument_error(TypeError, name, f"must be a str, got {type(value).__name__}")
    text = str(value)
    if not text and not empty:
        raise argument_error(GranularIdError, name, "is empty; give a text or leave it out (None)")
    if not text.isprintable():  # checked for all texts; which character it is, of those few that are not
        bad = next((c for c in text if unicodedata.category(c) in _CONTROLS or c in OVERRIDES), None)
        if bad is not None:
            raise argument_error(GranularIdError, name, f"{text[:40]!r} holds the control character {bad!r}")
    if not spaced and text != text.strip():
        problem = "begins or ends with a space: it would not equal its own name"
        raise argument_error(GranularIdError, name, f"{text[:40]!r} {problem}")
    return text


def items_of(argument: str, value: object, kind: type[Item]) -> tuple[Item, ...]:
    """Return the items of a sequence, all of one class; a text is no sequence."""
    if not isinstance(value, Iterable) or isinstance(value, str):
        raise argument_error(
            TypeError, argument, f"must be a sequence of {kind.__name__}, got {type(value).__name__}"
        )
    items = tuple(value)
    for i, item in enumerate(items):
        if not isinstance(item, kind):
            problem = f"[{i}] is a {type(item).__name__}; wanted {kind.__name__}"
            raise argument_error(TypeError, argument, problem)
    return items


# Arrays, as float64.


def float_array(argument: str, values: npt.ArrayLike) -> FloatArray:
    """Return numbers as float64, without a copy where they are; complex ones, of which numpy would drop half, raise."""
    try:
        given = np.asarray(values)
        if given.dtype.kind != "c":
            return given.astype(np.float64, copy=False)
    except (TypeError, ValueError) as reason:
        raise argument_error(GranularIdError, argument, f"must be an array of numbers: {reason}") from None
    raise argument_error(TypeError, argument, f"must hold real numbers, got {given.dtype}")


def as_floats(value: object, name: str, wanted: str) -> FloatArray:
    """Convert to float64 in C order, refusing what would lose meaning (complex, text, objects, masks, booleans)."""
    if isinstance(value, np.ma.MaskedArray):
        raise argument_error(
            TypeError, name, f"is a masked array; wanted {wanted}: fill or drop the masked samples first"
        )
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise argument_error(GranularIdError, name, f"is not a rectangular array; wanted {wanted}") from error
    if array.dtype.kind not in "iuf":
        raise argument_error(TypeError, name, f"has dtype {array.dtype}; wanted {wanted}")
    with np.errstate(over="ignore"):  # what overflows becomes infinite and is refused by the caller's check
        return np.asarray(array, dtype=np.float64, order="C")


def finite_numbers(name: str, values: object, n: int, *, each: bool = False) -> FloatArray:
    """Return an array of `n` finite numbers; with `each` any number of rows of them, shape (..., n)."""
    wanted = f"finite numbers of shape ({'..., ' * each}{n}{',' * (not each)})"
    array = as_floats(values, name, wanted)
    if array.shape[-1:] != (n,) or not (each or array.ndim == 1) or not np.isfinite(array).all():
        raise argument_error(
            GranularIdError, name, f"has shape {array.shape}, or NaN or infinity; wanted {wanted}"
        )
    return array


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


# JSON-like trees.


def freeze(value: object, name: str) -> Any:
    """Copy a JSON-like tree into one that cannot be changed (mappings become read-only, lists tuples)."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise argument_error(GranularIdError, name, f"is {value}; numbers must be finite")
        return value
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise argument_error(TypeError, name, f"has the key {key!r}; keys must be str")
        return MappingProxyType({str(key): freeze(item, f"{name}[{key!r}]") for key, item in value.items()})
    if isinstance(value, (list, tuple)):
        return tuple(freeze(item, f"{name}[{i}]") for i, item in enumerate(value))
    wanted = "None, bool, int, float, str, lists or mappings of them"
    raise argument_error(TypeError, name, f"is a {type(value).__name__}; wanted {wanted}")


def frozen_mapping(argument: str, value: object) -> Any:
    """Return a mapping that nobody can change."""
    if not isinstance(value, Mapping):
        raise argument_error(TypeError, argument, f"must be a mapping, got {type(value).__name__}")
    return freeze(value, argument)


def thaw(value: Any) -> Any:
    """Turn a frozen tree back into plain dicts and lists, ready for ``json.dumps``."""
    if isinstance(value, Mapping):
        return {key: thaw(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [thaw(item) for item in value]
    return value

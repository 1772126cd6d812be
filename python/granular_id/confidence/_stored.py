"""Reading rules that were stored as plain values: each part is there, of its type, and nothing else is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeVar

__all__ = ["Reader"]

T = TypeVar("T")


class Reader:
    """Takes the parts of a stored rule out one by one.

    Parameters
    ----------
    what : str
        What is read, for messages.
    form : str
        Text that must stand under ``"format"``.
    stored : mapping
    """

    def __init__(self, what: str, form: str, stored: Mapping[str, Any]) -> None:
        if not isinstance(stored, Mapping):
            raise TypeError(f"a stored {what} must be a mapping, got {type(stored).__name__}")
        self._what = what
        self._left = dict(stored)
        found = self._left.pop("format", None)
        if found != form:
            raise ValueError(f"a stored {what} must have format {form!r}, got {found!r:.80}")

    def take(self, name: str, kind: type[T]) -> T:
        """Return a part of a type."""
        if name not in self._left:
            raise ValueError(f"the stored {self._what} has no {name!r}")
        value = self._left.pop(name)
        if not isinstance(value, kind):
            raise TypeError(f"{name!r} of the {self._what} must be {kind.__name__}, got {value!r:.80}")
        return value

    def names(self, name: str) -> tuple[str, ...]:
        """Return a list of texts."""
        values = self.take(name, list)
        if not all(isinstance(value, str) for value in values):
            raise TypeError(f"{name!r} of the {self._what} must hold texts, got {values!r:.80}")
        return tuple(values)

    def number(self, name: str) -> float:
        """Return one finite number."""
        return self.as_numbers(name, [self.take(name, object)])[0]

    def numbers(self, name: str) -> tuple[float, ...]:
        """Return a list of finite numbers."""
        return self.as_numbers(name, self.take(name, list))

    def matrix(self, name: str) -> tuple[tuple[float, ...], ...]:
        """Return a list of lists of finite numbers, all of one length."""
        rows = tuple(self.as_numbers(name, row) for row in self.take(name, list))
        if len({len(row) for row in rows}) > 1:
            raise ValueError(f"{name!r} of the {self._what} must have rows of one length")
        return rows

    def counts(self, name: str) -> tuple[int, ...]:
        """Return a list of whole numbers."""
        values = self.take(name, list)
        if not all(isinstance(value, int) and not isinstance(value, bool) for value in values):
            raise TypeError(f"{name!r} of the {self._what} must hold whole numbers, got {values!r:.80}")
        return tuple(values)

    def count(self, name: str) -> int:
        """Return one whole number."""
        value = self.take(name, int)
        if isinstance(value, bool):
            raise TypeError(f"{name!r} of the {self._what} must be a whole number, got {value!r}")
        return value

    def as_numbers(self, name: str, values: object, *, none: float | None = None) -> tuple[float, ...]:
        """Return numbers of a list as floats; `none` stands for None, which is refused without it."""
        if not isinstance(values, list):
            raise TypeError(f"{name!r} of the {self._what} must hold lists of numbers, got {values!r:.80}")
        found = []
        for value in values:
            if value is None and none is not None:
                found.append(none)
            elif isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                raise TypeError(f"{name!r} of the {self._what} must hold finite numbers, got {value!r:.80}")
            else:
                found.append(float(value))
        return tuple(found)

    def finish(self) -> None:
        """Refuse parts that nobody asked for."""
        if self._left:
            raise ValueError(
                f"the stored {self._what} has unknown parts: {', '.join(sorted(map(str, self._left)))}"
            )

"""Wrenches inside messages of other types, found by the definition that a bag keeps of its types.

A sensor's driver may publish a type of its maker, with a ``geometry_msgs/WrenchStamped`` or ``Wrench`` as one of its
fields. The definition is parsed by rosbags; header and wrench are then cut out of the bytes of each message, so that
what is left are messages of the plain types, read as every other. No code is made of a stranger's definition.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.extras import need
from granular_id.io.ros.wrench import DEFINITION, ORDERS, STAMPED, WRENCH_TYPES, Encoding, Refuse

__all__ = ["LONGEST_DEFINITION", "Inside", "may_hold_wrench"]

LONGEST_DEFINITION = 128 * 1024
"""Characters of a definition with all it is made of; parsing takes a second for a million."""

_MOST_FIELDS = 5000
"""Fields of a message, those of its parts counted; types that hold each other by twos would have billions."""

_DEEPEST = 32
_HEADER, _WRENCH, _STAMPED = (
    "std_msgs/msg/Header",
    "geometry_msgs/msg/Wrench",
    "geometry_msgs/msg/WrenchStamped",
)
_TIME, _DURATION = "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"
_WRENCH_BYTES = 48
_SIZES = {
    **dict.fromkeys(("bool", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}

_Path = tuple[str, ...]


def may_hold_wrench(definition: str) -> bool:
    """Tell quickly whether a definition is worth parsing."""
    named = re.search(r"\bgeometry_msgs/(msg/)?Wrench(Stamped)?\b", definition)
    return named is not None and len(definition) <= LONGEST_DEFINITION


@dataclass(frozen=True)
class _Place:
    """Where a wrench lies in a message: the fields that lead to it, and to the header that stamps it."""

    wrench: _Path
    header: _Path | None


@dataclass(frozen=True)
class _Layout:
    """The bytes of one message: spans of header and wrench, and the bytes on which these depend."""

    header: range
    wrench: range
    fixed: list[int]


class Inside:
    """A type of message, by its definition in the bag.

    Parameters
    ----------
    definition : str
        With the definitions of all it is made of, as ROS 1 bags and MCAP keep them.
    type_name : str
        Like ``rokubimini_msgs/Reading``.
    encoding : {"cdr", "ros1"}

    Raises
    ------
    ValueError
        A definition that cannot be parsed, or defines the standard types otherwise.
    ImportError
        rosbags is missing.
    """

    def __init__(self, definition: str, type_name: str, encoding: Encoding) -> None:
        self._cdr = encoding == "cdr"
        self._name = _ros2_name(type_name)
        library = need("rosbags.typesys", extra="ros", why="to read messages of makers' types")
        self._types = _parsed(library.get_types_from_msg, definition, type_name, ros1=not self._cdr)

    @cached_property
    def places(self) -> dict[str, _Place]:
        """Wrenches of a message by the dotted name of their field; those in lists are not counted."""
        left = [_MOST_FIELDS]
        return dict(self._found(self._name, (), None, left))

    def plain(
        self, data: bytes | bytearray, lengths: NDArray[np.int64], field: str, refuse: Refuse
    ) -> tuple[bytes, NDArray[np.int64], str]:
        """Cut one wrench, with its header if it has one, out of each message.

        Returns
        -------
        data, lengths
            Messages of a plain type, one after the other, and the bytes of each.
        type_name : str
            One of `WRENCH_TYPES`.
        """
        place = self.places[field]
        first = self._layout(bytes(data[: lengths[0]]), place, 0, refuse)
        type_name = WRENCH_TYPES[place.header is None]
        if (lengths == lengths[0]).all():
            table = np.frombuffer(data, np.uint8).reshape(len(lengths), -1)
            if (table[:, first.fixed] == table[0, first.fixed]).all():
                cut = table[:, [at for span in self._spans(first) for at in span]]
                return cut.tobytes(), np.full(len(cut), cut.shape[1], np.int64), type_name
        ends = np.cumsum(lengths).tolist()
        messages = [bytes(data[start:end]) for start, end in zip([0, *ends], ends, strict=False)]
        parts = []
        for i, message in enumerate(messages):
            spans = self._spans(self._layout(message, place, i, refuse))
            parts.append(b"".join(message[span.start : span.stop] for span in spans))
        return b"".join(parts), np.array([len(part) for part in parts], np.int64), type_name

    def _spans(self, layout: _Layout) -> list[range]:
        """Bytes of the plain message: CDR aligns the wrench to 8 bytes from behind its own four."""
        if not self._cdr:
            return [layout.header, layout.wrench]
        return [range(4), layout.header, range(-len(layout.header) % 8), layout.wrench]

    def _found(
        self, name: str, path: _Path, header: _Path | None, left: list[int]
    ) -> Iterator[tuple[str, _Place]]:
        if name == _WRENCH:
            yield ".".join(path), _Place(path, header)
            return
        fields = self._fields(name, path)
        left[0] -= len(fields)
        if left[0] < 0:
            raise ValueError(f"a message has more than {_MOST_FIELDS} fields")
        own = next(((*path, field) for field, kind in fields if _struct(kind) == _HEADER), header)
        if name == _STAMPED:  # named as a whole, not by the field inside
            yield ".".join(path), _Place((*path, "wrench"), own)
            return
        for field, kind in fields:
            inner = _struct(kind)
            if inner is not None:
                yield from self._found(inner, (*path, field), own, left)

    def _fields(self, name: str, path: _Path) -> list[tuple[str, Any]]:
        if name not in self._types:
            raise ValueError(f"the type {name[:80]} of field {'.'.join(path)[:80]} is not defined")
        if len(path) > _DEEPEST:
            raise ValueError(f"types are nested more than {_DEEPEST} deep")
        return list(self._types[name][1])

    def _layout(self, message: bytes, place: _Place, index: int, refuse: Refuse) -> _Layout:
        walk = _Walk(self, message, cdr=self._cdr)
        try:
            walk.run(self._name)
        except ValueError as error:
            refuse(index, str(error))
        stop = walk.spans[place.wrench][1]
        header = range(0) if place.header is None else range(*walk.spans[place.header])
        return _Layout(header, range(stop - _WRENCH_BYTES, stop), walk.fixed)


class _Walk:
    """One message walked over field by field."""

    def __init__(self, types: Inside, message: bytes, *, cdr: bool) -> None:
        self._types = types
        self._data = message
        self._cdr = cdr
        self._at = 0
        self._values_left = len(message) + _MOST_FIELDS  # lists of what has no bytes could be of any length
        self._order: Any = "little"
        self.spans: dict[_Path, tuple[int, int]] = {}
        self.fixed: list[int] = []

    def run(self, name: str) -> None:
        """Walk to the end of the message.

        Raises
        ------
        ValueError
            It is shorter or longer than its type makes it.
        """
        if self._cdr:
            if self._data[:2] not in ORDERS:
                begins = self._data[:4].hex(" ") or "nothing"
                raise ValueError(f"begins with {begins}; wanted plain CDR (00 00 or 00 01)")
            self._order = "little" if ORDERS[self._data[:2]] == "<" else "big"
            self.fixed += range(4)
            self._at = 4
        self._struct(name, ())
        left = len(self._data) - self._at
        if left > 3 * self._cdr:  # what CDR may be filled up by
            raise ValueError(f"has {left} bytes more than its type makes it")

    def _struct(self, name: str, path: _Path) -> None:
        fields = self._types._fields(name, path)
        if self._cdr and name == _HEADER:
            self._align(4)
        start = self._at
        for field, kind in fields:
            self._value(kind, (*path, field))
        if not fields and self._cdr:
            self._step(1)  # an empty struct has a byte there
        if name in (_HEADER, _WRENCH):
            self.spans[path] = start, self._at

    def _value(self, kind: Any, path: _Path) -> None:
        self._values_left -= 1
        if self._values_left < 0:
            raise ValueError("has more values than bytes")
        what = kind[1]
        inner = _struct(kind)
        if inner is not None:
            self._struct(inner, path)
        elif isinstance(what[0], str):
            self._base(what[0], 1)
        else:
            item, count = what
            if kind[0].name == "SEQUENCE":
                count = self._count()
            if _struct(item) is None and item[1][0] in _SIZES:
                self._base(item[1][0], count)
                return
            for _ in range(count):
                self._value(item, (*path, "[]"))

    def _base(self, name: str, count: int) -> None:
        if name == "string":
            self._step(self._count())
        elif name not in _SIZES:
            raise ValueError(f"holds a {name[:40]}, whose bytes are not known here")
        elif count:
            self._align(_SIZES[name])
            self._step(count * _SIZES[name])

    def _count(self) -> int:
        self._align(4)
        at = self._at
        self._step(4)
        self.fixed += range(at, at + 4)
        return int.from_bytes(self._data[at : at + 4], self._order)

    def _align(self, size: int) -> None:
        if self._cdr:
            self._step(-(self._at - 4) % size)

    def _step(self, n_bytes: int) -> None:
        self._at += n_bytes
        if self._at > len(self._data):
            raise ValueError(f"has {len(self._data)} bytes, less than its type makes it")


def _struct(kind: Any) -> str | None:
    """Return the name of the struct that a field is; None for numbers, texts and lists."""
    return kind[1] if kind[0].name == "NAME" else None


def _ros2_name(type_name: str) -> str:
    package, _, name = type_name.rpartition("/")
    return f"{package}/msg/{name}"


@lru_cache(16)  # all bags of a folder have the same definition
def _parsed(
    parse: Callable[[str, str], dict[str, Any]], definition: str, type_name: str, *, ros1: bool
) -> Mapping[str, Any]:
    """Return the fields of each type, as rosbags gives them."""
    standard = parse(DEFINITION, STAMPED)
    if ros1:
        seq = parse("uint32 seq\n", "x/Seq")["x/msg/Seq"][1]
        constants, fields = standard[_HEADER]
        standard[_HEADER] = (constants, seq + fields)
    try:
        types = parse(definition, _ros2_name(type_name))
    except Exception as error:  # of the parser: its own kind, RecursionError, ValueError of a number
        lines = str(error).splitlines() or [type(error).__name__]
        raise ValueError(f"its definition cannot be parsed ({lines[0][:200]})") from error
    for name, (_, fields) in standard.items():
        if name != _TIME and name in types and list(types[name][1]) != list(fields):
            shown = "; ".join(field for field, _ in types[name][1])
            raise ValueError(f"{name} is defined as {shown[:200]!r}, not as the standard has it")
    known = {**standard, _DURATION: standard[_TIME]}
    return {**known, **types}

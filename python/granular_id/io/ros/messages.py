"""Types of messages by the definition that a bag keeps of them, and the wrenches and IMUs inside.

A sensor's driver may publish a type of its maker, with a ``geometry_msgs/WrenchStamped`` or ``Wrench`` as one of its
fields; a plain message is a wrench as a whole. rosbags reads both by the definition, one by one. Where messages differ
in numbers only, as they mostly do, these lie at the same bytes in all of them and are taken from there, fifty times as
fast.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from operator import attrgetter
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray
from granular_id.io.errors import need

_HEADER, _WRENCH, _IMU = "std_msgs/msg/Header", "geometry_msgs/msg/Wrench", "sensor_msgs/msg/Imu"
_TIME = "builtin_interfaces/Time stamp"
_PARTS = {_WRENCH: ("force", "torque"), _IMU: ("angular_velocity", "linear_acceleration")}
_SIZED_AS = {"byte": "uint8", "char": "uint8", "octet": "uint8"}
_PLAIN_CDR = (b"\0\0", b"\0\1")
_FILL_BYTES = 3
"""By which a message in CDR may be filled up at its end."""

_Path = tuple[str, ...]


def may_hold_wrench(definition: str) -> bool:
    """Tell quickly whether a definition is worth parsing."""
    return re.search(r"\bgeometry_msgs/(msg/)?Wrench(Stamped)?\b", definition) is not None


def may_hold_imu(definition: str) -> bool:
    """Tell the same of an IMU."""
    return re.search(r"\bsensor_msgs/(msg/)?Imu\b", definition) is not None


@dataclass(frozen=True)
class _Place:
    """The fields that lead to a wrench or an IMU, and to the header that stamps it."""

    struct: _Path
    header: _Path | None
    kind: str = _WRENCH

    @property
    def numbers(self) -> list[_Path]:
        """The six numbers, two vectors."""
        return [(*self.struct, part, axis) for part in _PARTS[self.kind] for axis in "xyz"]


class MessageType:
    """A type of message, like ``rokubimini_msgs/Reading`` in CDR ("cdr") or as of ROS 1 ("ros1").

    The definition, in the language of ``.msg`` files, has all that it is made of; it may be empty for the plain types.
    A ValueError says where it cannot be parsed.
    """

    def __init__(self, name: str, definition: str, encoding: str) -> None:
        library = need("rosbags.typesys", extra="ros", why="to read the messages of bags")
        self._ros1 = encoding == "ros1"
        self._name = _ros2_name(name)
        standard = DEFINITION.replace(_TIME, f"uint32 seq\n{_TIME}") if self._ros1 else DEFINITION
        self._store = library.get_typestore(library.Stores.EMPTY)
        try:
            types = library.get_types_from_msg(standard, _ros2_name(STAMPED))
            types |= library.get_types_from_msg(definition, self._name) if definition else {}
            self._store.register(types)
        except Exception as error:  # of the parser, or the code that rosbags makes of what it has parsed
            reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
            raise ValueError(f"the definition of {name} cannot be parsed ({reason})") from error

    @property
    def wrenches(self) -> dict[str, _Place]:
        """Where a message has wrenches, by the dotted name of their field; those in lists are not counted."""
        return {field: place for field, place in self._places.items() if place.kind == _WRENCH}

    @property
    def imus(self) -> list[str]:
        """Where a message has IMUs; "" where it is one."""
        return [field for field, place in self._places.items() if place.kind == _IMU]

    @cached_property
    def _places(self) -> dict[str, _Place]:
        return dict(self._found(self._name, (), None))

    def _found(self, name: str, path: _Path, header: _Path | None) -> Iterator[tuple[str, _Place]]:
        if name == _WRENCH:
            yield ".".join(path), _Place(path, header)
            return
        known = self._store.get_msgdef(name).fields
        structs = {(*path, field): what for field, (node, what) in known if node.name == "NAME"}
        own = next((inner for inner, kind in structs.items() if kind == _HEADER), header)
        if name == _ros2_name(STAMPED):  # named as a whole, not by the field inside
            yield ".".join(path), _Place((*path, "wrench"), own)
            return
        if name == _IMU:
            yield ".".join(path), _Place(path, own, _IMU)
            return
        for inner, kind in structs.items():
            yield from self._found(kind, inner, own)

    def decode(self, messages: Sequence[bytes], field: str, refuse: Refuse) -> Wrenches:
        """Return one wrench (or IMU) of each message, with its header if it has one."""
        place = self._places[field]
        first = self._value(messages[0], 0, refuse)
        return self._at_once(messages, first, place, refuse) or self._one_by_one(messages, place, refuse)

    def _value(self, message: bytes, index: int, refuse: Refuse) -> Any:
        read = self._store.deserialize_ros1 if self._ros1 else self._store.deserialize_cdr
        if not self._ros1 and message[:2] not in _PLAIN_CDR:  # older rosbags would take it for plain
            begins = message[:4].hex(" ") or "nothing"
            refuse(index, f"begins with {begins}; wanted plain CDR (00 00 or 00 01)")
        try:
            return read(message, self._name)
        except Exception as error:  # of many kinds: the code is made of the definition
            refuse(index, f"does not fit its type ({error or type(error).__name__})")

    def _one_by_one(self, messages: Sequence[bytes], place: _Place, refuse: Refuse) -> Wrenches:
        values = [self._value(message, i, refuse) for i, message in enumerate(messages)]
        numbers = attrgetter(*map(".".join, place.numbers))
        wrench = np.array([numbers(value) for value in values], np.float64)
        parts = _PARTS[place.kind]
        if place.header is None:
            return Wrenches.checked(wrench, None, None, refuse, parts)
        headers = [_part(value, place.header) for value in values]
        stamps = np.array([(header.stamp.sec, header.stamp.nanosec) for header in headers], np.int64)
        return Wrenches.checked(wrench, stamps, [header.frame_id for header in headers], refuse, parts)

    def _at_once(
        self, messages: Sequence[bytes], first: Any, place: _Place, refuse: Refuse
    ) -> Wrenches | None:
        """Take the numbers from where they lie in the first message; None where others are laid out otherwise.

        Bytes that depend on no number hold lengths and texts. Where they are the same, so is the layout.
        """
        vector = self._store.get_msgdef("geometry_msgs/msg/Vector3").fields
        if any(kind[1][0] != "float64" for _, kind in vector):
            return None
        size = len(messages[0])
        order = "<" if self._ros1 or messages[0][1] else ">"
        zeros = self._filled_bytes(first, None, order)
        if any(len(message) != size for message in messages) or not 0 <= size - len(zeros) <= _FILL_BYTES:
            return None
        table = np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), size)[:, : len(zeros)]
        fixed = table[:, zeros == self._filled_bytes(first, (), order)]
        if (fixed != fixed[0]).any():
            return None

        def numbers(kind: str, *paths: _Path) -> NDArray[Any]:
            found = [np.flatnonzero(zeros != self._filled_bytes(first, path, order)) for path in paths]
            return np.ascontiguousarray(table[:, np.concatenate(found)]).view(order + kind)

        wrench = numbers("f8", *place.numbers).astype(np.float64)
        parts = _PARTS[place.kind]
        if place.header is None:
            return Wrenches.checked(wrench, None, None, refuse, parts)
        seconds = [
            numbers(kind, (*place.header, "stamp", name)) for kind, name in (("i4", "sec"), ("u4", "nanosec"))
        ]
        frame = _part(first, place.header).frame_id
        return Wrenches.checked(wrench, np.hstack(seconds).astype(np.int64), [frame], refuse, parts)

    def _filled_bytes(self, value: Any, chosen: _Path | None, order: str) -> NDArray[np.uint8]:
        """Return a message whose numbers are all bytes 1 below a field, and zero elsewhere."""
        filled = self._filled(value, (None, self._name), (), chosen)
        if self._ros1:
            data = self._store.serialize_ros1(filled, self._name)
        else:
            data = self._store.serialize_cdr(filled, self._name, little_endian=order == "<")
        return np.frombuffer(data, np.uint8)

    def _filled(self, value: Any, kind: Any, path: _Path, chosen: _Path | None) -> Any:
        what = kind[1]
        if isinstance(what, str):  # the name of a struct
            known = self._store.get_msgdef(what).fields
            parts = [self._filled(getattr(value, name), kind, (*path, name), chosen) for name, kind in known]
            return type(value)(*parts)
        if isinstance(value, list):
            return [self._filled(item, what[0], path, chosen) for item in value]
        if isinstance(value, str):
            return value
        base = what[0] if isinstance(what[0], str) else what[0][1][0]
        size = np.dtype(_SIZED_AS.get(base, base))
        byte = b"\1" if chosen is not None and path[: len(chosen)] == chosen else b"\0"
        number = np.frombuffer(byte * size.itemsize, size)[0]
        return np.full_like(value, number) if isinstance(value, np.ndarray) else number


message_type = lru_cache(16)(MessageType)
"""All bags of a folder have the same definition, which takes some time to parse."""


def _part(value: Any, path: _Path) -> Any:
    for name in path:
        value = getattr(value, name)
    return value


def _ros2_name(type_name: str) -> str:
    package, _, name = type_name.rpartition("/")
    return f"{package}/msg/{name}"


# Wrenches as messages carry them: what readers hand over.

Refuse = Callable[[int, str], NoReturn]
"""Called with the index of the first bad message and what is wrong with it."""

IMU_AXES = ("wx", "wy", "wz", "ax", "ay", "az")
"""Of ``angular_velocity`` and ``linear_acceleration``."""

STAMPED = "geometry_msgs/WrenchStamped"
WRENCH_TYPES = (STAMPED, "geometry_msgs/Wrench")
"""The plain types; ROS 2 puts ``/msg/`` in between."""

_RULE = "=" * 80

DEFINITION = f"""std_msgs/Header header
geometry_msgs/Wrench wrench
{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_RULE}
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
"""ROS 2 definition of WrenchStamped with everything it is made of, as MCAP keeps it (``ros2msg``)."""


@dataclass(frozen=True)
class Wrenches:
    """Messages of one topic, in the order they were given: N and N m, ``header.stamp`` in ns, the frame of all."""

    wrench: FloatArray
    stamps_ns: NDArray[np.int64] | None
    frame_id: str | None

    @classmethod
    def checked(
        cls,
        wrench: FloatArray,
        stamps: NDArray[np.int64] | None,
        frames: list[str] | None,
        refuse: Refuse,
        parts: tuple[str, str],
    ) -> Wrenches:
        """Make them of seconds and nanoseconds (T, 2), and the frame of each message, or the one of all."""
        bad = np.argwhere(~np.isfinite(wrench))
        if len(bad):
            row, column = bad[0].tolist()
            name = f"{parts[column // 3]}.{'xyz'[column % 3]}"
            refuse(row, f"{name} is {wrench[row, column]}; samples must be finite")
        if stamps is None or frames is None:
            return cls(wrench, None, None)
        seconds, rest = stamps.T
        over = np.flatnonzero(rest >= 10**9)
        if len(over):
            refuse(int(over[0]), f"header.stamp has {rest[over[0]]} nanosec; wanted less than 1e9")
        other = next((i for i, frame in enumerate(frames) if frame != frames[0]), None)
        if other is not None:
            change = f"frame_id changes from {frames[0][:80]!r} to {frames[other][:80]!r}"
            refuse(other, f"{change}; a recording has its forces in one frame")
        return cls(wrench, seconds * 10**9 + rest, frames[0])

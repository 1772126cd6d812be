"""Wrench messages as bytes: the layouts of ROS 1 and of CDR, read as one table instead of one by one.

All messages of a topic have the same length as long as the frame does not change, so that their bytes, joined,
are an array of records. The same tables serve the writer.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "DEFINITION",
    "LARGEST_MESSAGE",
    "LONGEST_FRAME",
    "ORDERS",
    "STAMPED",
    "WRENCH_TYPES",
    "Encoding",
    "Refuse",
    "Wrenches",
    "decode_wrenches",
    "encode_wrenches",
    "foreign_definition",
]

Encoding = Literal["cdr", "ros1"]
"""How messages are laid out: ROS 2 (common data representation) or ROS 1."""

Refuse = Callable[[int, str], NoReturn]
"""Called with the index of the first bad message and what is wrong with it."""

STAMPED = "geometry_msgs/WrenchStamped"
WRENCH_TYPES = (STAMPED, "geometry_msgs/Wrench")
"""Types that can be read; ROS 2 puts ``/msg/`` in between."""

LARGEST_MESSAGE = 64 * 1024
"""Bytes of a message, compressed or not: a plain one has at most 72 without its frame_id, makers' own have more."""

LONGEST_FRAME = 1024
"""Bytes of a frame_id, at most."""

_LITTLE_ENDIAN = b"\x00\x01"
ORDERS = {b"\x00\x00": ">", _LITTLE_ENDIAN: "<"}
"""What a CDR message begins with, and the byte order that it means."""

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

_FIELDS = {
    "WrenchStamped": (("Header header", "Wrench wrench"),),
    "Wrench": (("Vector3 force", "Vector3 torque"),),
    "Vector3": (("float64 x", "float64 y", "float64 z"),),
    "Header": (("Time stamp", "string frame_id"), ("uint32 seq", "time stamp", "string frame_id")),
    "Time": (("int32 sec", "uint32 nanosec"),),
}
"""Fields of the types in question, package names left out (Header: of ROS 2, and of ROS 1)."""


@dataclass(frozen=True)
class Wrenches:
    """Messages of one topic, in the order they were given.

    Attributes
    ----------
    wrench : ndarray, shape (T, 6)
        Force x y z in N, torque x y z in N m; finite.
    stamps_ns : ndarray of int64, shape (T,), or None
        ``header.stamp`` in nanoseconds; None for messages without a header.
    frame_id : str or None
    """

    wrench: NDArray[np.float64]
    stamps_ns: NDArray[np.int64] | None
    frame_id: str | None


def foreign_definition(text: str, type_name: str) -> str | None:
    """Say where a message definition kept in a file departs from the standard types; None where it does not."""
    name = type_name.rpartition("/")[2]
    for section in re.split(r"^=+\s*$", text, flags=re.MULTILINE):
        lines = [" ".join(line.partition("#")[0].split()) for line in section.splitlines()]
        lines = [line for line in lines if line and "=" not in line]  # constants take no room in a message
        if lines and lines[0].startswith("MSG: "):
            name = lines.pop(0).rpartition("/")[2]
        fields = tuple(line.rpartition("/")[2] for line in lines)
        if name in _FIELDS and fields not in _FIELDS[name]:
            return f"{name} is defined as {'; '.join(fields)[:200]!r}, not as {'; '.join(_FIELDS[name][0])!r}"
    return None


def decode_wrenches(
    data: bytes | bytearray, lengths: NDArray[np.int64], encoding: Encoding, type_name: str, refuse: Refuse
) -> Wrenches:
    """Decode all messages of a topic at once.

    Parameters
    ----------
    data : bytes
        The messages, one after the other.
    lengths : ndarray of int, shape (T,)
        Bytes of each, T >= 1.
    encoding : {"cdr", "ros1"}
    type_name : str
        One of `WRENCH_TYPES`.
    refuse : callable
        Raises the error, see `Refuse`.
    """
    stamped = type_name == STAMPED
    n_bytes = int(lengths[0])
    layout = _layout_of(bytes(data[:n_bytes]), encoding, stamped, lambda problem: refuse(0, problem))
    _first(lengths != n_bytes, lambda i: _refuse_other(data, lengths, i, encoding, layout, refuse))
    table = np.frombuffer(data, dtype=layout)
    if encoding == "cdr":
        order = table["encapsulation"]
        _first(order != order[0], lambda i: refuse(i, "the byte order changes"))
    if not stamped:
        return Wrenches(_finite(table["wrench"], refuse), None, None)
    other = table["frame_bytes"] != table["frame_bytes"][0]
    if "frame" in (layout.names or ()):
        other |= (table["frame"] != table["frame"][0]).any(axis=1)
    _first(other, lambda i: _refuse_other(data, lengths, i, encoding, layout, refuse))
    nanosec = table["nanosec"]
    _first(
        nanosec >= 10**9, lambda i: refuse(i, f"header.stamp has {nanosec[i]} nanosec; wanted less than 1e9")
    )
    stamps_ns = table["sec"].astype(np.int64) * 10**9 + nanosec.astype(np.int64)
    try:
        frame_id = _frame(table[0]).decode("utf-8")
    except UnicodeDecodeError:
        refuse(0, "frame_id is not UTF-8 text")
    return Wrenches(_finite(table["wrench"], refuse), stamps_ns, frame_id)


def encode_wrenches(wrench: NDArray[np.float64], stamps_ns: NDArray[np.int64], frame_id: str) -> list[bytes]:
    """Encode samples as CDR messages of type WrenchStamped, little-endian; the inverse of `decode_wrenches`."""
    frame = frame_id.encode() + b"\0"
    layout = _layout("cdr", "<", stamped=True, frame_bytes=len(frame))
    table = np.zeros(len(wrench), layout)
    table["encapsulation"] = int.from_bytes(_LITTLE_ENDIAN, "big")
    table["sec"], table["nanosec"] = np.divmod(stamps_ns, 10**9)
    table["frame_bytes"] = len(frame)
    table["frame"] = np.frombuffer(frame, np.uint8)
    table["wrench"] = wrench
    data, size = table.tobytes(), layout.itemsize
    return [data[i : i + size] for i in range(0, len(data), size)]


def _layout_of(
    message: bytes, encoding: Encoding, stamped: bool, refuse: Callable[[str], NoReturn]
) -> np.dtype[np.void]:
    """Find the layout of a message from its first bytes and its length."""
    order = "<"
    if encoding == "cdr":
        if message[:2] not in ORDERS:
            refuse(f"begins with {message[:4].hex(' ') or 'nothing'}; wanted plain CDR (00 00 or 00 01)")
        order = ORDERS[message[:2]]
    frame_bytes = 0
    if stamped:
        frame_bytes = int.from_bytes(message[12:16], "little" if order == "<" else "big")
        if frame_bytes > LONGEST_FRAME:
            refuse(f"claims a frame_id of {frame_bytes} bytes; at most {LONGEST_FRAME} are read")
    layout = _layout(encoding, order, stamped=stamped, frame_bytes=frame_bytes)
    if layout.itemsize != len(message):
        refuse(f"has {len(message)} bytes; its type makes it {layout.itemsize}")
    return layout


def _layout(encoding: Encoding, order: str, *, stamped: bool, frame_bytes: int) -> np.dtype[np.void]:
    fields: list[tuple[Any, ...]] = []
    if encoding == "cdr":
        fields += [("encapsulation", ">u2"), ("options", "u2")]
    elif stamped:
        fields += [("seq", "<u4")]
    if stamped:
        sec = "i4" if encoding == "cdr" else "u4"
        fields += [("sec", order + sec), ("nanosec", order + "u4"), ("frame_bytes", order + "u4")]
        if frame_bytes:
            fields += [("frame", "u1", (frame_bytes,))]
        # CDR aligns doubles to 8 bytes, counted from behind its own header
        padding = -(12 + frame_bytes) % 8 if encoding == "cdr" else 0
        if padding:
            fields += [("padding", "u1", (padding,))]
    fields += [("wrench", order + "f8", (6,))]
    return np.dtype(fields)


def _finite(values: NDArray[np.float64], refuse: Refuse) -> NDArray[np.float64]:
    wrench = np.ascontiguousarray(values, dtype=np.float64)
    if not np.isfinite(wrench).all():
        row, column = (int(i) for i in np.argwhere(~np.isfinite(wrench))[0])
        name = f"{('force', 'torque')[column // 3]}.{'xyz'[column % 3]}"
        refuse(row, f"{name} is {wrench[row, column]}; samples must be finite")
    return wrench


def _first(wrong: NDArray[np.bool_], refuse: Callable[[int], NoReturn]) -> None:
    """Call `refuse` with the first index that is wrong, if any is."""
    if wrong.any():
        refuse(int(wrong.argmax()))


def _frame(message: np.void) -> bytes:
    return bytes(message["frame"]).removesuffix(b"\0") if "frame" in (message.dtype.names or ()) else b""


def _refuse_other(
    data: bytes | bytearray,
    lengths: NDArray[np.int64],
    index: int,
    encoding: Encoding,
    layout: np.dtype[np.void],
    refuse: Refuse,
) -> NoReturn:
    """Say why a message is laid out unlike the first: its frame is another one, or it is damaged."""
    start = int(lengths[:index].sum())
    message = bytes(data[start : start + int(lengths[index])])
    stamped = "frame_bytes" in (layout.names or ())
    own_layout = _layout_of(message, encoding, stamped, lambda problem: refuse(index, problem))
    records = (np.frombuffer(data, layout, count=1)[0], np.frombuffer(message, own_layout)[0])
    before, after = (_frame(record).decode("utf-8", "replace")[:80] for record in records)
    refuse(index, f"frame_id changes from {before!r} to {after!r}; a recording has its forces in one frame")

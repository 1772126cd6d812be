"""Wrenches as messages carry them: what readers hand over, and the plain messages that are written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray

__all__ = ["DEFINITION", "LONGEST_FRAME", "STAMPED", "WRENCH_TYPES", "Refuse", "Wrenches", "encode_wrenches"]

Refuse = Callable[[int, str], NoReturn]
"""Called with the index of the first bad message and what is wrong with it."""

STAMPED = "geometry_msgs/WrenchStamped"
WRENCH_TYPES = (STAMPED, "geometry_msgs/Wrench")
"""The plain types; ROS 2 puts ``/msg/`` in between."""

LONGEST_FRAME = 1024
"""Bytes of a frame_id that is written, at most."""

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
    ) -> Wrenches:
        """Make them of seconds and nanoseconds (T, 2), and the frame of each message, or the one of all."""
        bad = np.argwhere(~np.isfinite(wrench))
        if len(bad):
            row, column = bad[0].tolist()
            name = f"{('force', 'torque')[column // 3]}.{'xyz'[column % 3]}"
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


def encode_wrenches(wrench: FloatArray, stamps_ns: NDArray[np.int64], frame_id: str) -> list[bytes]:
    """Encode samples as CDR messages of type WrenchStamped, little-endian."""
    frame = frame_id.encode() + b"\0"
    layout = np.dtype(
        [
            ("encapsulation", "4u1"),
            ("sec", "<i4"),
            ("nanosec", "<u4"),
            ("frame_bytes", "<u4"),
            ("frame", "u1", (len(frame),)),
            # CDR aligns doubles to 8 bytes, counted from behind its own header
            ("padding", "u1", (-(12 + len(frame)) % 8,)),
            ("wrench", "<f8", (6,)),
        ]
    )
    table = np.zeros(len(wrench), layout)
    table["encapsulation"] = (0, 1, 0, 0)
    table["sec"], table["nanosec"] = np.divmod(stamps_ns, 10**9)
    table["frame_bytes"] = len(frame)
    table["frame"] = np.frombuffer(frame, np.uint8)
    table["wrench"] = wrench
    data, size = table.tobytes(), layout.itemsize
    return [data[i : i + size] for i in range(0, len(data), size)]

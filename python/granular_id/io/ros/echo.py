"""What ``rostopic echo -p`` (ROS 1) and ``ros2 topic echo --csv`` (ROS 2) print: a line of text for each message.

ROS 1 names its columns in line 1 (``%time,field.header.seq,...``), ROS 2 does not: there a first line of two whole
numbers, a frame and six more cells is one of ``geometry_msgs/msg/WrenchStamped``.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from granular_id.io.columns import axis_of
from granular_id.io.errors import RecordingFileError
from granular_id.io.files import open_bounded, read_text_bounded
from granular_id.io.numbers import parse_numbers
from granular_id.io.options import LoadOptions
from granular_id.io.ros.messages import WRENCH_TYPES, Wrenches
from granular_id.io.ros.read import recording_of
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import AXES

_LOGGED, _SEQ, _STAMP, _FRAME = "%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"
_SEC, _NANOSEC = "header.stamp.sec", "header.stamp.nanosec"
_ROS2 = (_SEC, _NANOSEC, _FRAME, *AXES)
_ROS2_LINE = re.compile(rb"[0-9]{1,10},[0-9]{1,9},(?![-+.0-9eE]+,)[^,]*(?:,[^,]*){6}")
_LONGEST_LINE, _LONGEST_NUMBER = 64 * 1024, 24


def is_echo(path: Path) -> bool:
    """Tell from the first line of a CSV file whether ROS has printed it."""
    try:
        with open_bounded(path, path.parent, sys.maxsize) as (file, _):
            line = file.readline(_LONGEST_LINE)
    except RecordingFileError:
        return False
    return line.startswith(_LOGGED.encode() + b",") or _ROS2_LINE.fullmatch(line) is not None


def read_echo(source: FileSource, options: LoadOptions) -> FileContent:
    """Read one file as one recording, as a bag with these messages is read."""
    path = source.path
    lines = read_text_bounded(path, source.root, options.max_text_bytes).rstrip().splitlines()
    named = lines[0].startswith(_LOGGED.encode())
    names = _names(lines[0], path) if named else _ROS2
    first_line = 2 if named else 1
    rows = [line.split(b",") for line in lines[first_line - 1 :]]
    if not rows:
        raise RecordingFileError(path, "holds no messages", line=1)

    def place_of(index: int) -> dict[str, Any]:
        return {"line": index + first_line}

    def refuse(index: int, problem: str) -> NoReturn:
        raise RecordingFileError(path, problem, **place_of(index))

    for i, row in enumerate(rows):
        if len(row) != len(names):
            refuse(i, f"{len(row)} cells; wanted {len(names)}, as many as the fields of the message")
    cells = dict(zip(names, zip(*rows, strict=True), strict=True))

    def whole(name: str, most: int = 2**63 - 1) -> NDArray[np.int64]:
        for i, cell in enumerate(cells[name]):
            if not cell.strip().isdigit() or len(cell) > _LONGEST_NUMBER or int(cell) > most:
                problem = f"{cell.decode('utf-8', 'replace')[:40]!r} is not a whole number up to {most}"
                raise RecordingFileError(path, problem, column=name, **place_of(i))
        return np.array([int(cell) for cell in cells[name]], np.int64)

    text = b"\n".join(b",".join(row) for row in zip(*(cells[axis] for axis in AXES), strict=True))
    wrench = parse_numbers(text, 0, AXES, path, first_line=first_line)
    stamps = None
    if _STAMP in names:
        stamps = np.stack(np.divmod(whole(_STAMP), 10**9), axis=1)
    elif _SEC in names:
        stamps = np.stack([whole(_SEC, 2**31 - 1), whole(_NANOSEC)], axis=1)
    try:
        frames = [cell.strip().decode() for cell in cells[_FRAME]] if _FRAME in names else [""]
    except UnicodeDecodeError:
        refuse(0, "frame_id is not UTF-8 text")
    wrenches = Wrenches.checked(wrench, stamps, frames, refuse)
    about = {"frame": wrenches.frame_id, "message_type": WRENCH_TYPES[stamps is None]}
    log_ns = whole(_LOGGED) if named else None
    return recording_of(wrenches, log_ns, source, options, about, place_of, [])


def _names(line: bytes, path: Path) -> tuple[str, ...]:
    """Column names of ROS 1, with those of the six axes as ours."""
    names = [name.strip() for name in line.decode("utf-8", "replace").split(",")]
    names = [axis if (axis := axis_of(name)) in AXES else name for name in names]
    for i, name in enumerate(names):
        if name not in (_LOGGED, _SEQ, _STAMP, _FRAME, *AXES) or name in names[:i]:
            what = "occurs twice" if name in names[:i] else "is no field of a wrench"
            raise RecordingFileError(
                path,
                f"{name[:80]!r} {what}; wanted geometry_msgs/WrenchStamped or Wrench",
                line=1,
                column=str(i + 1),
            )
    missing = [axis for axis in AXES if axis not in names]
    if missing:
        raise RecordingFileError(path, f"column {missing[0]!r} is missing; wanted {', '.join(AXES)}", line=1)
    return tuple(names)

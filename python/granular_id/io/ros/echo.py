"""What ``rostopic echo -p`` (ROS 1) and ``ros2 topic echo --csv`` (ROS 2) print: a line of text for each message.

ROS 1 names its columns in line 1 (``%time,field.header.seq,...``), ROS 2 does not: there a first line of two whole
numbers, a frame and six more cells is one of ``geometry_msgs/msg/WrenchStamped``.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from granular_id.io.columns import axis_of
from granular_id.io.csv import csv_columns
from granular_id.io.errors import RecordingFileError
from granular_id.io.files import read_text_bounded
from granular_id.io.numbers import Header, first_line, picked_columns, split_header
from granular_id.io.options import LoadOptions
from granular_id.io.ros.messages import WRENCH_TYPES, Wrenches
from granular_id.io.ros.read import recording_of
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import AXES

_LOGGED, _SEQ, _STAMP, _FRAME = "%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"
_SEC, _NANOSEC = "header.stamp.sec", "header.stamp.nanosec"
_ROS1, _ROS2 = (_LOGGED, _SEQ, _STAMP, _FRAME), (_SEC, _NANOSEC, _FRAME)
_ROS2_LINE = re.compile(rb"[0-9]{1,10},[0-9]{1,9},(?![-+.0-9eE]+,)[^,]*(?:,[^,]*){6}")
_WHOLE_NUMBER = re.compile(r"[0-9]{1,24}")
_LONGEST_LINE = 64 * 1024


def is_echo(path: Path) -> bool:
    """Tell from the first line of a CSV file whether ROS has printed it."""
    line = first_line(path, _LONGEST_LINE)
    return line.startswith(_LOGGED.encode() + b",") or _ROS2_LINE.fullmatch(line) is not None


def read_echo(source: FileSource, options: LoadOptions) -> FileContent:
    """Read one file as one recording, as a bag with these messages is read."""
    path = source.path
    data = read_text_bounded(path, source.root, options.max_text_bytes)
    named = data.startswith(_LOGGED.encode())
    header = split_header(data, path) if named else Header([*_ROS2, *AXES], 0, ",")
    begin, fields = (2, _ROS1) if named else (1, _ROS2)
    columns = csv_columns(header.names, path, known={name: name for name in fields})
    known = [name in fields or axis_of(name) in AXES for name in header.names]
    other = known.index(False) if False in known else None
    if other is not None:
        problem = f"{header.names[other][:80]!r} is no field of a wrench; wanted geometry_msgs/WrenchStamped or Wrench"
        raise RecordingFileError(path, problem, line=1, column=str(other + 1))
    axes = [columns[axis] for axis in AXES]
    others = [i for what, i in columns.items() if what not in AXES]
    wrench, cells = picked_columns(data, header, axes, others, path, first_line=begin)

    def place_of(index: int) -> dict[str, Any]:
        return {"line": index + begin}

    def refuse(index: int, problem: str) -> NoReturn:
        raise RecordingFileError(path, problem, **place_of(index))

    def whole(name: str, most: int = 2**63 - 1) -> NDArray[np.int64]:
        values = cells[columns[name]]
        for i, cell in enumerate(values):
            if not _WHOLE_NUMBER.fullmatch(cell) or int(cell) > most:
                problem = f"{cell[:40]!r} is not a whole number up to {most}"
                raise RecordingFileError(path, problem, column=name, **place_of(i))
        return np.array([int(cell) for cell in values], np.int64)

    stamps = None
    if _STAMP in columns:
        stamps = np.stack(np.divmod(whole(_STAMP), 10**9), axis=1)
    elif _SEC in columns:
        stamps = np.stack([whole(_SEC, 2**31 - 1), whole(_NANOSEC)], axis=1)
    frames = cells[columns[_FRAME]] if _FRAME in columns else [""]
    wrenches = Wrenches.checked(wrench, stamps, frames, refuse)
    about = {"frame": wrenches.frame_id, "message_type": WRENCH_TYPES[stamps is None]}
    log_ns = whole(_LOGGED) if named else None
    return recording_of(wrenches, log_ns, source, options, about, place_of, [])

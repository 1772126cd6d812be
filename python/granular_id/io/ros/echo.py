"""What ``rostopic echo -p`` (ROS 1) and ``ros2 topic echo --csv`` (ROS 2) print: a line of text for each message.

ROS 1 names its columns in line 1 (``%time,field.header.seq,...``), ROS 2 does not: there a first line of two whole
numbers, a frame and six more cells is one of ``geometry_msgs/msg/WrenchStamped``.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_id.io.columns import axis_of
from granular_id.io.csv.numbers import parse_numbers
from granular_id.io.errors import RecordingFileError
from granular_id.io.files import open_bounded, read_text_bounded
from granular_id.io.options import LoadOptions
from granular_id.io.ros.clock import recording_of
from granular_id.io.ros.wrench import WRENCH_TYPES, Wrenches
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import AXES

__all__ = ["is_echo", "read_echo"]

_LOGGED, _SEQ, _STAMP, _FRAME = "%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"
_SEC, _NANOSEC = "header.stamp.sec", "header.stamp.nanosec"
_ROS2 = (_SEC, _NANOSEC, _FRAME, *AXES)

_WHOLE = re.compile(rb"[0-9]{1,19}")
_LONGEST_LINE = 64 * 1024
_MOST_NS = 2**63 - 1
_MOST_S = _MOST_NS // 10**9 - 1

_ROS2_LINE = re.compile(rb"[0-9]{1,10},[0-9]{1,9},(?![-+.0-9eE]+,)[^,]*(?:,[^,]*){6}")


def is_echo(path: Path) -> bool:
    """Tell from the first line of a CSV file whether ROS has printed it."""
    try:
        with open_bounded(path, path.parent, sys.maxsize) as (file, _):
            line = file.readline(_LONGEST_LINE)
    except RecordingFileError:
        return False
    return line.startswith(_LOGGED.encode() + b",") or _ROS2_LINE.fullmatch(line) is not None


def read_echo(source: FileSource, options: LoadOptions) -> FileContent:
    """Read one file as one recording, as a bag with these messages is read.

    Raises
    ------
    RecordingFileError
        With line and column: other fields than those of a wrench, what is no number, a frame that changes.
    """
    lines = read_text_bounded(source.path, source.root, options.max_text_bytes).splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    named = lines[0].startswith(_LOGGED.encode())
    names = _names(lines[0], source.path) if named else _ROS2
    table = _Table(source.path, names, lines[1:] if named else lines, 2 if named else 1)
    stamps_ns = table.whole(_STAMP)
    if not named:
        seconds, rest = table.whole(_SEC, _MOST_S), table.whole(_NANOSEC, 10**9 - 1)
        stamps_ns = None if seconds is None or rest is None else seconds * 10**9 + rest
    frame = table.frame()
    wrenches = Wrenches(table.axes(), stamps_ns, frame)
    return recording_of(
        wrenches,
        table.whole(_LOGGED),
        source,
        options,
        {
            "frame": frame,
            "message_type": WRENCH_TYPES[stamps_ns is None],
        },
        lambda message: {"line": message + table.first_line},
        [],
    )


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


class _Table:
    """Cells of all lines."""

    def __init__(self, path: Path, names: Sequence[str], lines: Sequence[bytes], first_line: int) -> None:
        self.path, self.names, self.first_line = path, names, first_line
        if not lines:
            raise RecordingFileError(path, "holds no messages", line=1)
        self.rows = [line.split(b",") for line in lines]
        for number, row in enumerate(self.rows):
            if len(row) != len(names):
                problem = f"{len(row)} cells; wanted {len(names)}, as many as the fields of the message"
                raise RecordingFileError(path, problem, line=number + first_line)

    def whole(self, name: str, most: int = _MOST_NS) -> NDArray[np.int64] | None:
        """Return the whole numbers of a column; None where it is not there."""
        if name not in self.names:
            return None
        cells = self._cells(name)
        for number, cell in enumerate(cells):
            if not _WHOLE.fullmatch(cell) or int(cell) > most:
                problem = f"{cell.decode('utf-8', 'replace')[:40]!r} is not a whole number up to {most}"
                raise RecordingFileError(self.path, problem, line=number + self.first_line, column=name)
        return np.array([int(cell) for cell in cells], np.int64)

    def frame(self) -> str | None:
        """Return the one frame of all messages; None where they have none."""
        if _FRAME not in self.names:
            return None
        cells = self._cells(_FRAME)
        for number, cell in enumerate(cells):
            if cell != cells[0]:
                before, after = (text.decode("utf-8", "replace")[:80] for text in (cells[number - 1], cell))
                problem = (
                    f"frame_id changes from {before!r} to {after!r}; a recording has its forces in one frame"
                )
                raise RecordingFileError(self.path, problem, line=number + self.first_line)
        try:
            return cells[0].decode("utf-8")
        except UnicodeDecodeError as error:
            raise RecordingFileError(self.path, "frame_id is not UTF-8 text", line=self.first_line) from error

    def axes(self) -> NDArray[np.float64]:
        """Return the samples, shape (T, 6)."""
        places = [self.names.index(axis) for axis in AXES]
        text = b"\n".join(b",".join([row[place] for place in places]) for row in self.rows)
        return parse_numbers(text, 0, AXES, self.path, first_line=self.first_line)

    def _cells(self, name: str) -> list[bytes]:
        place = self.names.index(name)
        return [row[place].strip() for row in self.rows]

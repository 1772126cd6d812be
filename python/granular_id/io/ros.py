"""Recordings in the formats of ROS: .bag of ROS 1, bag folders, .mcap and .db3 of ROS 2, read by rosbags.

One topic of one bag is one recording: of ``WrenchStamped``, ``Wrench``, or any message that has one of these as a
field, by the definition that the bag keeps.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from granular_id.io.files import RecordingFileError, need
from granular_id.io.source import FileContent, FileSource, LoadOptions
from granular_id.recording import AXES, Table

_HEADER, _WRENCH = "std_msgs/msg/Header", "geometry_msgs/msg/Wrench"
_STAMPED = "geometry_msgs/msg/WrenchStamped"
_NUMBERS = tuple(f"{part}.{axis}" for part in ("force", "torque") for axis in "xyz")
_LISTED = 12
_JSON = (
    "messages in JSON are no messages of ROS; the package mcap reads them: in Python: "
    "from mcap.reader import make_reader; import io, json, pathlib; "
    "bag = make_reader(io.BytesIO(pathlib.Path({path!r}).read_bytes())); "
    "rows = [(m.log_time / 1e9, json.loads(m.data){keys}) for _, _, m in bag.iter_messages(topics=[{topic!r}])]; "
    "Dataset.from_frames({{'time': [t for t, _ in rows], **{{{columns}}}}})"
)
"""What to do with messages of Foxglove and others."""

_JSON_COLUMNS = {
    "vectors": "p[0] + a: [w[p][a] for _, w in rows] for p in ('force', 'torque') for a in 'xyz'",
    "lists": "p[0] + a: [w[p][i] for _, w in rows] for p in ('force', 'torque') for i, a in enumerate('xyz')",
    "axes": f"a: [w[a] for _, w in rows] for a in {AXES}",
}
"""What leads from a wrench to fx ... tz: ``force`` and ``torque`` of x, y, z or three numbers, or the axes."""


@dataclass(frozen=True)
class _Wrench:
    """Where a topic carries a wrench: its connections, and the fields that lead to the wrench and its header."""

    topic: str
    type_name: str
    connections: tuple[Any, ...]
    field: str  # "" where the message is a wrench itself
    wrench: str
    header: str | None

    @property
    def name(self) -> str:
        """What ``topic=`` calls it."""
        return self.topic + (self.field and f".{self.field}")

    @property
    def count(self) -> int:
        return sum(connection.msgcount for connection in self.connections)


def read_ros(source: FileSource, options: LoadOptions) -> FileContent:
    """Read the wrench messages of one bag as one recording: a ``.bag``, ``.mcap`` or ``.db3`` file, or a folder.

    Its clock is ``header.stamp``, or the log time where stamps were never set.
    """
    with _opened(source.path) as reader:
        chosen, notes = _chosen(reader, source.path, options.topic)
        found = [
            (log_ns, reader.deserialize(data, connection.msgtype))
            for connection, log_ns, data in reader.messages(connections=list(chosen.connections))
        ]
    if not found:
        raise RecordingFileError(
            source.path, f"has no messages on topic {chosen.name!r:.80}, though it lists some"
        )
    log_ns = np.array([time for time, _ in found], np.int64)
    messages = [message for _, message in found]
    numbers = attrgetter(*(f"{chosen.wrench}.{name}".lstrip(".") for name in _NUMBERS))
    values = np.array([numbers(message) for message in messages], np.float64)
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = bad[0].tolist()
        problem = f"{_NUMBERS[column]} is {values[row, column]}; samples must be finite"
        raise RecordingFileError(source.path, problem, place=f"message {row + 1} of {chosen.topic[:80]}")
    stamps, clock = log_ns, "log time"
    frame = None
    if chosen.header is None:
        notes.append(
            "messages without a header: log times are taken, which jitter more than the sensor's clock"
        )
    else:
        headers = list(map(attrgetter(chosen.header), messages))
        frame = _frame_of(headers, source.path, chosen.topic)
        own = np.array([header.stamp.sec * 10**9 + header.stamp.nanosec for header in headers], np.int64)
        if own.any() and (len(own) < 2 or (own != own[0]).any()):
            stamps, clock = own, "header.stamp"
        else:
            notes.append(
                "header.stamp never changes: log times are taken, which jitter more than the sensor's clock"
            )
    about = {"topic": chosen.name, "message_type": chosen.type_name, "frame": frame}
    table = Table(
        name=source.name,
        values=values,
        axes=AXES,
        stamps=stamps.view("M8[ns]"),
        meta={key: value for key, value in about.items() if value},
        clock=clock,
    )

    def place(_: int, row: int | None) -> dict[str, Any]:
        return {} if row is None else {"place": f"message {row + 1} of {chosen.topic[:80]}"}

    return FileContent([table], notes=notes, place=place)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a bag; what rosbags says of one that was not closed gets the way out."""
    library = need("rosbags.highlevel", extra="ros", why="to read ROS bags and MCAP")
    typesys = need("rosbags.typesys", extra="ros", why="to read ROS bags and MCAP")
    is_ros1 = path.suffix.lower() == ".bag" and path.is_file()
    for file in [path, *path.glob("*.db3")] if path.is_dir() else [path]:
        log = file.with_name(file.name + "-wal")
        if os.path.isfile(log) and log.stat().st_size:  # noqa: PTH113 (rosbags would pass over the messages in it)
            problem = (
                f"was not closed: {log.name} holds messages that are not in it yet; run `ros2 bag reindex`"
            )
            raise RecordingFileError(file, problem)
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if is_ros1 else typesys.Stores.LATEST)
    try:
        with library.AnyReader([path], default_typestore=store) as reader:
            yield reader
    except (library.AnyReaderError, AssertionError, KeyError, ValueError) as error:
        if isinstance(error, RecordingFileError):
            raise
        other = _other_messages(path)
        if other is not None:
            raise RecordingFileError(path, other) from error
        said = (str(error).partition("\n")[0] or type(error).__name__)[:200].rstrip(".")
        way_out = "`rosbag reindex`" if is_ros1 else "`ros2 bag reindex`, or `mcap recover` of an .mcap"
        problem = f"cannot be read: {said}; if the recording was not closed, try {way_out}"
        raise RecordingFileError(path, problem) from error


def _other_messages(path: Path) -> str | None:
    """Say what reads an MCAP file whose messages are not those of ROS 2; None for any other file."""
    if path.suffix.lower() != ".mcap" or not path.is_file():
        return None
    try:
        make_reader = import_module("mcap.reader").make_reader
    except ImportError:
        return "is no bag of ROS 2: install mcap (pip install mcap) and load it again to see what its messages are"
    try:
        with path.open("rb") as file:
            found = {
                channel.topic: (channel, message) for _, channel, message in make_reader(file).iter_messages()
            }
    except Exception:  # it is damaged: what rosbags says of it holds
        return None
    for topic, (channel, message) in found.items():
        wrench = _wrench_in_json(json.loads(message.data)) if channel.message_encoding == "json" else None
        if wrench is not None:
            keys, columns = wrench
            return _JSON.format(path=str(path), topic=topic, keys=keys, columns=_JSON_COLUMNS[columns])
    listed = ", ".join(f"{topic[:80]} ({channel.message_encoding})" for topic, (channel, _) in found.items())
    encodings = {channel.message_encoding for channel, _ in found.values()}
    if encodings <= {"cdr"}:
        return None
    return (
        f"holds no wrenches of ROS 2 but {listed[:300]}: decode them, and pass columns to Dataset.from_frames"
    )


def _wrench_in_json(value: Any, keys: str = "") -> tuple[str, str] | None:
    """Return the keys that lead to a wrench in a message, and which of `_JSON_COLUMNS` it has."""
    if not isinstance(value, dict):
        return None
    parts = [value.get("force"), value.get("torque")]
    if all(isinstance(part, dict) and {"x", "y", "z"} <= part.keys() for part in parts):
        return keys, "vectors"
    if all(isinstance(part, list) and len(part) == 3 for part in parts):
        return keys, "lists"
    if set(AXES) <= value.keys():
        return keys, "axes"
    inner = (_wrench_in_json(one, f"{keys}[{key!r}]") for key, one in value.items())
    return next((found for found in inner if found is not None), None)


def _chosen(reader: Any, path: Path, asked: str | None) -> tuple[_Wrench, list[str]]:
    """Return the one wrench to read, and a note where it is a field of a message."""
    groups: dict[tuple[str, str], list[Any]] = {}
    counted = any(connection.msgcount for connection in reader.connections)  # an MCAP file may not count them
    for connection in reader.connections:
        if connection.msgcount or not counted:
            groups.setdefault((connection.topic, connection.msgtype), []).append(connection)
    every = [
        one for (topic, kind), same in groups.items() for one in _wrenches(reader, topic, kind, tuple(same))
    ]
    there = ", ".join(
        f"{topic[:80]} ({kind[:80]}, {sum(c.msgcount for c in same)} messages)"
        for (topic, kind), same in list(groups.items())[:_LISTED]
    )
    if not every:
        wanted = "messages of type WrenchStamped or Wrench, nor with one as a field"
        nothing = "no messages at all" + "; `mcap recover` lists topics that a summary lacks" * (
            path.suffix == ".mcap"
        )
        raise RecordingFileError(path, f"has no {wanted}; it has {there or nothing}")
    found = (
        every
        if asked is None
        else [one for one in every if asked.strip("/") in (one.name.strip("/"), one.topic.strip("/"))]
    )
    if not found:
        raise RecordingFileError(path, f"has no wrenches on topic {asked!r}; it has {_named(every)}")
    plain = [one for one in found if not one.field]
    if len(found) > 1 and len(plain) == 1:
        others = _named([one for one in found if one.field])
        return plain[0], [f"wrenches in {others} are not read; topic= chooses them"]
    if len(found) > 1:
        raise RecordingFileError(
            path, f"has {len(found)} topics with wrenches: {_named(found)}; choose by topic="
        )
    (one,) = found
    return one, [f"the wrench is the field {one.field} of {one.type_name}"] if one.field else []


def _named(wrenches: Sequence[_Wrench]) -> str:
    more = f" and {len(wrenches) - _LISTED} more" if len(wrenches) > _LISTED else ""
    return ", ".join(f"{one.name[:80]!r} ({one.count} messages)" for one in wrenches[:_LISTED]) + more


def _wrenches(reader: Any, topic: str, kind: str, connections: tuple[Any, ...]) -> Iterator[_Wrench]:
    """Yield the wrenches in messages of a type, by its definition; those in lists are not counted."""
    plain = kind.replace("/msg/", "/")

    def found(name: str, path: tuple[str, ...], header: str | None) -> Iterator[_Wrench]:
        if name == _WRENCH:
            yield _Wrench(topic, plain, connections, ".".join(path), ".".join(path), header)
            return
        try:
            fields = reader.typestore.get_msgdef(name).fields
        except KeyError:
            return
        structs = {field: what for field, (node, what) in fields if node.name == "NAME"}
        own = next((".".join((*path, field)) for field, inner in structs.items() if inner == _HEADER), header)
        if name == _STAMPED:  # named as a whole, not by the field inside
            yield _Wrench(topic, plain, connections, ".".join(path), ".".join((*path, "wrench")), own)
            return
        for field, inner in structs.items():
            yield from found(inner, (*path, field), own)

    yield from found(kind, (), None)


def _frame_of(headers: Sequence[Any], path: Path, topic: str) -> str:
    first = str(headers[0].frame_id)
    other = next((i for i, header in enumerate(headers) if header.frame_id != first), None)
    if other is not None:
        change = f"frame_id changes from {first[:80]!r} to {str(headers[other].frame_id)[:80]!r}"
        place = f"message {other + 1} of {topic[:80]}"
        raise RecordingFileError(path, f"{change}; a recording has its forces in one frame", place=place)
    return first

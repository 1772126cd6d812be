"""Recordings in the formats of ROS: .bag of ROS 1, bag folders, .mcap and .db3 of ROS 2, read by rosbags.

One topic of one bag is one recording: of ``WrenchStamped``, ``Wrench``, or any message that has one of these as a
field, by the definition that the bag keeps.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from granular_id._text import alternatives, in_both
from granular_id.io.files import RecordingFileError, need
from granular_id.io.source import FileContent, FileSource, LoadOptions
from granular_id.io.ways_out import PART_NAMES, Place, in_columns, in_python_each, paths_line, places_of
from granular_id.recording import AXES, Table, meaning_of

_HEADER, _WRENCH = "std_msgs/msg/Header", "geometry_msgs/msg/Wrench"
_STAMPED = "geometry_msgs/msg/WrenchStamped"
_NUMBERS = tuple(f"{part}.{axis}" for part in ("force", "torque") for axis in "xyz")
_NO_FORCES = re.compile(r"pos|vel|acc|effort|joint|cov|temp|current|target|\bqd?\b|tau", re.IGNORECASE)
"""Names of lists of six numbers that are no wrench: those of joints."""

_FORCES = re.compile(r"wrench|force|torque|load|\bft\b", re.IGNORECASE)
_PLACES = re.compile(r"pos|point|target|translation", re.IGNORECASE)
"""Names of vectors that no sensor of forces or motion measures."""

_LISTED = 12


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
    with _opened(source) as reader:
        chosen, notes = _chosen(reader, source, options.topic)
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
    fields = [f"{chosen.wrench}.{name}".lstrip(".") for name in _NUMBERS]
    values = np.array(list(map(attrgetter(*fields), messages)), np.float64)
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

    return FileContent(
        [table],
        notes=notes,
        place=place,
        in_python=lambda mend: _bag_lines(source, chosen.topic, _renamed(fields), mend),
    )


@contextmanager
def _opened(source: FileSource) -> Iterator[Any]:
    """Open a bag; what rosbags says of one that was not closed gets the way out."""
    path = source.path
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
        other = _other_messages(source)
        if other is not None:
            raise RecordingFileError(path, other) from error
        reason = (str(error).partition("\n")[0] or type(error).__name__)[:200].rstrip(".")
        way_out = "`rosbag reindex`" if is_ros1 else "`ros2 bag reindex`, or `mcap recover` of an .mcap"
        problem = f"cannot be read: {reason}; if the recording was not closed, try {way_out}"
        raise RecordingFileError(path, problem) from error


def _other_messages(source: FileSource) -> str | tuple[str, ...] | None:
    """Say what reads an MCAP file whose messages are not those of ROS 2; None for any other file."""
    path = source.path
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
    in_json = [(topic, one) for topic, (channel, one) in found.items() if channel.message_encoding == "json"]
    forms = [(topic, form) for topic, one in in_json if (form := _form_of(json.loads(one.data)))]
    if forms:
        forms.sort(key=lambda one: bool(one[1].axes))  # a wrench before other sensors
        return ("messages in JSON are no messages of ROS", *_json_lines(source, *forms[0]))
    encodings = [channel.message_encoding for channel, _ in found.values()]
    listed = ", ".join(f"{topic[:80]} ({kind})" for topic, kind in zip(found, encodings, strict=True))
    others = (
        f"holds no wrenches of ROS 2 but {listed[:300]}: decode them, and pass columns to Dataset.from_frames"
    )
    return None if set(encodings) <= {"cdr"} else others


def _json_lines(source: FileSource, topic: str, form: _Form) -> list[str]:
    """Return the lines that read messages in JSON."""
    bag = f"make_reader(io.BytesIO(path.read_bytes())).iter_messages(topics=[{topic!r}])"
    rows = f"[{{**json.loads(m.data), 'time': m.log_time / 1e9}} for _, _, m in {bag}]"
    return _frame_lines(source, ["from mcap.reader import make_reader"], [], rows, form, [])


def _bag_lines(source: FileSource, topic: str, form: _Form, mend: str = "") -> list[str]:
    """Return the lines that read the messages of a bag on a topic."""
    row = "{**dataclasses.asdict(bags[path].deserialize(data, c.msgtype)), 'time': t / 1e9}"
    rows = f"[{row} for c, t, data in bags[path].messages() if c.topic == {topic!r}]"
    imports = ["from rosbags.highlevel import AnyReader", "from rosbags.typesys import Stores, get_typestore"]
    one = "AnyReader([path], default_typestore=get_typestore(Stores.LATEST))"
    opened = [f"bags = {{path: {one} for path in paths}}", "[bag.open() for bag in bags.values()]"]
    whole = form._replace(mend=form.mend + mend)
    return _frame_lines(source, imports, opened, rows, whole, ["[bag.close() for bag in bags.values()]"])


def _frame_lines(
    source: FileSource,
    imports: Sequence[str],
    opened: Sequence[str],
    rows: str,
    form: _Form,
    closed: Sequence[str],
) -> list[str]:
    """Return the lines that make tables of messages, of all files like this one; `rows` are those of a path."""
    places = places_of(source)
    paths = paths_line(source) if places else f"paths = [pathlib.Path({str(source.path)!r})]"
    # the number of a sensor, or of a message, is no id of a recording
    plain = f"pandas.json_normalize({rows}).drop(columns='id', errors='ignore')"
    frames = f"frames = [{plain}{form.mend} for path in paths]"
    own = source.label or source.label_else
    axes = f", axes={','.join(form.axes)!r}" if form.axes else ""
    calls = []
    for label, session, why in places or [Place("" if own is None else repr(own), None, "")]:
        labels = f", [{label} for path in paths]" * bool(label)
        sessions = f", sessions=[{session} for path in paths]" if session else ""
        assumed = " and ".join(filter(None, (form.why, why)))
        calls.append((f"Dataset.from_frames(frames{labels}{sessions}{axes})", assumed))
    return in_python_each([*imports, paths, *opened, frames, *closed], calls)


class _Form(NamedTuple):
    """What makes a table of messages of another kind: methods of a data frame of them, and axes that are no wrench."""

    mend: str
    axes: tuple[str, ...] = ()
    why: str = ""  # what it assumes


def _form_of(message: Any) -> _Form | None:
    """Find the six numbers of a wrench in a message, by their names or in lists; else vectors of other sensors."""
    if not isinstance(message, dict):
        return None
    cells = need("pandas", extra="app", why="to read messages of other kinds").json_normalize(message).iloc[0]
    tails = [(name, ".".join(name.split(".")[-n:])) for name in reversed(list(cells.index)) for n in (2, 1)]
    named = {what: name for name, tail in tails if (what := meaning_of(tail).what) in AXES}
    if set(AXES) <= named.keys():
        return _renamed([named[axis] for axis in AXES])
    arrays = {name: np.asarray(cell) for name, cell in cells.items() if isinstance(cell, (list, np.ndarray))}
    lists = {name: len(array) for name, array in arrays.items() if array.dtype.kind in "iuf"}
    six = [name for name, n in lists.items() if n == len(AXES) and not _NO_FORCES.search(str(name))]
    six = [name for name in six if _FORCES.search(str(name))] or six[: len(six) == 1]
    three = [
        next((name for name in lists if name.rpartition(".")[2].lower() in words and lists[name] == 3), None)
        for words in PART_NAMES
    ]
    if six:
        return _Form(in_columns(six[0], AXES), why=f"{six[0]!r} holds fx to tz in N and N m")
    if None not in three:
        return _Form(
            "".join(
                in_columns(str(name), axes) for name, axes in zip(three, (AXES[:3], AXES[3:]), strict=True)
            )
        )
    vectors = [
        name[:-2]
        for name in cells.index
        if name.endswith(".x") and f"{name[:-1]}w" not in cells.index and not _PLACES.search(name)
    ]
    return _Form("", tuple(f"{name}.{axis}" for name in vectors for axis in "xyz")) if vectors else None


def _renamed(fields: Sequence[str]) -> _Form:
    return _Form(f".rename(columns={dict(zip(fields, AXES, strict=True))})")


def _chosen(reader: Any, source: FileSource, named: str | None) -> tuple[_Wrench, list[str]]:
    """Return the one wrench to read, and a note where it is a field of a message."""
    path = source.path
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
        forms = [(topic, form) for (topic, _), same in groups.items() if (form := _form_in(reader, same[0]))]
        forms.sort(key=lambda one: bool(one[1].axes))  # a wrench before other sensors
        lines = _bag_lines(source, *forms[0]) if forms else []
        raise RecordingFileError(path, (f"has no {wanted}; it has {there or nothing}", *lines))
    found = (
        every
        if named is None
        else [one for one in every if named.strip("/") in (one.name.strip("/"), one.topic.strip("/"))]
    )
    if not found:
        raise RecordingFileError(path, f"has no wrenches on topic {named!r}; it has {_named(every)}")
    plain = [one for one in found if not one.field]
    if len(found) > 1 and len(plain) == 1:
        others = _named([one for one in found if one.field])
        return plain[0], [f"wrenches in {others} are not read; topic= chooses them (--topic)"]
    if len(found) > 1:
        raise RecordingFileError(
            path,
            (
                f"has {len(found)} topics with wrenches: {_named(found)}; pass ",
                *alternatives([in_both(topic=one.name) for one in found[:_LISTED]]),
            ),
        )
    (one,) = found
    return one, [f"the wrench is the field {one.field} of {one.type_name}"] if one.field else []


def _form_in(reader: Any, connection: Any) -> _Form | None:
    """Say what makes a table of messages of another type, by what is in the first of them."""
    first = next(reader.messages(connections=[connection]), None)
    return None if first is None else _form_of(asdict(reader.deserialize(first[2], connection.msgtype)))


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

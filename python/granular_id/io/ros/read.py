"""Recordings in the formats of ROS: .bag of ROS 1, bag folders, .mcap and .db3 of ROS 2.

One topic of one bag is one recording. The libraries rosbags and mcap read the containers; here the topic is chosen, its
messages are decoded and its clock is settled.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NoReturn
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError, need
from granular_id.io.files import check_file, list_folder, open_bounded, refuse_outside
from granular_id.io.options import LoadOptions
from granular_id.io.ros.messages import (
    IMU_AXES,
    STAMPED,
    WRENCH_TYPES,
    MessageType,
    Wrenches,
    may_hold_imu,
    may_hold_wrench,
    message_type,
)
from granular_id.io.source import FileContent, FileSource
from granular_id.io.stamped import SINCE_1970, stamped_recording

_METADATA_NAME = "metadata.yaml"
_MCAP_MAGIC = b"\x89MCAP0\r\n"


@dataclass
class _Bag:
    """The topics of a bag, and what else is taken from it."""

    topics: list[Topic]
    distro: str | None = None


def is_bag_folder(folder: Path) -> bool:
    """Tell whether a folder is a ROS 2 bag."""
    return os.path.isfile(folder / _METADATA_NAME)  # noqa: PTH113 (says False where is_file raises: no permission)


def read_ros(source: FileSource, options: LoadOptions) -> FileContent:
    """Read the wrench messages of one bag as one recording: a ``.bag``, ``.mcap`` or ``.db3`` file, or a folder.

    Its clock is ``header.stamp``, or the log time where stamps were never set.
    """
    with _naming_way_out(source.path), _opened(source, options) as bag:
        topic, inner, notes = chosen_topic(bag.topics, source.path, options.topic)
        found = list(topic.messages)
    if not found:
        problem = f"has no messages on topic {topic.name!r:.80}, though it lists some"
        raise RecordingFileError(source.path, problem)
    log_ns, messages = zip(*found, strict=True)

    def place_of(index: int) -> dict[str, Any]:
        return {"place": f"message {index + 1} of {topic.name[:80]}"}

    def refuse(index: int, problem: str) -> NoReturn:
        raise RecordingFileError(source.path, problem, **place_of(index))

    wrenches = topic.message_type.decode(messages, inner, refuse)
    about = {
        "topic": topic.name + (inner and f".{inner}"),
        "message_type": topic.type_name,
        "frame": wrenches.frame_id,
        "node": topic.node,
        "ros_distro": bag.distro,
    }
    axes = IMU_AXES if inner in topic.imus else ()
    return _recording_of(wrenches, np.array(log_ns, np.int64), source, options, about, place_of, notes, axes)


@contextmanager
def _naming_way_out(path: Path) -> Iterator[None]:
    """Add what rebuilds an index or an end to what rosbags says of a bag."""
    try:
        yield
    except Exception as error:
        if type(error).__name__ != "ReaderError":  # of rosbag1 and of rosbag2, which may not be installed
            raise
        is_ros1 = "rosbag1" in type(error).__module__
        way_out = "`rosbag reindex`" if is_ros1 else "`ros2 bag reindex`, or `mcap recover` of an .mcap"
        said = str(error).partition("\n")[0][:200].rstrip(".")
        problem = f"cannot be read: {said}; if the recording was not closed, try {way_out}"
        raise RecordingFileError(path, problem) from error


@contextmanager
def _opened(source: FileSource, options: LoadOptions) -> Iterator[_Bag]:
    path, root, most = source.path, source.root, options.max_binary_bytes
    if path.is_dir():
        _check_folder(path, root, most)
        with _rosbag2(path) as reader:
            yield _Bag(_topics_of(reader), reader.ros_distro)
    elif path.suffix.lower() == ".mcap":
        with open_bounded(path, root, most) as (file, _):
            yield _mcap(file, path, options.topic)
    else:
        check_file(path, root, most)
        if path.suffix.lower() == ".bag":
            library = need("rosbags.rosbag1", extra="ros", why="to read ROS 1 bags")
            opened = library.Reader(path)
        else:
            _refuse_unclosed(path)
            opened = _rosbag2(path)
        with opened as reader:
            yield _Bag(_topics_of(reader))


def _check_folder(folder: Path, root: Path, most: int) -> None:
    """Refuse links out, what is no regular file, and too many bytes, before anything is opened."""
    refuse_outside(folder, root)
    files = [file for file in list_folder(folder)[0] if file.suffix in (".db3", ".mcap", ".yaml", ".zstd")]
    n_bytes = sum(check_file(file, folder, most) for file in files)
    if n_bytes > most:
        problem = f"the files have {n_bytes} bytes together, more than max_file_bytes={most}"
        raise RecordingFileError(folder, f"{problem}; raise max_file_bytes to read them")
    for file in files:
        _refuse_unclosed(file)


def _refuse_unclosed(file: Path) -> None:
    log = file.with_name(file.name + "-wal")
    # rosbags would pass over the messages in it; Path.is_file raises where the name is too long to be one
    if os.path.isfile(log) and log.stat().st_size:  # noqa: PTH113
        problem = f"was not closed: {log.name} holds messages that are not in it yet; run `ros2 bag reindex`"
        raise RecordingFileError(file, problem)


def _rosbag2(path: Path) -> Any:
    """Return the reader of a bag folder or a .db3 file; SQLite is given names as it takes them, parts of an address."""
    library = need("rosbags.rosbag2", extra="ros", why="to read ROS 2 bags")
    sqlite = library.Reader.STORAGE_PLUGINS[".db3"]

    def quoted(file: Path) -> Any:
        return sqlite(Path(quote(os.fspath(file))) if set("?#%") & set(os.fspath(file)) else file)

    reader = library.Reader(path)
    if path.is_dir():
        reader.storage.STORAGE_PLUGINS = {**reader.storage.STORAGE_PLUGINS, "sqlite3": quoted}
    else:
        reader.storage = quoted(path)
    return reader


def _topics_of(reader: Any) -> list[Topic]:
    """Return the topics that rosbags finds; connections of one topic and type, of several nodes, are one."""
    groups: dict[tuple[str, str, str], list[Any]] = {}
    for connection in reader.connections:
        encoding = getattr(connection.ext, "serialization_format", "ros1")
        groups.setdefault((connection.topic, connection.msgtype, encoding), []).append(connection)
    return [
        Topic(
            name,
            type_name.replace("/msg/", "/"),
            encoding,
            same[0].msgdef.data if same[0].msgdef.format.name == "MSG" else "",
            getattr(same[0].ext, "callerid", None),
            ((log_ns, message) for _, log_ns, message in reader.messages(same)),
            sum(connection.msgcount for connection in same),
            reader.duration,
        )
        for (name, type_name, encoding), same in groups.items()
    ]


def _mcap(file: BinaryIO, path: Path, asked: str | None) -> _Bag:
    """Read a file from its first record to its last: an index at the end may be missing."""
    reader = need("mcap.stream_reader", extra="ros", why="to read .mcap files").StreamReader
    if file.read(len(_MCAP_MAGIC)) != _MCAP_MAGIC:
        raise RecordingFileError(path, "does not begin as an MCAP file does")
    file.seek(-len(_MCAP_MAGIC), os.SEEK_END)
    if file.read() != _MCAP_MAGIC:
        way_out = f"`mcap recover {path.name} -o whole.mcap` keeps what there is"
        raise RecordingFileError(path, f"is cut off, the recording was not closed; {way_out}")
    file.seek(0)
    schemas = {0: ("", "")}
    topics: dict[tuple[str, str, str], Topic] = {}
    logs: dict[tuple[str, str, str], list[tuple[int, bytes]]] = {}
    channels: dict[int, tuple[list[tuple[int, bytes]], bool]] = {}
    for record in reader(file, validate_crcs=True).records:
        kind = type(record).__name__
        if kind == "Message":
            log, kept = channels[record.channel_id]
            log.append((record.log_time, record.data if kept else b""))
        elif kind == "Schema":
            is_text = record.encoding in ("ros1msg", "ros2msg")
            schemas[record.id] = record.name, record.data.decode("utf-8", "replace") if is_text else ""
        elif kind == "Channel":
            type_name, definition = schemas[record.schema_id]
            key = (record.topic, type_name.replace("/msg/", "/"), record.message_encoding)
            log = logs.setdefault(key, [])
            topic = topics.setdefault(key, Topic(*key, definition, record.metadata.get("callerid"), log))
            channels[record.id] = log, topic.may_hold_wrench or (topic.may_hold_imu and topic.is_asked(asked))
    for key, log in logs.items():
        if log:
            times = [log_ns for log_ns, _ in log]
            topics[key].count, topics[key].span_ns = len(log), max(times) - min(times)
    return _Bag(list(topics.values()))


# The topics of a bag, and which of them holds the wrench.

_LISTED = 12
_ENCODINGS = ("cdr", "ros1")


@dataclass
class Topic:
    """One topic: its type without the ``/msg/`` of ROS 2; its messages (log time in ns, bytes), where they are kept."""

    name: str
    type_name: str
    encoding: str
    definition: str = ""
    node: str | None = None
    messages: Iterable[tuple[int, bytes]] = ()
    count: int = 0
    span_ns: int = 0

    @property
    def is_wrench(self) -> bool:
        """Whether the messages are wrenches, of the plain types."""
        return self.type_name in WRENCH_TYPES and self.encoding in _ENCODINGS

    @property
    def may_hold_wrench(self) -> bool:
        """Whether the messages are wrenches, or may have them as fields."""
        return self.is_wrench or (self.encoding in _ENCODINGS and may_hold_wrench(self.definition))

    @property
    def may_hold_imu(self) -> bool:
        """Whether the messages are IMUs, or may have them as fields, by their definition."""
        known = self.definition and (self.type_name == "sensor_msgs/Imu" or may_hold_imu(self.definition))
        return self.encoding in _ENCODINGS and bool(known)

    def is_asked(self, asked: str | None) -> bool:
        """Whether the topic, or a field of its messages, is asked for."""
        return asked is not None and f"{asked.strip('/')}.".startswith(f"{self.name.strip('/')}.")

    @property
    def imus(self) -> list[str]:
        """Which fields of the messages are IMUs; "" is the whole."""
        return self.message_type.imus if self.may_hold_imu else []

    @property
    def message_type(self) -> MessageType:
        """The type of the messages, by its definition; ValueError where that is no proper one."""
        return message_type(self.type_name, self.definition, self.encoding)

    def __str__(self) -> str:
        rate = f", {(self.count - 1) * 1e9 / self.span_ns:.4g} Hz" if self.span_ns > 0 else ""
        encoding = "" if self.encoding in _ENCODINGS else f" in {self.encoding[:80]}"
        return f"{self.name[:80]} ({self.type_name[:80]}{encoding}, {self.count} messages{rate})"


def chosen_topic(topics: Iterable[Topic], path: Path, asked: str | None) -> tuple[Topic, str, list[str]]:
    """Return the one topic to read, which field of its messages is the wrench ("" the whole), and notes."""
    every = [topic for topic in topics if topic.count]
    named, field_asked = (every, "") if asked is None else _named(every, asked.strip("/"))
    imus = [topic for topic in named if asked is not None and topic.may_hold_imu]
    imus = [topic for topic in imus if field_asked in _fields_of(topic, path, "imus")]
    if len(imus) == len(named) == 1:
        return imus[0], field_asked, []
    plain = [topic for topic in named if topic.is_wrench]
    others = [topic for topic in named if topic.may_hold_wrench and not topic.is_wrench]
    if asked is not None and (len(named) != 1 or not plain + others):
        what = "messages of two types" if len(named) > 1 else "no wrenches" if named else "no messages"
        raise RecordingFileError(path, f"has {what} on topic {asked!r}; it has {_listed(every)}")
    if len(plain) > 1:
        problem = f"has {len(plain)} topics with wrenches: {_listed(plain)}; choose by topic="
        raise RecordingFileError(path, problem)
    if plain:
        beside = [f"wrenches in {_listed(others)} are not read; topic= chooses them"] if others else []
        return plain[0], "", beside
    inside = [(topic, field) for topic in others for field in _fields_of(topic, path)]
    found = [pair for pair in inside if field_asked in ("", pair[1])]
    if len(found) == 1:
        topic, field = found[0]
        return topic, field, [f"the wrench is the field {field} of {topic.type_name}"]
    if not inside:
        wanted = f"messages of type {STAMPED} or Wrench, nor with one as a field"
        problem = f"has no {wanted}; it has {_listed(every)}"
        if any(not topic.definition for topic in every):
            problem += "; `ros2 bag convert` to mcap, where the types are installed, adds definitions that are missing"
        raise RecordingFileError(path, problem)
    listed = ", ".join(f"{topic.name[:80]}.{field[:80]}" for topic, field in inside[:_LISTED])
    more = f" and {len(inside) - _LISTED} more" if len(inside) > _LISTED else ""
    some = f"no wrench {asked!r}" if field_asked else f"{len(inside)} wrenches"
    raise RecordingFileError(path, f"has {some} inside its messages: {listed}{more}; choose by topic=")


def _named(topics: Sequence[Topic], asked: str) -> tuple[list[Topic], str]:
    """Return the topics that are called so, else those of which it is ``topic.field``, and the field."""
    whole = [topic for topic in topics if topic.name.strip("/") == asked]  # there may be dots in it
    if whole:
        return whole, ""
    starts = [(topic, f"{topic.name.strip('/')}.") for topic in topics if not topic.is_wrench]
    inner = [
        (topic, asked[len(start) :]) for topic, start in starts if asked.startswith(start) and asked != start
    ]
    return [topic for topic, _ in inner], inner[0][1] if inner else ""


def _fields_of(topic: Topic, path: Path, kind: str = "wrenches") -> list[str]:
    try:
        return list(getattr(topic.message_type, kind))
    except (ValueError, KeyError, RecursionError) as error:
        raise RecordingFileError(path, f"has {topic}, but {error}") from error


def _listed(topics: Sequence[Topic]) -> str:
    more = f" and {len(topics) - _LISTED} more" if len(topics) > _LISTED else ""
    return ", ".join(map(str, topics[:_LISTED])) + more or "no messages at all"


# The clock of messages: which stamps are taken, and the recording that they make.


def _recording_of(
    wrenches: Wrenches,
    log_ns: NDArray[np.int64],
    source: FileSource,
    options: LoadOptions,
    about: Mapping[str, Any],
    place_of: Callable[[int], dict[str, Any]],
    notes: list[str],
    axes: tuple[str, ...],
) -> FileContent:
    """Make one recording of messages; what of `about` is empty is left out of its metadata.

    `log_ns` says when messages were logged: their order, and their clock where ``header.stamp`` was never set.
    """
    order = np.argsort(log_ns, kind="stable")  # as every player does; files may hold them otherwise
    stamps_ns, clock = _stamps(wrenches, log_ns, notes)
    # ns since 1970 do not fit float64: seconds from the first stamp do, rounded once
    first_ns = int(stamps_ns.min())
    first_s = first_ns / 10**9  # of integers, rounded once; 1e9 would round twice
    stamps = (stamps_ns[order] - first_ns) / 1e9
    recording, remarks = stamped_recording(
        wrenches.wrench[order],
        source,
        options,
        stamps=stamps,
        start_time=first_s if first_s > SINCE_1970 else None,
        meta={key: value for key, value in about.items() if value},
        locate=lambda i: {} if i is None else place_of(int(order[i])),
        clock=clock,
        time_unit="s",
        axes=axes,
    )
    if 0 != first_s <= SINCE_1970:
        remarks["first_stamp_s"] = first_s
    return FileContent([recording], [{"name": recording.name, **remarks}] if remarks else [], notes)


def _stamps(wrenches: Wrenches, log_ns: NDArray[np.int64], notes: list[str]) -> tuple[NDArray[np.int64], str]:
    """Choose the clock: the sensor's own stamps where they were ever set, else when messages were logged."""
    stamps_ns = wrenches.stamps_ns
    jitter = "log times are taken, which jitter more than the sensor's clock"
    if stamps_ns is None:
        notes.append(f"messages without a header: {jitter}")
        return log_ns, "log time"
    if (len(stamps_ns) > 1 and (stamps_ns == stamps_ns[0]).all()) or not stamps_ns.any():
        notes.append(f"header.stamp never changes: {jitter}")
        return log_ns, "log time"
    return stamps_ns, "header.stamp"

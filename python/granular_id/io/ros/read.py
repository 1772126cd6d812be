"""Recordings in the formats of ROS: .bag of ROS 1, bag folders, .mcap and .db3 of ROS 2.

One topic of one bag is one recording. The libraries rosbags and mcap read the containers; here the topic is chosen, its
messages are decoded and its clock is settled.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NoReturn
from urllib.parse import quote

import numpy as np

from granular_id.io.errors import RecordingFileError, need
from granular_id.io.files import check_file, list_folder, open_bounded, refuse_outside
from granular_id.io.options import LoadOptions
from granular_id.io.ros.clock import recording_of
from granular_id.io.ros.mcap_own import CHANGED_NOTE, OWN_NAME, OwnRecords, restored
from granular_id.io.ros.topics import Topic, chosen_topic
from granular_id.io.source import FileContent, FileSource

__all__ = ["is_bag_folder", "read_ros"]

_METADATA_NAME = "metadata.yaml"
_MCAP_MAGIC = b"\x89MCAP0\r\n"


@dataclass
class _Bag:
    """The topics of a bag, and what else is taken from it."""

    topics: list[Topic]
    distro: str | None = None
    own: OwnRecords = field(default_factory=OwnRecords)


def is_bag_folder(folder: Path) -> bool:
    """Tell whether a folder is a ROS 2 bag."""
    return os.path.isfile(folder / _METADATA_NAME)  # noqa: PTH113 (says False where is_file raises: no permission)


def read_ros(source: FileSource, options: LoadOptions) -> FileContent:
    """Read the wrench messages of one bag as one recording: a ``.bag``, ``.mcap`` or ``.db3`` file, or a folder.

    Its clock is ``header.stamp``, or the log time where stamps were never set.
    """
    with _opened(source, options) as bag:
        topic, inner, notes = chosen_topic(bag.topics, source.path, options.topic)
        found = list(topic.messages)
    if not found:
        raise RecordingFileError(
            source.path, f"has no messages on topic {topic.name!r:.80}, though it lists some"
        )
    log_ns, messages = zip(*found, strict=True)

    def place_of(index: int) -> dict[str, Any]:
        return {"place": f"message {index + 1} of {topic.name[:80]}"}

    def refuse(index: int, problem: str) -> NoReturn:
        raise RecordingFileError(source.path, problem, **place_of(index))

    wrenches = topic.message_type.decode(messages, inner, refuse)
    if bag.own.metadata:
        content = restored(bag.own, wrenches, source)
        if content is not None:
            return content
        notes.append(CHANGED_NOTE)
    about = {
        "topic": topic.name + (inner and f".{inner}"),
        "message_type": topic.type_name,
        "frame": wrenches.frame_id,
        "node": topic.node,
        "ros_distro": bag.distro,
    }
    return recording_of(wrenches, np.array(log_ns, np.int64), source, options, about, place_of, notes)


@contextmanager
def _opened(source: FileSource, options: LoadOptions) -> Iterator[_Bag]:
    path, root, most = source.path, source.root, options.max_binary_bytes
    if path.is_dir():
        _check_folder(path, root, most)
        with _rosbag2(path) as reader:
            yield _Bag(_topics_of(reader), reader.ros_distro)
    elif path.suffix.lower() == ".mcap":
        with open_bounded(path, root, most) as (file, _):
            yield _mcap(file, path)
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
            _messages_of(reader, same),
            sum(connection.msgcount for connection in same),
            reader.duration,
        )
        for (name, type_name, encoding), same in groups.items()
    ]


def _messages_of(reader: Any, connections: list[Any]) -> Iterable[tuple[int, bytes]]:
    yield from ((log_ns, message) for _, log_ns, message in reader.messages(connections))


def _mcap(file: BinaryIO, path: Path) -> _Bag:
    """Read a file from its first record to its last: an index at the end may be missing."""
    reader = need("mcap.stream_reader", extra="ros", why="to read .mcap files").StreamReader
    if file.read(len(_MCAP_MAGIC)) == _MCAP_MAGIC:
        file.seek(-len(_MCAP_MAGIC), os.SEEK_END)
        if file.read() != _MCAP_MAGIC:
            way_out = f"`mcap recover {path.name} -o whole.mcap` keeps what there is"
            raise RecordingFileError(path, f"is cut off, the recording was not closed; {way_out}")
    file.seek(0)
    own = OwnRecords()
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
            schemas[record.id] = record.name, record.data.decode() if is_text else ""
        elif kind == "Channel":
            type_name, definition = schemas[record.schema_id]
            key = (record.topic, type_name.replace("/msg/", "/"), record.message_encoding)
            log = logs.setdefault(key, [])
            topic = topics.setdefault(key, Topic(*key, definition, record.metadata.get("callerid"), log))
            channels[record.id] = log, topic.may_hold_wrench
        elif kind == "Metadata" and record.name == OWN_NAME:
            own.metadata = record.metadata
        elif kind == "Attachment" and record.name.startswith(OWN_NAME):
            own.attachments[record.name] = record.data
    for key, log in logs.items():
        if log:
            times = [log_ns for log_ns, _ in log]
            topics[key].count, topics[key].span_ns = len(log), max(times) - min(times)
    return _Bag(list(topics.values()), own=own)

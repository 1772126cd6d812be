"""Recordings in the formats of ROS: .bag of ROS 1, bag folders, .mcap and .db3 of ROS 2.

One topic of one bag is one recording. The walks through the containers stand in files of their own; here the
topic is chosen, its messages are decoded and its clock is settled.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NoReturn, cast

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import RecordingFileError
from granular_id.io.extras import need
from granular_id.io.files import check_file, open_bounded
from granular_id.io.options import LoadOptions
from granular_id.io.ros.bag1 import walk_bag1
from granular_id.io.ros.bag2 import read_bag_folder
from granular_id.io.ros.clock import recording_of
from granular_id.io.ros.db3 import walk_db3
from granular_id.io.ros.mcap_file import OwnRecords, walk_mcap
from granular_id.io.ros.mcap_own import CHANGED_NOTE, restored
from granular_id.io.ros.topics import Topic, Topics, shown
from granular_id.io.ros.unpack import Unpacker, unpack_zstd
from granular_id.io.ros.wrench import (
    LARGEST_MESSAGE,
    Encoding,
    Refuse,
    Wrenches,
    decode_wrenches,
    foreign_definition,
)
from granular_id.io.source import FileContent, FileSource

__all__ = ["read_ros"]

_PIECE = 1 << 20


def read_ros(source: FileSource, options: LoadOptions) -> FileContent:
    """Read the wrench messages of one bag as one recording.

    Parameters
    ----------
    source : FileSource
        A ``.bag``, ``.mcap`` or ``.db3`` file, or a folder with ``metadata.yaml``.
    options : LoadOptions
        `topic` names the topic where there are several with wrenches.

    Returns
    -------
    FileContent
        One recording. Its clock is ``header.stamp``, or the log time where stamps were never set; `meta` has the
        topic, the message type, the frame, the publishing node (ROS 1) and the distribution (ROS 2).

    Raises
    ------
    RecordingFileError
        A damaged file, no topic or several to choose from, forces that are not finite, a frame that changes,
        stamps that run back.
    ImportError
        The libraries of the extra ``ros`` are missing.
    """
    topics = Topics(source.path, options.topic)
    bag = _walked(source, options, topics)
    topic, field, notes = topics.chosen()

    def refuse(index: int, problem: str) -> NoReturn:
        raise RecordingFileError(source.path, problem, place=f"message {index + 1} of {shown(topic.name)}")

    wrenches = _decoded(topic, field, bag, refuse)
    if bag.own.metadata:
        content = restored(bag.own, wrenches, source, options)
        if content is not None:
            return content
        notes.append(CHANGED_NOTE)
    about = {
        "topic": topic.name + (field and f".{field}"),
        "message_type": topic.type_name,
        "frame": wrenches.frame_id,
        "node": topic.node,
        "ros_distro": bag.distro,
    }
    log_ns = _log_times(topic, refuse)
    return recording_of(
        wrenches,
        log_ns,
        source,
        options,
        about,
        lambda i: {"place": f"message {i + 1} of {shown(topic.name)}"},
        notes,
    )


class _Bag:
    """What a walk learnt beside the topics."""

    def __init__(self, path: Path, n_bytes: int) -> None:
        self.unpacker = Unpacker(path, n_bytes)
        self.own = OwnRecords()
        self.distro: str | None = None
        self.zstd_messages = False


def _walked(source: FileSource, options: LoadOptions, topics: Topics) -> _Bag:
    """Collect the topics of whatever the source is."""
    path, root, most = source.path, source.root, options.max_binary_bytes
    if not path.is_dir():
        bag = _Bag(path, check_file(path, root, most))
        _walk_file(path, path, root, topics, bag)
        return bag
    folder = read_bag_folder(path, root, options)
    bag = _Bag(path, folder.n_bytes)
    bag.distro = folder.distro
    bag.zstd_messages = folder.compression == "message"
    for file in folder.files:
        if folder.compression != "file":
            _walk_file(file, file, path, topics, bag)
            continue
        with _expanded(file, path, most, bag.unpacker) as whole:
            _walk_file(whole, file, whole.parent, topics, bag)
    if len(folder.files) > 1:
        bag.own = OwnRecords()
    return bag


def _walk_file(file: Path, shown: Path, root: Path, topics: Topics, bag: _Bag) -> None:
    suffix = file.suffix.lower()
    if suffix == ".db3":
        walk_db3(file, shown, topics, bag.unpacker)
        return
    if suffix not in (".mcap", ".bag"):
        raise RecordingFileError(shown, "is of no kind that a ROS 2 bag has; wanted .mcap or .db3")
    with open_bounded(file, root, file.stat().st_size) as (opened, n_bytes):
        if suffix == ".bag":
            walk_bag1(opened, n_bytes, shown, topics, bag.unpacker)
        else:
            bag.own = walk_mcap(opened, n_bytes, shown, topics, bag.unpacker)


@contextmanager
def _expanded(file: Path, root: Path, most: int, unpacker: Unpacker) -> Iterator[Path]:
    """Expand a file compressed as a whole into a temporary folder."""
    zstandard = need("zstandard", extra="ros", why="to read compressed bags")
    with TemporaryDirectory() as folder, open_bounded(file, root, most) as (packed, _):
        whole = Path(folder) / file.stem
        try:
            with whole.open("wb") as target:
                reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
                while piece := reader.read(_PIECE):
                    unpacker.spend(len(piece), file.name)
                    target.write(piece)
        except zstandard.ZstdError as error:
            raise RecordingFileError(file, f"cannot be decompressed (zstd: {error})") from error
        yield whole


def _decoded(topic: Topic, field: str, bag: _Bag, refuse: Refuse) -> Wrenches:
    checked = bool(field) or not topic.definition
    foreign = None if checked else foreign_definition(topic.definition, topic.type_name)
    if foreign is not None:
        refuse(0, foreign)
    lengths = np.frombuffer(topic.lengths, np.int64)
    data: bytes | bytearray = topic.data
    if bag.zstd_messages:
        ends = np.cumsum(lengths).tolist()
        spans = map(slice, [0, *ends], ends)
        messages = [_expanded_message(bytes(data[span]), i, refuse) for i, span in enumerate(spans)]
        data, lengths = b"".join(messages), np.array([len(message) for message in messages], np.int64)
        bag.unpacker.spend(len(data), shown(topic.name))
    type_name = topic.type_name
    if field:
        data, lengths, type_name = topic.inside.plain(data, lengths, field, refuse)
    return decode_wrenches(data, lengths, cast(Encoding, topic.encoding), type_name, refuse)


def _expanded_message(message: bytes, index: int, refuse: Refuse) -> bytes:
    try:
        return unpack_zstd(message, LARGEST_MESSAGE)
    except ImportError:
        raise
    except Exception as error:  # the library's own kind, or the size
        refuse(index, f"cannot be decompressed (zstd: {error})")


def _log_times(topic: Topic, refuse: Refuse) -> NDArray[np.int64]:
    log_ns = np.frombuffer(topic.log_ns, np.uint64)
    late = log_ns >= 1 << 63
    if late.any():
        first = int(late.argmax())
        refuse(first, f"has the log time {log_ns[first]} ns; wanted less than 2^63 (the year 2262)")
    return log_ns.astype(np.int64)

"""Walk through a ROS 1 bag (format 2.0): the connections behind the chunks first, then chunk by chunk.

The index of messages within a chunk is not used: chunks have to be expanded anyway, and an index may lie.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO, NoReturn

from granular_id.io.errors import RecordingFileError
from granular_id.io.ros.topics import Topic, Topics
from granular_id.io.ros.unpack import Unpacker

__all__ = ["walk_bag1"]

_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG_HEADER, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = range(2, 8)
_LARGEST_HEADER = 1 << 20
"""Of one record, bytes; the header of a connection holds the whole message definition, in about 3 kB."""

_U32 = struct.Struct("<I")
_TIME = struct.Struct("<II")

Header = dict[bytes, bytes]


def walk_bag1(file: BinaryIO, n_bytes: int, path: Path, topics: Topics, unpacker: Unpacker) -> None:
    """Collect the topics of a .bag file and the messages to be kept.

    Parameters
    ----------
    file : binary file
    n_bytes : int
        Its size.
    path : Path
        What errors name.
    topics : Topics
        Where topics and messages go.
    unpacker : Unpacker

    Raises
    ------
    RecordingFileError
        No bag of version 2.0, not closed, encrypted, cut off or damaged, with the byte.
    """
    _Walk(file, n_bytes, path, topics, unpacker).run()


class _Walk:
    def __init__(self, file: BinaryIO, end: int, path: Path, topics: Topics, unpacker: Unpacker) -> None:
        self._file = file
        self._end = end
        self._path = path
        self._topics = topics
        self._unpacker = unpacker
        self._connections: dict[bytes, Topic] = {}

    def run(self) -> None:
        magic = self._file.read(len(_MAGIC))
        if magic != _MAGIC:
            other = f"begins with {magic.decode('ascii', 'replace').strip()!r}"
            came = other if magic.startswith(b"#ROSBAG") else "does not begin as a bag does"
            raise RecordingFileError(self._path, f"{came}; wanted '#ROSBAG V2.0'")
        header, data_bytes, start = self._record(len(_MAGIC))
        if header.get(b"op") != bytes([_BAG_HEADER]):
            self._fail("has no bag header", len(_MAGIC))
        if header.get(b"encryptor"):
            self._fail(
                f"is encrypted by {header[b'encryptor'][:40].decode('ascii', 'replace')!r}", len(_MAGIC)
            )
        index_at = int.from_bytes(header.get(b"index_pos", b""), "little")
        if not index_at:
            problem = (
                f"has no index: the recording was not closed; `rosbag reindex {self._path.name}` repairs it"
            )
            raise RecordingFileError(self._path, problem)
        first = start + data_bytes
        if not first <= index_at <= self._end:
            self._fail(
                f"is cut off or damaged: the index is said to be at byte {index_at} of {self._end}", first
            )
        n_chunks = self._read_connections(index_at)
        if n_chunks != int.from_bytes(header.get(b"chunk_count", b""), "little"):
            self._fail(f"is cut off or damaged: its index lists {n_chunks} chunks", index_at)
        while first < index_at:
            header, data_bytes, start = self._record(first)
            if header.get(b"op") == bytes([_CHUNK]):
                self._unpacker.check_part(data_bytes, f"byte {first}")
                self._read_chunk(header, self._file.read(data_bytes), first)
            elif header.get(b"op") != bytes([_INDEX]):
                self._fail("has a record that is neither chunk nor index", first)
            first = start + data_bytes

    def _record(self, position: int) -> tuple[Header, int, int]:
        """Return the header of the record at `position`, the bytes of its data and where they begin."""
        self._unpacker.walked(1, f"byte {position}")
        header_bytes = self._length(position)
        if header_bytes > _LARGEST_HEADER:
            self._fail(f"has a header of {header_bytes} bytes", position)
        header = self._fields(self._file.read(header_bytes), position)
        start = position + 8 + header_bytes
        data_bytes = self._length(start - 4)
        if start + data_bytes > self._end:
            self._fail(f"is cut off: a record of {data_bytes} bytes goes past the end", position)
        return header, data_bytes, start

    def _length(self, position: int) -> int:
        self._file.seek(position)
        data = self._file.read(_U32.size)
        if len(data) < _U32.size:
            self._fail("is cut off", position)
        return int(_U32.unpack(data)[0])

    def _fields(self, data: bytes, position: int) -> Header:
        return {name: data[span] for name, span in self._spans(data, position).items()}

    def _spans(self, data: bytes, position: int) -> dict[bytes, slice]:
        """Find where a header has the value of each field."""
        spans, at = {}, 0
        while at < len(data):
            end = at + 4 + int.from_bytes(data[at : at + 4], "little")
            equals = data.find(b"=", at + 4, end)
            if end > len(data) or equals < 0:
                self._fail("has a damaged header", position)
            spans[data[at + 4 : equals]] = slice(equals + 1, end)
            at = end
        return spans

    def _read_connections(self, position: int) -> int:
        """Read the connections behind the chunks; return how many chunks are listed there."""
        n_chunks = 0
        while position < self._end:
            header, data_bytes, start = self._record(position)
            kind = header.get(b"op")
            if kind == bytes([_CONNECTION]):
                if data_bytes > _LARGEST_HEADER:
                    self._fail(f"has a connection of {data_bytes} bytes", position)
                about = self._fields(self._file.read(data_bytes), position)
                self._connections[header.get(b"conn", b"")] = self._topics.add(
                    self._text(header.get(b"topic"), "topic", position),
                    self._text(about.get(b"type"), "type", position),
                    "ros1",
                    node=about.get(b"callerid", b"").decode("utf-8", "replace") or None,
                    definition=about.get(b"message_definition", b"").decode("utf-8", "replace"),
                )
            elif kind == bytes([_CHUNK_INFO]):
                n_chunks += 1
            else:
                self._fail("has a record in its index that is neither connection nor chunk", position)
            position = start + data_bytes
        return n_chunks

    def _text(self, value: bytes | None, name: str, position: int) -> str:
        try:
            return (value or b"").decode("utf-8")
        except UnicodeDecodeError:
            self._fail(f"has a {name} that is not UTF-8 text", position)

    def _read_chunk(self, header: Header, data: bytes, position: int) -> None:
        place = f"byte {position}"
        compression = self._text(header.get(b"compression"), "compression", position)
        n_bytes = int.from_bytes(header.get(b"size", b""), "little")
        data = self._unpacker.unpack(data, compression, n_bytes, place)
        view, end, at, n_records = memoryview(data), len(data), 0, 0
        form = _Form()
        while at < end:
            n_records += 1
            if n_records > self._unpacker.records_left:
                break
            header_end = at + 4 + int.from_bytes(data[at : at + 4], "little")
            start = header_end + 4
            stop = start + int.from_bytes(data[header_end:start], "little")
            if stop > end or start > end:
                self._fail("has a chunk with a record that goes past its end", position)
            head = data[at + 4 : header_end]
            if not form.fits(head):
                spans = self._spans(head, position)
                if head[spans.get(b"op", slice(0))] == bytes([_CONNECTION]):
                    at = stop
                    continue
                if not form.learn(head, spans):
                    self._fail("has a chunk with a record that is no message", position)
            sec, nanosec = _TIME.unpack_from(head, form.time)
            topic = self._connections.get(head[form.conn : form.conn + 4])
            if topic is None:
                self._fail("has a message of a connection that its index does not list", position)
            log_ns = sec * 10**9 + nanosec
            if topic.kept:
                topic.keep(log_ns, view[start:stop])
            else:
                topic.seen(log_ns)
            at = stop
        self._unpacker.walked(n_records, place)

    def _fail(self, problem: str, position: int) -> NoReturn:
        raise RecordingFileError(self._path, problem, place=f"byte {position}")


class _Form:
    """Where the headers of messages have their connection and time: one writer makes them all alike."""

    def __init__(self) -> None:
        self._length = -1
        self._fixed: list[tuple[slice, bytes]] = []
        self.conn = self.time = 0

    def fits(self, head: bytes) -> bool:
        """Whether the header is like the one learnt, but for connection and time."""
        return len(head) == self._length and all(head[part] == value for part, value in self._fixed)

    def learn(self, head: bytes, spans: dict[bytes, slice]) -> bool:
        """Take this header as the pattern; False if it is not that of a message."""
        op, conn, time = (spans.get(name, slice(0, 0)) for name in (b"op", b"conn", b"time"))
        if head[op] != bytes([_MESSAGE]) or len(head[conn]) != _U32.size or len(head[time]) != _TIME.size:
            return False
        self.conn, self.time = conn.start, time.start
        first, second = sorted((conn, time), key=lambda span: span.start)
        gaps = (slice(0, first.start), slice(first.stop, second.start), slice(second.stop, len(head)))
        self._length = len(head)
        self._fixed = [(gap, head[gap]) for gap in gaps]
        return True

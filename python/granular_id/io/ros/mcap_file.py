"""Walk through an MCAP file from its first byte to its last, within its bounds.

The index at the end of the file is not used: it may be missing or wrong, and chunks have to be expanded anyway.
Records are parsed by the mcap library; the walk itself and the expansion of chunks are done here, because the
library reads lengths and expands chunks as the file claims.
"""

from __future__ import annotations

import os
import struct
import zlib
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from granular_id.io.errors import RecordingFileError
from granular_id.io.extras import need
from granular_id.io.ros.topics import Topic, Topics
from granular_id.io.ros.unpack import Unpacker

__all__ = ["MAGIC", "OWN_NAME", "OwnRecords", "walk_mcap"]

MAGIC = b"\x89MCAP0\r\n"

OWN_NAME = "granular_id"
"""Name of the metadata record, and beginning of the names of attachments, that this library writes."""

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = range(1, 7)
_ATTACHMENT, _METADATA, _DATA_END = 0x09, 0x0C, 0x0F
_LARGEST_RECORD = 64 * 1024 * 1024
"""Of schemas, channels and metadata, bytes."""

_ATTACHED_BYTES, _SAMPLE_BYTES = 4096, 8
"""What an attachment of ours may have, altogether and per message: stamps are float64."""

_MOST_DEFINITIONS = 20_000
"""Schemas and channels in a file; a robot has hundreds."""

_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<BQHIQQ")
_OWN_PREFIX = struct.pack("<I", len(OWN_NAME)) + OWN_NAME.encode()
_OWN_ATTACHMENT = slice(20, 20 + len(OWN_NAME))
"""Where an attachment has its name: behind two times and a length."""


@dataclass
class OwnRecords:
    """What this library wrote beside the messages: see ``mcap_own``."""

    metadata: dict[str, str] = field(default_factory=dict)
    n_metadata: int = 0
    attachments: dict[str, bytes] = field(default_factory=dict)


def walk_mcap(file: BinaryIO, n_bytes: int, path: Path, topics: Topics, unpacker: Unpacker) -> OwnRecords:
    """Collect the topics of an MCAP file and the messages to be kept.

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
        No MCAP file, cut off, or damaged, with the byte.
    """
    if file.read(len(MAGIC)) != MAGIC:
        raise RecordingFileError(path, "does not begin as an MCAP file does; wanted 89 4d 43 41 50 30 0d 0a")
    file.seek(max(n_bytes - len(MAGIC), 0))
    complete = file.read() == MAGIC and n_bytes > 2 * len(MAGIC)
    walk = _Walk(file, n_bytes - len(MAGIC) if complete else n_bytes, path, topics, unpacker)
    if not walk.run() or not complete:
        kept = f"{topics.n_kept} messages with wrenches come before" if topics.n_kept else "nothing of use"
        problem = (
            f"is cut off at byte {n_bytes}, the recording was not closed ({kept}); `mcap recover {path.name} -o "
            "whole.mcap` keeps what there is"
        )
        raise RecordingFileError(path, problem)
    if walk.own.metadata.get("n_samples") == str(topics.n_kept):  # else the messages are others by now
        walk.read_attachments()
    return walk.own


class _Walk:
    def __init__(self, file: BinaryIO, end: int, path: Path, topics: Topics, unpacker: Unpacker) -> None:
        self._file = file
        self._end = end
        self._path = path
        self._topics = topics
        self._unpacker = unpacker
        self._records = need("mcap.records", extra="ros", why="to read .mcap files")
        self._stream = need("mcap.data_stream", extra="ros", why="to read .mcap files").ReadDataStream
        self._schemas: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, Topic] = {}
        self._known: set[bytes] = set()
        self._attached: list[tuple[int, int]] = []
        self.own = OwnRecords()

    def run(self) -> bool:
        """Walk to the end of the data section; False where the file ends before it does."""
        position = len(MAGIC)
        first = True
        while self._end - position >= _RECORD.size:
            self._file.seek(position)
            opcode, length = _RECORD.unpack(self._file.read(_RECORD.size))
            place = f"byte {position}"
            if first and opcode != _HEADER:
                self._fail(f"has a record of kind {opcode} first; wanted the header (1)", place)
            if opcode in (_DATA_END, _FOOTER):
                return True
            first = False
            position += _RECORD.size + length
            if position > self._end:
                return False
            self._unpacker.walked(1, place)
            self._record(opcode, length, place)
        return False

    def _record(self, opcode: int, length: int, place: str) -> None:
        if opcode in (_CHUNK, _MESSAGE):
            self._unpacker.check_part(length, place)
        if opcode == _CHUNK:
            chunk = self._parsed("Chunk", self._file.read(length), place)
            data = self._unpacker.unpack(chunk.data, chunk.compression, chunk.uncompressed_size, place)
            if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
                self._fail("has a chunk whose checksum does not fit: the data have changed", place)
            self._messages(data, place)
        elif opcode == _MESSAGE:  # outside of chunks
            self._file.seek(-_RECORD.size, os.SEEK_CUR)
            self._messages(self._file.read(_RECORD.size + length), place)
        elif opcode == _ATTACHMENT:
            self._attachment(length)
        elif opcode in (_SCHEMA, _CHANNEL, _METADATA):
            if length > _LARGEST_RECORD:
                self._fail(f"has {length} bytes of names and text; at most {_LARGEST_RECORD} are read", place)
            body = self._file.read(length)
            if opcode != _METADATA:
                self._define(opcode, body, place)
            elif body.startswith(_OWN_PREFIX):
                self.own.n_metadata += 1
                self.own.metadata = self._parsed("Metadata", body, place).metadata
        elif not opcode:
            self._fail("has a record of kind 0", place)

    def _messages(self, data: bytes, place: str) -> None:
        """Take the messages, schemas and channels in the records of a chunk."""
        view, end, position, n_records = memoryview(data), len(data), 0, 0
        channels, most = self._channels, self._unpacker.records_left
        head, size = _MESSAGE_HEAD.unpack_from, _MESSAGE_HEAD.size
        while position < end and n_records <= most:
            n_records += 1
            if data[position] == _MESSAGE and position + size <= end:
                _, length, channel, _, log_ns, _ = head(data, position)
                start = position + size
                position += _RECORD.size + length
                if not start <= position <= end:
                    self._fail(f"has a message of {length} bytes that does not fit its chunk", place)
                topic = channels.get(channel)
                if topic is None:
                    self._fail(f"has a message of channel {channel}, which is not defined before it", place)
                if topic.kept:
                    topic.keep(log_ns, view[start:position])
                else:
                    topic.seen(log_ns)
            else:
                start = position + _RECORD.size
                opcode, length = _RECORD.unpack_from(data, position) if start <= end else (0, 0)
                position = start + length
                if opcode not in (_SCHEMA, _CHANNEL) or position > end:
                    self._fail(f"has a record of kind {opcode} and {length} bytes in a chunk", place)
                self._define(opcode, data[start:position], place)
        self._unpacker.walked(n_records, place)

    def _define(self, opcode: int, body: bytes, place: str) -> None:
        """Take a schema or a channel; writers repeat them in every chunk."""
        key = bytes([opcode]) + body
        if key in self._known:
            return
        self._known.add(key)
        if len(self._known) > _MOST_DEFINITIONS:
            self._fail(f"has more than {_MOST_DEFINITIONS} schemas and channels", place)
        if opcode == _SCHEMA:
            schema = self._parsed("Schema", body, place)
            is_text = schema.encoding in ("ros2msg", "ros1msg")
            definition = schema.data.decode("utf-8", "replace") if is_text else ""
            self._schemas[schema.id] = (schema.name, definition)
            return
        channel = self._parsed("Channel", body, place)
        if channel.schema_id and channel.schema_id not in self._schemas:
            self._fail(f"has a channel of schema {channel.schema_id}, which is not defined before it", place)
        type_name, definition = self._schemas.get(channel.schema_id, ("", ""))
        self._channels[channel.id] = self._topics.add(
            channel.topic,
            type_name,
            channel.message_encoding,
            node=channel.metadata.get("callerid"),
            definition=definition,
        )

    def _attachment(self, length: int) -> None:
        start = self._file.tell()
        if self._file.read(min(length, _OWN_ATTACHMENT.stop))[_OWN_ATTACHMENT] == OWN_NAME.encode():
            self._attached.append((start, length))  # the others are somebody else's, of any size

    def read_attachments(self) -> None:
        """Read what this library attached, now that the number of messages says how long that may be."""
        most = _ATTACHED_BYTES + _SAMPLE_BYTES * self._topics.n_kept
        for start, length in self._attached:
            place = f"byte {start - _RECORD.size}"
            if length > most:
                self._fail(f"has an attachment of {length} bytes for {self._topics.n_kept} messages", place)
            self._file.seek(start)
            body = self._file.read(length)
            record = self._parsed("Attachment", body, place)
            stated = int.from_bytes(body[-4:], "little")
            if stated and zlib.crc32(body[:-4]) != stated:
                self._fail(f"has an attachment {record.name[:40]!r} whose checksum does not fit", place)
            self.own.attachments[record.name] = record.data

    def _parsed(self, kind: str, body: bytes, place: str) -> Any:
        try:
            return getattr(self._records, kind).read(self._stream(BytesIO(body)))
        except (
            Exception
        ) as error:  # struct.error, EndOfFile, UnicodeDecodeError, OverflowError: all mean damage
            problem = f"has a damaged {kind.lower()} record ({str(error) or type(error).__name__})"
            raise RecordingFileError(self._path, problem, place=place) from error

    def _fail(self, problem: str, place: str) -> NoReturn:
        raise RecordingFileError(self._path, problem, place=place)

"""Walk through the SQLite file of a ROS 2 bag (.db3).

The database is opened as immutable, and only plain tables are read: a view, a virtual table or a generated column
could run any SQL in their place.
"""

from __future__ import annotations

import math
import os
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from granular_id.io.errors import RecordingFileError
from granular_id.io.ros.inside import LONGEST_DEFINITION
from granular_id.io.ros.topics import Topic, Topics
from granular_id.io.ros.unpack import Unpacker
from granular_id.io.ros.wrench import LARGEST_MESSAGE

__all__ = ["walk_db3"]

_MAGIC = b"SQLite format 3\0"
_HEAD = struct.Struct(">16sH10xI")
"""Magic, bytes of a page (1 means 65536), number of pages."""

_MOST_TOPICS = 20_000

_ALLOWED = (sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ, sqlite3.SQLITE_FUNCTION, sqlite3.SQLITE_PRAGMA)


def walk_db3(file: Path, path: Path, topics: Topics, unpacker: Unpacker) -> None:
    """Collect the topics of a .db3 file and the messages to be kept.

    Parameters
    ----------
    file : Path
        The database; checked to be a regular file within bounds.
    path : Path
        What errors name.
    topics : Topics
        Where topics and messages go.
    unpacker : Unpacker

    Raises
    ------
    RecordingFileError
        Not an SQLite file, not closed, tables missing or no plain tables, damaged.
    """
    try:
        with file.open("rb") as opened:
            head = opened.read(_HEAD.size)
            n_bytes = opened.seek(0, os.SEEK_END)
    except OSError as error:
        raise RecordingFileError(path, f"cannot be read: {error.strerror}") from error
    if not head.startswith(_MAGIC):
        raise RecordingFileError(path, "is not an SQLite file, as the .db3 of a ROS 2 bag is")
    if len(head) < _HEAD.size or math.prod(_HEAD.unpack(head)[1:]) > n_bytes:
        raise RecordingFileError(path, f"is cut off at byte {n_bytes}")
    log = file.with_name(file.name + "-wal")
    # not Path.exists, which raises where the name with its ending is too long to be one
    if os.path.exists(log) and log.stat().st_size:  # noqa: PTH110
        problem = f"was not closed: {log.name} holds messages that are not in it yet; run `ros2 bag reindex`"
        raise RecordingFileError(path, problem)
    with _database(file, path) as database:
        for table in ("topics", "messages"):
            _check_table(database, table, path)
        by_id = _read_topics(database, path, topics)
        _read_messages(database, path, by_id, unpacker)


@contextmanager
def _database(file: Path, path: Path) -> Iterator[sqlite3.Connection]:
    try:
        uri = f"{file.absolute().as_uri()}?mode=ro&immutable=1"
        with closing(sqlite3.connect(uri, uri=True)) as database:
            for pragma in ("trusted_schema = OFF", "cell_size_check = ON", "mmap_size = 0"):
                database.execute(f"PRAGMA {pragma}")
            database.set_authorizer(
                lambda action, *_: sqlite3.SQLITE_OK if action in _ALLOWED else sqlite3.SQLITE_DENY
            )
            yield database
    except (sqlite3.Error, UnicodeDecodeError, OverflowError, MemoryError) as error:
        raise RecordingFileError(path, f"cannot be read as SQLite ({error})") from error


def _check_table(database: sqlite3.Connection, table: str, path: Path) -> None:
    query = "SELECT type, rootpage FROM sqlite_master WHERE lower(name) = ?"
    found = database.execute(query, (table,)).fetchmany(2)
    if not found:
        raise RecordingFileError(path, f"has no table {table!r}, as the .db3 of a ROS 2 bag has")
    hidden = [
        column[6] for column in database.execute(f"PRAGMA table_xinfo({table})")
    ]  # generated or virtual
    if len(found) > 1 or found[0][0] != "table" or not found[0][1] or any(hidden):
        raise RecordingFileError(
            path, f"{table!r} is not a plain table; views and generated columns are not read"
        )


def _read_topics(database: sqlite3.Connection, path: Path, topics: Topics) -> dict[int, Topic]:
    rows = database.execute("SELECT id, name, type, serialization_format FROM topics").fetchmany(_MOST_TOPICS)
    definitions = _definitions(database, path)
    by_id = {}
    for key, name, type_name, encoding in rows:
        if not (isinstance(key, int) and all(isinstance(text, str) for text in (name, type_name, encoding))):
            raise RecordingFileError(
                path, f"has a topic {str(name)[:40]!r} that is not three texts with a number"
            )
        by_id[key] = topics.add(name, type_name, encoding, definition=definitions.get(type_name, ""))
    return by_id


def _definitions(database: sqlite3.Connection, path: Path) -> dict[object, str]:
    """Return the definitions of types by name: a table that recorders write since ROS 2 Iron."""
    table = "message_definitions"
    if not database.execute("SELECT 1 FROM sqlite_master WHERE lower(name) = ?", (table,)).fetchone():
        return {}
    _check_table(database, table, path)
    text = "encoded_message_definition"
    wanted = f"encoding = 'ros2msg' AND length({text}) <= {LONGEST_DEFINITION}"
    query = f"SELECT topic_type, {text} FROM {table} WHERE {wanted}"
    rows = database.execute(query).fetchmany(_MOST_TOPICS)
    return {name: text for name, text in rows if isinstance(text, str)}


def _read_messages(
    database: sqlite3.Connection,
    path: Path,
    by_id: dict[int, Topic],
    unpacker: Unpacker,
) -> None:
    kept = [key for key, topic in by_id.items() if topic.kept]
    marks = ",".join("?" * len(kept))
    query = (
        "SELECT topic_id, timestamp, length(data), "
        f"CASE WHEN topic_id IN ({marks}) AND length(data) <= {LARGEST_MESSAGE} THEN data END "
        "FROM messages NOT INDEXED"
    )
    n_rows = 0
    for key, log_ns, n_bytes, message in database.execute(query, kept):
        n_rows += 1
        topic = by_id.get(key)
        if topic is None or not isinstance(log_ns, int) or log_ns < 0:
            problem = f"topic_id {str(key)[:20]} and timestamp {str(log_ns)[:20]} are not those of a message"
            raise RecordingFileError(path, problem, place=f"row {n_rows} of messages")
        if not topic.kept:
            topic.seen(log_ns)
        elif isinstance(message, bytes):
            topic.keep(log_ns, message)
        else:
            problem = f"has {n_bytes} bytes, more than a {topic.type_name} can have"
            raise RecordingFileError(path, problem, place=f"message {topic.count + 1}")
        if n_rows >= unpacker.records_left:
            break
    unpacker.walked(n_rows, "table messages")

"""ROS 1 bags and .db3 files made to do harm: each function writes one and returns the path to read."""

from __future__ import annotations

import bz2
import sqlite3
import struct
from contextlib import closing

import lz4.frame

from mcap_attacks import MIB, written
from ros_cases import (
    STAMPED,
)

# -- ROS 1


def fields(**values):
    parts = [name.encode() + b"=" + value for name, value in values.items()]
    return b"".join(struct.pack("<I", len(part)) + part for part in parts)


def bag_record(head, data, data_bytes=None):
    size = len(data) if data_bytes is None else data_bytes
    return struct.pack("<I", len(head)) + head + struct.pack("<I", size) + data


def bag(folder, body=b"", index=None, chunks=1, **header):
    """Put a bag together: a chunk record or what stands for it, and the index."""
    connection = bag_record(
        fields(op=b"\7", conn=bytes(4), topic=b"/ft"),
        fields(type=b"geometry_msgs/WrenchStamped", md5sum=b"*"),
    )
    info = bag_record(fields(op=b"\6", ver=b"\1\0\0\0", chunk_pos=bytes(8), count=bytes(4)), b"") * chunks
    fixed = {
        "op": b"\3",
        "index_pos": bytes(8),
        "conn_count": b"\1\0\0\0",
        "chunk_count": struct.pack("<I", chunks),
    }
    first = 13 + len(bag_record(fields(**{**fixed, **header}), b""))
    fixed["index_pos"] = struct.pack("<Q", first + len(body))
    path = folder / "x.bag"
    end = connection + info if index is None else index
    path.write_bytes(b"#ROSBAG V2.0\n" + bag_record(fields(**{**fixed, **header}), b"") + body + end)
    return path


def bag_chunk(data, compression=b"none", stated=None, packed=None):
    size = struct.pack("<I", len(data) if stated is None else stated)
    return bag_record(
        fields(op=b"\5", compression=compression, size=size), data if packed is None else packed
    )


def bag_message(data=b"", conn=0, **more):
    return bag_record(fields(op=b"\2", conn=struct.pack("<I", conn), time=bytes(8), **more), data)


BAG_ATTACKS = {
    "version 1.2": (
        lambda f: written(f / "x.bag", b"#ROSBAG V1.2\n" + bytes(99)),
        r"begins with '#ROSBAG V1.2'",
    ),
    "another kind of file": (
        lambda f: written(f / "x.bag", b"PK" * 50),
        "does not begin as a bag does; wanted '#ROSBAG V2.0'",
    ),
    "nothing but magic": (lambda f: written(f / "x.bag", b"#ROSBAG V2.0\n"), "is cut off"),
    "giant header": (
        lambda f: written(f / "x.bag", b"#ROSBAG V2.0\n" + b"\xff" * 9),
        "header of 4294967295 bytes",
    ),
    "not closed": (lambda f: bag(f, index_pos=bytes(8)), "no index: the recording was not closed"),
    "index beyond the file": (
        lambda f: bag(f, index_pos=b"\xff" * 8),
        "said to be at byte 18446744073709551615",
    ),
    "index before the data": (lambda f: bag(f, index_pos=b"\1" + bytes(7)), "said to be at byte 1"),
    "index of something else": (lambda f: bag(f, index=bag_chunk(b"")), "neither connection nor chunk"),
    "more chunks than there are": (lambda f: bag(f, chunk_count=b"\xff" * 4), "its index lists 1 chunks"),
    "encrypted": (lambda f: bag(f, encryptor=b"rosbag/AesCbcEncryptor"), "is encrypted"),
    "no bag header": (lambda f: bag(f, op=b"\5"), "no bag header"),
    "data of 4 GiB": (
        lambda f: bag(f, bag_record(fields(op=b"\5", compression=b"none", size=b"\xff" * 4), b"", 2**32 - 1)),
        "goes past the end",
    ),
    "chunk of 4 GiB": (
        lambda f: bag(f, bag_chunk(b"", b"bz2", 2**32 - 1, bz2.compress(b"x"))),
        "would expand",
    ),
    "bz2 bomb": (
        lambda f: bag(f, bag_chunk(b"", b"bz2", 99, bz2.compress(bytes(16 * MIB)))),
        "more than 99",
    ),
    "lz4 bomb": (
        lambda f: bag(f, bag_chunk(b"", b"lz4", 99, lz4.frame.compress(bytes(99 * MIB)))),
        "more than 99",
    ),
    "damaged bz2": (lambda f: bag(f, bag_chunk(b"", b"bz2", 99, b"no bz2")), "cannot be decompressed"),
    "unknown compression": (
        lambda f: bag(f, bag_chunk(b"", b"\xff", 9, b"?")),
        "compression that is not UTF-8",
    ),
    "message outside of chunks": (lambda f: bag(f, bag_message()), "neither chunk nor index"),
    "message of no connection": (
        lambda f: bag(f, bag_chunk(bag_message(conn=9))),
        "connection that its index",
    ),
    "record past its chunk": (lambda f: bag(f, bag_chunk(bag_message(b"abc")[:-1])), "goes past its end"),
    "record of a strange kind": (
        lambda f: bag(f, bag_chunk(bag_record(fields(op=b"\4"), b""))),
        "is no message",
    ),
    "header without an equals sign": (
        lambda f: bag(f, bag_chunk(bag_record(b"\1\0\0\0?", b""))),
        "damaged header",
    ),
    "field past its header": (
        lambda f: bag(f, bag_chunk(bag_record(b"\xff\0\0\0a=b", b""))),
        "damaged header",
    ),
    "time too short": (
        lambda f: bag(f, bag_chunk(bag_record(fields(op=b"\2", conn=bytes(4), time=b"\1"), b""))),
        "is no message",
    ),
    "message of no bytes": (lambda f: bag(f, bag_chunk(bag_message())), "has 0 bytes"),
    "millions of empty records": (
        lambda f: bag(f, bag_chunk(b"", b"bz2", 16_000_000, bz2.compress(bag_record(b"", b"") * 2_000_000))),
        "is no message",
    ),
    "giant connection": (
        lambda f: bag(f, index=bag_record(fields(op=b"\7", conn=bytes(4), topic=b"/ft"), bytes(2 * MIB))),
        "connection of 2097152 bytes",
    ),
    "topic that is no text": (
        lambda f: bag(f, index=bag_record(fields(op=b"\7", conn=bytes(4), topic=b"\xff"), b"")),
        "topic that is not UTF-8",
    ),
}


# -- SQLite


def database(folder, *statements, name="x.db3", tables=("topics", "messages")):
    made = {
        "topics": "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)",
        "messages": "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)",
    }
    path = folder / name
    with closing(sqlite3.connect(path)) as connection:
        for table in tables:
            connection.execute(made[table])
        if "topics" in tables:
            connection.execute("INSERT INTO topics VALUES (1, '/ft', ?, 'cdr')", (STAMPED,))
        for statement in statements:
            connection.execute(statement)
        connection.commit()
    return path


def insert(values):
    return f"INSERT INTO messages(topic_id, timestamp, data) VALUES ({values})"


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"

DB3_ATTACKS = {
    "text": (lambda f: written(f / "x.db3", b"SQLite format 2\0" + bytes(5000)), "is not an SQLite file"),
    "magic only": (lambda f: written(f / "x.db3", b"SQLite format 3\0"), "is cut off at byte 16"),
    "noise behind the magic": (
        lambda f: written(f / "x.db3", b"SQLite format 3\0" + bytes(84) + bytes(range(100, 256)) * 64),
        "cannot be read as SQLite",
    ),
    "pages that are not there": (
        lambda f: written(f / "y.db3", database(f).read_bytes()[:-4096]),
        "is cut off at byte",
    ),
    "no tables": (lambda f: database(f, "CREATE TABLE a(b)", tables=()), "no table 'topics'"),
    "no messages": (lambda f: database(f, tables=("topics",)), "no table 'messages'"),
    "other columns": (
        lambda f: database(f, "CREATE TABLE messages(x)", tables=("topics",)),
        "cannot be read as SQLite",
    ),
    "endless view": (
        lambda f: database(
            f,
            f"CREATE VIEW messages AS {ENDLESS} SELECT i id, 1 topic_id, i timestamp, zeroblob(99) data FROM n",
            tables=("topics",),
        ),
        "'messages' is not a plain table",
    ),
    "view in capitals": (
        lambda f: database(f, "CREATE VIEW MESSAGES AS SELECT 1 AS topic_id", tables=("topics",)),
        "'messages' is not a plain table",
    ),
    "virtual table": (
        lambda f: database(f, "CREATE VIRTUAL TABLE messages USING fts5(topic_id)", tables=("topics",)),
        "vtable|not a plain table",
    ),
    "generated column": (
        lambda f: database(
            f,
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
            "data BLOB AS (zeroblob(1000000000)) VIRTUAL)",
            "INSERT INTO messages(topic_id, timestamp) VALUES (1, 1)",
            tables=("topics",),
        ),
        "'messages' is not a plain table",
    ),
    "giant message": (lambda f: database(f, insert("1, 1, zeroblob(50000000)")), "has 50000000 bytes"),
    "message of no bytes": (lambda f: database(f, insert("1, 1, x''")), "begins with nothing"),
    "message that is text": (lambda f: database(f, insert("1, 1, 'abc'")), "3 bytes, and is no|more than"),
    "no message": (lambda f: database(f, insert("1, 1, NULL")), "more than|no bytes"),
    "time that is text": (lambda f: database(f, insert("1, 'now', x''")), "timestamp now"),
    "time before 1970": (lambda f: database(f, insert("1, -5, x''")), "timestamp -5"),
    "message of no topic": (lambda f: database(f, insert("9, 1, x''")), "topic_id 9"),
    "topic without a name": (
        lambda f: database(f, "INSERT INTO topics VALUES (2, NULL, NULL, 7)"),
        "three texts",
    ),
    "text that is not UTF-8": (
        lambda f: database(f, "INSERT INTO topics VALUES (2, CAST(x'ff' AS TEXT), 'a', 'cdr')"),
        "cannot be read as SQLite",
    ),
    "hundreds of thousands of empty messages": (
        lambda f: database(
            f,
            f"{ENDLESS} INSERT INTO messages(topic_id, timestamp) SELECT 2, i FROM n LIMIT 300000",
            "INSERT INTO topics VALUES (2, '/b', 'b/msg/B', 'cdr')",
        ),
        "no messages of type|next to no bytes",
    ),
    "not closed": (lambda f: _with_wal(database(f)), "was not closed: x.db3-wal"),
}


def _with_wal(path):
    path.with_name("x.db3-wal").write_bytes(b"?")
    return path

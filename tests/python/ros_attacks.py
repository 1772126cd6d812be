"""Bags made to do harm: each function writes one into a folder and returns the path to read."""

from __future__ import annotations

import bz2
import os
import sqlite3
import struct
from contextlib import closing

import lz4.frame
import zstandard

from ros_cases import (
    MCAP,
    ROS1,
    ROS2,
    STAMPED,
    even_stamps,
    one_topic,
    payloads,
    samples,
    write_bag1,
    write_bag2,
    write_mcap,
)

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, METADATA, DATA_END = 1, 2, 3, 4, 5, 6, 12, 15


def good(folder, kind):
    """Return a bag without a fault, as one file."""
    if kind == "mcap":
        return write_mcap(folder / "x.mcap", one_topic(ROS2, samples(), even_stamps()))
    if kind == "bag":
        return write_bag1(folder / "x.bag", one_topic(ROS1, samples(), even_stamps()))
    path = write_bag2(folder / "x", one_topic(ROS2, samples(), even_stamps()))
    return (path / "x.db3").rename(folder / "x.db3")


# -- MCAP, by hand


def text(value):
    raw = value if isinstance(value, bytes) else value.encode()
    return struct.pack("<I", len(raw)) + raw


def record(kind, body, length=None):
    return struct.pack("<BQ", kind, len(body) if length is None else length) + body


def schema(key=1, name=STAMPED, encoding="ros2msg"):
    return record(SCHEMA, struct.pack("<H", key) + text(name) + text(encoding) + text(""))


def channel(key=1, schema_key=1, topic="/ft"):
    return record(CHANNEL, struct.pack("<HH", key, schema_key) + text(topic) + text("cdr") + text(""))


def message(data=b"", key=1, time=0):
    return record(MESSAGE, struct.pack("<HIQQ", key, 0, time, time) + data)


def chunk(data, compression="", stated=None, packed=None, crc=0):
    body = struct.pack("<QQQI", 0, 0, len(data) if stated is None else stated, crc) + text(compression)
    raw = data if packed is None else packed
    return record(CHUNK, body + struct.pack("<Q", len(raw)) + raw)


def mcap(folder, *records):
    end = record(DATA_END, bytes(4)) + record(FOOTER, bytes(20)) + MAGIC
    path = folder / "x.mcap"
    path.write_bytes(MAGIC + record(HEADER, text("ros2") + text("test")) + b"".join(records) + end)
    return path


def whole_chunk():
    return schema() + channel() + b"".join(map(message, payloads(ROS2, samples(3), even_stamps(3))))


def zstd_without_size(n_bytes):
    return zstandard.ZstdCompressor(write_content_size=False).compress(bytes(n_bytes))


LARGE = 1 << 28
MIB = 1 << 20

MCAP_ATTACKS = {
    "nothing but magic": (lambda f: _written(f / "x.mcap", MAGIC), "is cut off"),
    "magic twice": (lambda f: _written(f / "x.mcap", MAGIC * 2), "is cut off"),
    "no header": (lambda f: _written(f / "x.mcap", MAGIC + schema() + MAGIC), "wanted the header"),
    "record beyond the file": (lambda f: mcap(f, record(CHUNK, b"", 2**40)), "is cut off"),
    "record of 2^64 - 1 bytes": (lambda f: mcap(f, record(MESSAGE, b"", 2**64 - 1)), "is cut off"),
    "record of kind 0": (lambda f: mcap(f, record(0, b"")), "record of kind 0"),
    "chunk of a terabyte": (
        lambda f: mcap(f, chunk(b"", "zstd", 2**40, zstd_without_size(10))),
        "would expand",
    ),
    "zstd bomb, stated": (
        lambda f: mcap(f, chunk(b"", "zstd", LARGE, zstandard.compress(bytes(LARGE)))),
        "would expand",
    ),
    "zstd bomb, size hidden": (
        lambda f: mcap(f, chunk(b"", "zstd", 100, zstd_without_size(64 * MIB))),
        "zstd",
    ),
    "zstd bomb, size in its frame": (
        lambda f: mcap(f, chunk(b"", "zstd", 100, zstandard.compress(bytes(LARGE)))),
        "a frame of 268435456 bytes",
    ),
    "zstd bomb in parts": (lambda f: mcap(f, *[_zstd_chunk(_padded(48 * MIB))] * 9), "would expand"),
    "lz4 bomb": (
        lambda f: mcap(f, chunk(b"", "lz4", 100, lz4.frame.compress(bytes(99 * MIB)))),
        "more than 100",
    ),
    "damaged zstd": (lambda f: mcap(f, chunk(b"", "zstd", 100, b"no zstd at all")), "cannot be decompressed"),
    "damaged lz4": (lambda f: mcap(f, chunk(b"", "lz4", 100, b"no lz4 at all")), "cannot be decompressed"),
    "unknown compression": (lambda f: mcap(f, chunk(b"", "brotli", 100, b"?")), "compressed by 'brotli'"),
    "size not as stated": (lambda f: mcap(f, chunk(b"", "", 100, b"?")), "states 100 bytes but expands to 1"),
    "checksum": (lambda f: mcap(f, chunk(whole_chunk(), crc=7)), "checksum does not fit"),
    "a million empty records": (
        lambda f: mcap(f, chunk(message() * (20 * MIB // 31))),
        "is not defined before",
    ),
    "a million empty messages behind a channel": (
        lambda f: mcap(f, schema() + channel(), _zstd_chunk(message() * 1_000_000)),
        "next to no bytes",
    ),
    "channels without end": (
        lambda f: mcap(
            f, schema(), _zstd_chunk(b"".join(channel(i % 65536, topic=str(i)) for i in range(30_000)))
        ),
        "more than 20000 schemas and channels",
    ),
    "record of a strange kind in a chunk": (lambda f: mcap(f, chunk(record(CHUNK, b""))), "record of kind 6"),
    "half a record in a chunk": (lambda f: mcap(f, chunk(b"\5\1")), "record of kind 0"),
    "message past its chunk": (
        lambda f: mcap(f, chunk(whole_chunk() + message()[:-1])),
        "of kind 5|does not fit",
    ),
    "message of 2^64 - 1 bytes": (
        lambda f: mcap(f, chunk(whole_chunk() + record(MESSAGE, bytes(40), 2**64 - 1))),
        "does not fit its chunk",
    ),
    "message shorter than its head": (
        lambda f: mcap(f, chunk(whole_chunk() + record(MESSAGE, bytes(22), 3))),
        "does not fit its chunk",
    ),
    "channel of no schema": (lambda f: mcap(f, channel(schema_key=5)), "of schema 5"),
    "message of no channel": (lambda f: mcap(f, message()), "message of channel 1"),
    "name that is no text": (lambda f: mcap(f, schema(name=b"\xff\xfe")), "damaged schema record"),
    "name past its record": (
        lambda f: mcap(f, record(SCHEMA, b"\1\0\xff\xff\xff\xff")),
        "damaged schema record",
    ),
    "metadata past its record": (
        lambda f: mcap(f, record(METADATA, text("granular_id") + b"\xff\xff\xff\xff")),
        "damaged metadata record",
    ),
    "log time after 2262": (
        lambda f: mcap(f, schema(), channel(), message(payloads(ROS2, samples(1), [5])[0], time=2**63)),
        "has the log time 9223372036854775808 ns",
    ),
    "bytes behind the end": (
        lambda f: _written(f / "y.mcap", mcap(f, chunk(whole_chunk())).read_bytes() + b"?"),
        "is cut off",
    ),
}


def _written(path, data):
    path.write_bytes(data)
    return path


def _padded(n_bytes):
    """Return a chunk of this many bytes, nearly all of them in one message of another topic."""
    head = whole_chunk() + channel(2, topic="/camera")
    return head + message(bytes(n_bytes - len(head) - len(message())), key=2)


def _zstd_chunk(data):
    return chunk(b"", "zstd", len(data), zstandard.compress(data))


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
        lambda f: _written(f / "x.bag", b"#ROSBAG V1.2\n" + bytes(99)),
        r"begins with '#ROSBAG V1.2'",
    ),
    "nothing but magic": (lambda f: _written(f / "x.bag", b"#ROSBAG V2.0\n"), "is cut off"),
    "giant header": (
        lambda f: _written(f / "x.bag", b"#ROSBAG V2.0\n" + b"\xff" * 9),
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
    "text": (lambda f: _written(f / "x.db3", b"SQLite format 2\0" + bytes(5000)), "is not an SQLite file"),
    "magic only": (lambda f: _written(f / "x.db3", b"SQLite format 3\0"), "is cut off at byte 16"),
    "noise behind the magic": (
        lambda f: _written(f / "x.db3", b"SQLite format 3\0" + bytes(84) + bytes(range(100, 256)) * 64),
        "cannot be read as SQLite",
    ),
    "pages that are not there": (
        lambda f: _written(f / "y.db3", database(f).read_bytes()[:-4096]),
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
    "millions of empty messages": (
        lambda f: database(
            f,
            f"{ENDLESS} INSERT INTO messages(topic_id, timestamp) SELECT 2, i FROM n LIMIT 600000",
            "INSERT INTO topics VALUES (2, '/b', 'b/msg/B', 'cdr')",
        ),
        "no messages of type|next to no bytes",
    ),
    "not closed": (lambda f: _with_wal(database(f)), "was not closed: x.db3-wal"),
}


def _with_wal(path):
    path.with_name("x.db3-wal").write_bytes(b"?")
    return path


# -- folders


def folder_of(folder, metadata, *, files=("x.mcap",)):
    path = folder / "x"
    path.mkdir()
    for name in files:
        write_mcap(path / name, one_topic(ROS2, samples(), even_stamps()))
    (path / "metadata.yaml").write_bytes(metadata if isinstance(metadata, bytes) else metadata.encode())
    return path


def metadata(*paths, **more):
    listed = "".join(f"\n    - {path}" for path in paths)
    other = "".join(f"\n  {key}: {value}" for key, value in more.items())
    return f"rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:{listed}{other}\n"


def _outside(folder, how):
    secret = folder / "secret.mcap"
    write_mcap(secret, one_topic(ROS2, samples(), even_stamps()))
    inner = folder / "in"
    inner.mkdir()
    if how in ("link", "beside"):
        path = folder_of(inner, metadata("y.mcap"))
        (path / "y.mcap").symlink_to(secret if how == "link" else secret.rename(inner / "secret.mcap"))
        return path
    return folder_of(inner, metadata({"up": "../../secret.mcap", "absolute": secret}[how]))


def _packed(folder, data, name="x.db3.zstd"):
    path = folder_of(folder, metadata(name, compression_format="zstd", compression_mode="FILE"), files=())
    (path / name).write_bytes(data)
    return path


def _pipe(folder):
    path = folder_of(folder, metadata("y.mcap"))
    os.mkfifo(path / "y.mcap")
    return path


def _packed_messages(folder, data):
    topics = {"/ft": (STAMPED, [data], [5])}
    path = write_bag2(folder / "x", topics, MCAP)
    (path / "metadata.yaml").write_text(
        metadata("x.mcap", compression_format="zstd", compression_mode="MESSAGE")
    )
    return path


ALIASES = "\n".join(f"  a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9) if i else 'x'}]" for i in range(30))

FOLDER_ATTACKS = {
    "empty metadata": (lambda f: folder_of(f, ""), "no entry rosbag2_bagfile_information"),
    "binary metadata": (lambda f: folder_of(f, b"\xff\xfe\0\1" * 99), "is not UTF-8"),
    "no YAML": (lambda f: folder_of(f, "a: [b\nc: }"), "is not proper YAML"),
    "deep brackets": (lambda f: folder_of(f, "[" * 9_000), "too deeply nested"),
    "deep dashes": (lambda f: folder_of(f, "- " * 9_000), "not proper YAML|no entry"),
    "long list": (lambda f: folder_of(f, metadata(*(f"{i}.mcap" for i in range(9000)))), "too long"),
    "aliases upon aliases": (
        lambda f: folder_of(f, f"rosbag2_bagfile_information:\n{ALIASES}\n  relative_file_paths: *a29\n"),
        "not proper YAML|no list relative_file_paths",
    ),
    "aliases as names": (
        lambda f: folder_of(
            f, f"x:\n{ALIASES}\nrosbag2_bagfile_information: {{relative_file_paths: *a29}}\n"
        ),
        "no list relative_file_paths|not proper YAML",
    ),
    "a Python object": (
        lambda f: folder_of(f, metadata("!!python/object/apply:os.getcwd []")),
        "not proper YAML|no list relative_file_paths",
    ),
    "a list for a block": (lambda f: folder_of(f, "rosbag2_bagfile_information: [1]"), "no entry"),
    "names that are numbers": (lambda f: folder_of(f, metadata(1, 2)), "no list relative_file_paths"),
    "no names": (lambda f: folder_of(f, metadata()), "no list relative_file_paths"),
    "a name above": (lambda f: _outside(f, "up"), "wanted a name within the folder"),
    "an absolute name": (lambda f: _outside(f, "absolute"), "wanted a name within the folder"),
    "a link out": (lambda f: _outside(f, "link"), "links out are not followed"),
    "a link to what lies beside the bag": (lambda f: _outside(f, "beside"), "links out are not followed"),
    "lines without end": (lambda f: folder_of(f, metadata("x.mcap") + "\n" * 300_000), "lines, more than"),
    "a file twice": (lambda f: folder_of(f, metadata(*["x.mcap"] * 9)), "names a file twice"),
    "a missing file": (lambda f: folder_of(f, metadata("y.mcap")), "cannot be read: No such file"),
    "a folder for a file": (lambda f: folder_of(f, metadata(".")), "wanted a name within the folder"),
    "another kind of file": (lambda f: folder_of(f, metadata("metadata.yaml")), "wanted .mcap or .db3"),
    "a pipe": (_pipe, "is not a regular file"),
    "a compression nobody has": (
        lambda f: folder_of(f, metadata("x.mcap", compression_format="fake", compression_mode="file")),
        "compression 'fake' of each 'file'",
    ),
    "a mode that is a list": (
        lambda f: folder_of(f, metadata("x.mcap", compression_mode="[file]")),
        "compression_mode is a list",
    ),
    "a packed bomb": (lambda f: _packed(f, zstandard.compress(bytes(LARGE))), "would expand"),
    "damaged packing": (lambda f: _packed(f, b"no zstd at all"), "cannot be decompressed"),
    "packing cut off": (lambda f: _packed(f, zstandard.compress(os.urandom(9999))[:5000]), "SQLite"),
    "a packed message bomb": (
        lambda f: _packed_messages(f, zstandard.compress(bytes(LARGE))),
        "a frame of 268435456",
    ),
    "damaged packed messages": (lambda f: _packed_messages(f, b"no zstd"), "cannot be decompressed"),
}

"""MCAP files made to do harm, put together byte by byte: each function writes one and returns the path to read."""

from __future__ import annotations

import struct

import lz4.frame
import zstandard

from ros_cases import ROS2, STAMPED, even_stamps, payloads, samples

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA, DATA_END = 1, 2, 3, 4, 5, 6, 9, 12, 15


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


def metadata(**texts):
    pairs = b"".join(text(key) + text(value) for key, value in texts.items())
    return record(METADATA, text("granular_id") + struct.pack("<I", len(pairs)) + pairs)


def whole_chunk():
    return schema() + channel() + b"".join(map(message, payloads(ROS2, samples(3), even_stamps(3))))


def zstd_without_size(n_bytes):
    return zstandard.ZstdCompressor(write_content_size=False).compress(bytes(n_bytes))


LARGE = 1 << 28
MIB = 1 << 20

MCAP_ATTACKS = {
    "nothing but magic": (lambda f: written(f / "x.mcap", MAGIC), "is cut off"),
    "magic twice": (lambda f: written(f / "x.mcap", MAGIC * 2), "is cut off"),
    "no header": (lambda f: written(f / "x.mcap", MAGIC + schema() + MAGIC), "wanted the header"),
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
        lambda f: written(f / "y.mcap", mcap(f, chunk(whole_chunk())).read_bytes() + b"?"),
        "is cut off",
    ),
}


def written(path, data):
    path.write_bytes(data)
    return path


def _padded(n_bytes):
    """Return a chunk of this many bytes, nearly all of them in one message of another topic."""
    head = whole_chunk() + channel(2, topic="/camera")
    return head + message(bytes(n_bytes - len(head) - len(message())), key=2)


def _zstd_chunk(data):
    return chunk(b"", "zstd", len(data), zstandard.compress(data))

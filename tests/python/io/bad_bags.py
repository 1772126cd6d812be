"""Bags with parts of a gigabyte, which take no room on the disk: files of zeros that are not stored."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import mcap_attacks as mcap
import ros_attacks as ros
from bad_files import GIB, BadCase

ATTACHED = bytes(16) + mcap.text("granular_id/flags") + mcap.text("")
CHUNK_HEAD = struct.pack("<QQQI", 0, 0, GIB - 44, 0) + mcap.text("zstd") + struct.pack("<Q", GIB - 44)


def bag_cases() -> Iterator[tuple[str, BadCase]]:
    """Yield bags whose records are as large as they say."""
    yield "mcap: chunk of a gigabyte", BadCase("mcap", partial(_mcap, mcap.CHUNK, CHUNK_HEAD))
    yield "mcap: message of a gigabyte", BadCase("mcap", partial(_mcap, mcap.MESSAGE, bytes(22)))
    yield "mcap: schema of a gigabyte", BadCase("mcap", partial(_mcap, mcap.SCHEMA, b""))
    ours = mcap.chunk(mcap.whole_chunk()), mcap.metadata(n_samples="3")
    yield (
        "mcap: attachment of a gigabyte",
        BadCase("mcap", partial(_mcap, mcap.ATTACHMENT, ATTACHED, records=ours)),
    )
    for compression in (b"none", b"bz2", b"lz4"):
        what = f"ros1: chunk of a gigabyte, {compression.decode()}"
        yield what, BadCase("ros1", partial(_bag, compression))


def _mcap(kind: int, body: bytes, folder: Path, records: tuple[bytes, ...] = ()) -> Path:
    path = mcap.mcap(folder, *records)
    data = path.read_bytes()
    start = data.index(mcap.record(mcap.DATA_END, bytes(4)))
    path.write_bytes(data[:start] + struct.pack("<BQ", kind, GIB) + body)
    return _grown(path, start + 9 + GIB, data[start:])


def _bag(compression: bytes, folder: Path) -> Path:
    chunk = ros.bag_chunk(b"", compression, 100)
    path = ros.bag(folder, chunk)
    data = path.read_bytes()
    end = data.index(chunk) + len(chunk)
    head = data[: end - 4].replace(struct.pack("<Q", end), struct.pack("<Q", end + GIB))
    path.write_bytes(head + struct.pack("<I", GIB))
    return _grown(path, end + GIB, data[end:])


def _grown(path: Path, n_bytes: int, tail: bytes) -> Path:
    """Fill a file up with zeros, and end it."""
    os.truncate(path, n_bytes)
    with path.open("ab") as file:
        file.write(tail)
    return path

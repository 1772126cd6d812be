"""Parquet files made to do harm: footers and pages that lie, columns that are none."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet

import good_files as good
from bad_files import BadCase
from good_files import TABLE

MIB = 1 << 20


def _parquet(make: Callable[[Path], object], folder: Path) -> Path:
    make(folder / "bad.parquet")
    return folder / "bad.parquet"


def _patched(old: bytes, new: bytes, path: Path, **options: object) -> None:
    good.write_parquet(path, **options)
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new))


def _page_sizes(path: Path) -> None:
    """Let pages claim a megabyte each: the second field of their headers is the size, 160,008 bytes before."""
    columns = dict.fromkeys(TABLE, np.zeros(20_000 * 50))
    good.write_parquet(path, columns, use_dictionary=False, compression="zstd", write_statistics=False)
    data, size = path.read_bytes(), b"\x15\x00\x15" + varint(2 * (8 * 20_000 + 8))
    assert data.count(size) == 50 * len(columns)
    path.write_bytes(data.replace(size, b"\x15\x00\x15" + varint(2 * MIB - 2)))


def varint(value: int) -> bytes:
    parts = []
    while value > 127:
        parts.append(value & 127 | 128)
        value >>= 7
    return bytes([*parts, value])


def _zstd_pages(path: Path) -> None:
    columns = {name: np.zeros(2 * MIB) for name in TABLE}  # 117 MB
    good.write_parquet(path, columns, use_dictionary=False, compression="zstd", write_statistics=False)


def _repeated(path: Path) -> None:
    """A dictionary of one value and run lengths: 240 MB of samples in some kilobytes."""
    one = pyarrow.DictionaryArray.from_arrays(pyarrow.array(np.zeros(5 * MIB, np.int32)), [0.0])
    pyarrow.parquet.write_table(pyarrow.table(dict.fromkeys(TABLE, one)), path, write_statistics=False)


def _many_columns(path: Path) -> None:
    pyarrow.parquet.write_table(pyarrow.table({f"c{i}": [0.0] for i in range(3000)}), path)


def _nested(path: Path) -> None:
    inner: object = {"fx": 1.0}
    for _ in range(60):
        inner = {"a": inner}
    pyarrow.parquet.write_table(pyarrow.table({"fx": [inner]}), path)


PARQUETS: dict[str, Callable[[Path], object]] = {
    "footer of 4 GiB": lambda path: path.write_bytes(b"PAR1" + bytes(99) + b"\xff\xff\xff\xffPAR1"),
    "footer of nothing": lambda path: path.write_bytes(b"PAR1" + bytes(99) + bytes(4) + b"PAR1"),
    "footer of noise": lambda path: path.write_bytes(b"PAR1" + bytes(range(256)) * 4 + b"\0\4\0\0PAR1"),
    "footer of long lists": lambda path: path.write_bytes(
        b"PAR1" + b"\x15\x02\x19\xfc" + varint(2**31 - 1) + bytes(99) + b"\x6c\0\0\0PAR1"
    ),
    "encrypted": lambda path: path.write_bytes(b"PARE" + bytes(99) + b"\x10\0\0\0PARE"),
    "pages of zeros": _zstd_pages,
    "pages that claim more": _page_sizes,
    "one value for millions of rows": _repeated,
    "3000 columns": _many_columns,
    "nested 60 deep": _nested,
    "a column twice": lambda path: pyarrow.parquet.write_table(
        pyarrow.Table.from_arrays([pyarrow.array([1.0])] * 2, names=["fx", "fx"]), path
    ),
    "a column with a control character": lambda path: good.write_parquet(path, {"f\x1b[2J\nx": [1.0]}),
}


def parquet_cases() -> Iterator[tuple[str, BadCase]]:
    """Yield Parquet files that no library would write, and some that one would."""
    for what, make in PARQUETS.items():
        yield f"parquet: {what}", BadCase("parquet", partial(_parquet, make))

"""A Parquet file opened with care: sizes are checked before anything is decoded, faults are named."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from granular_id.io.errors import RecordingFileError
from granular_id.io.extras import need
from granular_id.io.files import check_expansion, open_bounded
from granular_id.io.parquet.footer import MAX_FOOTER_BYTES, Footer, read_footer
from granular_id.io.parquet.pages import unpacked_bytes

__all__ = ["CheckedParquet", "open_parquet", "parquet_library"]

_MAX_FOOTER_ITEMS = 100_000
"""Longest list in a footer; a longer claim would take hundreds of megabytes before it is seen to be false."""


def parquet_library(why: str) -> Any:
    """Return ``pyarrow.parquet``, or say how to install it."""
    return need("pyarrow.parquet", extra="app", why=why)


@contextmanager
def open_parquet(
    path: Path, root: Path, max_bytes: int, texts: Sequence[str] = ()
) -> Iterator[CheckedParquet]:
    """Open a Parquet file inside `root`.

    Parameters
    ----------
    path, root : Path
    max_bytes : int
        Largest file that is opened.
    texts : sequence of str
        Columns to read dictionary-encoded, so that a long text that is repeated is held once.

    Raises
    ------
    RecordingFileError
        Not a Parquet file, cut off, damaged, too large or outside `root`.
    ImportError
        pyarrow is missing.
    """
    library = parquet_library("to read Parquet files")
    with open_bounded(path, root, max_bytes) as (file, n_bytes):
        try:
            footer = read_footer(file, n_bytes)
        except ValueError as error:
            raise RecordingFileError(path, str(error)) from error
        with _naming(path, "footer"):
            source = _source(path, file)
            parquet = library.ParquetFile(
                source,
                read_dictionary=list(texts),
                pre_buffer=False,
                page_checksum_verification=True,
                thrift_string_size_limit=MAX_FOOTER_BYTES,
                thrift_container_size_limit=_MAX_FOOTER_ITEMS,
            )
            opened = CheckedParquet(path, file, n_bytes, parquet, footer, use_threads=source is not file)
        try:
            yield opened
        finally:
            parquet.close(force=True)


def _source(path: Path, file: BinaryIO) -> Any:
    """Return pyarrow's own file, or the Python file where pyarrow cannot spell the name.

    Threads of pyarrow that read through a Python file can abort or hang the process when it ends (Apache Arrow,
    issues 34314 and 50482), so only pyarrow's own files are read by threads.
    """
    try:
        os.fspath(path).encode()
    except UnicodeEncodeError:
        return file
    return need("pyarrow", extra="app", why="to read Parquet files").OSFile(os.fspath(path))


class CheckedParquet:
    """An open Parquet file.

    Attributes
    ----------
    columns : dict
        Arrow type of each top-level column, by name.
    labels : dict
        Key-value texts of the footer.
    rows : list of int
        Rows of each row group.
    """

    def __init__(
        self, path: Path, file: BinaryIO, n_bytes: int, parquet: Any, footer: Footer, *, use_threads: bool
    ) -> None:
        self.path = path
        self._use_threads = use_threads
        self._file = file
        self._n_bytes = n_bytes
        self._parquet = parquet
        self._footer = footer
        self._checked: set[str] = set()
        schema = parquet.schema_arrow
        names = list(schema.names)
        if len(set(names)) < len(names):
            twice = next(name for i, name in enumerate(names) if name in names[:i])
            raise ValueError(f"column {twice[:40]!r} occurs twice")
        self.columns: dict[str, Any] = dict(zip(names, schema.types, strict=True))
        self.labels = footer.labels
        self.rows = footer.rows

    def check(self, columns: Sequence[str]) -> None:
        """Refuse what the columns would expand to, before any of it is decoded.

        Raises
        ------
        RecordingFileError
            With the row group: pages that contradict the footer, or would take far more memory than recordings do.
        """
        wanted = set(columns) - self._checked
        total = 0
        for group, rows in enumerate(self.rows):
            with _naming(self.path, f"row group {group}"):
                for chunk in self._footer.chunks[group]:
                    if not {chunk.column, chunk.column.partition(".")[0]} & wanted:
                        continue
                    if chunk.n_values != rows:
                        raise ValueError(
                            f"column {chunk.column[:40]} has {chunk.n_values} values for {rows} rows"
                        )
                    total += 8 * rows + unpacked_bytes(self._read_at, chunk)
            check_expansion(self.path, self._n_bytes, total, place=f"row group {group}")
        self._checked |= wanted

    def read(self, group: int, columns: Sequence[str]) -> Any:
        """Decode columns of one row group, a ``pyarrow.Table``."""
        self.check(columns)
        with _naming(self.path, f"row group {group}"):
            table = self._parquet.read_row_group(group, columns=list(columns), use_threads=self._use_threads)
            table.validate(full=True)
            if table.num_rows != self.rows[group]:
                raise ValueError(f"{table.num_rows} rows could be decoded of {self.rows[group]}")
            return table.select(list(columns))

    def _read_at(self, offset: int, n: int) -> bytes:
        self._file.seek(offset)
        return self._file.read(n)


@contextmanager
def _naming(path: Path, place: str) -> Iterator[None]:
    """Turn what pyarrow raises about a damaged file into the one exception that names the file and the place."""
    arrow = need("pyarrow", extra="app", why="to read Parquet files")
    try:
        yield
    except RecordingFileError:
        raise
    except (
        arrow.ArrowException,
        OSError,
        ValueError,
        TypeError,
        IndexError,
        KeyError,
        OverflowError,
    ) as error:
        lines = str(error).strip().splitlines() or [type(error).__name__]
        raise RecordingFileError(path, f"cannot be decoded: {lines[0][:200]}", place=place) from error

"""A Parquet file opened with care: sizes are checked before anything is decoded, faults are named."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from granular_id.io.bulk import bulk_threads
from granular_id.io.errors import RecordingFileError
from granular_id.io.extras import need
from granular_id.io.files import check_expansion, open_bounded
from granular_id.io.parquet.footer import MAX_FOOTER_BYTES, Footer, read_footer
from granular_id.io.parquet.pages import unpacked_bytes

__all__ = ["TEXTS", "CheckedParquet", "is_list", "open_parquet", "parquet_library"]

TEXTS = ("string", "large_string", "string_view")
"""Types of Arrow that hold texts."""

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
            readers = _Readers(library, path, file, list(texts))
        try:
            with _naming(path, "footer"):
                opened = CheckedParquet(path, file, n_bytes, readers, footer)
            yield opened
        finally:
            readers.close()


class _Readers:
    """pyarrow's readers of one file: one for each thread, as none can be used by two at a time."""

    def __init__(self, library: Any, path: Path, file: BinaryIO, texts: list[str]) -> None:
        self._library, self._texts = library, texts
        self._own = threading.local()
        self._all: list[Any] = []
        self.own_file = _has_plain_name(path)
        arrow = need("pyarrow", extra="app", why="to read Parquet files")
        # one open file for all: another may take its name meanwhile
        self._source = arrow.OSFile(os.fspath(path)) if self.own_file else file
        self._metadata = None
        self._metadata = self.get().metadata  # the others need not read it again

    def get(self) -> Any:
        """Return the reader of this thread."""
        if not hasattr(self._own, "reader"):
            self._own.reader = self._open()
            self._all.append(self._own.reader)
        return self._own.reader

    def _open(self) -> Any:
        return self._library.ParquetFile(
            self._source,
            metadata=self._metadata,
            read_dictionary=self._texts,
            pre_buffer=False,
            page_checksum_verification=True,
            thrift_string_size_limit=MAX_FOOTER_BYTES,
            thrift_container_size_limit=_MAX_FOOTER_ITEMS,
        )

    def close(self) -> None:
        for reader in self._all:
            reader.close()
        if self.own_file:
            self._source.close()


def _has_plain_name(path: Path) -> bool:
    """Tell whether pyarrow can spell the name, and open the file itself; otherwise it reads the Python file.

    Threads of pyarrow that read through a Python file can abort or hang the process when it ends (Apache Arrow,
    issues 34314 and 50482), so only pyarrow's own files are read by threads.
    """
    try:
        os.fspath(path).encode()
    except UnicodeEncodeError:
        return False
    return True


class CheckedParquet:
    """An open Parquet file.

    Attributes
    ----------
    columns : dict
        Arrow type of each top-level column, by name.
    units : dict
        What the metadata of columns, by name, say of their units.
    labels : dict
        Key-value texts of the footer.
    rows : list of int
        Rows of each row group.
    most_threads : int
        How many may `read` at a time, after a `check`: pyarrow's own threads gain nothing on row groups of this size.
    """

    def __init__(self, path: Path, file: BinaryIO, n_bytes: int, readers: _Readers, footer: Footer) -> None:
        self.path = path
        self.most_threads = bulk_threads() if readers.own_file else 1
        self._file = file
        self._n_bytes = n_bytes
        self._readers = readers
        self._footer = footer
        self._checked: set[str] = set()
        schema = readers.get().schema_arrow
        names = list(schema.names)
        if len(set(names)) < len(names):
            twice = next(name for i, name in enumerate(names) if name in names[:i])
            raise ValueError(f"column {twice[:40]!r} occurs twice")
        self.columns: dict[str, Any] = dict(zip(names, schema.types, strict=True))
        self.units = {name: unit for name in names if (unit := _unit_of_field(schema.field(name)))}
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
        if not wanted:  # as for all threads, which must not read the Python file together
            return
        total = 0
        for group, rows in enumerate(self.rows):
            with _naming(self.path, f"row group {group}"):
                for chunk in self._footer.chunks[group]:
                    if not {chunk.column, chunk.column.partition(".")[0]} & wanted:
                        continue
                    kind = self.columns.get(chunk.column, self.columns.get(chunk.column.partition(".")[0]))
                    if chunk.n_values != rows and not is_list(kind):
                        raise ValueError(
                            f"column {chunk.column[:40]} has {chunk.n_values} values for {rows} rows"
                        )
                    total += 8 * max(rows, chunk.n_values) + unpacked_bytes(self._read_at, chunk)
            check_expansion(self.path, self._n_bytes, total, place=f"row group {group}")
        self._checked |= wanted

    def read(self, group: int, columns: Sequence[str]) -> Any:
        """Decode columns of one row group, a ``pyarrow.Table``."""
        self.check(columns)
        with _naming(self.path, f"row group {group}"):
            reader = self._readers.get()
            table = reader.read_row_group(group, columns=list(columns), use_threads=False)
            table.validate(full=True)
            table = _with_plain_dictionaries(table)
            if table.num_rows != self.rows[group]:
                raise ValueError(f"{table.num_rows} rows could be decoded of {self.rows[group]}")
            return table.select(list(columns))

    def _read_at(self, offset: int, n: int) -> bytes:
        self._file.seek(offset)
        return self._file.read(n)


def _unit_of_field(field: Any) -> str | None:
    """Return what the metadata of a column say of its unit."""
    about = {key.lower(): value for key, value in (field.metadata or {}).items()}
    said = about.get(b"units", about.get(b"unit"))
    return None if said is None else str(said.decode("utf-8", "replace")).strip() or None


def is_list(kind: Any) -> bool:
    """Tell whether a type of Arrow is one of lists."""
    types = need("pyarrow", extra="app", why="to read Parquet files").types
    return kind is not None and bool(
        types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)
    )


def _with_plain_dictionaries(table: Any) -> Any:
    """Make dictionaries of texts ones with int32 indices, whatever their writer chose, and others plain columns."""
    arrow = need("pyarrow", extra="app", why="to read Parquet files")
    for i, field in enumerate(table.schema):
        if arrow.types.is_dictionary(field.type):
            kind = field.type.value_type
            wanted = arrow.dictionary(arrow.int32(), kind) if str(kind) in TEXTS else kind
            table = table.set_column(i, field.name, table.column(i).cast(wanted))
    return table


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

"""A Parquet file opened with care: sizes are checked before anything is decoded, faults are named."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from granular_id.io.errors import RecordingFileError
from granular_id.io.extras import need
from granular_id.io.files import check_expansion, open_bounded
from granular_id.io.parquet_pages import MAGIC, unpacked_bytes

__all__ = ["CheckedParquet", "open_parquet", "parquet_library"]

_MAX_FOOTER = 16 * 1024 * 1024
"""Footers grow with row groups times columns: a part of 64 groups needs 60 kB."""

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
        _check_frame(file, n_bytes, path)
        with _naming(path, "footer"):
            parquet = library.ParquetFile(
                file,
                read_dictionary=list(texts),
                pre_buffer=False,
                page_checksum_verification=True,
                thrift_string_size_limit=_MAX_FOOTER,
                thrift_container_size_limit=_MAX_FOOTER_ITEMS,
            )
            opened = CheckedParquet(path, file, n_bytes, parquet)
        yield opened


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

    def __init__(self, path: Path, file: BinaryIO, n_bytes: int, parquet: Any) -> None:
        self.path = path
        self._file = file
        self._n_bytes = n_bytes
        self._parquet = parquet
        self._checked: set[str] = set()
        footer = parquet.metadata
        schema = parquet.schema_arrow
        names = list(schema.names)
        if len(set(names)) < len(names):
            twice = next(name for i, name in enumerate(names) if name in names[:i])
            raise ValueError(f"column {twice[:40]!r} occurs twice")
        self.columns: dict[str, Any] = dict(zip(names, schema.types, strict=True))
        self.labels = {
            key.decode("utf-8", "replace"): value.decode("utf-8", "replace")
            for key, value in (footer.metadata or {}).items()
        }
        self.rows = [footer.row_group(i).num_rows for i in range(footer.num_row_groups)]
        if min(self.rows, default=0) < 0 or sum(self.rows) != footer.num_rows:
            raise ValueError(f"the row groups hold {sum(self.rows)} rows, the footer says {footer.num_rows}")

    def check(self, columns: Sequence[str]) -> None:
        """Refuse what the columns would expand to, before any of it is decoded.

        Raises
        ------
        RecordingFileError
            With the row group: pages that contradict the footer, or would take far more memory than recordings do.
        """
        wanted = set(columns) - self._checked
        total = 0
        footer = self._parquet.metadata
        for group, rows in enumerate(self.rows):
            with _naming(self.path, f"row group {group}"):
                record = footer.row_group(group)
                for i in range(record.num_columns):
                    chunk = record.column(i)
                    if (
                        chunk.path_in_schema.split(".")[0] not in wanted
                        and chunk.path_in_schema not in wanted
                    ):
                        continue
                    if chunk.num_values != rows:
                        said = f"{chunk.path_in_schema[:40]} has {chunk.num_values} values for {rows} rows"
                        raise ValueError(f"column {said}")
                    total += 8 * rows + unpacked_bytes(self._read_at, chunk, self._n_bytes)
            check_expansion(self.path, self._n_bytes, total, place=f"row group {group}")
        self._checked |= wanted

    def read(self, group: int, columns: Sequence[str]) -> Any:
        """Decode columns of one row group, a ``pyarrow.Table``."""
        self.check(columns)
        with _naming(self.path, f"row group {group}"):
            table = self._parquet.read_row_group(group, columns=list(columns))
            table.validate(full=True)
            if table.num_rows != self.rows[group]:
                raise ValueError(f"{table.num_rows} rows could be decoded of {self.rows[group]}")
            return table.select(list(columns))

    def _read_at(self, offset: int, n: int) -> bytes:
        self._file.seek(offset)
        return self._file.read(n)


def _check_frame(file: BinaryIO, n_bytes: int, path: Path) -> None:
    """Look at the ends of the file: magic numbers, and a footer that fits between them."""
    start = file.read(len(MAGIC))
    if not n_bytes:
        raise RecordingFileError(path, "is empty (0 bytes)")
    if start != MAGIC:
        raise RecordingFileError(path, "is not a Parquet file: it does not begin with PAR1")
    file.seek(max(0, n_bytes - 8))
    end = file.read(8)
    if n_bytes < 12 or end[4:] != MAGIC:
        raise RecordingFileError(
            path, f"is cut off: its {n_bytes} bytes do not end with PAR1, as Parquet files do"
        )
    footer = int.from_bytes(end[:4], "little")
    if footer > min(n_bytes - 12, _MAX_FOOTER):
        most = min(n_bytes - 12, _MAX_FOOTER)
        raise RecordingFileError(path, f"says that its footer has {footer} bytes; wanted at most {most}")
    file.seek(0)


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

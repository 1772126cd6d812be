"""Parquet files, opened by pyarrow; what it raises becomes the one exception."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.errors import naming
from granular_id.io.extras import need
from granular_id.io.files import open_bounded

__all__ = ["coded_texts", "labels_of", "open_parquet", "parquet_library"]


def parquet_library(why: str) -> Any:
    """Return ``pyarrow.parquet``, or say how to install it."""
    return need("pyarrow.parquet", extra="app", why=why)


@contextmanager
def open_parquet(path: Path, root: Path, max_bytes: int, texts: Sequence[str] = ()) -> Iterator[Any]:
    """Open a file inside `root` as ``pyarrow.parquet.ParquetFile``, some columns to be read dictionary-encoded."""
    library = parquet_library("to read Parquet files")
    with open_bounded(path, root, max_bytes) as (file, _), naming(path, "reading it as Parquet"):
        try:
            place = os.fspath(path).encode().decode()
        except UnicodeEncodeError:  # pyarrow cannot spell it
            place = need("pyarrow", extra="app", why="to read Parquet files").BufferReader(file.read())
        with library.ParquetFile(place, read_dictionary=texts, page_checksum_verification=True) as opened:
            yield opened


def labels_of(opened: Any) -> dict[str, str]:
    """Return the key-value texts of a footer."""
    found = opened.metadata.metadata or {}
    return {key.decode("utf-8", "replace"): value.decode("utf-8", "replace") for key, value in found.items()}


def coded_texts(column: Any) -> tuple[NDArray[np.int64], list[str | None]]:
    """Return a dictionary-encoded column as codes and what they mean; the last one, None, is an empty cell."""
    whole = column.unify_dictionaries().combine_chunks()
    values: list[str | None] = whole.dictionary.to_pylist()
    codes = whole.indices.fill_null(len(values)).to_numpy(zero_copy_only=False)
    return codes.astype(np.int64), [*values, None]

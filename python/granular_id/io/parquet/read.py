"""Parquet: the native archive (a folder), or a single file of samples that somebody else wrote."""

from __future__ import annotations

from granular_id.io.files import refuse_outside
from granular_id.io.options import LoadOptions
from granular_id.io.parquet.archive import ParquetArchive
from granular_id.io.parquet.table import read_parquet_table
from granular_id.io.source import FileContent, FileSource

__all__ = ["read_parquet"]


def read_parquet(source: FileSource, options: LoadOptions) -> FileContent:
    """Read an archive that ``save_parquet`` wrote, or a file with columns fx fy fz tx ty tz.

    Raises
    ------
    RecordingFileError
        With file and row group: damaged, cut off, too large, or not what is wanted.
    ImportError
        pyarrow is missing.
    """
    refuse_outside(source.path, source.root)
    if source.path.is_dir():
        return ParquetArchive(source.path, max_file_bytes=options.max_binary_bytes).content(source)
    return read_parquet_table(source, options)

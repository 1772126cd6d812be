"""Archives: recordings in Parquet by the million, and features and answers from them, exactly once."""

from __future__ import annotations

from granular_id.archive.answers import Answers, identify
from granular_id.archive.check import CheckReport, check
from granular_id.archive.features import Features, extract
from granular_id.archive.partitions import Extraction, PartitionError
from granular_id.io.parquet.archive import Archive, RowGroup
from granular_id.io.parquet.writing import Appended, append

__all__ = [
    "Answers",
    "Appended",
    "Archive",
    "CheckReport",
    "Extraction",
    "Features",
    "PartitionError",
    "RowGroup",
    "append",
    "check",
    "extract",
    "identify",
]

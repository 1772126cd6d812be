"""Archives: recordings in Parquet by the million, and features and answers from them, exactly once."""

from __future__ import annotations

from granular_id.io.parquet.archive import Archive

__all__ = ["Archive"]

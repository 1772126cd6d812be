"""Readers and writers of recordings: one file per format; ``load`` and ``save`` pick it."""

from granular_id.io.csv import save_csv
from granular_id.io.errors import RecordingFileError
from granular_id.io.load import load, load_parts
from granular_id.io.saving import save

__all__ = ["RecordingFileError", "load", "load_parts", "save", "save_csv"]

"""Readers and writers of recordings: one file per format; ``load`` picks it."""

from granular_id.io.csv_save import save_csv
from granular_id.io.errors import RecordingFileError
from granular_id.io.loading import load

__all__ = ["RecordingFileError", "load", "save_csv"]

"""Readers and writers of recordings: one file per format; ``load`` and ``save`` pick it."""

from granular_id.io.files import RecordingFileError
from granular_id.io.formats import save
from granular_id.io.load import load, load_parts

__all__ = ["RecordingFileError", "load", "load_parts", "save"]

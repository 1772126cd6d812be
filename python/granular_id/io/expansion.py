"""What a file being read has expanded to so far, counted before memory is taken."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from granular_id.io.errors import RecordingFileError
from granular_id.io.files import check_expansion


@dataclass
class Expansion:
    """The bytes that one file has been given in memory."""

    path: Path
    n_bytes: int
    expanded: int = 0

    def spend(self, n_bytes: int, place: str) -> None:
        """Count bytes about to be allocated, or refuse them."""
        self.expanded += n_bytes
        check_expansion(self.path, self.n_bytes, self.expanded, place=place)

    def fault(self, place: str, problem: str) -> RecordingFileError:
        """Return the error to raise about one place of the file."""
        return RecordingFileError(self.path, problem, place=place)

"""How files are read: the settings of ``load``, checked once and handed to every format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from granular_id.recording._values import checked_rate

MAX_FILE_BYTES = 8 * 1024 * 1024
"""Default size cap of one text file: three minutes of 500 Hz samples, read or refused within a second."""

MIN_LINE_BYTES = 40
"""A line counts as at least this many bytes towards the cap: short lines take as long as others to parse."""


@dataclass(frozen=True)
class LoadOptions:
    """Settings of :func:`granular_id.io.load`, where they are described."""

    rate_hz: float | None = None
    on_error: Literal["raise", "skip"] = "raise"
    on_time_error: Literal["raise", "repair"] = "raise"
    max_file_bytes: int = MAX_FILE_BYTES
    progress: Callable[[int, int], object] | None = None

    def __post_init__(self) -> None:
        if self.rate_hz is not None:
            object.__setattr__(self, "rate_hz", checked_rate(self.rate_hz))
        for name, wanted in (("on_error", ("raise", "skip")), ("on_time_error", ("raise", "repair"))):
            if getattr(self, name) not in wanted:
                raise ValueError(f"{name}={getattr(self, name)!r}; wanted {wanted[0]!r} or {wanted[1]!r}")
        if isinstance(self.max_file_bytes, bool) or not isinstance(self.max_file_bytes, int):
            raise TypeError(f"max_file_bytes must be an int, got {type(self.max_file_bytes).__name__}")
        if self.max_file_bytes < 1:
            raise ValueError(f"max_file_bytes must be positive, got {self.max_file_bytes}")
        if self.progress is not None and not callable(self.progress):
            raise TypeError(f"progress must be callable or None, got {type(self.progress).__name__}")

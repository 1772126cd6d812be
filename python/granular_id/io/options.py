"""How files are read: the settings of ``load``, checked once and handed to every format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from granular_id._checks import argument_error, checked_text, finite_number, whole_number

MAX_TEXT_BYTES = 8 * 1024 * 1024
"""Default cap of one text file: three minutes of 500 Hz samples, read or refused within a second."""

MAX_BINARY_BYTES = 2 * 1024 * 1024 * 1024
"""Default cap of one binary file, which may hold a whole data set: 28,000 pushes of 1600 x 6."""

MIN_LINE_BYTES = 40
"""A line counts as at least this many bytes towards the cap: short lines take as long as others to parse."""


_CHOICES: dict[str, tuple[str | None, ...]] = {
    "on_error": ("raise", "skip"),
    "on_time_error": ("raise", "repair"),
    "time_unit": (None, "s", "ms", "us", "ns", "sample"),
}


@dataclass(frozen=True)
class LoadOptions:
    """Settings of :func:`granular_id.io.load`, where they are described."""

    rate_hz: float | None = None
    on_error: Literal["raise", "skip"] = "raise"
    on_time_error: Literal["raise", "repair"] = "raise"
    max_file_bytes: int | None = None
    topic: str | None = None
    time_unit: Literal["s", "ms", "us", "ns", "sample"] | None = None
    array: str | None = None
    label: str | None = None

    def __post_init__(self) -> None:
        if self.rate_hz is not None:
            object.__setattr__(self, "rate_hz", finite_number("rate_hz", self.rate_hz, positive=True))
        if self.max_file_bytes is not None:
            whole_number("max_file_bytes", self.max_file_bytes)
        for name, wanted in _CHOICES.items():
            if getattr(self, name) not in wanted:
                words = ", ".join(repr(word) for word in wanted if word is not None)
                raise argument_error(ValueError, name, f"={getattr(self, name)!r}; wanted one of {words}")
        for name in ("topic", "array", "label"):
            if getattr(self, name) is not None:
                checked_text(getattr(self, name), name)

    @property
    def max_text_bytes(self) -> int:
        """Cap of one text file, bytes."""
        return MAX_TEXT_BYTES if self.max_file_bytes is None else self.max_file_bytes

    @property
    def max_binary_bytes(self) -> int:
        """Cap of one binary file, bytes."""
        return MAX_BINARY_BYTES if self.max_file_bytes is None else self.max_file_bytes

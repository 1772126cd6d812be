"""How files are read: the settings of ``load``, checked once and handed to every format."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from granular_id._checks import argument_error, checked_text, finite_number, positive_number, whole_number
from granular_id.recording import AXES

MAX_TEXT_BYTES = 24 * 1024 * 1024
"""Default cap of one text file: more than an hour of six axes at 50 Hz, read or refused within seconds."""

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
    axes: tuple[str, ...] | None = None
    units: tuple[str, ...] | None = None
    window_s: float | None = None
    hop_s: float | None = None
    session: str | None = None

    def __post_init__(self) -> None:
        if self.rate_hz is not None:
            object.__setattr__(self, "rate_hz", finite_number("rate_hz", self.rate_hz, positive=True))
        if self.max_file_bytes is not None:
            whole_number("max_file_bytes", self.max_file_bytes)
        for name, wanted in _CHOICES.items():
            if getattr(self, name) not in wanted:
                words = ", ".join(repr(word) for word in wanted if word is not None)
                raise argument_error(ValueError, name, f"={getattr(self, name)!r}; wanted one of {words}")
        for name in ("topic", "array", "label", "session"):
            if getattr(self, name) is not None:
                checked_text(getattr(self, name), name)
        for name in ("axes", "units"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _names(name, getattr(self, name), empty=name == "units"))
        if self.axes is not None and self.units is not None:
            self.units_of(self.axes)
        for name in ("window_s", "hop_s"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, positive_number(name, getattr(self, name), "seconds"))
        if self.hop_s is not None and self.window_s is None:
            raise argument_error(
                ValueError, "hop_s", "is the way from one window to the next: give window_s too"
            )

    def units_of(self, axes: Sequence[str]) -> dict[str, str]:
        """Return the unit that is stated of each axis; empty where none is."""
        units = self.units or ()
        if not units:
            return {}
        run, rest = divmod(len(axes), len(units))
        if rest or not run:
            problem = f"has {len(units)} for {len(axes)} axes ({', '.join(axes)})"
            wanted = "wanted one for all, one per axis, or one for each of several runs of equal length"
            raise argument_error(ValueError, "units", f"{problem}; {wanted}")
        return {axis: unit for i, axis in enumerate(axes) if (unit := units[i // run])}

    @property
    def other_sensor(self) -> bool:
        """Whether the axes are named, and are not those of a wrench or some of them."""
        return self.axes is not None and not set(self.axes) <= set(AXES)

    @property
    def max_text_bytes(self) -> int:
        """Cap of one text file, bytes."""
        return MAX_TEXT_BYTES if self.max_file_bytes is None else self.max_file_bytes

    @property
    def max_binary_bytes(self) -> int:
        """Cap of one binary file, bytes."""
        return MAX_BINARY_BYTES if self.max_file_bytes is None else self.max_file_bytes


def _names(argument: str, value: object, *, empty: bool) -> tuple[str, ...]:
    """Return names that come as a sequence, or as one text with commas between them."""
    if isinstance(value, str):
        value = [name.strip() for name in value.split(",")]
    if not isinstance(value, Iterable):
        raise argument_error(TypeError, argument, f"must be texts, got {type(value).__name__}")
    names = tuple(
        checked_text(name, f"{argument}[{i}]", empty=empty, spaced=False) for i, name in enumerate(value)
    )
    if not names:
        raise argument_error(ValueError, argument, "is empty; leave it out, or give names like 'wx,wy,wz'")
    if not empty and len(set(names)) < len(names):
        raise argument_error(ValueError, argument, f"={','.join(names)!r} names one twice")
    return names

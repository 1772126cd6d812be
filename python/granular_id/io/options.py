"""How files are read: the settings of ``load``, checked once and handed to every format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal

from granular_id._checks import argument_error, checked_text, finite_number
from granular_id.recording import AXES, Stated, checked_time_unit, names_in, units_by_axis

_CHOICES = {"on_error": ("raise", "skip"), "on_time_error": ("raise", "repair")}
PLACES = "'folder', 'parent', 'file', 'column:NAME' or 'meta:PATH'"


@dataclass(frozen=True)
class LoadOptions:
    """Settings of :func:`granular_id.load`, where they are described."""

    rate_hz: float | None = None
    on_error: Literal["raise", "skip"] = "raise"
    on_time_error: Literal["raise", "repair"] = "raise"
    topic: str | None = None
    array: str | None = None
    time: str | None = None
    time_unit: str | None = None
    axes: tuple[str, ...] | None = None
    units: tuple[str, ...] | None = None
    id: str | None = None
    label: str | None = None
    session: str | None = None
    csv: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        if self.rate_hz is not None:
            object.__setattr__(self, "rate_hz", finite_number("rate_hz", self.rate_hz, positive=True))
        for name, wanted in _CHOICES.items():
            if getattr(self, name) not in wanted:
                words = " or ".join(map(repr, wanted))
                raise argument_error(ValueError, name, f"={getattr(self, name)!r}; wanted {words}")
        checked_time_unit(self.time_unit)
        for name in ("topic", "array", "time", "id", "label", "session"):
            if getattr(self, name) is not None:
                checked_text(getattr(self, name), name)
        for name in ("label", "session"):
            place = getattr(self, name)
            if place is not None and place not in ("folder", "parent", "file"):
                kind, _, rest = place.partition(":")
                if kind not in ("column", "meta") or not rest:
                    raise argument_error(ValueError, name, f"={place!r:.60}; wanted {PLACES}")
        for name in ("axes", "units"):
            object.__setattr__(self, name, names_in(name, getattr(self, name), empty=name == "units"))
        if self.axes is not None and self.units is not None:
            units_by_axis(self.axes, self.units)
        if self.csv is not None and (
            not isinstance(self.csv, Mapping) or not all(isinstance(k, str) for k in self.csv)
        ):
            raise argument_error(
                TypeError, "csv", "must be a mapping of options of pandas.read_csv to their values"
            )

    def stated(self) -> Stated:
        """Return what holds for every file."""
        return Stated(
            rate_hz=self.rate_hz,
            time_unit=self.time_unit,
            axes=self.axes,
            units=self.units,
            time=self.time,
            id=self.id,
            label_from=_looked_up(self.label),
            session_from=_looked_up(self.session),
            repair=self.on_time_error == "repair",
        )

    @property
    def read_as(self) -> str | None:
        """What somebody chose to read of files: part of the set-up that models compare."""
        chosen = {"array": self.array, "topic": self.topic, "time": self.time}
        if self.axes is not None and self.axes != AXES:
            chosen["axes"] = ",".join(self.axes)
        said = [f"{name}={value}" for name, value in chosen.items() if value is not None]
        said += [f"csv {key}={value!r}" for key, value in sorted((self.csv or {}).items())]
        return ", ".join(said) or None

    def to_dict(self) -> dict[str, Any]:
        """Return the settings that were given, for a report."""
        given = {field.name: getattr(self, field.name) for field in fields(self)}
        if self.csv is not None:
            given["csv"] = {key: repr(value) for key, value in self.csv.items()}
        return {name: value for name, value in given.items() if value is not None}


def _looked_up(place: str | None) -> str | None:
    return place if place is not None and ":" in place else None

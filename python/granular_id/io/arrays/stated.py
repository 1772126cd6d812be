"""What a file states beside its samples is obeyed or refused: names and order of axes, units, dimensions."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from granular_id._checks import FloatArray
from granular_id.io.arrays.names import FORCES, TORQUES, is_general, is_other_thing, plain_name, role_of
from granular_id.io.arrays.tree import Origin, is_leaf, n_values, texts
from granular_id.io.columns import TAKEN, TIME, axes_among, factor, split_unit
from granular_id.io.errors import RecordingFileError
from granular_id.io.options import LoadOptions
from granular_id.recording import AXES, same_unit, unit_of

Units = Mapping[str, tuple[str, tuple[str, ...]]]
"""From what has a unit (see `what_has_unit`) to the entry that says so and the units, as they stand."""

ALL, FORCE, TORQUE = "", "force", "torque"

_LONGEST = 200
"""Characters of a name that are looked at."""

_LONGEST_LIST = 10_000
"""Characters of a text that may list names or units."""

_UNIT_KEY = re.compile(r"(.*?)[\s_.-]*units?", re.IGNORECASE)
_BETWEEN = re.compile(r"\s*[,;|]\s*")
_WANTED = f"wanted {TAKEN['N']} for forces, {TAKEN['N m']} for torques"

_DIMENSIONS = {
    0: "n recording recordings trial trials push pushes demo demos episode episodes run runs batch",
    1: "t time times sample samples step steps timestep timesteps row rows frame frames",
    2: "c axis axes channel channels component components feature features column columns sensor wrench",
}
_PLACES = {word: place for place, words in _DIMENSIONS.items() for word in words.split()}


def names_of(node: Any) -> tuple[str, ...]:
    """Return a list of names, also from one text that lists them; empty where a node is none."""
    named = texts(node) or []
    if len(named) != 1 or len(named[0]) > _LONGEST_LIST:
        return tuple(named)
    (text,) = named
    if text.startswith("["):
        try:
            listed = json.loads(text)
        except (ValueError, RecursionError):
            return (text,)
        return tuple(listed) if listed and all(isinstance(item, str) for item in listed) else (text,)
    parts = tuple(_BETWEEN.split(text))
    return parts if len(parts) > 1 else tuple(text.split())


def orders_axes(node: Any) -> bool:
    """Tell whether a node lists the six axes, each once, in any order: whatever it is called, it names columns."""
    if n_values(node) not in (1, len(AXES)):
        return False
    return sorted(split_unit(name)[0] or "" for name in names_of(node)) == sorted(AXES)


def what_has_unit(key: str, siblings: Mapping[str, Any]) -> str | None:
    """Tell whose unit an entry states by its name: ``units`` all, ``force_unit`` forces, ``t_units`` the stamps.

    ``/X`` for an array X beside it; None where the entry is about something else.
    """
    found = _UNIT_KEY.fullmatch(key[-_LONGEST:])
    return None if found is None else _whose(found[1], siblings)


def _whose(base: str, siblings: Mapping[str, Any]) -> str | None:
    axis, role = split_unit(base)[0], role_of(base)
    if axis in AXES or axis == TIME:
        return axis
    if role in ("rate", "step"):
        return role
    if base in siblings:
        node = siblings[base]
        holds = isinstance(node, (Mapping, list)) or (is_leaf(node) and len(node.shape) > 1)
        return f"/{base}" if holds else None
    for what, words in ((FORCE, FORCES), (TORQUE, TORQUES)):
        if plain_name(base) in words:
            return what
    return ALL if not base or is_general(base) else None


def units_of(
    node: Any, what: str, key: str, siblings: Mapping[str, Any], origin: Origin
) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Read one entry that states units: a text, a list, or a struct with a unit for each thing.

    Of one array, ``/X``, a struct may state what ``/X:force`` and ``/X:torque`` have.
    """
    if isinstance(node, Mapping):
        found: dict[str, tuple[str, tuple[str, ...]]] = {}
        around = siblings if what == ALL else {}
        for name, inner in node.items():
            whose = what_has_unit(name, around)
            whose = _whose(name, around) if whose is None else whose
            if whose is not None:
                of_part = f"{what}:{whose}" if whose and what.startswith("/") else what
                found |= units_of(inner, of_part if what else whose, f"{key}/{name}", siblings, origin)
        return found
    said = texts(node)
    if said is None:
        raise origin.fault(key, "does not hold units; wanted texts such as 'N' and 'N m'")
    if len(said) == 1 and len(said[0]) <= _LONGEST_LIST:
        said = [part for part in re.split(r"\s*(?:[,;|/]|\band\b)\s*", said[0].strip("[] ")) if part]
    return {what: (key, tuple(said))} if any(said) else {}


def single_unit(entry: tuple[str, tuple[str, ...]] | None) -> str | None:
    """Return the unit of an entry that states one, or the same several times."""
    return None if entry is None else entry[1][0] if len(set(entry[1])) == 1 else ", ".join(entry[1])


def unit_in_name(name: str) -> tuple[str, ...]:
    """Return the unit that the name of an array of samples ends with, as ``wrench_mN`` does."""
    unit = split_unit(name)[1] or ""
    of_time = factor(unit, "s") or factor(unit, "Hz")
    return (unit,) if len(plain_name(unit)) > 1 and of_time is None else ()


def time_unit_in_name(name: str) -> str | None:
    """Return the unit that the name of stamps states, but for seconds: ``time_s`` is what people call any clock."""
    unit = split_unit(name.rpartition("/")[2])[1]
    return None if factor(unit or "s", "s") == 1 else unit


def dimensions_of(key: str, node: Any, origin: Origin) -> tuple[int, ...]:
    """Return which dimension counts recordings (0), samples (1) and axes (2); empty where nothing is named."""
    named = [plain_name(name) for name in names_of(node)]
    if not any(named):
        return ()
    if {"t", "time", "step", "timestep"} & set(named):  # samples are then what others call recordings
        named = ["recording" if name in ("sample", "samples") else name for name in named]
    places = [_PLACES.get(name, -1) for name in named]
    if named.count("") == 1:  # what the others leave
        left = {1, 2} if len(named) == 2 else {0, 1, 2}
        places[named.index("")] = next(iter(left - set(places)))
    if sorted(places) not in ([0, 1, 2], [1, 2]):
        problem = f"names the dimensions {', '.join(named)[:80]}"
        raise origin.fault(key, f"{problem}; wanted recording, time and axis in their order")
    return tuple(places)


@dataclass(frozen=True)
class Columns:
    """What the columns of an array of samples hold, by their names and units.

    `axes` are those that are asked for, else fx ... tz where all of them are named, else the names as they stand;
    `order` their columns and `scales`
    what each must be multiplied with (None: as they stand); `time` is the column of stamps; `meta_units` are the units
    of axes that are no part of a wrench.
    """

    axes: tuple[str, ...]
    order: list[int] | None
    scales: tuple[float, ...] | None
    time: int | None
    time_unit: str | None
    meta_units: dict[str, str]

    @classmethod
    def named(
        cls, names: tuple[str, ...], units: Units, place: str, origin: Origin, options: LoadOptions
    ) -> Columns:
        """Tell what the columns of the array at `place` are; refuse two of one meaning, and units that do not fit."""
        meant = [split_unit(name) for name in names]
        found, in_names = [axis for axis, _ in meant], [unit for _, unit in meant]
        axes, order, time, time_unit = names, None, None, None
        picked = None
        if options.axes is not None:
            with _refusing(origin, place):
                picked = dict(axes_among(names, options.axes))
        if picked is not None:
            found = ["" if i in picked or axis != TIME else TIME for i, axis in enumerate(found)]
        twice = next((axis for axis in (*AXES, TIME) if found.count(axis) > 1), None)
        if twice is not None:
            raise origin.unclear(f"two columns of {place} mean {twice}: {', '.join(names)[:80]}")
        if picked is not None and options.axes is not None:
            axes, order = options.axes, list(picked)
            in_names = [picked.get(column) for column in range(len(names))]
        elif set(AXES) <= set(found):
            axes, order = AXES, [found.index(axis) for axis in AXES]
        elif all(is_other_thing(name) for name in names):
            raise origin.unclear(f"the columns of {place} are no wrench: {', '.join(names)[:80]}")
        if order is not None and TIME in found:
            time = found.index(TIME)
        columns = list(range(len(names))) if order is None else order
        entry, of_all = _unit_of_each(names, columns, axes, units, origin)
        if time is not None:
            listed = units.get(ALL, ("", ()))[1]
            of_column = listed[time] if len(listed) == len(names) else None
            time_unit = single_unit(units.get(TIME)) or of_column or time_unit_in_name(names[time])
        scales: list[float] = []
        meta_units: dict[str, str] = {}
        with _refusing(origin, place):
            asked = options.units_of(axes)
        for axis, column, of_axis in zip(axes, columns, of_all, strict=True):
            said = [(place, in_names[column]), (entry, of_axis)]
            of_half = (FORCE if axis[0] == "f" else TORQUE,) if axis in AXES else ()
            said += [(units[w][0], single_unit(units[w])) for w in (axis, *of_half) if w in units]
            known = [(key, unit) for key, unit in said if unit]
            if axis in asked:
                known = _agreed(axis, known, asked[axis], origin)
            scales.append(_scale(axis, known, origin) if axis in AXES else 1.0)
            if axis not in AXES and known:
                meta_units[axis] = asked.get(axis, known[0][1])
        return cls(
            axes=axes,
            order=None if columns == list(range(len(names))) else columns,
            scales=tuple(scales) if any(scale != 1 for scale in scales) else None,
            time=time,
            time_unit=time_unit,
            meta_units=meta_units,
        )

    def said(self, names: Sequence[str]) -> str:
        """Say what was taken from where, and scaled by what."""
        columns = range(len(names)) if self.order is None else self.order
        scales = self.scales or (1.0,) * len(self.axes)
        return ", ".join(
            f"{axis} from column {column} ({names[column]})" + (f" times {scale:g}" if scale != 1 else "")
            for axis, column, scale in zip(self.axes, columns, scales, strict=True)
        )

    def wrench(self, array: FloatArray) -> FloatArray:
        """Return the axes of an array (..., columns), in newton and newton metre."""
        taken = array if self.order is None else array[..., self.order]
        return taken if self.scales is None else taken * self.scales


def _unit_of_each(
    names: Sequence[str], columns: Sequence[int], axes: Sequence[str], units: Units, origin: Origin
) -> tuple[str, Sequence[str]]:
    """Return what is stated of the whole array, by which entry: a unit for each axis, empty where there is none."""
    key, listed = units.get(ALL, ("", ()))
    whole = tuple(axes) == AXES
    if len(listed) == 1 and whole:
        if plain_name(listed[0]) != "si" and factor(listed[0], "N") != 1:
            problem = f"states one unit, {listed[0]!r:.40}, for forces and torques"
            raise origin.fault(key, f"{problem}; wanted one for each, such as 'mN, N mm', or one per axis")
        return key, [""] * len(axes)  # everybody's short form of N and N m
    if len(listed) == 2 and whole:
        return key, [listed[axis[0] == "t"] for axis in axes]
    if len(listed) == len(names):
        return key, [listed[column] for column in columns]
    if len(listed) > 1:
        raise origin.fault(key, f"states {len(listed)} units for {len(names)} axes; wanted one per axis")
    return key, (listed or ("",)) * len(axes)


@contextmanager
def _refusing(origin: Origin, place: str) -> Iterator[None]:
    """Name the file in which axes or units that the options name are not to be had."""
    try:
        yield
    except ValueError as error:
        raise RecordingFileError(origin.path, str(error), place=place) from error


def _agreed(axis: str, known: list[tuple[str, str]], asked: str, origin: Origin) -> list[tuple[str, str]]:
    """Add the unit that the options state to what the file states: it may be no other.

    Of forces and torques N and N m may be asked for, whatever the file states: that is what they are converted to.
    """
    if axis in AXES:
        scale = factor(asked, unit_of(axis))
        if scale is None:
            raise RecordingFileError(origin.path, f"units= states {asked!r:.40} of {axis}; {_WANTED}")
        if known and scale == 1:
            return known
    other = next((said for said in known if axis not in AXES and not same_unit(said[1], asked)), None)
    if other is not None:
        problem = f"the unit of {axis} is {other[1]!r:.40} in the file, and units= states {asked!r:.40}"
        raise RecordingFileError(origin.path, f"{problem}; leave it out, or convert the values first")
    return [*known, ("units=", asked)]


def _scale(axis: str, said: Sequence[tuple[str, str]], origin: Origin) -> float:
    scales = {}
    for key, unit in said:
        scale = factor(unit, unit_of(axis))
        if scale is None:
            raise origin.fault(key, f"the unit of {axis} is {unit!r:.40}; {_WANTED}")
        scales[scale] = f"{unit} ({key})"
    if len(scales) > 1:
        raise origin.unclear(f"two units of {axis}: {' and '.join(scales.values())}")
    return next(iter(scales), 1.0)

"""What a file or data frame gives: a `Table`, what is `Stated` of it, and the columns, axes and units that are read."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, locked
from granular_id._core import AXES
from granular_id._text import UNITS, in_both
from granular_id.recording.columns import (
    LABEL,
    NANOSECONDS,
    RECORDING,
    SCALED_UNITS,
    SESSION,
    TAKEN,
    TIME,
    UNIT_NAMES,
    TableError,
    cell_text,
    columns_of,
    factor,
    is_known_unit,
    meaning_of,
    numbers_of,
    same_unit,
    unit_spelling,
    units_by_axis,
)
from granular_id.recording.recording import (
    checked_axes,
    unit_of,
)


@dataclass(frozen=True)
class Table:
    """Samples and what is stated beside them: columns by their names, or an array of one recording."""

    name: str = ""  # of the recording in reports; of several, each has its own part behind it
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    values: NDArray[Any] | None = None  # (T, C), in place of `columns`
    axes: tuple[str, ...] | None = None  # names of the columns of `values`
    units: Mapping[str, str] = field(default_factory=dict)  # stated beside the names, by column or axis
    beside: Mapping[str, Any] = field(
        default_factory=dict
    )  # metadata that are not read, but must not state units
    stamps: NDArray[Any] | None = None  # the clock of `values`: seconds, or numpy's dates
    rate_hz: float | None = None
    rate_hint: tuple[str, float] | None = None  # what is called like a rate, and is not read, with its value
    label: str | None = None
    session: str | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    clock: str = "time"  # how errors call the clock
    csv: Mapping[str, Any] | None = (
        None  # the options of pandas.read_csv that made it; others may read it otherwise
    )


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What a caller, an option or an index says of recordings; it is obeyed, or refused where the table contradicts."""

    rate_hz: float | None = None
    time_unit: str | None = None
    axes: tuple[str, ...] | None = None
    units: tuple[str, ...] | None = None
    columns: tuple[tuple[str, str], ...] = ()  # what a column is, as TIME, and its name
    label: str | None = None  # wins over what the table says
    session: str | None = None
    label_from: str | None = None  # a place in the metadata that holds it, "meta:PATH"
    session_from: str | None = None
    label_else: str | None = None  # where nothing else says it
    session_else: str | None = None
    start_time: float | None = None
    trigger_index: int | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    irregular: bool = False  # keep stamps even where they are even
    repair: bool = False  # sort samples whose stamps run back


@dataclass
class Picked:
    """The columns that were chosen; `called` says what each is called in the table."""

    wrench: FloatArray  # N and N m where the axes are those of a wrench
    axes: tuple[str, ...]
    called: Mapping[str, str]
    units: dict[str, str]  # of axes that are not of a wrench
    notes: list[str]
    columns: dict[str, NDArray[Any]]  # clock, id, label, session, rate, flags
    time_unit: str | None  # what the clock counts, where the table says so


def picked_columns(table: Table, stated: Stated) -> Picked:
    """Choose the columns that are read, and settle axes and units."""
    own = tuple(what for what in (LABEL, SESSION) if getattr(table, what) is not None)
    named = tuple((what, name) for what, name in stated.columns if what not in own)
    cells, named_axes = dict(table.columns), stated.axes
    if table.values is not None:
        cells, named_axes = _named_cells(table.values, table.axes, stated.axes)
    n_samples = len(next(iter(cells.values()), ()))
    if table.stamps is not None:
        cells[table.clock], named = np.asarray(table.stamps), ((TIME, table.clock), *named)
        if table.stamps.shape != (n_samples,):
            raise TableError(f"{table.clock} has the shape {table.stamps.shape} for {n_samples} samples")
    called = dict(columns_of(tuple(cells), named_axes, named, own))
    axes = named_axes or AXES
    if RECORDING in called and RECORDING not in dict(named) and _numbers_rows(cells[called[RECORDING]]):
        del called[RECORDING]
    has_units = any(name in table.units for axis in axes for name in (axis, called[axis]))
    if not has_units and not all(meaning_of(called[axis]).unit for axis in axes):
        one_each = [name for name in cells if UNIT_NAMES.search(name) and len(set(cells[name].tolist())) == 1]
        of_columns = {name: cell_text(cells[name][0]) for name in one_each}
        beside = {**table.meta, **stated.meta, **table.beside, **of_columns}
        refuse_units_unread(beside, units_by_axis(axes, stated.units))
    scales, units, notes = _units_of(axes, called, table, stated)
    columns = {what: cells[name] for what, name in called.items() if what not in axes}
    time_unit = None if TIME not in called else table.units.get(called[TIME]) or meaning_of(called[TIME]).unit
    if NANOSECONDS in columns:
        seconds, nanoseconds = columns[TIME], columns.pop(NANOSECONDS)
        if not (np.isfinite(seconds).all() and np.isfinite(nanoseconds).all()):
            raise TableError("a stamp is empty", column=called[TIME])
        columns[TIME] = seconds.astype(np.int64) * 1_000_000_000 + nanoseconds.astype(np.int64)
        time_unit = "ns"
    names = [called[axis] for axis in axes]
    if table.values is not None and names == list(cells)[: table.values.shape[1]]:
        # not copied where nobody can change them
        wrench = locked(np.asarray(table.values, np.float64, order="C"))
    else:
        try:
            wrench = numbers_of(cells, names, clock=called.get(TIME), csv=table.csv)
        except TableError as error:
            if ".explode(" in error.mend and not any(meaning_of(name).what == RECORDING for name in cells):
                error.mend = f".assign(recording=lambda f: range(len(f))){error.mend}"
            raise
    notes += _notes_on(cells, called, table)
    wrench = wrench if scales is None else wrench * scales
    return Picked(wrench, axes, called, units, notes, columns, time_unit)


def refuse_units_unread(
    beside: Mapping[str, Any], wanted: Mapping[str, str], *, is_stated: bool = False
) -> None:
    """Refuse units of forces or torques where none are read: others than those `wanted` of axes, or than N and N m."""
    found: dict[str, list[str]] = {}
    for name, text in [one for item in beside.items() for one in _entries(*item)]:
        if not UNIT_NAMES.search(name) or not isinstance(text, str):
            continue
        units = [part.strip() for part in re.split("[,;/|]", text)]
        if all(factor(one, "N") or factor(one, "N m") for one in units):
            found[name] = units
        elif SCALED_UNITS.search(text):
            found[name] = [text.strip()]
    of_axes = {
        name: units for name, units in found.items() if _OF_AXES.fullmatch(name.rpartition(".")[2].strip())
    }
    every_pair = [(name, axis, unit) for name in of_axes for axis in wanted for unit in found[name]]
    for name, axis, unit in every_pair:
        scales = [factor(one, unit_of(axis)) for one in (unit, wanted[axis])] if axis in AXES else [None]
        if None not in scales and scales[0] != scales[1]:
            raise TableError(f"{name!r:.60} states {unit!r:.40}, and units= {wanted[axis]!r:.40} of {axis}")
    scaled = [
        name
        for name, units in found.items()
        if not any(1.0 in (factor(one, "N"), factor(one, "N m")) for one in units)
        or len({factor(one, "N") or factor(one, "N m") for one in units}) > 1
    ]
    if not scaled or wanted or is_stated:
        return
    kinds = [_KIND_OF_UNITS.match(name.rpartition(".")[2]) for name in found]
    of_kind = {kind[0][0].lower(): found[name] for name, kind in zip(found, kinds, strict=True) if kind}
    pair = [of_kind.get("f", ["N"])[0], of_kind.get("t", of_kind.get("m", ["N m"]))[0]] if of_kind else []
    every = next((units for units in found.values() if len(units) > 1), pair)
    problem = f"{scaled[0]!r:.60} states units ({','.join(found[scaled[0]])!r:.40}), which are not read there; pass "
    way_out = in_both(units=",".join(every) or UNITS)
    raise TableError((problem, way_out, *[", those of the axes"] * (not every)))


def _entries(name: str, value: Any) -> list[tuple[str, Any]]:
    """Return a text beside samples, or what is in it where it is an object of JSON."""
    with suppress(TypeError, ValueError):
        inner = json.loads(value)
        if isinstance(inner, dict):
            return [one for key, each in inner.items() for one in _inner_entries(f"{name}.{key}", each)]
    return [(name, value)]


def _inner_entries(name: str, value: Any) -> list[tuple[str, str]]:
    if isinstance(value, dict):
        return [one for key, each in value.items() for one in _inner_entries(f"{name}.{key}", each)]
    return [(name, ",".join(map(str, value)) if isinstance(value, list) else str(value))]


_OF_AXES = re.compile(r"((forces?|f|torques?|t|moments?|m|axes|axis|channels?)[\W_]*)?units?", re.IGNORECASE)
_KIND_OF_UNITS = re.compile(r"(forces?|f|torques?|t|moments?)[\W_]*units?\b", re.IGNORECASE)


def _notes_on(cells: Mapping[str, NDArray[Any]], called: Mapping[str, str], table: Table) -> list[str]:
    """Name the columns that are not read, and those whose name is not what they are taken for."""
    unread = [repr(name) for name in cells if name not in called.values()]
    usual = {(TIME, "timestamp"), (TIME, table.clock)}
    others = {}
    for what, name in called.items():
        base = meaning_of(name).base.strip().lower()
        if what != NANOSECONDS and base != what.lower() and (what, base) not in usual:
            others[name] = what
    notes = [f"columns that are not read: {', '.join(unread)[:200]}"] if unread else []
    taken = f"columns {', '.join(map(repr, others))} taken as {', '.join(others.values())}"[:300]
    return [*notes, taken] if others else notes


def _numbers_rows(values: NDArray[Any]) -> bool:
    """Return True if no value of a column occurs again: it numbers samples, not recordings."""
    return len(values) > 1 and len(set(map(str, values.tolist()))) == len(values)


def _named_cells(
    values: NDArray[Any], names: tuple[str, ...] | None, wanted: tuple[str, ...] | None
) -> tuple[dict[str, NDArray[Any]], tuple[str, ...]]:
    """Return the columns of an array by their names, and its axes; beside the six there may be others, as a clock."""
    if values.ndim != 2 or not values.size or values.dtype.kind not in "iuf":
        came = f"{values.dtype} of shape {values.shape}"
        raise TableError(f"samples are {came}; wanted numbers of shape (samples, axes)")
    n, known = values.shape[1], names or wanted or AXES
    if names is None and len(known) != n:
        came = "" if wanted is None else f", and axes names {len(wanted)}"
        problem = f"samples have {n} columns without names{came}"
        raise TableError(f"{problem}; pass axes= with a name for each", no_wrench=True)
    try:
        known = known if known == AXES and n == len(AXES) else checked_axes(known, values.shape)
        cells = dict(zip(known, values.T, strict=True))
    except (TypeError, ValueError) as error:
        raise TableError(str(error)) from error
    has_six = {meaning_of(name).what for name in known} >= set(AXES)
    if has_six and (wanted is None or (names is None and n > len(AXES))):
        return cells, AXES
    return cells, wanted or known


def _units_of(
    axes: Sequence[str], called: Mapping[str, str], table: Table, stated: Stated
) -> tuple[tuple[float, ...] | None, dict[str, str], list[str]]:
    """Return what makes N and N m of each axis (None: they are), units of other axes, and what was converted."""
    wanted = units_by_axis(axes, stated.units) if stated.units else {}
    own: dict[str, str | None] = {}
    scales: list[float] = []
    for axis in axes:
        name = called[axis]
        in_name = meaning_of(name).unit if axis != name.strip() or axis in AXES else None
        places = (in_name, table.units.get(name), table.units.get(axis))
        known = [unit for unit in places if unit and unit != "-"]
        other = next((unit for unit in known[1:] if not same_unit(known[0], unit)), None)
        if other is not None:
            problem = f"its unit is {known[0]!r:.40}, and {other!r:.40} is stated beside it"
            raise TableError(problem, column=name)
        if known and axis in wanted and not same_unit(known[0], wanted[axis]):
            problem = f"its unit is {known[0]!r:.40}, and units= states {wanted[axis]!r:.40}; leave it out"
            raise TableError(problem, column=name)
        if axis in wanted and axis not in AXES and not is_known_unit(wanted[axis]):
            problem = (
                f"units= states {wanted[axis]!r:.40}, which is no unit that is known; wanted {TAKEN['N']}; "
            )
            raise TableError(
                f"{problem}{TAKEN['N m']}; m/s2, rad/s, deg/s, V ... as of other sensors", column=name
            )
        own[axis] = unit = known[0] if known else wanted.get(axis)
        scale = 1.0 if unit is None or axis not in AXES else factor(unit, unit_of(axis))
        if scale is None:
            problem = f"its unit is {unit!r:.40}; wanted {TAKEN[unit_of(axis)]}; convert other values first"
            raise TableError(problem, column=name)
        scales.append(scale)
    converted = {axis: own[axis] for axis, scale in zip(axes, scales, strict=True) if scale != 1}
    for alike in (AXES[:3], AXES[3:]):
        silent = [axis for axis in alike if axis in axes and own[axis] is None]
        other = next((axis for axis in alike if axis in converted), None)
        if silent and other is not None:
            problem = f"column {called[other]!r} states a unit and column {called[silent[0]]!r} none"
            raise TableError(f"{problem}; wanted that of each", column=called[silent[0]])
    as_is = {
        unit
        for axis, unit in own.items()
        if axis not in AXES and unit is not None and {factor(unit, "N"), factor(unit, "N m")} - {None, 1.0}
    }
    units = {axis: unit_spelling(unit) for axis, unit in own.items() if axis not in AXES and unit is not None}
    bare = [axis for axis, unit in own.items() if axis not in AXES and unit is None]
    notes = [f"no unit is known of {', '.join(bare)[:200]}: units= states it (--units)"] if bare else []
    if as_is:
        notes.append(f"{', '.join(sorted(as_is))} stay as they are: only axes called fx to tz are converted")
    if not converted:
        return None, units, notes
    units_converted = ", ".join(
        dict.fromkeys(f"{unit} to {unit_of(axis)}" for axis, unit in converted.items())
    )
    return tuple(scales), units, [*notes, f"converted from {units_converted}"]

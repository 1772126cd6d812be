"""``Table``: samples as a file or a caller has them, what is stated of them, and which columns are the axes.

Every format and every data frame comes through here, and then through ``to_recordings``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, argument_error
from granular_id._core import AXES, GranularIdError
from granular_id._text import in_both
from granular_id.recording.columns import (
    LABEL,
    RATE,
    RECORDING,
    SESSION,
    TAKEN,
    TIME,
    TableError,
    columns_of,
    factor,
    meaning_of,
    name_and_unit,
    nanoseconds_beside,
    same_unit,
    unit_spelling,
)
from granular_id.recording.recording import unit_of

_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")
_THOUSANDS = re.compile(r"\s*[+-]?\d{1,3}(,\d{3})+\.\d*\s*")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+\s*")


@dataclass(frozen=True)
class Table:
    """Samples and what is stated beside them.

    Attributes
    ----------
    name : str
        How reports call the recording; of several, each has its own part behind it.
    columns : mapping of str to ndarray of shape (T,)
        Columns by their names, in the order of the table: axes, clock and others.
    values : ndarray of shape (T, C), optional
        The samples in place of `columns`, one recording.
    axes : tuple of str, optional
        Names of the columns of `values`.
    units : mapping of str to str
        Units that are stated beside the names, by column or axis.
    stamps : ndarray of shape (T,), optional
        The clock of `values`: seconds, or numpy's dates.
    rate_hz, label, session, meta
        What the file states of the recording, as in `Recording`.
    clock : str
        How errors call the clock.
    is_text : bool
        Whether ``pandas.read_csv`` made it, so that options of that may read it otherwise.
    """

    name: str = ""
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    values: NDArray[Any] | None = None
    axes: tuple[str, ...] | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    stamps: NDArray[Any] | None = None
    rate_hz: float | None = None
    label: str | None = None
    session: str | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    clock: str = "time"
    is_text: bool = False


@dataclass(frozen=True)
class Stated:
    """What a caller, an option or an index says of recordings; it is obeyed, or refused where the table contradicts.

    Attributes
    ----------
    rate_hz, time_unit, axes, units
        As in `granular_id.load`.
    time, id : str, optional
        Columns of the clock, and of what tells recordings apart.
    label, session : str, optional
        Of all recordings; they win over what the table says.
    label_from, session_from : str, optional
        Where else to look: ``"column:NAME"``, or ``"meta:PATH"``, a place in the metadata.
    label_else, session_else : str, optional
        What holds where nothing else says it.
    start_time, trigger_index, meta
        Of the one recording.
    irregular : bool
        Keep stamps even where they are even.
    repair : bool
        Sort samples whose stamps run back.
    """

    rate_hz: float | None = None
    time_unit: str | None = None
    axes: tuple[str, ...] | None = None
    units: tuple[str, ...] | None = None
    time: str | None = None
    id: str | None = None
    label: str | None = None
    session: str | None = None
    label_from: str | None = None
    session_from: str | None = None
    label_else: str | None = None
    session_else: str | None = None
    start_time: float | None = None
    trigger_index: int | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    irregular: bool = False
    repair: bool = False

    @property
    def columns(self) -> dict[str, str | None]:
        """Columns that somebody names: of the clock, what tells recordings apart, label and session."""
        places = {LABEL: self.label_from, SESSION: self.session_from}
        named = {
            what: place.removeprefix("column:") if place is not None and place.startswith("column:") else None
            for what, place in places.items()
        }
        return {TIME: self.time, RECORDING: self.id, **named}


def units_by_axis(axes: Sequence[str], units: Sequence[str] | None) -> dict[str, str]:
    """Return the unit that is stated of each axis: of one for all, one an axis, or one for each of several equal runs.

    Examples
    --------
    >>> from granular_id.recording.table import units_by_axis
    >>> units_by_axis(("wx", "wy", "ax", "ay"), ("rad/s", "m/s2"))
    {'wx': 'rad/s', 'wy': 'rad/s', 'ax': 'm/s2', 'ay': 'm/s2'}
    """
    if not units:
        return {}
    run, rest = divmod(len(axes), len(units))
    if rest or not run:
        problem = f"has {len(units)} for {len(axes)} axes ({', '.join(axes)})"
        wanted = "wanted one for all, one per axis, or one for each of several runs of equal length"
        raise argument_error(GranularIdError, "units", f"{problem}; {wanted}")
    return {axis: unit for i, axis in enumerate(axes) if (unit := units[i // run])}


@dataclass
class Picked:
    """The columns that were chosen; `called` says what each is called in the table."""

    wrench: FloatArray  # N and N m where the axes are those of a wrench
    axes: tuple[str, ...]
    called: Mapping[str, str]
    units: dict[str, str]  # of axes that are not of a wrench
    notes: list[str]
    columns: Mapping[str, NDArray[Any]]  # clock, id, label, session, rate, flags
    time_unit: str | None = None
    rate_unit: str | None = None


def picked_columns(table: Table, stated: Stated) -> Picked:
    """Choose the columns that are read, and settle axes and units."""
    cells, asked_axes, beside_axes = dict(table.columns), stated.axes, True
    if not cells:
        cells, asked_axes, beside_axes = _named_cells(table, stated)
    asked = {**stated.columns}
    for what, own in ((LABEL, table.label), (SESSION, table.session)):
        if own is not None:
            asked[what] = None
    called = columns_of(list(cells), asked_axes, asked if beside_axes else None)
    axes = asked_axes or AXES
    if not beside_axes:
        called = {axis: called[axis] for axis in axes}
    if stated.id is None and RECORDING in called and _numbers_rows(cells[called[RECORDING]]):
        del called[RECORDING]
    scales, units, notes = _units_of(axes, called, table, stated)
    columns = {what: cells[name] for what, name in called.items() if what not in axes}
    used = set(called.values())
    time_unit, rate_unit = (
        table.units.get(called[what]) or meaning_of(called[what]).unit if what in called else None
        for what in (TIME, RATE)
    )
    beside = nanoseconds_beside(called[TIME], list(cells)) if TIME in called else None
    if beside is not None:
        used.add(beside)
        columns[TIME], time_unit = _joined_time(columns[TIME], cells[beside], called[TIME]), "ns"
    if table.stamps is not None and TIME not in columns:
        columns[TIME] = np.asarray(table.stamps)
        n = len(cells[called[axes[0]]])
        if columns[TIME].shape != (n,):
            raise TableError(f"{TIME} has the shape {columns[TIME].shape} for {n} samples")
    names = [called[axis] for axis in axes]
    if table.values is not None and names == list(cells):
        wrench = np.asarray(table.values, np.float64)  # not copied
    else:
        wrench = numbers_of([cells[name] for name in names], names, is_text=table.is_text)
    unread = [repr(name) for name in cells if name not in used]
    if unread:
        notes.append(f"columns that are not read: {', '.join(unread)[:200]}")
    others = {name: what for what, name in called.items() if not _same_name(name, what)}
    if others:
        notes.append(f"columns {', '.join(map(repr, others))} taken as {', '.join(others.values())}"[:300])
    wrench = wrench if scales is None else wrench * scales
    return Picked(wrench, axes, called, units, notes, columns, time_unit, rate_unit)


def _same_name(name: str, what: str) -> bool:
    return name_and_unit(name)[0].strip().lower() in (what.lower(), "timestamp" if what == TIME else what)


def _joined_time(seconds: NDArray[Any], nanoseconds: NDArray[Any], name: str) -> NDArray[np.int64]:
    """Join whole seconds and nanoseconds, as ROS prints stamps."""
    if not (np.isfinite(seconds).all() and np.isfinite(nanoseconds).all()):
        raise TableError("a stamp is empty", column=name)
    return seconds.astype(np.int64) * 1_000_000_000 + nanoseconds.astype(np.int64)


def _numbers_rows(values: NDArray[Any]) -> bool:
    """Return True if a column counts 0, 1, 2 ...: it numbers samples, not recordings."""
    if values.dtype.kind not in "iu" or len(values) < 2:
        return False
    return bool((np.diff(values) == 1).all())


def _named_cells(
    table: Table, stated: Stated
) -> tuple[dict[str, NDArray[Any]], tuple[str, ...] | None, bool]:
    """Return the columns of an array by their names: its own, those stated, or the six of a wrench.

    Also which of them are the axes, and whether others, such as a clock, are read beside the six.
    """
    values = np.asarray(table.values)
    if values.ndim != 2 or not values.size or values.dtype.kind not in "iuf":
        came = f"{values.dtype} of shape {values.shape}"
        raise TableError(f"samples are {came}; wanted numbers of shape (samples, axes)")
    n, known = values.shape[1], table.axes
    if known is not None and len(known) != n:
        raise TableError(f"samples have {n} columns, and {len(known)} axes are named: {', '.join(known)}")
    if known is None:
        known = AXES if stated.axes is None else stated.axes
    if len(known) != n:
        came = "" if stated.axes is None else f", and axes names {len(known)}"
        problem = f"samples have {n} columns without names{came}"
        raise TableError(f"{problem}; pass axes= with a name for each (--axes NAMES)", no_wrench=True)
    cells = dict(zip(known, values.T, strict=True))
    has_six = {meaning_of(name).what for name in known} >= set(AXES)
    names_all = stated.axes is None or (table.axes is None and known == stated.axes)
    if has_six and names_all and n > len(AXES):
        return cells, None, True
    of_wrench = has_six and n == len(AXES)
    return cells, stated.axes or (AXES if of_wrench else tuple(known)), False


def _units_of(
    axes: Sequence[str], called: Mapping[str, str], table: Table, stated: Stated
) -> tuple[tuple[float, ...] | None, dict[str, str], list[str]]:
    """Return what makes N and N m of each axis (None: they are), units of other axes, and what was converted."""
    asked = units_by_axis(axes, stated.units)
    own = {axis: _unit_of(axis, called[axis], table, asked.get(axis)) for axis in axes}
    scales: list[float] = []
    converted: dict[str, str] = {}
    for axis, unit in own.items():
        scale = factor(unit, unit_of(axis)) if axis in AXES and unit is not None else 1.0
        if scale is None:
            wanted = f"wanted {TAKEN[unit_of(axis)]}; convert other values first"
            raise TableError(f"its unit is {unit!r:.40}; {wanted}", column=called[axis])
        scales.append(scale)
        if scale != 1 and unit is not None:
            converted[axis] = unit
    for alike in (AXES[:3], AXES[3:]):
        silent = [axis for axis in alike if axis in axes and own[axis] is None]
        if silent and any(axis in converted for axis in alike):
            other = next(axis for axis in alike if axis in converted)
            problem = f"column {called[other]!r} states a unit and column {called[silent[0]]!r} none"
            raise TableError(f"{problem}; wanted that of each", column=called[silent[0]])
    units = {axis: unit_spelling(unit) for axis, unit in own.items() if axis not in AXES and unit is not None}
    if not converted:
        return None, units, []
    said_units = ", ".join(dict.fromkeys(f"{unit} to {unit_of(axis)}" for axis, unit in converted.items()))
    return tuple(scales), units, [f"converted from {said_units}"]


def _unit_of(axis: str, name: str, table: Table, asked: str | None) -> str | None:
    """Return the unit that the name of a column, what stands beside it, or the user states: all the same."""
    in_name = name_and_unit(name)[1] if axis != name.strip() or axis in AXES else None
    said = [unit for unit in (in_name, table.units.get(name), table.units.get(axis)) if unit and unit != "-"]
    other = next((unit for unit in said[1:] if not same_unit(said[0], unit)), None)
    if other is not None:
        raise TableError(f"its unit is {said[0]!r:.40}, and {other!r:.40} is stated beside it", column=name)
    if said and asked is not None and not same_unit(said[0], asked):
        raise TableError(
            f"its unit is {said[0]!r:.40}, and units= states {asked!r:.40}; leave it out", column=name
        )
    return said[0] if said else asked


def numbers_of(columns: Sequence[NDArray[Any]], names: Sequence[str], *, is_text: bool = False) -> FloatArray:
    """Put columns of numbers side by side; empty cells are NaN."""
    found = []
    for values, name in zip(columns, names, strict=True):
        if values.dtype.kind in "iuf":
            found.append(values)
            continue
        if values.ndim != 1 or values.dtype.kind not in "OUT":
            raise TableError(f"holds {values.dtype}; wanted numbers", column=name)
        cells = values.tolist()
        no_number = [
            row
            for row, cell in enumerate(cells)
            if isinstance(cell, bool) or not isinstance(cell, (int, float, type(None)))
        ]
        if no_number:
            texts = [row for row in no_number if _NUMBER.fullmatch(str(cells[row])) is None]
            row = (texts or no_number)[0]
            raise TableError(_why_no_number(row, cells[row], columns if is_text else []), row, name)
        found.append(np.array([np.nan if cell is None else cell for cell in cells], np.float64))
    return np.column_stack(found).astype(np.float64, copy=False)


def _why_no_number(row: int, cell: Any, columns: Sequence[NDArray[Any]]) -> str:
    """Say what is wrong with a cell; `columns` are those of a text table, which options of pandas may read."""
    if isinstance(cell, (list, tuple, np.ndarray)):
        return "holds lists; wanted one number a row (pandas: frame.explode makes rows of them)"
    text, way_out = str(cell)[:40], "; wanted a number"
    if _NUMBER.fullmatch(str(cell)):
        way_out = "; it is text (pandas: frame.astype makes numbers of it)"
    elif columns and _DECIMAL_COMMA.fullmatch(str(cell)):
        way_out = f"; a decimal comma is read by {in_both(csv={'decimal': ','})}"
    elif columns and _THOUSANDS.fullmatch(str(cell)):
        way_out = f"; marks of thousands are read by {in_both(csv={'thousands': ','})}"
    elif columns and all(column[row] == cell for column in columns):  # else the row would be empty in part
        way_out = f"; if it stands for a missing sample pass {in_both(csv={'na_values': text})}"
    return f"{text!r} is no number{way_out}"

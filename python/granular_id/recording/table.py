"""``Table``: samples as a file or a caller has them, what is stated of them, and which columns are the axes.

Every format and every data frame comes through here, and then through ``to_recordings``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, argument_error
from granular_id._core import AXES
from granular_id.recording.names import (
    FLAGS,
    LABEL,
    RATE,
    RECORDING,
    SESSION,
    TAKEN,
    TIME,
    ColumnError,
    columns_of,
    factor,
    meaning_of,
    name_and_unit,
    nanoseconds_beside,
    unit_spelling,
)
from granular_id.recording.recording import same_unit, unit_of

_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+\s*")


class TableError(ValueError):
    """Samples that make no recording: the problem, and the row and column of the table where it is.

    `no_wrench`: the table holds none of the axes, so that it may be something else beside recordings.
    """

    def __init__(
        self, problem: str, row: int | None = None, column: str | None = None, *, no_wrench: bool = False
    ) -> None:
        super().__init__(problem)
        self.problem, self.row, self.column, self.no_wrench = problem, row, column, no_wrench


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
        The clock of `values`: seconds or what `time_unit` says, or numpy's dates.
    time_unit : str, optional
        What stamps count, where that is stated.
    rate_hz, start_time, label, session, trigger_index, flags, meta
        What the file states of the recording, as in `Recording`.
    clock : str
        How errors call the clock.
    """

    name: str = ""
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    values: NDArray[Any] | None = None
    axes: tuple[str, ...] | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    stamps: NDArray[Any] | None = None
    time_unit: str | None = None
    rate_hz: float | None = None
    start_time: float | None = None
    label: str | None = None
    session: str | None = None
    trigger_index: int | None = None
    flags: NDArray[Any] | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)
    clock: str = "time"


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

    def column(self, what: Literal["label", "session"]) -> str | None:
        """Return the column that the label or session is to be taken from."""
        place = getattr(self, f"{what}_from")
        return place.removeprefix("column:") if place is not None and place.startswith("column:") else None


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
        raise argument_error(ValueError, "units", f"{problem}; {wanted}")
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
    try:
        return _of_columns(table, stated) if table.columns else _of_values(table, stated)
    except ColumnError as error:
        raise TableError(str(error), no_wrench=error.no_wrench) from error


def _of_columns(table: Table, stated: Stated) -> Picked:
    """Choose the columns that are read."""
    names = list(table.columns)
    asked = {
        TIME: stated.time,
        RECORDING: stated.id,
        LABEL: stated.column("label") if table.label is None else None,
        SESSION: stated.column("session") if table.session is None else None,
    }
    called = columns_of(names, stated.axes, asked)
    axes = stated.axes or AXES
    if stated.id is None and RECORDING in called and _numbers_rows(table.columns[called[RECORDING]]):
        del called[RECORDING]
    scales, units, notes = _units_of(axes, called, table, stated)
    columns = {what: table.columns[name] for what, name in called.items() if what not in axes}
    used = set(called.values())
    beside = nanoseconds_beside(called[TIME], names) if TIME in called else None
    if beside is not None:
        used.add(beside)
        columns[TIME] = _joined_time(columns[TIME], table.columns[beside], called[TIME])
    wrench = numbers_of([table.columns[called[axis]] for axis in axes], [called[axis] for axis in axes])
    unread = [repr(name) for name in names if name not in used]
    if unread:
        notes.append(f"columns that are not read: {', '.join(unread)[:200]}")
    others = {name: what for what, name in called.items() if not _same_name(name, what)}
    if others:
        notes.append(f"columns {', '.join(map(repr, others))} taken as {', '.join(others.values())}"[:300])
    if scales is not None:
        wrench = wrench * scales
    time_unit = None if TIME not in called else table.units.get(called[TIME]) or meaning_of(called[TIME]).unit
    rate_unit = None if RATE not in called else table.units.get(called[RATE]) or meaning_of(called[RATE]).unit
    if beside is not None:
        time_unit = "ns"
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


def _of_values(table: Table, stated: Stated) -> Picked:
    """Take an array of samples, whose columns may have names."""
    values = np.asarray(table.values)
    if values.ndim != 2 or not values.size or values.dtype.kind not in "iuf":
        came = f"{values.dtype} of shape {values.shape}"
        raise TableError(f"samples are {came}; wanted numbers of shape (samples, axes)")
    known = _names_of(values, table.axes, stated.axes)
    meant = {meaning_of(name).what for name in known}
    names_only = stated.axes is None or (table.axes is None and tuple(known) == tuple(stated.axes))
    if names_only and len(known) > len(AXES) and meant >= set(AXES):  # a clock, or others, beside the six
        table = replace(table, columns=dict(zip(known, values.T, strict=True)))
        return _of_columns(table, replace(stated, axes=None))
    columns = {name: values[:, i] for i, name in enumerate(known)}
    wanted = stated.axes or (AXES if len(known) == len(AXES) and meant == set(AXES) else known)
    found = columns_of(known, wanted)
    called = {axis: found[axis] for axis in wanted}
    scales, units, notes = _units_of(wanted, called, table, stated)
    in_order = tuple(called.values()) == tuple(known)
    chosen = values if in_order else np.column_stack([columns[name] for name in called.values()])
    wrench = np.asarray(chosen, np.float64)
    if scales is not None:
        wrench = wrench * scales
    others: dict[str, NDArray[Any]] = {}
    for what, cells in ((TIME, table.stamps), (FLAGS, table.flags)):
        if cells is not None:
            others[what] = np.asarray(cells)
            if others[what].shape != (len(values),):
                raise TableError(f"{what} has the shape {others[what].shape} for {len(values)} samples")
    return Picked(wrench, tuple(wanted), called, units, notes, others, table.time_unit)


def _names_of(
    values: NDArray[Any], known: Sequence[str] | None, stated: Sequence[str] | None
) -> Sequence[str]:
    """Return a name for each column of an array: its own, those stated, or the six of a wrench."""
    n = values.shape[1]
    if known is not None and len(known) != n:
        raise TableError(f"samples have {n} columns, and {len(known)} axes are named: {', '.join(known)}")
    if known is not None:
        return known
    if stated is not None and len(stated) == n:
        return stated
    if stated is None and n == len(AXES):
        return AXES
    came = "" if stated is None else f", and axes names {len(stated)}"
    problem = f"samples have {n} columns without names{came}"
    raise TableError(f"{problem}; pass axes= with a name for each", no_wrench=True)


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
    other = next((unit for unit in said[1:] if not _agree(axis, said[0], unit)), None)
    if other is not None:
        raise TableError(f"its unit is {said[0]!r:.40}, and {other!r:.40} is stated beside it", column=name)
    if said and asked is not None and not _agree(axis, said[0], asked):
        raise TableError(
            f"its unit is {said[0]!r:.40}, and units= states {asked!r:.40}; leave it out", column=name
        )
    return said[0] if said else asked


def _agree(axis: str, one: str, other: str) -> bool:
    if axis in AXES:
        scales = [factor(unit, unit_of(axis)) for unit in (one, other)]
        return scales[0] == scales[1] is not None or same_unit(one, other)
    return same_unit(one, other)


def numbers_of(columns: Sequence[NDArray[Any]], names: Sequence[str]) -> FloatArray:
    """Put columns of numbers side by side; empty cells are NaN."""
    found = []
    for values, name in zip(columns, names, strict=True):
        found.append(values if values.dtype.kind in "iuf" else _numbers_in(values, name))
    return np.column_stack(found).astype(np.float64, copy=False)


def _numbers_in(values: NDArray[Any], name: str) -> FloatArray:
    """Return the numbers of a column that holds something else too, or say which cell is none."""
    if values.ndim != 1 or values.dtype.kind not in "OUT":
        raise TableError(f"holds {values.dtype}; wanted numbers", column=name)
    numbers = np.empty(len(values))
    cells = values.tolist()
    some = [cell for cell in cells if isinstance(cell, str)]
    only_numbers = bool(some) and all(map(_NUMBER.fullmatch, some))  # then the column holds texts of numbers
    for row, cell in enumerate(cells):
        is_number = isinstance(cell, (int, float)) and not isinstance(cell, bool)
        if cell is None or is_number:
            numbers[row] = np.nan if cell is None else cell
            continue
        if isinstance(cell, str) and not only_numbers and _NUMBER.fullmatch(cell):
            continue
        if isinstance(cell, (list, tuple, np.ndarray)):
            raise TableError(
                "holds lists; wanted one number a row (pandas: frame.explode makes rows of them)", row, name
            )
        text = str(cell)
        way_out = f"; if it stands for a missing sample pass csv={{'na_values': {text[:40]!r}}}"
        if _DECIMAL_COMMA.fullmatch(text):
            way_out = "; a decimal comma is read by csv={'decimal': ','}"
        raise TableError(f"{text[:40]!r} is no number{way_out}", row, name)
    return numbers

"""Data sets of what is in memory: arrays, and tables with named columns of pandas, polars or pyarrow."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import argument_error, as_floats, checked_choice, checked_text, finite_number
from granular_id._core import AXES, GranularIdError
from granular_id._text import counted
from granular_id.recording.columns import (
    RECORDING,
    TableError,
    cell_text,
    column_names,
    refuse_table,
    unit_spelling,
    units_by_axis,
)
from granular_id.recording.conversion import Made, to_recordings
from granular_id.recording.recording import Recording, checked_axes
from granular_id.recording.report import StepReport
from granular_id.recording.table import Stated, Table

TimeUnit = Literal["s", "ms", "us", "ns", "sample"]
_LEAST_PADDED = 0.02
"""The part of a recording in zeros at its end that is more than a sensor at rest has."""

_ARRAYS = "(n, T, C): recordings, samples, axes; or a list of arrays (T, C)"


def recordings_of_arrays(
    X: Any,
    of_recordings: Mapping[str, Any],
    rate_hz: float,
    axes: str | Sequence[str] | None,
    units: str | Sequence[str] | None,
) -> tuple[list[Recording], StepReport]:
    """Make the recordings of arrays; see :meth:`Dataset.from_arrays`, which calls this."""
    rate = finite_number("rate_hz", rate_hz, positive=True)
    arrays = _arrays(X)
    if isinstance(X, np.ndarray) and (n_padded := padded_by_zeros(arrays)):
        problem = f": {n_padded} of {len(X)} recordings end in rows of zeros, as what is padded"
        way = "wanted a list of arrays cut to their lengths, [x[:n] for x, n in zip(X, lengths)]; list(X) keeps zeros"
        raise argument_error(GranularIdError, "X", f"{problem}; {way}")
    labels, days, called = (
        _texts(given, what, len(arrays), "recording") for what, given in of_recordings.items()
    )
    known = names_in("axes", axes)
    n_axes = arrays[0].shape[1]
    if known is None and n_axes != len(AXES):
        problem = f"names none, and X[0] has the shape {arrays[0].shape}; wanted a name for each column"
        turned = "X.transpose(0, 2, 1)" if isinstance(X, np.ndarray) else "[x.T for x in X]"
        way = f", as {turned} has it" if arrays[0].shape[0] == len(AXES) else ""
        way = "; of a clock in the first column [x[:, 1:] for x in X]" if n_axes == len(AXES) + 1 else way
        raise argument_error(GranularIdError, "axes", f"{problem}, or X of shape {_ARRAYS}{way}")
    columns = checked_axes(known, arrays[0].shape)
    stated = Stated(axes=columns, units=names_in("units", units, empty=True))
    units_by_axis(columns, stated.units)
    shared: dict[str, Any] = {"axes": columns, "rate_hz": rate}
    tables = [
        Table(called[i] or f"recording {i + 1}", values=array, label=labels[i], session=days[i], **shared)
        for i, array in enumerate(arrays)
    ]
    return _made(tables, stated, "X", "from_arrays", {"of": "arrays", "rate_hz": rate})


def padded_by_zeros(arrays: Sequence[NDArray[Any]]) -> int:
    """Return how many recordings of one array end in rows of zeros that others do not have; 0 where none is padded."""
    alive = [values for values in arrays if values.any()]  # zeros from end to end are a dead sensor
    zeros = [np.asarray(~values.any(axis=1)) for values in alive]
    if not zeros:
        return 0
    tails = [int(rows[::-1].cumprod().sum()) for rows in zeros]  # rows of zeros at the end of each
    is_padded = len(set(tails)) > 1 and max(tails) > max(1, _LEAST_PADDED * len(zeros[0]))
    begin_so = 2 * sum(rows[0] for rows in zeros) > len(zeros)
    return int(np.count_nonzero(tails)) if is_padded and not begin_so else 0


def recordings_of_frames(
    frames: Any,
    of_tables: Mapping[str, Any],
    columns: Mapping[str, str | None],
    axes: str | Sequence[str] | None,
    units: str | Sequence[str] | None,
    rate_hz: float | None,
    time_unit: str | None,
) -> tuple[list[Recording], StepReport]:
    """Make the recordings of tables; see :meth:`Dataset.from_frames`, which calls this."""
    one = column_names(frames, "frames") is not None or hasattr(frames, "columns")  # which may be numbers
    if isinstance(frames, Mapping) and any(column_names(table) is not None for table in frames.values()):
        wanted = "a list of them: list(frames.values()), with labels=list(frames) where these are the labels"
        raise argument_error(TypeError, "frames", f"is a dict of tables; wanted {wanted}")
    every = [frames] if one else _items(frames, "frames", "a table, or a list of tables")
    known, days, called = (_texts(given, what, len(every), "table") for what, given in of_tables.items())
    if time_unit is not None:
        checked_choice("time_unit", time_unit, *get_args(TimeUnit))
    named = [
        (RECORDING if what == "id" else what, checked_text(name, what).removeprefix("column:"))
        for what, name in columns.items()
        if name is not None
    ]
    for what in ("label", "session"):
        if columns[what] is not None and of_tables[f"{what}s"] is not None:
            problem = f"names a column, and {what}s are given too; wanted one of them"
            raise argument_error(GranularIdError, what, problem)
    stated = Stated(
        rate_hz=None if rate_hz is None else finite_number("rate_hz", rate_hz, positive=True),
        time_unit=time_unit,
        axes=names_in("axes", axes),
        units=names_in("units", units, empty=True),
        columns=tuple(named),
    )
    tables = [
        Table(
            name=called[i] or ("frames" if one else f"recording {i + 1}"),
            columns=columns_in(frame, "frames" if one else f"frames[{i}]"),
            units=units,
            beside=beside,
            label=known[i],
            session=days[i],
        )
        for i, frame in enumerate(every)
        for units, beside in [stated_beside(frame)]
    ]
    return _made(tables, stated, "frames", "from_frames", {"of": "frames", **columns, "axes": stated.axes})


def columns_in(frame: Any, argument: str = "frame") -> dict[str, NDArray[Any]]:
    """Return the columns of a table by name; the index of pandas comes first where it is a clock or has a name."""
    names = column_names(frame, argument)
    if names is None:
        grouped = "; of a groupby [table for _, table in ...]" * isinstance(frame, tuple)
        problem = f"is a {type(frame).__name__}; wanted a table with named columns{grouped}"
        raise argument_error(TypeError, argument, problem)
    twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if twice is not None:
        raise argument_error(GranularIdError, argument, f"has two columns {twice!r}")
    columns: dict[str, NDArray[Any]] = {}
    index: Any = getattr(frame, "index", None)
    kind = getattr(getattr(index, "dtype", None), "kind", "")
    if kind and not callable(index):
        name = getattr(index, "name", None)
        if kind in "mM" or isinstance(name, str):
            columns[name if isinstance(name, str) else "time"] = _plain(index)
    levels = list(getattr(index, "names", [])) if getattr(index, "nlevels", 1) > 1 else []
    columns |= {name: _plain(index.get_level_values(name)) for name in levels if isinstance(name, str)}
    for name in names:
        columns[name] = _plain(frame[name])
    rows = next(iter(columns.values())).shape[:1]
    for name, cells in columns.items():
        if cells.shape != rows or cells.ndim != 1:
            problem = (
                f": column {name!r} has the shape {cells.shape}; wanted {rows or '(rows,)'}, a value a row"
            )
            raise argument_error(GranularIdError, argument, problem)
    if rows == (0,):
        raise argument_error(GranularIdError, argument, "has no rows; wanted a row a sample")
    return columns


def stated_beside(frame: Any) -> tuple[dict[str, str], dict[str, Any]]:
    """Return units of columns, and all else that stands beside a table: attributes of pandas, metadata of pyarrow."""
    beside = {str(name): value for name, value in (getattr(frame, "attrs", None) or {}).items()}
    schema: Any = getattr(frame, "schema", None)
    units: dict[str, str] = {}
    if hasattr(schema, "metadata"):
        beside |= _texts_in(schema.metadata)
        beside.pop("pandas", None)  # which holds the attributes again
        with suppress(json.JSONDecodeError, TypeError, ValueError):
            beside |= dict(json.loads(beside.pop("PANDAS_ATTRS", "{}")))
        for field in schema:
            about = {key.lower(): text.strip() for key, text in _texts_in(field.metadata).items()}
            units |= {field.name: unit} if (unit := about.get("units") or about.get("unit")) else {}
    columns = set(column_names(frame) or ())
    for name in ("units", "unit"):
        stated = beside.get(name)
        with suppress(TypeError, ValueError):
            beside[name] = stated = json.loads(str(stated))
        if isinstance(stated, Mapping):
            known = {str(key): str(unit) for key, unit in beside.pop(name).items() if unit is not None}
            units = {key: unit for key, unit in known.items() if key in columns} | units
            beside |= {f"{key} unit": unit for key, unit in known.items() if key not in columns}
        elif isinstance(stated, (list, tuple)):
            beside[name] = ",".join(map(str, stated))
    return units, beside


def _texts_in(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    return {
        key.decode("utf-8", "replace"): text.decode("utf-8", "replace")
        for key, text in (metadata or {}).items()
    }


def _plain(column: Any) -> NDArray[Any]:
    """Return a column as an array, empty cells of pandas as None, and dates with a zone as those of UTC."""
    dtype = getattr(column, "dtype", None)
    if getattr(dtype, "tz", None) is not None:
        return np.asarray(column.to_numpy(dtype="datetime64[ns]"))
    values = np.asarray(column.to_numpy() if hasattr(column, "to_numpy") else column)
    if values.dtype == object and hasattr(column, "isna"):
        values = values.copy()
        values[np.asarray(column.isna())] = None
    return values


def names_in(argument: str, value: object, *, empty: bool = False) -> tuple[str, ...] | None:
    """Return names that come as a sequence, or as one text with commas between them."""
    if value is None:
        return None
    names = [name.strip() for name in value.split(",")] if isinstance(value, str) else value
    found = tuple(
        checked_text(name, f"{argument}[{i}]", empty=empty, spaced=False)
        for i, name in enumerate(_items(names, argument, "a sequence of names, or a text like 'wx,wy,wz'"))
    )
    if not empty and len(set(found)) < len(found):
        raise argument_error(GranularIdError, argument, f"={','.join(found)!r} names one twice")
    return tuple(unit_spelling(unit) for unit in found) if argument == "units" else found


def _arrays(X: Any) -> list[NDArray[np.float64]]:
    """Return one read-only array (T, C) a recording."""
    if isinstance(X, Mapping) and all(np.ndim(one) > 1 for one in X.values()):
        problem = (
            f"is a {type(X).__name__} of arrays; wanted {_ARRAYS}: list(X.values()), with y=list(X) where"
        )
        raise argument_error(TypeError, "X", f"{problem} each is one recording called as its label")
    refuse_table(X, "X")
    if isinstance(X, np.ndarray) and X.dtype != object:
        block = as_floats(X, "X", f"a real array of shape {_ARRAYS}")
        if block.ndim != 3 or not block.size:
            raise argument_error(GranularIdError, "X", f"has shape {X.shape}; wanted {_ARRAYS}")
        block = block.copy() if block.flags.writeable else block
        block.flags.writeable = False
        return list(block)
    found = []
    for i, one in enumerate(_items(X, "X", _ARRAYS)):
        refuse_table(one, f"X[{i}]")
        found.append(as_floats(one, f"X[{i}]", "a real array of shape (T, C)"))
    for i, one in enumerate(found):
        if one.ndim != 2 or not one.size or one.shape[1] != found[0].shape[-1]:
            others = "" if i == 0 else f", and X[0] {found[0].shape}"
            raise argument_error(
                GranularIdError, "X", f"[{i}] has shape {one.shape}{others}; wanted {_ARRAYS}"
            )
    return found


def _items(value: Any, argument: str, wanted: str) -> list[Any]:
    """Return the items of a sequence, or refuse what has none, or has them in no order."""
    if isinstance(value, (str, bytes, Mapping, set, frozenset)) or not isinstance(value, Iterable):
        raise argument_error(TypeError, argument, f"is a {type(value).__name__}; wanted {wanted}")
    every = list(value)
    if not every:
        raise argument_error(GranularIdError, argument, f"is empty; wanted {wanted}")
    return every


def _texts(values: Any, argument: str, n: int, each: str) -> list[str | None]:
    """Return a text for each of n recordings, or tables: of texts, numbers or None."""
    if values is None:
        return [None] * n
    one = isinstance(values, str) or not isinstance(values, Iterable)
    given = [values] if one else _items(values, argument, f"a sequence of texts or numbers, one a {each}")
    every = [value.item() if isinstance(value, np.generic) else value for value in given]
    if len(every) != n:
        within = (
            "; those of the recordings within a table stand in a column of it, which label= or session= name"
        )
        problem = f"has {len(every)} values for {counted(n, each)}{within * (each == 'table')}"
        raise argument_error(GranularIdError, argument, problem)
    for i, value in enumerate(every):
        if isinstance(value, bool) or not isinstance(value, (str, int, float, type(None))):
            problem = f"[{i}] is a {type(value).__name__}; wanted a text or number"
            raise argument_error(TypeError, argument, problem)
        if isinstance(value, str):
            checked_text(value, f"{argument}[{i}]", spaced=False)
    return [cell_text(value) or None for value in every]


def _made(
    tables: Sequence[Table], stated: Stated, argument: str, step: str, parameters: Mapping[str, Any]
) -> tuple[list[Recording], StepReport]:
    """Make the recordings of tables, and say what was done; a fault is at its place in the argument."""
    whole = Made()
    for i, table in enumerate(tables):
        try:
            made = to_recordings(table, stated)
        except TableError as error:
            where = [f"{argument}[{i}]" if len(tables) > 1 else argument]
            where += [] if error.row is None else [f"row {error.row}"]
            where += [] if error.column is None else [f"column {error.column!r}"]
            mend = f"; pandas: frame{error.mend}" * bool(error.mend)
            raise GranularIdError(f"{', '.join(where)}: {error.problem}{mend}") from error
        whole.recordings += made.recordings
        whole.rows += made.rows
        whole.notes += [note for note in made.notes if note not in whole.notes]
    return whole.recordings, StepReport(step, parameters, whole.totals, whole.rows, whole.notes)

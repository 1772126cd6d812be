"""Tables with named columns (pandas, polars, pyarrow) as samples; none of these libraries is needed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id._core import AXES
from granular_id.recording.names import TIME, axis_of, meaning_of


def column_names(value: object, argument: str = "wrench") -> tuple[str, ...] | None:
    """Return the names of the columns of a table; None for arrays, and for tables whose columns are only numbered."""
    if isinstance(value, (np.ndarray, list, tuple)):
        return None
    found = getattr(
        value, "column_names", getattr(value, "columns", None)
    )  # pyarrow keeps its arrays in columns
    if isinstance(found, str) or not isinstance(found, Iterable):
        return None
    names = tuple(found)
    other = [name for name in names if not isinstance(name, str)]
    if not other:
        return names or None
    if all(isinstance(name, (int, np.integer)) for name in names):
        return None
    raise TypeError(f"{argument} has a column with the name {other[0]!r:.80}; wanted text")


def by_name(
    table: Any, names: Sequence[str], argument: str, wanted: Sequence[str] | None
) -> tuple[npt.NDArray[Any], tuple[str, ...]]:
    """Take columns by their names: those wanted; else the six of a wrench in their order, or all as they stand."""
    have = " ".join(names)
    own = {_axis(name): name for name in names}  # fx for Fx
    if len(own) < len(names):
        twice = next(name for k, name in enumerate(names) if _axis(name) in map(_axis, names[:k]))
        raise ValueError(f"{argument} has two columns {twice!r}: {have}")
    if wanted is not None:
        places = {**own, **{name: name for name in names}}
        missing = [axis for axis in wanted if axis not in places]
        if missing:
            raise ValueError(
                f"{argument} has no column {missing[0]!r}: its columns are {have}, wanted are {' '.join(wanted)}; an "
                f"array has no names: {argument}.to_numpy() passes for these"
            )
        chosen = [(axis, places[axis]) for axis in wanted]
    elif own.keys() == set(AXES):
        chosen = [(axis, own[axis]) for axis in AXES]
    else:
        times = [name for name in names if meaning_of(name.lstrip("%# ")).what == TIME]
        beside = [name for name in names if _axis(name) not in AXES] if own.keys() >= set(AXES) else []
        if times or beside:
            left = [name for name in names if name not in times and name not in beside]
            axes = [name for name in left if np.asarray(table[name]).dtype.kind in "iuf"]
            what = "no axis" if times else "no force or torque"
            raise ValueError(
                f"{argument} has the column {(times or beside)[0]!r}, which is {what}: its columns are {have}; choose "
                f"those that are axes, as in {argument}[{axes}]"
            )
        chosen = [(name, name) for name in names]
    columns = [np.asarray(table[name]) for _, name in chosen]
    for (_, name), column in zip(chosen, columns, strict=True):
        if column.dtype.kind not in "iuf" or column.ndim != 1:
            raise TypeError(f"column {name!r} of {argument} must hold real numbers, got dtype {column.dtype}")
    return np.column_stack(columns), tuple(axis for axis, _ in chosen)


def samples_of(value: Any, argument: str, wanted: Sequence[str] | None) -> tuple[Any, tuple[str, ...] | None]:
    """Take a table, or a list of tables, by the names of its columns; what has no names comes back as it is."""
    names = column_names(value, argument)
    if names is not None:
        if wanted is not None and len(names) > len(wanted):
            raise ValueError(
                f"{argument} has the columns {' '.join(names)}, wanted are {' '.join(wanted)}: leave out the others"
            )
        return by_name(value, names, argument, wanted)
    if isinstance(value, np.ndarray) and value.dtype == object and value.ndim == 1:
        _refuse_ragged(value, argument)
    if not isinstance(value, (list, tuple)):
        return value, None
    named = [k for k, item in enumerate(value) if column_names(item, f"{argument}[{k}]") is not None]
    if not named:
        _refuse_ragged(value, argument)
        return value, None
    first, axes = samples_of(value[named[0]], f"{argument}[{named[0]}]", wanted)
    every = list(value)
    every[named[0]] = first
    for k in named[1:]:
        every[k], _ = samples_of(value[k], f"{argument}[{k}]", axes)
    _refuse_ragged(every, argument)
    return np.stack(every), axes


def _refuse_ragged(recordings: Iterable[Any], argument: str) -> None:
    shapes = set()
    for one in recordings:
        if isinstance(one, np.ndarray):
            shapes.add(one.shape)
        elif isinstance(one, (list, tuple)) and one and isinstance(one[0], (list, tuple, np.ndarray)):
            shapes.add((len(one), len(one[0])))
    if len(shapes) > 1:
        low, *_, high = sorted(shapes)
        raise ValueError(
            f"{argument} must hold recordings of one shape, got {low} and {high}: cut them to one length, as "
            "Dataset.align(n_samples=...) and Dataset.windows(duration_s) do"
        )


def wrench_of(value: Any) -> Any:
    """Take samples, and refuse six named columns that are no wrench: their features would be named after one."""
    samples, axes = samples_of(value, "wrench", None)
    if axes is not None and len(axes) == len(AXES) and axes != AXES:
        raise ValueError(
            f"wrench has the columns {' '.join(axes)}; six axes are {' '.join(AXES)}: name them so, or pass "
            "an array without names (to_numpy()), whose columns count as these"
        )
    return samples


def _axis(name: str) -> str:
    """Return fx for Fx, force_x or wrench.force.x [N]; a name that is no such axis as it is."""
    return axis_of(name) or name

"""Columns that are not read, and what they may be: labels, ids of recordings, counts of runs or of rows, clocks."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.recording.clock import SEVERAL
from granular_id.recording.columns import ANEW, LABEL_NAMES, RECORDING, TableError, cell_text
from granular_id.recording.table import Picked, Table

MANY = 5
"""Rows of a stretch, in the mean, that may be a recording."""

_RUN_NAMES = re.compile(
    r"(recording|trial|push|run|rep(etition|lica)?|take|test|experiment|episode|versuch|lauf|messung|ensayo|essai|prova)"
    r"([\s_.-]*(id|no|nr|num(ber)?|idx|index|count)\.?)?",
    re.IGNORECASE,
)
"""Names of columns that count recordings, beside those of ids."""

_MOST_RISE = 0.95
"""The part of the steps of a clock that are forward."""

_ID_END = r"[\W_]*\d*(\.\w+)?$"


def refuse_counts_anew(table: Table, picked: Picked) -> None:
    """Refuse a table without a clock whose rows a column counts from the beginning several times."""
    for name, cells in table.columns.items():
        if name in picked.called.values() or cells.dtype.kind not in "iu" or len(cells) < MANY:
            continue
        steps = np.diff(cells)
        is_anew = np.mean(steps == 1) > _MOST_RISE and (steps < 0).any() and (steps[steps != 1] < 0).all()
        n_values = int(cells.max()) + 1
        if is_anew and n_values & (n_values - 1):  # a counter of 8 or 16 bits overflows at a power of two
            mend = ANEW.format(name="recording", stamps=f"f[{name!r}]")
            raise TableError(f"counts rows, and begins anew: {SEVERAL}", column=name, mend=mend)


def run_columns(table: Table, picked: Picked) -> list[str]:
    """Return the columns that are not read, are called like runs, and count stretches of rows."""
    unread = {name: cells for name, cells in table.columns.items() if name not in picked.called.values()}
    called = [name for name in unread if _RUN_NAMES.fullmatch(name)]
    return [name for name in called if 0 < len(changes_in(unread[name])) < len(unread[name]) / MANY]


def ids_of_runs(table: Table, picked: Picked) -> list[str]:
    """Return those of `run_columns` that have a value of its own in each stretch and are no flags."""
    found = []
    for name in run_columns(table, picked):
        texts = set(texts_of(table.columns[name]).tolist())
        n_stretches = len(changes_in(table.columns[name])) + 1
        if len(texts) == n_stretches and not texts <= {"0", "1", "True", "False"}:
            found.append(name)
    return found


def label_columns(
    columns: Mapping[str, NDArray[Any]],
    picked: Picked,
    parts: Sequence[NDArray[np.intp]],
    names: re.Pattern[str] = LABEL_NAMES,
) -> dict[str, list[str]]:
    """Return the columns that may be labels: of texts, or called so, with one value a recording."""
    found: dict[str, list[str]] = {}
    for name, cells in columns.items():
        if name in picked.called.values() or not (cells.dtype.kind in "OUT" or names.match(name)):
            continue
        kinds = [set(texts_of(cells[rows]).tolist()) for rows in parts]
        if all(len(one) == 1 and one != {""} for one in kinds):
            found[name] = [text for one in kinds for text in one]
    return found


def ways_into_several(table: Table, picked: Picked) -> list[dict[str, str]]:
    """Return options for columns of a few texts in long stretches, with the column that tells recordings apart."""
    found = []
    for name, cells in table.columns.items():
        texts = texts_of(cells) if name not in picked.called.values() and cells.dtype.kind in "OUT" else None
        if texts is None or (texts == "").any() or not 0 < len(changes_in(cells)) < len(cells) / MANY:
            continue
        ids = ids_in(table, picked, slice(None), changes_in(cells))
        found += [{"id": ids[0], "label": f"column:{name}"}] if ids else []
    return found


def ids_in(table: Table, picked: Picked, rows: Any, begins: set[int]) -> list[str]:
    """Return the columns that may tell recordings apart which begin behind some rows, and more: the finest first."""
    changes = {
        name: changes_in(cells[rows])
        for name, cells in table.columns.items()
        if name not in picked.called.values() and cells.dtype.kind in "iuOUT"
    }
    once = [
        name
        for name, places in changes.items()
        if begins <= places
        and 0 < len(places) < len(table.columns[name][rows]) / MANY
        and len(set(texts_of(table.columns[name][rows]).tolist())) == len(places) + 1
    ]
    return sorted(once, key=lambda name: -len(changes[name]))


def labels_of_ids(picked: Picked) -> str:
    """Return the method that makes labels of ids as ``rice_3`` or ``rice_3.csv``; nothing where these are no names."""
    name, cells = picked.called[RECORDING], picked.columns[RECORDING]
    every = set(texts_of(cells).tolist())
    stems = {re.sub(_ID_END, "", text) for text in every}
    if cells.dtype.kind not in "OUT" or "" in stems or not 1 < len(stems) < len(every):
        return ""
    return f".assign(label=lambda f: f[{name!r}].str.replace(r{_ID_END!r}, '', regex=True))".replace(
        "\\\\", "\\"
    )


def texts_of(values: NDArray[Any]) -> NDArray[np.str_]:
    """Return cells as texts."""
    return np.array([cell_text(value) for value in values.tolist()], dtype=np.str_)


def may_be_clock(cells: NDArray[Any]) -> bool:
    """Whether values rise, and not by one as an index, or are texts of times."""
    if cells.dtype.kind not in "iuf":
        return cells.dtype.kind == "M" or bool(re.search(r"\d:\d\d", str(cells[0])))
    steps = np.diff(cells.astype(np.float64))  # some run back, where recordings stand below each other
    return bool(np.mean(steps > 0) > _MOST_RISE and (steps[steps > 0] != 1).any())


def changes_in(cells: NDArray[Any]) -> set[int]:
    """Return the rows behind which a column has another value."""
    texts = texts_of(cells)
    return set(np.flatnonzero(texts[1:] != texts[:-1]).tolist())

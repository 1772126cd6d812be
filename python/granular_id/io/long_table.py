"""Tables with a row per sample, of one recording or of many: how CSV and Parquet files of others keep them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, checked_text
from granular_id.io.arrays.details import Entries, stated_rates
from granular_id.io.arrays.names import Role, role_of
from granular_id.io.arrays.stated import ALL, Columns, single_unit, time_unit_in_name, units_of, what_has_unit
from granular_id.io.arrays.tree import Origin
from granular_id.io.columns import FLAGS, LABEL, RATE, RECORDING, SESSION, TIME, factor, split_unit
from granular_id.io.errors import RecordingFileError
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileSource
from granular_id.io.stamped import stamped_recording
from granular_id.recording import AXES, KNOWN_FLAGS, Recording

_OF_ROLE: dict[Role | None, str] = {"labels": LABEL, "sessions": SESSION}

Coded = tuple[NDArray[np.int64], list[str | None]]
"""A column of texts: codes, and what each means; None is an empty cell."""


@dataclass(frozen=True)
class Stated:
    """What the names of columns, and the metadata of them and of the table, say."""

    scales: tuple[float, ...] | None  # what each axis must be multiplied with
    meta_units: dict[str, str]  # of axes that are no part of a wrench
    time_unit: str | None
    rate_hz: float | None  # of the whole table
    rate_unit: str  # of the column of rates
    texts: dict[str, str]  # label and session of the whole table
    notes: list[str]  # what was converted

    @classmethod
    def of(
        cls,
        columns: Mapping[str, str],
        path: Path,
        options: LoadOptions,
        *,
        about: Mapping[str, Any] | None = None,
        units_of_columns: Mapping[str, str] | None = None,
    ) -> Stated:
        """Read what is stated."""
        axes = options.axes or AXES
        origin = Origin(path, "metadata", about or {})
        units: dict[str, tuple[str, tuple[str, ...]]] = {}
        entries: Entries = {}
        for key, value in (about or {}).items():
            whose, role = what_has_unit(key, {}), role_of(key)
            if whose is not None and value is not None:
                units |= units_of(value, whose, key, {}, origin)
            elif role in ("rate", "step"):
                entries.setdefault(role, {})[key] = value
        units |= {
            meaning: (f"of column {name}", (unit,))
            for meaning, name in columns.items()
            if meaning in (*axes, TIME, RATE) and (unit := (units_of_columns or {}).get(name))
        }
        named = tuple(columns[axis] for axis in axes)
        rates = stated_rates(entries, 1, units, origin, options)
        time_unit = single_unit(units.get(TIME))
        if time_unit is None and TIME in columns:
            time_unit = time_unit_in_name(columns[TIME])
        wrench = Columns.named(named, {ALL: ("", ()), **units}, "the table", origin, options)
        texts = {
            what: text
            for key, text in (about or {}).items()
            if isinstance(text, str) and (what := _OF_ROLE.get(role_of(key))) and what not in columns
        }
        return cls(
            scales=wrench.scales,
            meta_units=wrench.meta_units,
            time_unit=time_unit,
            rate_hz=None if rates is None else rates[0],
            rate_unit=single_unit(units.get(RATE)) or split_unit(columns.get(RATE, ""))[1] or "Hz",
            texts=texts,
            notes=[] if wrench.scales is None else [wrench.said(named)],
        )


@dataclass(frozen=True)
class LongTable:
    """The columns that were read, T rows each."""

    wrench: FloatArray
    axes: tuple[str, ...]
    columns: Mapping[str, str]  # what each is called in the file, by what it means
    stated: Stated
    place: Callable[
        [str, int | None], dict[str, Any]
    ]  # from a recording's name and a row to what an error names
    stamps: FloatArray | None = None
    nanoseconds: NDArray[np.int64] | None = None  # since 1970, in place of `stamps`
    flags: FloatArray | None = None
    rates: FloatArray | None = None  # of the recording, in each of its rows
    keys: NDArray[Any] | None = None  # which recording a row belongs to; None: all to one
    names: list[str | None] | None = None  # what a key stands for; None: it is a number
    texts: Mapping[str, Coded] = field(default_factory=dict)  # label and session of each row


def recordings_of(
    table: LongTable, source: FileSource, options: LoadOptions, *, clock: str = "time"
) -> tuple[list[Recording], list[dict[str, Any]]]:
    """Make the recordings of a table, in the order in which they begin, and remarks on them."""
    asked = options.session not in (None, "file", "folder")
    if (
        table.keys is None and asked and SESSION in table.texts
    ):  # the column that was named parts recordings, too
        keys, names = table.texts[SESSION]
        table = replace(table, keys=keys, names=names)
    made = [
        _recording(table, rows, replace(source, name=name), options, clock)
        for rows, name in _parts(table, source)
    ]
    remarked = [{"name": recording.name, **remarks} for recording, remarks in made if remarks]
    return [recording for recording, _ in made], remarked


def refuse_mask(values: Iterable[Any], name: str, path: Path) -> None:
    """Refuse a table in which a mask leaves out rows; `values` are those that stand in its column."""
    kept = {"false", "0", "0.0"} if "pad" in name.lower() else {"true", "1", "1.0"}
    if not {str(value).lower() for value in values} <= kept:
        wanted = "leave the others out first, and then the column"
        raise RecordingFileError(path, f"tells which rows are samples: {wanted}", column=name)


def _parts(table: LongTable, source: FileSource) -> list[tuple[NDArray[np.intp], str]]:
    """Return the rows and the name of each recording."""
    n_rows = len(table.wrench)
    if table.keys is None:
        return [(np.arange(n_rows), source.name)]
    kinds, firsts, codes = np.unique(table.keys, return_index=True, return_inverse=True)
    column = table.columns.get(RECORDING, table.columns.get(SESSION))
    if column is not None and 1 < n_rows == len(kinds):
        problem = "has another value in every row: it numbers samples, not recordings; leave the column out"
        raise RecordingFileError(source.path, problem, column=column)
    values = table.names
    names = [f"{source.name}[{kind}]" if values is None else str(values[kind]) for kind in kinds.tolist()]
    for own, texts in (table.texts[name] for name in (LABEL, SESSION) if name in table.texts):
        if _n_pieces(codes) > len(firsts):  # trials are counted anew for each label or session
            kinds, firsts, codes = np.unique(codes * len(texts) + own, return_index=True, return_inverse=True)
            pairs = (divmod(kind, len(texts)) for kind in kinds.tolist())
            names = [names[key] + (f" ({texts[code]})" if texts[code] else "") for key, code in pairs]
    if _n_pieces(codes) > len(firsts):
        problem = (
            "has the same value again behind other recordings: which rows belong together cannot be told; wanted a "
            "value of its own for each recording, or columns material and session that tell them apart"
        )
        raise RecordingFileError(source.path, problem, column=table.columns.get(RECORDING))
    rows = np.split(np.argsort(codes, kind="stable"), np.cumsum(np.bincount(codes))[:-1])
    return [(rows[i], names[i]) for i in np.argsort(firsts).tolist()]


def _n_pieces(codes: NDArray[np.intp]) -> int:
    """Return how many times the key changes, and one."""
    return int(np.count_nonzero(np.diff(codes))) + 1


def _recording(
    table: LongTable, rows: NDArray[np.intp], source: FileSource, options: LoadOptions, clock: str
) -> tuple[Recording, dict[str, Any]]:
    def locate(sample: int | None) -> dict[str, Any]:
        return table.place(source.name, None if sample is None else int(rows[sample]))

    def picked(values: NDArray[Any]) -> NDArray[Any]:
        return values if table.keys is None else values[rows]  # all of one recording need not be copied

    stamps = None if table.stamps is None else picked(table.stamps)
    start_time = None
    if table.nanoseconds is not None:
        own = picked(table.nanoseconds)
        stamps, start_time = (own - own[0]) / 1e9, float(own[0]) / 1e9
    varies = stamps is not None and table.rates is not None and len(np.unique(table.rates[rows])) > 1
    recording, remarks = stamped_recording(
        picked(table.wrench),
        source,
        options,
        scales=table.stated.scales,
        stamps=stamps,
        start_time=start_time,
        flags=_flags(table, rows, source),
        label=_one_text(table, LABEL, rows, source),
        session=_one_text(table, SESSION, rows, source),
        axes=table.axes,
        meta={"units": table.stated.meta_units} if table.stated.meta_units else None,
        locate=locate,
        clock=clock,
        time_unit="s" if table.nanoseconds is not None else table.stated.time_unit,
        file_rate_hz=table.stated.rate_hz if varies else _rate_hz(table, rows, source),
    )
    if varies:  # it was measured
        remarks["remark"] = f"column {table.columns[RATE]!r} changes: the stamps give the rate"
    return recording, remarks


def _flags(table: LongTable, rows: NDArray[np.intp], source: FileSource) -> NDArray[np.uint8] | None:
    if table.flags is None:
        return None
    flags = table.flags[rows]
    wrong = np.flatnonzero((flags != np.floor(flags)) | (flags < 0) | (flags > KNOWN_FLAGS))
    if len(wrong):
        place = table.place(source.name, int(rows[wrong[0]])) | {"column": table.columns[FLAGS]}
        problem = f"{flags[wrong[0]]:g} is not a sum of SampleFlag bits (0 to {KNOWN_FLAGS})"
        raise RecordingFileError(source.path, problem, **place)
    return flags.astype(np.uint8)


def _rate_hz(table: LongTable, rows: NDArray[np.intp], source: FileSource) -> float | None:
    """Return the rate that a recording's rows, or the whole table, state."""
    of_table = table.stated.rate_hz
    if table.rates is None:
        return of_table
    rates = np.unique(table.rates[rows])
    scale = factor(table.stated.rate_unit, "Hz")
    if scale is None:
        problem = f"is in {table.stated.rate_unit!r:.40}; wanted Hz"
    elif len(rates) > 1 or rates[0] <= 0 or of_table not in (None, rates[0] * scale):
        beside = "" if of_table is None else f", the table one of {of_table:g} Hz"
        shown = f"{rates[:5].tolist()}{beside}"
        problem = f"recording {source.name!r:.60} states the rates {shown}; wanted one above 0"
    else:
        return float(rates[0] * scale)
    raise RecordingFileError(source.path, problem, column=table.columns[RATE])


def _one_text(table: LongTable, meaning: str, rows: NDArray[np.intp], source: FileSource) -> str | None:
    """Return what a recording's rows, or the whole table, say of its label or session: all of them the same."""
    if meaning not in table.texts:
        return table.stated.texts.get(meaning)
    codes, values = table.texts[meaning]
    said: set[str | None] = {values[code] for code in np.unique(codes[rows]).tolist()}
    if len(said) > 1:
        shown = ", ".join(sorted(f"{text!r:.30}" for text in said))[:80]
        problem = f"recording {source.name!r:.60} has {len(said)} values: {shown}; wanted one"
        if table.keys is None:
            problem += ", or a column recording (also trial, run) that tells the stretches of each apart"
        raise RecordingFileError(source.path, problem, column=table.columns[meaning])
    text = said.pop()
    try:
        return None if text is None else checked_text(text, meaning, spaced=False)
    except ValueError as error:
        raise RecordingFileError(source.path, str(error), column=table.columns[meaning]) from None

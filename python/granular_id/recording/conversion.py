"""``to_recordings``: the one place that settles clock, label, session, and which rows of a table belong together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, checked_text, thaw
from granular_id._text import counted
from granular_id.recording.clock import (
    IGNORED_OUT,
    SINCE_1970,
    ClockError,
    Stamps,
    has_date,
    rate_of,
    refuse_unlikely,
    stamps_of,
    time_order,
    unpacked,
)
from granular_id.recording.columns import (
    FLAGS,
    LABEL,
    RATE,
    RECORDING,
    SESSION,
    TIME,
    TableError,
    cell_text,
    factor,
)
from granular_id.recording.recording import KNOWN_FLAGS, Recording, SampleFlag
from granular_id.recording.table import Picked, Stated, Table, numbers_of, picked_columns

Text = Literal["label", "session"]


@dataclass
class Made:
    """What `to_recordings` made: recordings, a row for each with remarks, and notes on the whole table."""

    recordings: list[Recording]
    rows: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def to_recordings(table: Table, stated: Stated) -> Made:
    """Make the recordings of a table.

    Parameters
    ----------
    table : Table
    stated : Stated
        What a caller, an option or an index says; it is obeyed, or refused where the table says something else.

    Returns
    -------
    Made
        Recordings in the order in which they begin.

    Raises
    ------
    TableError
        What is missing, or contradicts itself or what is stated; with row and column.
    """
    picked = picked_columns(table, stated)
    parts = _parts(picked, table.name)
    if len(parts) > 1 and (stated.start_time is not None or stated.trigger_index is not None):
        problem = f"start_time and trigger_index are stated for {counted(len(parts))}"
        raise TableError(f"{problem}; wanted in the file itself")
    made = Made([], [], picked.notes)
    for rows, name in parts:
        part = _Part(table, stated, picked, rows, name)
        made.recordings.append(part.recording())
        made.rows += [{"name": name, **part.remarks}] if part.remarks else []
    return made


def _parts(picked: Picked, name: str) -> list[tuple[NDArray[np.intp], str]]:
    """Return the rows and the name of each recording: those with one id, and of these one label and one session."""
    n = len(picked.wrench)
    if RECORDING not in picked.columns:
        return [(np.arange(n), name)]
    ids = picked.columns[RECORDING]
    texts = [
        texts_of(ids),
        *(texts_of(picked.columns[what]) for what in (LABEL, SESSION) if what in picked.columns),
    ]
    if (texts[0] == "").any():
        raise TableError("the cell is empty", int((texts[0] == "").argmax()), picked.called[RECORDING])
    codes = np.zeros(n, np.int64)
    for values in texts:
        _, own = np.unique(values, return_inverse=True)
        _, codes = np.unique(codes * (own.max() + 1) + own, return_inverse=True)
    firsts = np.unique(codes, return_index=True)[1]
    if np.count_nonzero(np.diff(codes)) >= len(firsts) and TIME not in picked.columns:
        problem = "has the same value again behind other recordings, and no clock tells where the rows belong"
        raise TableError(problem, column=picked.called[RECORDING])
    numbered = all(text.isdecimal() for text in dict.fromkeys(texts[0].tolist()))
    names = [f"{name}[{texts[0][first]}]" if numbered else str(texts[0][first]) for first in firsts]
    if len(set(names)) < len(names):  # trials are counted anew for each label or session
        names = [
            f"{one} ({', '.join(str(values[first]) for values in texts[1:] if values[first])})"
            for one, first in zip(names, firsts, strict=True)
        ]
    rows = np.split(np.argsort(codes, kind="stable"), np.cumsum(np.bincount(codes))[:-1])
    return [(rows[i], names[i]) for i in np.argsort(firsts, kind="stable").tolist()]


def texts_of(values: NDArray[Any]) -> NDArray[np.str_]:
    """Return the cells of a column as texts."""
    return np.array([cell_text(value) for value in values.tolist()], dtype=np.str_)


class _Part:
    """The rows of one recording on their way: `rows` says where each kept sample stands in the table."""

    def __init__(
        self, table: Table, stated: Stated, picked: Picked, rows: NDArray[np.intp], name: str
    ) -> None:
        self._table, self._stated, self._picked, self._name = table, stated, picked, name
        self._rows, self._wrench, self._columns = rows, picked.wrench, picked.columns
        if len(rows) < len(picked.wrench):  # all of one recording need not be copied
            self._wrench = picked.wrench[rows]
            self._columns = {what: cells[rows] for what, cells in picked.columns.items()}
        self._flags: NDArray[np.uint8] | None = None
        self._trigger = stated.trigger_index
        self.remarks: dict[str, Any] = {}

    def recording(self) -> Recording:
        """Settle the clock and what is known of the recording."""
        if FLAGS in self._columns:
            flags = numbers_of([self._columns[FLAGS]], [FLAGS])[:, 0]
            wrong = np.flatnonzero(~np.isin(flags, np.arange(KNOWN_FLAGS + 1)))
            if len(wrong):
                problem = f"{flags[wrong[0]]:g} is not a sum of SampleFlag bits (0 to {KNOWN_FLAGS})"
                raise self._fault(problem, int(wrong[0]), FLAGS)
            self._flags = flags.astype(np.uint8)
        file_hz = self._rate_in_table()
        try:
            stamps = self._stamps(file_hz)
            rate_hz, time_s, start_time = self._settled(stamps, file_hz)
        except ClockError as error:
            raise self._fault(str(error), error.sample, TIME) from error
        units = {"units": self._picked.units} if self._picked.units else {}
        meta = {**units, **thaw(self._table.meta), **thaw(self._stated.meta)}
        label, session = self._text("label", meta), self._text("session", meta)
        try:
            return Recording(
                self._wrench,
                rate_hz=rate_hz,
                label=label,
                session=session,
                start_time=start_time if self._stated.start_time is None else self._stated.start_time,
                trigger_index=self._trigger,
                time_s=time_s,
                meta=meta,
                flags=self._flags,
                name=self._name,
                axes=self._picked.axes,
            )
        except (TypeError, ValueError) as error:
            raise TableError(str(error)) from error

    def _fault(self, problem: str, sample: int | None, what: str) -> TableError:
        row = None if sample is None else int(self._rows[sample])
        return TableError(problem, row, self._picked.called.get(what))

    def _keep(self, samples: NDArray[np.intp]) -> None:
        """Keep some samples, in this order."""
        if self._trigger is not None and 0 <= self._trigger < len(self._wrench):
            kept = np.flatnonzero(samples == self._trigger)
            after = np.flatnonzero(samples >= self._trigger)
            self._trigger = int(kept[0]) if len(kept) else int(after[0]) if len(after) else len(samples) - 1
        self._wrench, self._rows = self._wrench[samples], self._rows[samples]
        self._columns = {what: cells[samples] for what, cells in self._columns.items()}
        self._flags = None if self._flags is None else self._flags[samples]

    def _stamps(self, file_hz: float | None) -> Stamps | None:
        """Leave out samples that are empty in all axes, and return the stamps of the others.

        Without a clock there are stamps only where samples are missing: what is missing leaves a gap. A clock that is
        none is ignored where a rate is stated. A sample that is empty in some axes is refused.
        """
        rate_hz = file_hz if self._stated.rate_hz is None else self._stated.rate_hz
        bad = ~np.isfinite(self._wrench)
        places = np.arange(len(bad))
        if bad.any():
            missing = np.isnan(self._wrench).all(axis=1, keepdims=True)
            partly = np.argwhere(bad & ~missing)
            if len(partly):
                sample, column = partly[0].tolist()
                value = self._wrench[sample, column]
                what = (
                    "is empty or NaN, where others of the row are not" if np.isnan(value) else f"is {value}"
                )
                wanted = "wanted a finite number, or a row that is empty in all axes"
                raise self._fault(f"{what}; {wanted}", sample, self._picked.axes[column])
            if missing.all():
                raise TableError("holds no samples: all rows are empty")
            places = np.flatnonzero(~missing)
            self.remarks["left_out"] = int(missing.sum())
            self._keep(places)
        if TIME in self._columns:
            clock = self._columns[TIME]
            try:
                return stamps_of(clock, self._picked.time_unit, self._stated.time_unit, rate_hz)
            except ClockError as error:
                if self._stated.rate_hz is None or IGNORED_OUT not in str(error):
                    raise
                said = str(error).partition(";")[0]
                self.remarks["remark"] = f"the clock was ignored: {rate_hz:g} Hz is stated, and {said}"
                self._columns = {what: cells for what, cells in self._columns.items() if what != TIME}
        if rate_hz is None or len(places) == int(places[-1] - places[0]) + 1:
            return None
        return Stamps((places - places[0]) / rate_hz, 0.0, 0.0)

    def _settled(
        self, stamps: Stamps | None, file_hz: float | None
    ) -> tuple[float | None, FloatArray | None, float | None]:
        """Return rate, stamps (one of the two is None) and when the first sample was taken, since 1970."""
        stated = self._stated
        if stamps is None:
            rate_hz = file_hz if stated.rate_hz is None else agreed_rate(stated.rate_hz, file_hz, self._name)
            if rate_hz is None or stated.irregular:
                raise TableError(self._no_clock())
            return rate_hz, None, None
        clock = self._columns.get(TIME)
        counted = stated.time_unit == "sample"  # then the rate makes the clock
        stated_hz = None if clock is None or counted else stated.rate_hz
        order = time_order(
            stamps.time_s, self._wrench, rate_stated=stated_hz is not None, repair=stated.repair
        )
        if order.n_moved or order.n_merged:
            self.remarks |= {"moved": order.n_moved, "merged": order.n_merged}
            self._keep(order.rows)
            flags = np.zeros(len(order.rows), np.uint8) if self._flags is None else self._flags
            self._flags = flags | order.touched.astype(np.uint8) * np.uint8(SampleFlag.TIME_REPAIRED)
            time_s = stamps.time_s[order.rows]
            stamps = replace(stamps, time_s=time_s - time_s[0], first_s=stamps.first_s + float(time_s[0]))
        counts = clock is not None and clock.dtype.kind in "iuf"
        rate_hz = None
        in_stretches = None if stated_hz is None else unpacked(stamps.time_s, stated_hz)
        if in_stretches is not None:
            stamps = replace(stamps, time_s=in_stretches)
            self.remarks["remark"] = f"the clock was ignored but for its pauses: {stated_hz:g} Hz is stated"
        elif not stated.irregular:
            said = (stated.rate_hz, file_hz, self._picked.time_unit, stated.time_unit)
            if counts and all(one is None for one in said):
                refuse_unlikely(stamps)
            rate_hz, remark = rate_of(stamps, stated_hz, file_hz)
            self.remarks |= {} if remark is None else {"remark": remark}
        first_s = None
        if stamps.first_s > SINCE_1970 and clock is not None and (counts or has_date(clock)):
            first_s = stamps.first_s
        elif stamps.first_s and stamps.first_s <= SINCE_1970:
            self.remarks["first_stamp_s"] = stamps.first_s
        return rate_hz, None if rate_hz is not None else stamps.time_s, first_s

    def _no_clock(self) -> str:
        clock = self._table.clock
        if self._stated.irregular:
            return f"has no {clock}, but is called irregular"
        counting = [
            name
            for name, cells in self._table.columns.items()
            if cells.dtype.kind in "iuf" and len(cells) > 2 and (np.diff(cells.astype(np.float64)) > 0).all()
        ]
        column = (
            f", or time= with the column that is the clock ({', '.join(counting)[:80]}?)" if counting else ""
        )
        return f"has no {clock} and no rate is stated; pass rate_hz= (--recorded-hz RATE){column}"

    def _rate_in_table(self) -> float | None:
        """Return the rate that the table, or a column of it, states."""
        of_table = self._table.rate_hz
        if RATE not in self._columns:
            return of_table
        name, unit = self._picked.called[RATE], self._picked.rate_unit
        rates = np.unique(numbers_of([self._columns[RATE]], [name]))
        scale = 1.0 if unit is None else factor(unit, "Hz")
        if scale is None:
            raise TableError(f"its unit is {unit!r:.40}; wanted Hz", column=name)
        if len(rates) > 1 and TIME in self._columns:
            return None  # it was measured; stamps tell the rate
        if len(rates) > 1 or not 0 < rates[0] < np.inf or of_table not in (None, rates[0] * scale):
            beside = "" if of_table is None else f", the table one of {of_table:g} Hz"
            problem = f"recording {self._name!r:.60} states the rates {rates[:5].tolist()}{beside}"
            raise TableError(f"{problem}; wanted one above 0", int(self._rows[0]), name)
        return float(rates[0] * scale)

    def _text(self, what: Text, meta: Mapping[str, Any]) -> str | None:
        """Return label or session: what is stated, else what the table says, else what holds where nothing does."""
        place = getattr(self._stated, f"{what}_from")
        if place is not None and place.startswith("meta:"):
            return text_in_meta(what, place, meta)
        if getattr(self._stated, what) is not None:
            return str(getattr(self._stated, what))
        own = getattr(self._table, what)
        column = self._picked.called.get(what)
        if what in self._columns:
            kinds = list(dict.fromkeys(texts_of(self._columns[what]).tolist()))
            if len(kinds) > 1:
                shown = ", ".join(f"{text!r:.30}" for text in kinds[:5])
                apart = (
                    "" if RECORDING in self._columns else f", or id={column!r} to take each as a recording"
                )
                problem = f"has {len(kinds)} values in one recording: {shown}; wanted one{apart}"
                raise TableError(problem, int(self._rows[0]), column)
            own = kinds[0] or own
        elif place is not None and own is None:
            raise TableError(f"{what}={place!r:.60}: there is no such column")
        if not own:
            found: str | None = getattr(self._stated, f"{what}_else")
            return found
        try:
            return checked_text(own, what, spaced=False)
        except ValueError as error:
            raise TableError(str(error), column=column) from None


def agreed_rate(stated_hz: float, own_hz: float | None, name: str) -> float:
    """Return the rate that is stated, or refuse another one of the file's own."""
    if own_hz not in (None, stated_hz):
        problem = (
            f"recording {name!r:.60} was sampled at {own_hz:g} Hz, but a rate of {stated_hz:g} Hz is stated"
        )
        raise TableError(f"{problem}; leave it out, then call .resample(rate_hz)")
    return stated_hz


def text_in_meta(what: str, place: str, meta: Mapping[str, Any]) -> str:
    """Return a text or number in metadata: ``meta:source.material``."""
    value: Any = meta
    for key in place.removeprefix("meta:").split("."):
        value = value.get(key) if isinstance(value, Mapping) else None
    if isinstance(value, (str, int, float)) and not isinstance(value, bool) and str(value).strip():
        return str(value).strip()
    known = ", ".join(map(str, meta)) or "none"
    raise TableError(f"{what}={place!r:.60} is no text or number in its metadata (there are: {known:.200})")


def restated(recording: Recording, stated: Stated) -> Recording:
    """Put onto a recording that is complete what is stated from outside; refuse what it contradicts."""
    changed: dict[str, Any] = {}
    if stated.rate_hz is not None and recording.rate_hz is not None:
        agreed_rate(stated.rate_hz, recording.rate_hz, recording.name)
    changed |= {
        name: value
        for name in ("start_time", "trigger_index")
        if (value := getattr(stated, name)) is not None
    }
    meta = {**thaw(recording.meta), **thaw(stated.meta)}
    for name in ("label", "session"):
        place, other = getattr(stated, f"{name}_from"), getattr(stated, f"{name}_else")
        if place is not None and not place.startswith("meta:"):
            problem = (
                f"{name}={place!r:.60}: a data set that granular-id wrote has no columns; wanted 'meta:PATH'"
            )
            raise TableError(problem)
        if place is not None:
            changed[name] = text_in_meta(name, place, meta)
        elif getattr(stated, name) is not None:
            changed[name] = getattr(stated, name)
        elif getattr(recording, name) is None and other is not None:
            changed[name] = other
    if stated.axes is not None or stated.units is not None:
        own = recording.meta.get("units")
        units = own if isinstance(own, Mapping) else {}
        picked = picked_columns(Table(values=recording.wrench, axes=recording.axes, units=units), stated)
        meta = {**meta, "units": picked.units} if picked.units or own else meta
        changed |= {"wrench": picked.wrench, "axes": picked.axes}
    if meta != recording.meta:
        changed["meta"] = meta
    try:
        return replace(recording, **changed) if changed else recording
    except (TypeError, ValueError) as error:
        raise TableError(str(error)) from error

"""``to_recordings``: the one place that settles axes, units, clock, label and session of a ``Table``.

Every format and every data frame becomes a `Table`, and passes here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, checked_text
from granular_id._text import alternatives, in_both
from granular_id.recording.clock import (
    SEVERAL,
    SINCE_1970,
    STATE_RATE,
    Stamps,
    has_date,
    rate_of,
    stamps_of,
    time_order,
    unpacked,
)
from granular_id.recording.columns import (
    ANEW,
    DECIMAL_COMMA,
    FLAGS,
    LABEL,
    RATE,
    RECORDING,
    SESSION,
    SESSION_NAMES,
    TIME,
    TableError,
    factor,
    meaning_of,
    mended,
    numbers_of,
)
from granular_id.recording.recording import (
    KNOWN_FLAGS,
    Recording,
    SampleFlag,
)
from granular_id.recording.table import Picked, Stated, Table, picked_columns
from granular_id.recording.unread import (
    MANY,
    changes_in,
    ids_in,
    ids_of_runs,
    label_columns,
    labels_of_ids,
    may_be_clock,
    refuse_counts_anew,
    run_columns,
    texts_of,
    ways_into_several,
)

_MOST_OFFERED = 3
_PAUSE = 50
"""Steps of a clock, of the usual length, in one pause between recordings."""

_THOUSANDS = 0.1
"""The part by which steps may be off a thousandth of those before."""


@dataclass
class Made:
    """What `to_recordings` made: recordings, a row for each with remarks, and notes on the whole table."""

    recordings: list[Recording] = field(default_factory=list)
    rows: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    may_be_labels: Mapping[str, list[str]] = field(default_factory=dict)
    """Columns that are not read, with their text of each recording, where nothing in the table says the labels."""

    may_be_sessions: dict[str, list[str]] = field(default_factory=dict)
    """Columns that are not read and called like days, with their text of each recording."""

    may_be_several: Sequence[Mapping[str, str]] = ()
    """Options that make several recordings of one without a label: the columns of labels and of ids."""

    may_be_ids: Sequence[str] = ()
    """Columns that are not read, called like runs and counting stretches of rows, where there is no id."""

    label_column: str | None = None

    label_mend: str = ""  # the method of a data frame that makes labels of the ids, where no column may be it

    @property
    def totals(self) -> dict[str, int]:
        """Figures over all recordings, for a report."""
        counts = {"left_out_samples": "left_out", "moved_samples": "moved", "merged_samples": "merged"}
        return {
            "recordings": len(self.recordings),
            "uniform": sum(one.rate_hz is not None for one in self.recordings),
            "irregular": sum(one.rate_hz is None for one in self.recordings),
            **{name: sum(row.get(key, 0) for row in self.rows) for name, key in counts.items()},
        }


def to_recordings(table: Table, stated: Stated) -> Made:
    """Make the recordings of a table, in the order in which they begin; a `TableError` names row and column."""
    picked = picked_columns(table, stated)
    parts = [(np.arange(len(picked.wrench)), table.name)]
    if RECORDING in picked.columns:
        parts = _parts(picked, table.name)
    made = Made(notes=picked.notes)
    if RECORDING not in picked.columns and TIME not in picked.columns:
        refuse_counts_anew(table, picked)
    if LABEL not in picked.columns and table.label is None:
        if len(table.columns) > len(picked.called):
            made.may_be_labels = label_columns(table.columns, picked, [rows for rows, _ in parts])
        if RECORDING in picked.columns:
            made.label_mend = labels_of_ids(picked)
        else:
            made.may_be_several = ways_into_several(table, picked)
    if SESSION not in picked.columns and table.session is None and len(table.columns) > len(picked.called):
        named = {name: cells for name, cells in table.columns.items() if SESSION_NAMES.fullmatch(name)}
        made.may_be_sessions = label_columns(named, picked, [rows for rows, _ in parts], SESSION_NAMES)
    if RECORDING not in picked.columns and LABEL not in dict(stated.columns):
        made.label_column = picked.called.get(LABEL)
        made.may_be_ids = ids_of_runs(table, picked)
    for rows, name in parts:
        part = _Part(table, stated, picked, rows, name)
        made.recordings.append(part.recording())
        made.rows += [{"name": name, **part.remarks}] if part.remarks else []
    return made


def _parts(picked: Picked, name: str) -> list[tuple[NDArray[np.intp], str]]:
    """Return the rows and the name of each recording: those with one id, and of these one label and one session."""
    texts = [texts_of(picked.columns[what]) for what in (RECORDING, LABEL, SESSION) if what in picked.columns]
    if (texts[0] == "").any():
        own = picked.called[RECORDING]
        mend = f".replace({{{own!r}: {{'': None}}}}).dropna(subset=[{own!r}])"
        row = int((texts[0] == "").argmax())
        raise TableError("the cell is empty", row, picked.called[RECORDING], mend=mend)
    found = np.unique(np.column_stack(texts), axis=0, return_index=True, return_inverse=True)
    firsts, codes = found[1], found[2].ravel()
    n_stretches = np.count_nonzero(np.diff(codes)) + 1
    if n_stretches > len(firsts) and (TIME not in picked.columns or len(codes) > MANY * n_stretches):
        own = picked.called[RECORDING]
        problem = (
            f"has the same value again behind others: {len(firsts)} recordings in {n_stretches} stretches of rows; "
            "where each stretch is a recording"
        )
        names = list(
            dict.fromkeys(
                picked.called[what] for what in (RECORDING, LABEL, SESSION) if what in picked.columns
            )
        )
        anew = f"(f[{names}] != f[{names}].shift()).any(axis=1)"
        if TIME in picked.columns and picked.columns[TIME].dtype.kind in "iuf":
            anew = f"({anew} | (f[{picked.called[TIME]!r}].ffill().diff() < 0))"
        mend = f".assign(**{{{_id_anew(own)!r}: lambda f: {anew}.cumsum()}})"
        raise TableError(problem, column=own, mend=mend)
    numbered = all(text.isdecimal() for text in dict.fromkeys(texts[0].tolist()))
    names = [f"{name}[{texts[0][first]}]" if numbered else str(texts[0][first]) for first in firsts]
    if len(set(names)) < len(names):  # trials are counted anew for each label or session
        names = [
            f"{one} ({', '.join(str(values[first]) for values in texts[1:] if values[first])})"
            for one, first in zip(names, firsts, strict=True)
        ]
    rows = np.split(np.argsort(codes, kind="stable"), np.cumsum(np.bincount(codes))[:-1])
    return [(rows[i], names[i]) for i in np.argsort(firsts, kind="stable").tolist()]


def _id_anew(name: str) -> str:
    """Return the column that ids made anew go into: the one that is found by its name, or another."""
    return name if meaning_of(name).what == RECORDING else "recording"


class _Part:
    """The rows of one recording on their way: `rows` says where each sample that stays is in the table."""

    def __init__(
        self, table: Table, stated: Stated, picked: Picked, rows: NDArray[np.intp], name: str
    ) -> None:
        self._table, self._stated, self._picked, self._name = table, stated, picked, name
        self._rows, self._wrench, self._columns = rows, picked.wrench, picked.columns
        self._flags: NDArray[np.uint8] | None = None
        self._trigger = stated.trigger_index
        self._places: NDArray[np.intp] | None = None  # of the samples, before empty rows were left out
        self.remarks: dict[str, Any] = {}
        if len(rows) < len(picked.wrench):  # all of one recording need not be copied
            self._wrench = picked.wrench[rows]
            self._columns = {what: cells[rows] for what, cells in picked.columns.items()}

    def recording(self) -> Recording:
        """Settle the clock and what is known of the recording."""
        if FLAGS in self._columns:
            flags = numbers_of({FLAGS: self._columns[FLAGS]}, [FLAGS])[:, 0]
            wrong = np.flatnonzero(~np.isin(flags, np.arange(KNOWN_FLAGS + 1)))
            if len(wrong):
                problem = f"{flags[wrong[0]]:g} is not a sum of SampleFlag bits (0 to {KNOWN_FLAGS})"
                raise TableError(problem, int(self._rows[wrong[0]]), self._picked.called[FLAGS])
            self._flags = flags.astype(np.uint8)
        file_hz = self._rate_in_table() if RATE in self._columns else self._table.rate_hz
        if not np.isfinite(self._wrench).all():
            self._leave_out_empty_rows()
        stamps = None
        try:
            stamps = self._stamps(file_hz)
            rate_hz, time_s, start_time = self._clock(stamps, file_hz)
        except TableError as error:
            row = None if error.row is None else int(self._rows[error.row])
            parts, mend = error.parts, error.mend.format(clock=self._picked.called.get(TIME))
            if SEVERAL in parts and stamps is not None:
                way, mend = self._ways_apart(set(np.flatnonzero(np.diff(stamps.time_s) < 0).tolist()))
                parts = (*parts, *way)
            raise TableError(parts, row, self._picked.called.get(TIME), mend=mend) from error
        units = {"units": self._picked.units} if self._picked.units else {}
        meta = {**units, **self._table.meta, **self._stated.meta}
        self._wrench.flags.writeable = False  # not copied, then
        known: dict[str, Any] = {
            "rate_hz": rate_hz,
            "time_s": time_s,
            "label": self._text("label", meta),
            "session": self._text("session", meta),
            "start_time": start_time if self._stated.start_time is None else self._stated.start_time,
            "trigger_index": self._trigger,
            "flags": self._flags,
        }
        try:
            return Recording(self._wrench, meta=meta, name=self._name, axes=self._picked.axes, **known)
        except (TypeError, ValueError) as error:
            raise TableError(str(error)) from error

    def _keep(self, samples: NDArray[np.intp]) -> None:
        """Keep some samples, in this order."""
        if self._trigger is not None and 0 <= self._trigger < len(self._wrench):
            here = np.flatnonzero(samples == self._trigger)
            here = here if len(here) else np.flatnonzero(samples > self._trigger)
            self._trigger = int(here[0]) if len(here) else len(samples) - 1
        self._wrench, self._rows = self._wrench[samples], self._rows[samples]
        self._columns = {what: cells[samples] for what, cells in self._columns.items()}
        self._flags = None if self._flags is None else self._flags[samples]

    def _leave_out_empty_rows(self) -> None:
        """Leave out samples that are empty in all axes; one that is empty in some is refused."""
        bad = ~np.isfinite(self._wrench)
        missing = np.isnan(self._wrench).all(axis=1, keepdims=True)
        partly = np.argwhere(bad & ~missing)
        if len(partly):
            sample, column = partly[0].tolist()
            value = self._wrench[sample, column]
            came = "is empty or NaN, where others of the row are not" if np.isnan(value) else f"is {value}"
            problem = f"{came}; wanted a finite number, or a row that is empty in all axes"
            names = [self._picked.called[axis] for axis in self._picked.axes]
            take_turns = 2 * len(np.unique(partly[:, 0])) > len(bad)
            mend = mended(names, fill=take_turns)
            raise TableError(problem, int(self._rows[sample]), names[column], mend=mend)
        if missing.all():
            raise TableError("holds no samples: all rows are empty")
        self.remarks["left_out"] = int(missing.sum())
        self._places = np.flatnonzero(~missing)
        self._keep(self._places)

    def _stamps(self, file_hz: float | None) -> Stamps | None:
        """Return the stamps of the samples, if there is a clock that must not be ignored, or samples are missing."""
        stated = self._stated
        rate_hz = file_hz if stated.rate_hz is None else stated.rate_hz
        if TIME in self._columns:
            try:
                return stamps_of(self._columns[TIME], self._picked.time_unit, stated.time_unit, rate_hz)
            except TableError as error:
                if self._table.csv is not None and DECIMAL_COMMA.fullmatch(str(self._columns[TIME][0])):
                    text = f"{str(self._columns[TIME][0])[:40]!r} is no number: pass "
                    raise TableError((text, in_both(csv={"decimal": ","})), 0) from None
                if stated.rate_hz is None or STATE_RATE not in error.parts:
                    raise
                reason = error.problem.partition(";")[0]
                self.remarks["remark"] = f"the clock was ignored: {rate_hz:g} Hz is stated, and {reason}"
                self._columns = {what: cells for what, cells in self._columns.items() if what != TIME}
        if rate_hz is None or self._places is None or (np.diff(self._places) == 1).all():
            return None
        return Stamps((self._places - self._places[0]) / rate_hz, 0.0, 0.0)

    def _clock(
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
        self._refuse_points_in_stamps(stamps)
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
            known = (stated.rate_hz, file_hz, self._picked.time_unit, stated.time_unit)
            doubtful = counts and all(one is None for one in known)
            rate_hz, remark = rate_of(stamps, stated_hz, file_hz, doubtful=doubtful)
            self.remarks |= {} if remark is None else {"remark": remark}
        first_s = None
        if stamps.first_s > SINCE_1970 and clock is not None and (counts or has_date(clock)):
            first_s = stamps.first_s
        elif stamps.first_s and stamps.first_s <= SINCE_1970:
            self.remarks["first_stamp_s"] = stamps.first_s
        return rate_hz, None if rate_hz is not None else stamps.time_s, first_s

    def _refuse_points_in_stamps(self, stamps: Stamps) -> None:
        """Refuse 999 and then 1.000 where a comma is the decimal mark: the point stands between thousands."""
        csv = self._table.csv or {}
        back = np.flatnonzero(np.diff(stamps.time_s) < 0)
        if csv.get("decimal") != "," or "thousands" in csv or not len(back):
            return
        around = stamps.time_s[max(0, back[0] - 1) : back[0] + 3]
        before, after = (np.diff(around)[[0, -1]]) if len(around) == 4 else (0.0, 0.0)
        if before > 0 and abs(1000 * after / before - 1) < _THOUSANDS:
            problem = "stamps run back, as points between thousands make them: pass "
            raise TableError((problem, in_both(csv={"thousands": "."})), int(back[0]) + 1)

    def _ways_apart(self, begins: set[int]) -> tuple[tuple[str, ...], str]:
        """Return the option that tells recordings apart whose clocks begin anew, or methods that do."""
        clock, label = self._columns[TIME], self._columns.get(LABEL)
        if clock.dtype.kind not in "iuf":
            ids = ids_in(self._table, self._picked, self._rows, begins)
            return (("; pass ", in_both(id=ids[0])) if ids else ()), ""
        known = set() if label is None else changes_in(label)
        others = {
            name: changes_in(cells[self._rows])
            for name, cells in self._table.columns.items()
            if name not in self._picked.called.values() and cells.dtype.kind in "iuOUT"
        }
        ids = [name for name, changes in others.items() if changes and changes | known == begins]
        days = [name for name in ids if SESSION_NAMES.fullmatch(name)]
        if RECORDING in self._columns and SESSION not in self._columns and days:
            # trials are counted anew each day
            return ("; pass ", in_both(session=f"column:{days[0]}")), ""
        ids = sorted(ids, key=days.__contains__) or ids_in(self._table, self._picked, self._rows, begins)
        beside = [texts_of(cells) for what, cells in self._columns.items() if what in (LABEL, SESSION)]
        ids = [
            name
            for name in ids
            if len(np.unique([texts_of(self._table.columns[name][self._rows]), *beside], axis=1).T)
            > len(begins)
        ]
        if not ids or RECORDING in self._columns:
            return (), ANEW.format(
                name=_id_anew(self._picked.called.get(RECORDING, "")),
                stamps=f"f[{self._picked.called[TIME]!r}]",
            )
        return ("; pass ", in_both(id=ids[0])), ""

    def _no_clock(self) -> list[str]:
        """Say that no rate is known, and which columns may be a clock."""
        clock = self._table.clock
        if self._stated.irregular:
            return [f"has no {clock}, but is called irregular"]
        counting = [
            name
            for name, cells in self._table.columns.items()
            if len(cells) > 2 and name not in self._picked.called.values() and may_be_clock(cells)
            if not re.search("nano|nsec", name, re.IGNORECASE)
        ]
        ways = [in_both(time=name) for name in counting[:_MOST_OFFERED]]
        columns = ["; if it is the clock pass ", *alternatives(ways)] if ways else []
        way: tuple[str, ...] = (STATE_RATE, ", the one in Hz")
        if self._table.rate_hint is not None:
            name, rate_hz = self._table.rate_hint
            way = (in_both(rate_hz=rate_hz), f", as {name!r:.60} has it")
        return [f"has no {clock} and no rate is stated; pass ", *way, *columns]

    def _rate_in_table(self) -> float | None:
        """Return the rate that a column of the table states."""
        name = self._picked.called[RATE]
        unit = self._table.units.get(name) or meaning_of(name).unit or "Hz"
        rates, scale = np.unique(numbers_of({name: self._columns[RATE]}, [name])), factor(unit, "Hz")
        if scale is None:
            raise TableError(f"its unit is {unit!r:.40}; wanted Hz", column=name)
        if len(rates) > 1 and TIME in self._columns:
            return None  # it was measured; stamps tell the rate
        if len(rates) > 1 or not 0 < rates[0] < np.inf:
            problem = f"recording {self._name!r:.60} states the rates {rates[:5].tolist()}"
            raise TableError(f"{problem}; wanted one above 0", int(self._rows[0]), name)
        return float(rates[0] * scale)

    def _text(self, what: Literal["label", "session"], meta: Mapping[str, Any]) -> str | None:
        """Return label or session: what is stated, else what the table says, else what holds where nothing does."""
        place, text = getattr(self._stated, f"{what}_from"), getattr(self._stated, what)
        column = None
        if place is not None:
            text = text_in_meta(what, place, meta)
        elif text is None:
            text, column = getattr(self._table, what), self._picked.called.get(what)
            if what in self._columns:
                kinds = list(dict.fromkeys(texts_of(self._columns[what]).tolist()))
                if len(kinds) > 1:
                    shown = ", ".join(f"{kind!r:.30}" for kind in kinds[:5])
                    problem, mend = [f"has {len(kinds)} values in one recording: {shown}; wanted one"], ""
                    begins = changes_in(self._columns[what])
                    ids = ids_in(self._table, self._picked, self._rows, begins)
                    ids = [
                        name for name in ids if changes_in(self._table.columns[name][self._rows]) != begins
                    ]
                    counts, stamps = run_columns(self._table, self._picked), self._columns.get(TIME)
                    is_clock = stamps is not None and stamps.dtype.kind in "iuf"
                    steps = np.diff(stamps) if stamps is not None and is_clock else np.array([])
                    has_pauses = bool(steps.size) and bool(steps.max() > _PAUSE * np.median(steps) > 0)
                    has_id = RECORDING in self._columns
                    if ids and not has_id:
                        problem += ["; to tell recordings apart pass ", in_both(id=ids[0])]
                    elif not has_id and (counts or has_pauses or len(begins) >= len(kinds)):
                        names = [column, *counts]
                        anew = f"(f[{names}] != f[{names}].shift()).any(axis=1)"
                        if has_pauses:
                            clock = self._picked.called[TIME]
                            anew = f"{anew} | (f[{clock!r}].diff() > {_PAUSE * np.median(steps):.3g})"
                        mend = f".assign(recording=lambda f: ({anew}).cumsum())"
                    elif not has_id:
                        problem += ["; to take each as a recording pass ", in_both(id=column)]
                    raise TableError(problem, int(self._rows[0]), column, mend=mend)
                text = kinds[0] or text
            elif what in dict(self._stated.columns) and text is None:
                wanted = dict(self._stated.columns)[what]
                raise TableError(f"{what}='column:{wanted:.60}': there is no such column")
            text = text or getattr(self._stated, f"{what}_else")
        try:
            return None if text is None else checked_text(text, what, spaced=False)
        except ValueError as error:
            raise TableError(str(error), column=column) from None


def agreed_rate(stated_hz: float, own_hz: float | None, name: str) -> float:
    """Return the rate that is stated, or refuse another one of the file's own."""
    if own_hz not in (None, stated_hz):
        problem = f"was sampled at {own_hz:g} Hz, but a rate of {stated_hz:g} Hz is stated"
        raise TableError(f"recording {name!r:.60} {problem}; leave it out, then call .resample(rate_hz)")
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
    if stated.rate_hz is not None and recording.rate_hz is not None:
        agreed_rate(stated.rate_hz, recording.rate_hz, recording.name)
    changed = {name: getattr(stated, name) for name in ("start_time", "trigger_index", "label", "session")}
    # how the file was read is known already, and these options did not read it
    meta = {**recording.meta, **{key: value for key, value in stated.meta.items() if key != "read_as"}}
    for name in ("label", "session"):
        place, other = getattr(stated, f"{name}_from"), getattr(stated, f"{name}_else")
        if name in dict(stated.columns):
            problem = "a data set that granular-id wrote has no columns; wanted 'meta:PATH'"
            raise TableError(f"{name}='column:{dict(stated.columns)[name]:.60}': {problem}")
        if place is not None:
            changed[name] = text_in_meta(name, place, meta)
        elif changed[name] is None and getattr(recording, name) is None:
            changed[name] = other
    if stated.axes is not None or stated.units is not None:
        own = recording.meta.get("units")
        units = own if isinstance(own, Mapping) else {}
        picked = picked_columns(Table(values=recording.wrench, axes=recording.axes, units=units), stated)
        meta = {**meta, "units": picked.units} if picked.units or own else meta
        changed |= {"wrench": picked.wrench, "axes": picked.axes}
    changed = {name: value for name, value in changed.items() if value is not None}
    if meta != recording.meta:
        changed["meta"] = meta
    try:
        return replace(recording, **changed) if changed else recording
    except (TypeError, ValueError) as error:
        raise TableError(str(error)) from error

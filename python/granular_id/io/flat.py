"""A data set as a few flat arrays, and back: what NPZ and Parquet files hold.

The samples of all recordings stand one after the other in one array; everything else is one value per recording.
Reading checks whole columns at once, so that it costs little more than reading the bytes.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, all_finite, as_floats, checked_text, freeze, thaw
from granular_id.io.errors import RecordingFileError
from granular_id.io.files import check_parts
from granular_id.io.folder_save import checked_dataset, history_json
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import KNOWN_FLAGS, Dataset, Recording, StepReport, checked_axes, shared_base

NUMBERS = ("n_samples", "rate_hz", "start_time", "trigger_index")
TEXTS = ("label", "session", "name")
OPTIONAL = ("time_s", "flags")
"""Columns beside ``wrench``: numbers and texts per recording; what stands per sample only where it is needed."""

SAMPLES = ("wrench", *OPTIONAL)


@dataclass(frozen=True)
class FlatRecordings:
    """The columns of a data set of n recordings with N samples in all; from a file, unchecked until `unflatten`."""

    axes: Sequence[str]  # names of the C columns of `wrench`
    wrench: FloatArray  # (N, C): all samples, recording after recording; fx fy fz in N, tx ty tz in N m
    n_samples: NDArray[np.int64]  # (n,): they add up to N
    rate_hz: FloatArray  # (n,): NaN for irregular recordings
    start_time: FloatArray  # (n,): of the first samples, seconds since 1970; NaN where unknown
    trigger_index: NDArray[np.int64]  # (n,): sample at which the motion began; -1 where unknown
    label: Sequence[str | None]
    session: Sequence[str | None]
    name: Sequence[str | None]
    meta_json: Sequence[str | None]  # JSON objects; None for an empty one
    time_s: FloatArray | None = None  # (N,): seconds from the first sample of each; NaN in uniform recordings
    flags: NDArray[np.uint8] | None = None  # (N,): bits of `SampleFlag`
    history_json: str = "[]"  # a list of what `StepReport.to_dict` gives

    @property
    def texts(self) -> dict[str, list[str]]:
        """The columns `TEXTS`, with an empty text for None."""
        return {name: [text or "" for text in getattr(self, name)] for name in TEXTS}

    @property
    def meta_lines(self) -> str:
        """All metadata as one text, a line per recording: a column of fixed width would be as wide as the longest."""
        return "\n".join(text or "{}" for text in self.meta_json)


def flatten(dataset: Dataset) -> FlatRecordings:
    """Put a data set into flat columns, every bit kept."""
    recordings = checked_dataset(dataset).recordings
    triggers = [r.trigger_index for r in recordings]
    wrench, time_s, flags = flat_samples(recordings)
    return FlatRecordings(
        axes=dataset.axes,
        wrench=wrench,
        n_samples=np.array([r.n_samples for r in recordings], np.int64),
        rate_hz=_floats(r.rate_hz for r in recordings),
        start_time=_floats(r.start_time for r in recordings),
        trigger_index=np.array([NO_TRIGGER if i is None else i for i in triggers], np.int64),
        label=[r.label for r in recordings],
        session=[r.session for r in recordings],
        name=[r.name for r in recordings],
        meta_json=[json.dumps(thaw(r.meta)) if r.meta else None for r in recordings],
        time_s=time_s,
        flags=flags,
        history_json=history_json(dataset),
    )


def flat_samples(
    recordings: Sequence[Recording],
) -> tuple[FloatArray, FloatArray | None, NDArray[np.uint8] | None]:
    """Return wrench, stamps and flags of all samples; None where no recording has any."""
    time_s = flags = None
    if not all(r.is_uniform for r in recordings):
        time_s = np.concatenate(
            [np.full(r.n_samples, np.nan) if r.time_s is None else r.time_s for r in recordings]
        )
    if any(r.flags is not None for r in recordings):
        flags = np.concatenate(
            [np.zeros(r.n_samples, np.uint8) if r.flags is None else r.flags for r in recordings]
        )
    return joined([r.wrench for r in recordings]), time_s, flags


def unflatten(flat: FlatRecordings, path: Path, source: FileSource, *, finite: bool = False) -> FileContent:
    """Check flat columns that came from a file, and make recordings of them.

    The recordings are views of ``flat.wrench``, ``flat.time_s`` and ``flat.flags``, which become read-only.
    """
    try:
        recordings = _recordings(_stated(flat, source), source.name, finite)
        history = checked_history(flat.history_json, len(recordings))
    except (TypeError, ValueError) as error:
        raise RecordingFileError(path, str(error)) from error
    return FileContent(recordings=recordings, rows=[], notes=[], history=history)


@dataclass
class Leaf:
    """An array of a file, read when it is wanted and then kept: texts and numbers are looked at several times."""

    place: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    values: Callable[[], NDArray[Any]]
    _kept: NDArray[Any] | None = None

    def read(self) -> NDArray[Any]:
        """Return its values."""
        if self._kept is None:
            self._kept = self.values()
        return self._kept


def plain_texts(array: NDArray[Any]) -> list[str] | None:
    """Return the texts of an array of shape (n,) and kind U or S (UTF-8); None where one of them is no text."""
    if array.dtype.kind == "S":
        try:
            return [item.decode("utf-8") for item in array.tolist()]
        except UnicodeDecodeError:
            return None
    codes = np.ascontiguousarray(array).view(np.dtype(np.uint32).newbyteorder(array.dtype.byteorder))
    if codes.max(initial=0) > sys.maxunicode:  # no character: numpy would raise a SystemError over it
        return None
    return [str(item) for item in array.tolist()]


def _recordings(flat: FlatRecordings, source_name: str, finite: bool) -> list[Recording]:
    wrench = as_floats(flat.wrench, "column wrench", "a real array of shape (N, C)")
    if wrench.ndim != 2 or not wrench.size:
        raise ValueError(
            f"column wrench has shape {wrench.shape}; wanted (N, C): the samples of all recordings, C axes"
        )
    axes = checked_axes(tuple(flat.axes), wrench.shape)
    lengths = checked_lengths(flat.n_samples, len(wrench))
    n = len(lengths)
    named = _named(checked_texts(flat.name, "name", n, empty=True), source_name)
    rows = Rows(named, lengths)
    if not finite and not all_finite(wrench):
        rows.refuse(wrench, ~np.isfinite(wrench), "wrench", "finite numbers")
    rates = checked_rates(flat.rate_hz, rows)
    irregular = np.array([rate is None for rate in rates])
    times = checked_times(flat.time_s, irregular, rows)
    flags, flagged = checked_flags(flat.flags, rows)
    for array in (wrench, times, flags):
        if array is not None:
            array.flags.writeable = False
    spans = [slice(start, end) for start, end in zip(rows.starts.tolist(), rows.ends.tolist(), strict=True)]
    columns: dict[str, Iterable[Any]] = {
        "wrench": map(wrench.__getitem__, spans),
        "rate_hz": rates,
        "label": checked_texts(flat.label, "label", n),
        "session": checked_texts(flat.session, "session", n),
        "start_time": checked_start_times(flat.start_time, rows),
        "trigger_index": checked_triggers(flat.trigger_index, rows),
        "time_s": _views(times, spans, irregular),
        "meta": checked_metas(flat.meta_json, n),
        "flags": _views(flags, spans, flagged),
        "name": named,
        "axes": repeat(axes, n),
    }
    return Recording._trusted_rows(columns)


def _named(names: Sequence[str | None], source_name: str) -> list[str]:
    """Give those a name that have none: that of the file, and which one of it they are where it has several."""
    if len(names) == 1:
        return [source_name if names[0] is None else names[0]]
    return [f"{source_name}[{i}]" if name is None else name for i, name in enumerate(names)]


def _views(
    array: NDArray[Any] | None, spans: Sequence[slice], wanted: NDArray[np.bool_]
) -> Iterable[NDArray[Any] | None]:
    """Return the part of an array per recording, None for recordings that have none."""
    if array is None:
        return repeat(None, len(spans))
    return [array[span] if has else None for span, has in zip(spans, wanted.tolist(), strict=True)]


def _floats(values: Iterable[float | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], np.float64)


def _stated(flat: FlatRecordings, source: FileSource) -> FlatRecordings:
    """Put in place of what a file of one recording says what is stated from outside."""
    stated: dict[str, Any] = {
        name: np.array([getattr(source, name)])
        for name in ("start_time", "trigger_index")
        if getattr(source, name) is not None
    }
    return replace(flat, **stated) if stated and len(flat.n_samples) == 1 else flat


def joined(parts: Sequence[FloatArray]) -> FloatArray:
    """Put arrays (T, C) one below the other: without a copy where they lie so in memory already."""
    base = shared_base(parts)
    if base is not None:
        return base.reshape(-1, parts[0].shape[1])
    whole = np.empty((sum(map(len, parts)), parts[0].shape[1]))
    # without out=, column-major parts give a column-major whole, which has to be copied once more
    return np.concatenate(parts, out=whole)


# Checks of flat columns: each over all recordings at once, naming the recording that spoils it.

NO_TRIGGER = -1
"""What stands in ``trigger_index`` where a recording has none."""


class Rows:
    """Which rows of the flat arrays belong to which recording."""

    def __init__(self, names: Sequence[str], lengths: NDArray[np.int64]) -> None:
        self.names = names
        self.lengths = lengths
        self.ends = np.cumsum(lengths)
        self.starts = self.ends - lengths

    def __len__(self) -> int:
        return len(self.lengths)

    def refuse(self, values: NDArray[Any], bad: NDArray[np.bool_], name: str, wanted: str) -> None:
        """Raise ValueError for the first bad value of an array that has a row per sample, or one per recording."""
        if not bad.any():
            return
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        i, sample = first[0], ""
        if len(values) == self.ends[-1]:
            i = int(np.searchsorted(self.ends, first[0], side="right"))
            sample = f", sample {first[0] - int(self.starts[i])}"
        place = f"{', '.join(map(str, first))}] (recording {i} ({self.names[i][:60]!r}){sample})"
        raise ValueError(f"column {name}[{place} is {values[first]}; wanted {wanted}")


def checked_lengths(value: object, n_rows: int) -> NDArray[np.int64]:
    """Return how many samples each recording has: at least one, `n_rows` in all."""
    lengths: NDArray[np.int64] = _whole(value, "n_samples", None).astype(np.int64)
    wrong = np.flatnonzero((lengths < 1) | (lengths > n_rows))
    if len(wrong):
        raise ValueError(f"column n_samples[{wrong[0]}] is {lengths[wrong[0]]}; wanted 1 to {n_rows}")
    total = sum(lengths.tolist())  # whole numbers of Python cannot overflow
    if total != n_rows:
        raise ValueError(f"column n_samples adds up to {total}, but wrench has {n_rows} samples")
    return lengths


def checked_rates(value: object, rows: Rows) -> list[float | None]:
    """Return the sampling rates, Hz; None (NaN in the file) where a recording is irregular."""
    rates = _checked_floats(value, "rate_hz", len(rows))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        endless = ~np.isfinite(rows.lengths / rates)  # at a rate of 0, too, or a tiny one
    bad = ~np.isnan(rates) & (endless | (rates <= 0) | np.isinf(rates))
    rows.refuse(rates, bad, "rate_hz", "a positive rate in Hz, or NaN for stamps in time_s")
    return _none_for_nan(rates)


def checked_start_times(value: object, rows: Rows) -> list[float | None]:
    """Return the times of the first samples; None (NaN in the file) where they are unknown."""
    times = _checked_floats(value, "start_time", len(rows))
    rows.refuse(times, np.isinf(times), "start_time", "seconds since 1970, or NaN where unknown")
    return _none_for_nan(times)


def checked_triggers(value: object, rows: Rows) -> list[int | None]:
    """Return the samples at which the motion began; None (-1 in the file) where that is unknown."""
    triggers = _whole(value, "trigger_index", len(rows))
    bad = (triggers < NO_TRIGGER) | (triggers >= rows.lengths)
    rows.refuse(triggers, bad, "trigger_index", f"a sample of that recording, or {NO_TRIGGER} for none")
    return [None if trigger == NO_TRIGGER else trigger for trigger in triggers.tolist()]


def checked_times(value: object, irregular: NDArray[np.bool_], rows: Rows) -> FloatArray | None:
    """Return the stamps, NaN in uniform recordings; None where all recordings are uniform."""
    if value is None:
        if irregular.any():
            raise ValueError(
                f"recording {np.flatnonzero(irregular)[0]} has no rate (NaN), and there are no stamps in time_s"
            )
        return None
    times = _checked_floats(value, "time_s", int(rows.ends[-1]))
    stamped = np.repeat(irregular, rows.lengths)
    rows.refuse(times, ~stamped & ~np.isnan(times), "time_s", "NaN: this recording has a rate")
    rows.refuse(times, stamped & ~np.isfinite(times), "time_s", "a stamp: this recording has no rate")
    begins = np.zeros(len(times), bool)
    begins[rows.starts] = True
    rows.refuse(times, stamped & begins & (times != 0), "time_s", "0: seconds from the first sample")
    with np.errstate(invalid="ignore"):
        late = np.concatenate([[False], times[1:] <= times[:-1]])
    rows.refuse(times, stamped & ~begins & late, "time_s", "stamps that increase")
    return times + 0.0 if irregular.any() else None  # + 0.0: a first stamp of -0.0 becomes 0.0


def checked_flags(value: object, rows: Rows) -> tuple[NDArray[np.uint8] | None, NDArray[np.bool_]]:
    """Return the flags of all samples, and which recordings have any."""
    if value is None:
        return None, np.zeros(len(rows), bool)
    flags = _whole(value, "flags", int(rows.ends[-1]))
    rows.refuse(
        flags, (flags < 0) | (flags > KNOWN_FLAGS), "flags", f"bits of SampleFlag (0 to {KNOWN_FLAGS})"
    )
    return flags.astype(np.uint8), np.logical_or.reduceat(flags, rows.starts)


def checked_texts(values: object, name: str, n: int, *, empty: bool = False) -> list[str | None]:
    """Return n texts without control characters, or None; labels and sessions are neither empty nor spaced."""
    texts = _listed(values, name, n)
    sound: set[str | None] = {None}
    for i, text in enumerate(texts):
        if text not in sound:
            sound.add(checked_text(text, f"{name}[{i}]", empty=empty, spaced=empty))
    return list(texts)


def checked_metas(values: object, n: int) -> list[Any]:
    """Return n frozen trees, one per JSON object; an empty one for None."""
    known: dict[object, Any] = {None: freeze({}, "meta")}
    texts = _listed(values, "meta", n)
    check_parts((text for text in set(texts) if text is not None), "meta", n)
    for i, text in enumerate(texts):
        if text not in known:
            known[text] = _frozen_json(text, f"meta[{i}]", dict)
    return [known[text] for text in texts]


def checked_history(text: object, n_recordings: int) -> tuple[StepReport, ...]:
    """Return the steps that a JSON list describes."""
    if isinstance(text, str):
        check_parts([text], "history", n_recordings)
    steps = _frozen_json(text, "history", list)
    try:
        return tuple(map(StepReport.from_dict, steps))
    except (TypeError, ValueError) as error:
        raise ValueError(f"history: {error}") from error


def _frozen_json(text: object, name: str, kind: type) -> Any:
    if not isinstance(text, str):
        raise TypeError(f"{name} is a {type(text).__name__}; wanted JSON text")
    try:
        value = json.loads(text)
        if isinstance(value, kind):
            return freeze(value, name)
    except RecursionError as error:
        raise ValueError(f"{name} is nested too deeply") from error
    except json.JSONDecodeError as error:
        raise ValueError(f"{name} is not JSON: {error}") from error
    raise TypeError(f"{name} is a JSON {type(value).__name__}; wanted a {kind.__name__}")


def _listed(values: object, name: str, n: int) -> Sequence[Any]:
    if not isinstance(values, (list, tuple)) or not set(map(type, values)) <= {str, type(None)}:
        raise TypeError(f"{name} must be a list of texts, got {values!r:.80}")
    if len(values) != n:
        raise ValueError(f"{name} has {len(values)} values for {n} recordings")
    return values


def _checked_floats(value: object, name: str, n: int) -> FloatArray:
    array = as_floats(value, f"column {name}", f"a real array of shape ({n},)")
    if array.shape != (n,):
        raise ValueError(f"column {name} has shape {array.shape}; wanted ({n},)")
    return array


def _whole(value: object, name: str, n: int | None) -> NDArray[Any]:
    """Return whole numbers; those past int64, which would change their sign, become the largest one."""
    array = np.asarray(value)
    if array.dtype.kind not in "iu":
        raise TypeError(f"column {name} has dtype {array.dtype}; wanted whole numbers")
    if array.shape != (array.size if n is None else n,):
        raise ValueError(f"column {name} has shape {array.shape}; wanted ({'n' if n is None else n},)")
    if array.dtype == np.uint64:
        array = np.minimum(array, np.uint64(np.iinfo(np.int64).max)).astype(np.int64)
    return array


def _none_for_nan(values: FloatArray) -> list[float | None]:
    return [None if value != value else value for value in values.tolist()]  # noqa: PLR0124 (NaN)

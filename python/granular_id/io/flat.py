"""A data set as a few flat arrays, and back: what NPZ, HDF5 and Parquet files hold.

The samples of all recordings stand one after the other in one array; everything else is one value per recording.
Reading checks whole columns at once, so that it costs little more than reading the bytes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, as_floats, thaw
from granular_id.io.bulk import all_finite
from granular_id.io.errors import RecordingFileError
from granular_id.io.flat_checks import (
    NO_TRIGGER,
    Rows,
    checked_flags,
    checked_history,
    checked_lengths,
    checked_metas,
    checked_rates,
    checked_start_times,
    checked_texts,
    checked_times,
    checked_triggers,
)
from granular_id.io.folder_save import checked_dataset, history_json
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import Dataset, Recording, checked_axes, shared_base

RECORDING_BYTES = 1024
"""What a recording costs in memory beside its samples; counted before a file of a million empty ones is read."""

FORMAT, VERSION = "granular_id recordings", 1
"""What files of flat columns call themselves."""

NUMBERS = ("n_samples", "rate_hz", "start_time", "trigger_index")
TEXTS = ("label", "session", "name")
OPTIONAL = ("time_s", "flags")
"""Columns beside ``wrench``: numbers and texts per recording; what stands per sample only where it is needed."""


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

    @classmethod
    def of_texts(
        cls,
        axes: Sequence[str],
        texts: Mapping[str, Sequence[str]],
        meta_lines: str,
        history_json: str,
        columns: Mapping[str, Any],
    ) -> FlatRecordings:
        """Make the columns of a file whose texts cannot be None; see `texts` and `meta_lines`."""
        return cls(
            axes=tuple(axes),
            label=[text or None for text in texts["label"]],
            session=[text or None for text in texts["session"]],
            name=texts["name"],
            meta_json=[None if line == "{}" else line for line in meta_lines.split("\n")],
            history_json=history_json,
            **columns,
        )

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
    time_s = flags = None
    if not all(r.is_uniform for r in recordings):
        time_s = np.concatenate(
            [np.full(r.n_samples, np.nan) if r.time_s is None else r.time_s for r in recordings]
        )
    if any(r.flags is not None for r in recordings):
        flags = np.concatenate(
            [np.zeros(r.n_samples, np.uint8) if r.flags is None else r.flags for r in recordings]
        )
    return FlatRecordings(
        axes=dataset.axes,
        wrench=joined([r.wrench for r in recordings]),
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

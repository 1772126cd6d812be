"""A data set as a few flat arrays, and back: what NPZ files and archives hold.

The samples of all recordings stand one after the other in one array; everything else is one value per recording.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, as_floats, thaw
from granular_id._core import GranularIdError
from granular_id.io.files import RecordingFileError
from granular_id.io.source import FileContent, FileSource
from granular_id.recording import Dataset, Recording, StepReport, checked_axes, shared_base

NUMBERS = ("n_samples", "rate_hz", "start_time", "trigger_index")
TEXTS = ("label", "session", "name")
OPTIONAL = ("time_s", "flags")
"""Columns beside ``wrench``: numbers and texts per recording; what stands per sample only where it is needed."""

NO_TRIGGER = -1
"""What stands in ``trigger_index`` where a recording has none."""


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
    return _joined([r.wrench for r in recordings]), time_s, flags


def unflatten(flat: FlatRecordings, path: Path, source: FileSource) -> FileContent:
    """Make recordings of flat columns that came from a file; they are views, which become read-only."""
    try:
        recordings = _recordings(flat, source.name)
        history = checked_history(flat.history_json)
    except (TypeError, ValueError) as error:
        raise RecordingFileError(path, str(error)) from error
    return FileContent(recordings=recordings, history=history)


def _recordings(flat: FlatRecordings, source_name: str) -> list[Recording]:
    wrench = as_floats(flat.wrench, "column wrench", "a real array of shape (N, C)")
    if wrench.ndim != 2 or not wrench.size:
        came = f"column wrench has shape {wrench.shape}"
        raise GranularIdError(f"{came}; wanted (N, C): the samples of all recordings, C axes")
    axes = checked_axes(tuple(flat.axes), wrench.shape)
    lengths = _lengths(flat.n_samples, len(wrench))
    n = len(lengths)
    columns = {name: _column(getattr(flat, name), name, n) for name in (*NUMBERS[1:], *TEXTS, "meta_json")}
    times: Any
    flags: Any
    times, flags = (None if one is None else np.asarray(one) for one in (flat.time_s, flat.flags))
    for name, array in (("wrench", wrench), ("time_s", times), ("flags", flags)):
        if array is not None:
            if len(array) != len(wrench):
                problem = f"column {name} has {len(array)} values for {len(wrench)} samples"
                raise GranularIdError(problem)
            array.flags.writeable = False
            if isinstance(array.base, np.ndarray):  # else each recording is copied
                array.base.flags.writeable = False
    metas: dict[str | None, Any] = {}
    found: list[Recording] = []
    for i, end in enumerate(np.cumsum(lengths).tolist()):
        here = slice(end - int(lengths[i]), end)
        about = {name: values[i] for name, values in columns.items()}
        name = (
            about["name"] if about["name"] is not None else source_name if n == 1 else f"{source_name}[{i}]"
        )
        text = about["meta_json"]
        own = None if times is None else times[here]
        known = text in metas
        try:
            recording = Recording(
                wrench[here],
                rate_hz=_known(about["rate_hz"]),
                label=about["label"],
                session=about["session"],
                start_time=_known(about["start_time"]),
                trigger_index=None if about["trigger_index"] == NO_TRIGGER else about["trigger_index"],
                time_s=None if own is None or np.isnan(own).all() else own,
                meta={} if known or text is None else _json(text, "meta", dict),
                flags=None if flags is None or not flags[here].any() else flags[here],
                name=name,
                axes=axes,
            )
        except (TypeError, ValueError, RecursionError) as error:
            kind = TypeError if isinstance(error, TypeError) else ValueError
            what = "meta is nested too deeply" if isinstance(error, RecursionError) else error
            raise kind(f"recording {i} ({name[:60]!r}): {what}") from error
        if known:  # equal metadata are held once
            recording = Recording._trusted(**{**vars(recording), "meta": metas[text]})
        metas.setdefault(text, recording.meta)
        found.append(recording)
    return found


def _known(number: Any) -> Any:
    """Return a number, None for NaN."""
    return None if number != number else number  # noqa: PLR0124


def _lengths(value: Any, n_rows: int) -> NDArray[np.int64]:
    """Return how many samples each recording has: at least one, `n_rows` in all."""
    array = np.asarray(value)
    if array.dtype.kind not in "iu" or array.ndim != 1:
        came = f"dtype {array.dtype} and shape {array.shape}"
        raise TypeError(f"column n_samples has {came}; wanted whole numbers (n,)")
    wrong = np.flatnonzero((array < 1) | (array > n_rows))
    if len(wrong):
        raise GranularIdError(f"column n_samples[{wrong[0]}] is {array[wrong[0]]}; wanted 1 to {n_rows}")
    total = sum(array.tolist())  # whole numbers of Python cannot overflow
    if total != n_rows:
        raise GranularIdError(f"column n_samples adds up to {total}, but wrench has {n_rows} samples")
    return array.astype(np.int64)


def _column(values: Any, name: str, n: int) -> Any:
    """Return a column of one value per recording."""
    listed = values.tolist() if isinstance(values, np.ndarray) else values
    if not isinstance(listed, (list, tuple)) or len(listed) != n:
        came = len(listed) if hasattr(listed, "__len__") else "no"
        raise GranularIdError(f"column {name.removesuffix('_json')} has {came} values for {n} recordings")
    return listed


def checked_dataset(dataset: object) -> Dataset:
    """Return a data set, or say that it is none."""
    if not isinstance(dataset, Dataset):
        raise TypeError(f"dataset must be a Dataset, got {type(dataset).__name__}")
    return dataset


def history_json(dataset: Dataset) -> str:
    """Return the steps that made a data set as one JSON text."""
    return json.dumps([step.to_dict() for step in dataset.history])


def checked_history(text: object) -> tuple[StepReport, ...]:
    """Return the steps that a JSON list describes."""
    steps = _json(text, "history", list)
    try:
        return tuple(map(StepReport.from_dict, steps))
    except (TypeError, ValueError, RecursionError) as error:
        raise GranularIdError(f"history: {error}") from error


def _json(text: object, name: str, kind: type) -> Any:
    if not isinstance(text, str):
        raise TypeError(f"{name} is a {type(text).__name__}; wanted JSON text")
    try:
        value = json.loads(text)
    except RecursionError as error:
        raise GranularIdError(f"{name} is nested too deeply") from error
    except json.JSONDecodeError as error:
        raise GranularIdError(f"{name} is not JSON: {error}") from error
    if not isinstance(value, kind):
        raise TypeError(f"{name} is a JSON {type(value).__name__}; wanted a {kind.__name__}")
    return value


def _floats(values: Iterable[float | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], np.float64)


def _joined(parts: Sequence[FloatArray]) -> FloatArray:
    """Put arrays (T, C) one below the other: without a copy where they lie so in memory already."""
    base = shared_base(parts)
    if base is not None:
        return base.reshape(-1, parts[0].shape[1])
    whole = np.empty((sum(map(len, parts)), parts[0].shape[1]))
    # without out=, column-major parts give a column-major whole, which has to be copied once more
    return np.concatenate(parts, out=whole)

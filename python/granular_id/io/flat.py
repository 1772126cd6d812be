"""A data set as a few flat columns, and back: what NPZ files and archives hold.

The samples of all n recordings stand one after the other, N in all; everything else is one value per recording:

- ``axes``: names of the C columns of ``wrench`` (N, C), float64; fx fy fz in N, tx ty tz in N m
- ``n_samples`` (n,): they add up to N; ``rate_hz`` (n,): NaN for irregular recordings; ``start_time`` (n,): of the
  first samples, seconds since 1970, NaN where unknown; ``trigger_index`` (n,): where the motion began, else -1
- ``label``, ``session``, ``name``: n texts, empty where unknown
- ``meta``: one text, a JSON object a line (a column of fixed width would be as wide as the longest); ``history``: a
  JSON list of what ``StepReport.to_dict`` gives
- only where needed: ``time_s`` (N,): seconds from the first sample of each, NaN in uniform recordings; ``flags`` (N,):
  uint8, bits of `SampleFlag`
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, as_floats, thaw
from granular_id._core import GranularIdError
from granular_id.io.files import RecordingFileError
from granular_id.io.source import FileContent
from granular_id.recording import Dataset, Recording, StepReport, checked_axes, shared_base

NUMBERS = ("n_samples", "rate_hz", "start_time", "trigger_index")
TEXTS = ("label", "session", "name")
OPTIONAL = ("time_s", "flags")

NO_TRIGGER = -1
"""What stands in ``trigger_index`` where a recording has none."""


def flatten(dataset: Dataset) -> dict[str, Any]:
    """Put a data set into flat columns, with every bit."""
    recordings = checked_dataset(dataset).recordings
    triggers = [r.trigger_index for r in recordings]
    wrench, time_s, flags = flat_samples(recordings)
    columns = {
        "axes": dataset.axes,
        "wrench": wrench,
        "n_samples": np.array([r.n_samples for r in recordings], np.int64),
        "rate_hz": _floats(r.rate_hz for r in recordings),
        "start_time": _floats(r.start_time for r in recordings),
        "trigger_index": np.array([NO_TRIGGER if i is None else i for i in triggers], np.int64),
        **{name: [getattr(r, name) or "" for r in recordings] for name in TEXTS},
        "meta": "\n".join(json.dumps(thaw(r.meta)) for r in recordings),
        "history": history_json(dataset),
        "time_s": time_s,
        "flags": flags,
    }
    return {name: values for name, values in columns.items() if values is not None}


def flat_samples(
    recordings: Sequence[Recording],
) -> tuple[FloatArray, FloatArray | None, NDArray[np.uint8] | None]:
    """Return wrench, stamps and flags of all samples; None where no recording has any."""
    time_s = flags = None
    if any(r.rate_hz is None for r in recordings):
        time_s = np.concatenate(
            [np.full(r.n_samples, np.nan) if r.time_s is None else r.time_s for r in recordings]
        )
    if any(r.flags is not None for r in recordings):
        flags = np.concatenate(
            [np.zeros(r.n_samples, np.uint8) if r.flags is None else r.flags for r in recordings]
        )
    return _joined([r.wrench for r in recordings]), time_s, flags


def unflatten(columns: Mapping[str, Any], path: Path) -> FileContent:
    """Make recordings of flat columns that came from a file; they are views, which become read-only."""
    try:
        return FileContent(recordings=_recordings(columns), history=checked_history(columns["history"]))
    except (TypeError, ValueError) as error:
        raise RecordingFileError(path, str(error)) from error


def _recordings(columns: Mapping[str, Any]) -> list[Recording]:
    wrench = as_floats(columns["wrench"], "column wrench", "a real array of shape (N, C)")
    if wrench.ndim != 2 or not wrench.size:
        came = f"column wrench has shape {wrench.shape}"
        raise GranularIdError(f"{came}; wanted (N, C): the samples of all recordings, C axes")
    axes = checked_axes(tuple(columns["axes"]), wrench.shape)
    lengths = _lengths(columns["n_samples"], len(wrench))
    each = {name: list(columns[name]) for name in TEXTS} | {"meta": columns["meta"].split("\n")}
    each |= {name: np.asarray(columns[name]).tolist() for name in NUMBERS[1:]}
    times, flags = (columns.get(name) for name in OPTIONAL)
    of_samples = {"wrench": wrench, "time_s": times, "flags": flags}
    sizes = {name: (len(values), len(lengths)) for name, values in each.items()}
    sizes |= {name: (len(array), len(wrench)) for name, array in of_samples.items() if array is not None}
    for name, (n, wanted) in sizes.items():
        if n != wanted:
            raise GranularIdError(f"column {name} has {n} values; wanted {wanted}")
    for array in (wrench, times, flags):
        if array is not None:
            array.flags.writeable = False
            if isinstance(array.base, np.ndarray):  # else each recording is copied
                array.base.flags.writeable = False
    metas: dict[str, Any] = {}
    found: list[Recording] = []
    for i, end in enumerate(np.cumsum(lengths).tolist()):
        here = slice(end - int(lengths[i]), end)
        about = {name: values[i] for name, values in each.items()}
        text, own = about["meta"], None if times is None else times[here]
        known = text in metas
        try:
            recording = Recording(
                wrench[here],
                rate_hz=_known(about["rate_hz"]),
                label=about["label"] or None,
                session=about["session"] or None,
                start_time=_known(about["start_time"]),
                trigger_index=None if about["trigger_index"] == NO_TRIGGER else about["trigger_index"],
                time_s=None if own is None or np.isnan(own).all() else own,
                meta={} if known else _json(text, "meta", dict),
                flags=None if flags is None or not flags[here].any() else flags[here],
                name=about["name"],
                axes=axes,
            )
        except (TypeError, ValueError) as error:
            raise GranularIdError(f"recording {i} ({about['name'][:60]!r}): {error}") from error
        if known:  # equal metadata are held once
            object.__setattr__(recording, "meta", metas[text])
        metas.setdefault(text, recording.meta)
        found.append(recording)
    return found


def _known(number: Any) -> Any:
    """Return a number, None for NaN."""
    return None if number != number else number  # noqa: PLR0124


def _lengths(value: Any, n_rows: int) -> NDArray[np.int64]:
    """Return how many samples each recording has: at least one, `n_rows` in all."""
    array = np.asarray(value)
    is_whole = array.dtype.kind in "iu" and array.ndim == 1
    total = sum(array.tolist()) if is_whole else 0  # whole numbers of Python cannot overflow
    if total != n_rows or (array < 1).any():
        came = f"of dtype {array.dtype} and shape {array.shape}, adds up to {total} and begins {array[:3].tolist()}"
        raise GranularIdError(f"column n_samples, {came}; wanted whole numbers above 0 for {n_rows} samples")
    return array.astype(np.int64)


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
    try:
        return tuple(map(StepReport.from_dict, _json(text, "history", list)))
    except (TypeError, ValueError) as error:
        raise GranularIdError(f"history: {error}") from error


def _json(text: Any, name: str, kind: type) -> Any:
    try:
        value = json.loads(text)
    except (RecursionError, ValueError) as error:
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

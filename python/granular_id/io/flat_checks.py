"""Checks of flat columns: each over all recordings at once, naming the recording that spoils it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import FloatArray, as_floats, checked_text, freeze
from granular_id.io.files import check_parts
from granular_id.recording import KNOWN_FLAGS, StepReport

NO_TRIGGER = -1
"""What stands in ``trigger_index`` where a recording has none."""

_DECODER = json.JSONDecoder()


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
    rates = _floats(value, "rate_hz", len(rows))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        endless = ~np.isfinite(
            rows.lengths / rates
        )  # for a rate of 0, too, or one that makes it last for ever
    bad = ~np.isnan(rates) & (endless | (rates <= 0) | np.isinf(rates))
    rows.refuse(rates, bad, "rate_hz", "a positive rate in Hz, or NaN for stamps in time_s")
    return _none_for_nan(rates)


def checked_start_times(value: object, rows: Rows) -> list[float | None]:
    """Return the times of the first samples; None (NaN in the file) where they are unknown."""
    times = _floats(value, "start_time", len(rows))
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
    times = _floats(value, "time_s", int(rows.ends[-1]))
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
        value = _parsed(text)
        if isinstance(value, kind):
            return freeze(value, name)
    except RecursionError as error:
        raise ValueError(f"{name} is nested too deeply") from error
    except json.JSONDecodeError as error:
        raise ValueError(f"{name} is not JSON: {error}") from error
    raise TypeError(f"{name} is a JSON {type(value).__name__}; wanted a {kind.__name__}")


def _parsed(text: str) -> Any:
    """Parse JSON as ``json.loads`` does, in half the time where there are no blanks around it."""
    try:
        value, end = _DECODER.raw_decode(text)
    except ValueError:
        return json.loads(text)
    return value if end == len(text) else json.loads(text)


def _listed(values: object, name: str, n: int) -> Sequence[Any]:
    if not isinstance(values, (list, tuple)) or not set(map(type, values)) <= {str, type(None)}:
        raise TypeError(f"{name} must be a list of texts, got {values!r:.80}")
    if len(values) != n:
        raise ValueError(f"{name} has {len(values)} values for {n} recordings")
    return values


def _floats(value: object, name: str, n: int) -> FloatArray:
    return _one_per(n, as_floats(value, f"column {name}", f"a real array of shape ({n},)"), name)


def _whole(value: object, name: str, n: int | None) -> NDArray[Any]:
    """Return whole numbers; those past int64, which would change their sign, become the largest one."""
    array = np.asarray(value)
    if array.dtype.kind not in "iu":
        raise TypeError(f"column {name} has dtype {array.dtype}; wanted whole numbers")
    if array.dtype == np.uint64:
        array = np.minimum(array, np.uint64(np.iinfo(np.int64).max)).astype(np.int64)
    return _one_per(array.size if n is None else n, array, name)


def _one_per(n: int, array: NDArray[Any], name: str) -> NDArray[Any]:
    if array.shape != (n,):
        raise ValueError(f"column {name} has shape {array.shape}; wanted ({n},)")
    return array


def _none_for_nan(values: FloatArray) -> list[float | None]:
    unknown = np.isnan(values)
    if unknown.all():
        return [None] * len(values)
    listed: list[float | None] = values.tolist()
    for i in np.flatnonzero(unknown).tolist():
        listed[i] = None
    return listed

"""What a model file says of its training: its form, and what follows for the recordings that the model takes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._schema import EACH, check_form
from granular_id._text import counted, verb
from granular_id.recording import (
    Dataset,
    Difference,
    Setup,
    refuse_or_list,
    setup_differences,
    setups_in,
    unit_differences,
)

MAX_FILE_BYTES: int = _core.MAX_MODEL_FILE_BYTES
"""Largest model file that is made, and read unless more is allowed: 32 MiB."""

BANDED = ("best", "multiband")
"""Spaces of multi-band features, most of the work on which waits until an answer is asked for."""

SPACES = (*BANDED, "raw", "hfmh", "raw+hfmh")
"""Those of `granular_id.spaces.feature_spaces` that can be computed while samples arrive."""

MARKS = "recording_marks"
"""Key of the hashes of the recordings: side by side in one text."""

SOURCE = "source"
"""Key of what a model keeps of its training to be adapted: numbers in base64, float64, little-endian."""

ADAPTED = "adapted"
"""Key of the line that says how it was last brought to another set-up."""

Begin = Literal["auto", "first", "trigger"]

_MARK_DIGITS = 8
_MOST_MARKS = 4096
"""A model of more recordings does not know them one by one: their marks take half of the space for metadata."""

_ESTIMATE = {
    "held_out": str,
    "note": str,
    "n_folds": int,
    "n_answers": int,
    "accuracy": float,
    "interval_95": ([float, float], None),
    "recall": {EACH: (float, None)},
    "untested": {EACH: str},
}
_EARLY = {"why_not": str, "target_error": float}
_EARLY_OUTCOME = {"answered_early": float, "error": float, "worst": float, "mean_seconds": float}
_CHOICE = {
    "note": str,
    "random_state": (int, None),
    "machines": [{"name": str, "chosen": bool, "accuracies": [float, ...]}, ...],
    "chosen": [str, ...],
    "accuracy_on_the_folds_that_chose": (float, None),
    "in_folds": [{"chosen": [str, ...]}, ...],
}
_CONFIDENCE = {  # the core has found that these rules fit the model, and takes 3.0 for a whole number
    "candidates?": ({"n_rows": int}, None),
    "unknown?": ({"n_calibration": int}, None),
}
_TRAINED = {
    "settings?": {"space": str},
    "synthetic?": bool,
    "recordings?": {EACH: int},
    "background?": {EACH: int},
    "n_sessions?": int,
    "n_triggers?": int,
    "setup?": {EACH: [str, ...]},
    "recording_marks?": str,
    "history?": [{"step": str, "parameters": {}}, ...],
    "estimate?": (_ESTIMATE, None),
    "why_no_estimate?": str,
    "early?": (_EARLY, None),
    "choice?": _CHOICE,
    "confidence?": _CONFIDENCE,
    "temperature?": float,
    "left_out?": str,
    "notes?": [str, ...],
    "source?": {"mean": (str, None), "sd": str, "scores": str},
    "adapted?": str,
}


def check_trained(trained: Any) -> None:
    """Refuse what a model file says of its training where a part has another form; none of them has to be there."""
    check_form(trained, _TRAINED, what="the metadata")
    if (trained.get("early") or {"why_not": "-"})["why_not"] == "":  # there is an outcome
        check_form({"early": trained["early"]}, {"early": _EARLY_OUTCOME})
    if "choice" in trained and not trained["choice"]["machines"]:
        raise ValueError("choice.machines must hold at least one, got []")


def synthetic_words(*, recordings: bool, model: bool) -> str:
    """Say what is simulated; nothing where nothing is."""
    if recordings:
        return f"SYNTHETIC recordings{' and a model of such' if model else ''}"
    return "a model of SYNTHETIC recordings" if model else ""


class Metadata:
    """What a model keeps beside its weights."""

    def __init__(self, core: _core.Model) -> None:
        self._texts = core.metadata

    @cached_property
    def trained(self) -> dict[str, Any]:
        """What it was trained on and how, and the estimates; empty where nothing is known."""
        trained: dict[str, Any] = json.loads(self._texts["trained"])
        return trained

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(json.loads(self._texts["axes"]))

    @property
    def units(self) -> list[str]:
        """Unit of each axis."""
        units: list[str] = json.loads(self._texts["units"])
        return units

    @property
    def lead_s(self) -> float | None:
        """Seconds of rest ahead of the trigger, where the recordings of the training agree on them."""
        text = self._texts["lead_s"]
        return float(text) if text else None

    @property
    def begins_at_first(self) -> bool:
        """Whether recordings were cropped to begin at their first sample, or are windows; with no lead in common."""
        history = self.trained.get("history", [])
        crops = [step["parameters"] for step in history if step["step"] == "align"]
        at_first = bool(crops) and all(crop.get("trigger", "unknown") is None for crop in crops)
        return self.lead_s is None and (at_first or any(step["step"] == "windows" for step in history))

    @property
    def temperature(self) -> float | None:
        """What class values are divided by before the softmax; None where no recordings were held out."""
        found: float | None = self.trained.get("temperature")
        return found

    @property
    def marks(self) -> frozenset[str] | None:
        """Marks of the recordings, see `marks_of`; None where it does not keep them."""
        marks = self.trained.get(MARKS, "")
        return frozenset(marks[k : k + _MARK_DIGITS] for k in range(0, len(marks), _MARK_DIGITS)) or None


# Recordings that a model was trained on.


def fingerprint(data: Dataset, settings: Mapping[str, Any]) -> str:
    """Hash samples, labels and settings: what the weights follow from."""
    mark = hashlib.sha256()
    facts = (json.dumps(settings, sort_keys=True), repr(data.rate_hz), repr(data.axes), repr(data.X.shape))
    for text in (*facts, *data.y.tolist()):
        mark.update(text.encode() + b"\0")
    mark.update(np.ascontiguousarray(data.X, dtype="<f8").data)
    return mark.hexdigest()


def marks_of(data: Dataset) -> list[str]:
    """Hash the samples of each recording, to know it again: 8 hexadecimal digits, alike once in four billion."""
    return [mark_of(samples) for samples in data.X]


def mark_of(samples: npt.NDArray[np.float64]) -> str:
    """Hash the samples (T, C) of one recording."""
    return hashlib.sha256(np.ascontiguousarray(samples, dtype="<f8").data).hexdigest()[:_MARK_DIGITS]


def stored_marks(data: Dataset) -> dict[str, str]:
    """Return what a model keeps to know its recordings again: nothing of too many."""
    return {MARKS: "".join(sorted(marks_of(data)))} if len(data) <= _MOST_MARKS else {}


# Recordings as a model takes them: its axes, rate and set-up; its length, with its rest before the motion.


def check_recordings(data: Dataset, core: _core.Model, accept: str | Sequence[str] = ()) -> tuple[str, ...]:
    """Refuse recordings of other axes, another rate or another set-up than a model was trained on.

    What of the set-up is in `accept` may differ. Returns what else is not as in the training, by name, each once.
    """
    axes, rate_hz = Metadata(core).axes, core.rate_hz
    for recording in data:
        if recording.axes != axes:
            help_ = f": call .select(axes={list(axes)})" if set(recording.axes) >= set(axes) else ""
            raise ValueError(
                f"recording {recording.name!r} has the axes {' '.join(recording.axes)}; the model was trained on "
                f"{' '.join(axes)}{help_}"
            )
        if recording.rate_hz != rate_hz:
            came = "is sampled irregularly" if recording.rate_hz is None else f"has {recording.rate_hz:g} Hz"
            raise ValueError(
                f"recording {recording.name!r} {came}, the model was trained at {rate_hz:g} Hz; nothing is resampled "
                f"unasked: call .resample({rate_hz:g})"
            )
    compared = setup_comparison(core)
    differences: dict[str, None] = {}
    for recording, setup in zip(data, setups_in(data), strict=True):
        found = refuse_or_list(compared(setup, recording.meta), accept, f"recording {recording.name!r} has ")
        differences.update(dict.fromkeys(found))
    return tuple(differences)


def setup_comparison(core: _core.Model) -> Callable[[Setup, Mapping[str, Any]], list[Difference]]:
    """Return what compares a set-up, and units in metadata, with those that a model was trained with."""
    known = Metadata(core)
    trained = known.trained.get("setup", {})
    units = dict(zip(known.axes, known.units, strict=True))
    return lambda setup, meta: [*unit_differences(units, meta), *setup_differences(trained, setup)]


def cropped_to_model(
    data: Dataset,
    core: _core.Model,
    *,
    begin_at: Begin = "auto",
    lead_s: float | None = None,
    on_short: Literal["raise", "skip"] = "raise",
    over_all: bool = True,
) -> Dataset:
    """Crop recordings of the rate and axes of a model to its length; the same data set where all have it already.

    They begin at the first sample, or at the trigger less the lead. Automatically those of the length begin at the
    first sample, and longer ones as in the training: at the trigger where all had the same lead, else at the first
    sample where that is how they were cropped. `on_short` is for recordings that are too short, or longer and without
    trigger; `over_all` says whether answers over all of a recording would do, too.
    """
    n, rate_hz, known = core.n_samples, core.rate_hz, Metadata(core)
    lengths = [recording.n_samples for recording in data]
    if begin_at == "auto" and set(lengths) == {n}:
        return data
    short = [recording for recording in data if recording.n_samples < n]
    if short and on_short == "raise":
        skip = f": call .align({n}, on_short='skip') to leave such recordings out"
        raise ValueError(
            f"recording {short[0].name!r} has {short[0].n_samples} samples ({short[0].n_samples / rate_hz:g} s), the "
            f"model takes {n} ({n / rate_hz:g} s); {len(short)} of {counted(len(data))} "
            f"{verb(len(short), 'is', 'are')} shorter{skip if len(short) < len(data) else ''}"
        )
    if begin_at == "first" or (begin_at == "auto" and max(lengths) <= n):
        return data.align(n, on_short=on_short)
    if begin_at == "auto" and lead_s is None and known.begins_at_first:
        *before, step = (cropped := data.align(n, on_short=on_short)).history
        as_trained = replace(step, notes=["begins at the first sample, as in the training"])
        return Dataset(cropped.recordings, [*before, as_trained])
    longer = next((r for r in data if r.n_samples > n), data[0])
    lead = _known_lead(known, lead_s, longer.name, longer.n_samples, n, over_all=over_all)
    marked = data
    if begin_at == "auto":
        start = round(lead * rate_hz)
        recordings = [replace(r, trigger_index=start) if r.n_samples <= n else r for r in data]
        marked = Dataset(recordings, data.history)
    return marked.align(n, trigger="recorded", lead_s=lead, on_short=on_short, on_missing=on_short)


def starts_in(
    names: Sequence[str],
    lengths: npt.NDArray[np.int64],
    triggers: npt.NDArray[np.int64],
    core: _core.Model,
    *,
    begin_at: Begin = "auto",
    lead_s: float | None = None,
) -> npt.NDArray[np.int64]:
    """Return the sample at which `cropped_to_model` has each of n recordings begin; -1 where it leaves one out.

    `triggers` are -1 where there is none. A ValueError where nothing says how much rest comes before the motion.
    """
    n, known = core.n_samples, Metadata(core)
    starts = np.zeros(len(lengths), np.int64)
    from_trigger = np.full(len(lengths), begin_at == "trigger")
    if begin_at == "auto" and (lead_s is not None or not known.begins_at_first):
        from_trigger = lengths > n
    if from_trigger.any():
        first = int(from_trigger.argmax())
        lead = _known_lead(known, lead_s, names[first], int(lengths[first]), n)
        begun = np.where(triggers >= 0, triggers - round(lead * core.rate_hz), -1)
        starts = np.where(from_trigger, begun, starts)
    fits: npt.NDArray[np.int64] = np.where((starts >= 0) & (starts + n <= lengths), starts, -1)
    return fits


def _known_lead(
    known: Metadata, lead_s: float | None, name: str, length: int, n: int, *, over_all: bool = True
) -> float:
    """Return the rest before the motion, seconds: stated, or that of the training."""
    lead = known.lead_s if lead_s is None else lead_s
    if lead is None:
        ways = (
            ", pass begin_at='first', or call .predict_over(recording)"
            if over_all
            else " or pass begin_at='first'"
        )
        raise ValueError(
            f"recording {name!r} has {length} samples, the model takes {n}, and does not know how much rest comes "
            f"before the motion: state lead_s{ways}"
        )
    return lead

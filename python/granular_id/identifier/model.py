"""A model file: its weights, what it says of the training, and whether it has seen recordings before."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from typing_extensions import Self

from granular_id import _core
from granular_id._core import GranularIdError
from granular_id._files import MODELS, refuse_other_kind, whole_file
from granular_id._schema import EACH, check_form
from granular_id.confidence import CandidateRule, UnknownRule, softmax
from granular_id.features import FeatureSpec
from granular_id.identifier.requirements import Requirements
from granular_id.recording import Dataset

FloatArray = npt.NDArray[np.float64]

MAX_FILE_BYTES: int = _core.MAX_MODEL_FILE_BYTES
"""Largest model file that is made, and read unless more is allowed: 32 MiB."""

SPACES = ("best", "multiband", "raw", "hfmh", "raw+hfmh")
"""Those of `granular_id.spaces.feature_spaces` that can be computed while samples arrive."""

# Entries of what a model says of its training that more than one file knows.
RULES = "confidence"  # candidates and refusal
MARKS = "recording_marks"  # hashes of the recordings, side by side in one text
SOURCE = "source"  # what adapting needs: numbers in base64, float64, little-endian
ADAPTED = "adapted"  # the line that says how it was last brought to another set-up

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
_RULES = {  # the core has found that these rules fit the model, and takes 3.0 for a whole number
    "candidates?": ({"n_rows": int}, None),
    "unknown?": ({"n_calibration": int}, None),
}
_TRAINED = {
    "settings?": {"space": str},
    "synthetic?": bool,
    "recordings?": {EACH: int},
    "background?": {EACH: int},
    "n_sessions?": int,
    "setup?": {EACH: [str, ...]},
    "recording_marks?": str,
    "history?": [{"step": str, "parameters": {}}, ...],
    "estimate?": (_ESTIMATE, None),
    "why_no_estimate?": str,
    "early?": (_EARLY, None),
    "choice?": _CHOICE,
    "confidence?": _RULES,
    "temperature?": float,
    "left_out?": str,
    "notes?": [str, ...],
    "source?": {"mean": (str, None), "sd": str, "scores": str},
    "adapted?": str,
}


class TrainedModel:
    """What a model file holds; `core` decides about every answer."""

    def __init__(self, core: _core.Model | None = None) -> None:
        if not isinstance(core, _core.Model):
            came = "nothing" if core is None else type(core).__name__
            raise TypeError(
                "an Identifier is made by Identifier.fit(data) or Identifier.load(path); it holds a "
                f"granular_id._core.Model, got {came}"
            )
        self.core = core

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, max_file_bytes: int = MAX_FILE_BYTES) -> Self:
        """Read a model file. Nothing in it is executed; what is not exactly a model is refused.

        Parameters
        ----------
        path : path-like
            Written by `save`.
        max_file_bytes : int, default 32 MiB
            Largest file to read.

        Raises
        ------
        FileNotFoundError, OSError
            There is no such file, or it cannot be read.
        ValueError
            The file is no model, is damaged or too large: the first fault.
        """
        if os.path.isdir(path):  # noqa: PTH112 - bytes are paths, too
            wanted = "wanted a model file, as granular-id train and Identifier.save write it"
            raise IsADirectoryError(f"{os.fsdecode(path)} is a folder, {wanted}")
        model = cls(_core.Model.read(path, max_file_bytes=max_file_bytes))
        try:
            _check_trained(model.trained)
        except (TypeError, ValueError) as fault:
            raise _core.ModelFileError(f"{os.fspath(path)}: trained: {fault}") from None
        return model

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model into one file (safetensors), whole or not at all; one that is there is replaced.

        Raises
        ------
        ValueError
            The path ends like another kind of file.
        OSError
            It cannot be written.
        """
        refuse_other_kind(path, MODELS)
        with whole_file(path) as draft:
            draft.write_bytes(self.core.to_bytes())

    @property
    def classes(self) -> tuple[str, ...]:
        """The K labels, sorted."""
        return self.core.classes

    @property
    def spec(self) -> FeatureSpec | _core.MultiBandExtractor:
        """What is extracted from a recording: samples and counts, or multi-band features with their scales."""
        return self.core.spec

    @property
    def space(self) -> str:
        """Feature space that the model was trained in: "raw", "hfmh", "raw+hfmh", "multiband" or "best"."""
        if isinstance(self.spec, FeatureSpec):
            return "+".join(name for name in ("raw", "hfmh") if getattr(self.spec, name))
        return "best" if self.trained.get("settings", {}).get("space") == "best" else "multiband"

    @property
    def n_samples(self) -> int:
        """Samples T of a recording."""
        return self.core.n_samples

    @property
    def rate_hz(self) -> float:
        """Sampling rate, Hz."""
        return self.core.rate_hz

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Names of the C axes."""
        return tuple(json.loads(self.core.metadata["axes"]))

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Unit of each axis; empty where nobody stated it."""
        return tuple(json.loads(self.core.metadata["units"]))

    @property
    def lead_s(self) -> float | None:
        """Seconds of rest ahead of the trigger, where all recordings of the training had the same; else None."""
        text = self.core.metadata["lead_s"]
        return float(text) if text else None

    @cached_property
    def trained(self) -> dict[str, Any]:
        """What it was trained on and how, and the estimates; empty where nothing is known."""
        trained: dict[str, Any] = json.loads(self.core.metadata["trained"])
        return trained

    @property
    def synthetic(self) -> bool:
        """Whether it is known to be trained on simulated recordings: its answers say nothing about real materials."""
        return bool(self.trained.get("synthetic", False))

    @cached_property
    def temperature(self) -> float | None:
        """What class values are divided by before the softmax of probabilities; None where none were held out."""
        found: float | None = self.trained.get("temperature")
        return found

    @cached_property
    def requirements(self) -> Requirements:
        """What recordings must be like to be named: axes, rate, units, set-up, length and rest."""
        history = self.trained.get("history", [])
        crops = [step["parameters"] for step in history if step["step"] == "align"]
        at_first = bool(crops) and all(crop.get("trigger", "unknown") is None for crop in crops)
        return Requirements(
            self.n_samples,
            self.rate_hz,
            self.axes,
            self.units,
            self.trained.get("setup", {}),
            self.lead_s,
            at_first or any(step["step"] == "windows" for step in history),
        )

    def confidence_rules(self) -> tuple[CandidateRule | None, UnknownRule | None]:
        """Rules of candidates and of refusal, which the core applies; None where it has none."""
        stored = self.trained.get(RULES) or {}
        candidates, unknown = stored.get("candidates"), stored.get("unknown")
        return (
            None if candidates is None else CandidateRule.from_dict(candidates),
            None if unknown is None else UnknownRule.from_dict(unknown),
        )

    def __repr__(self) -> str:
        on = ", trained on SYNTHETIC recordings" if self.synthetic else ""
        size = f"{self.n_samples} samples at {self.rate_hz:g} Hz"
        return f"{type(self).__name__}({self.space!r}, {len(self.classes)} classes, {size}{on})"


def _check_trained(trained: Any) -> None:
    """Refuse what a model file says of its training where a part has another form; none of them has to be there."""
    check_form(trained, _TRAINED, what="the metadata")
    if (trained.get("early") or {"why_not": "-"})["why_not"] == "":  # there is an outcome
        check_form({"early": trained["early"]}, {"early": _EARLY_OUTCOME})
    if "choice" in trained and not trained["choice"]["machines"]:
        raise GranularIdError("choice.machines must hold at least one, got []")


def probabilities(model: TrainedModel, losses: FloatArray) -> FloatArray | None:
    """Probability (..., K) of each class from mean losses (..., K); None where a model has no temperature."""
    return None if model.temperature is None else softmax(-losses, model.temperature)


def synthetic_words(*, recordings: bool, model: bool) -> str:
    """Say what is simulated; nothing where nothing is."""
    if recordings:
        return f"SYNTHETIC recordings{' and a model of such' if model else ''}"
    return "a model of SYNTHETIC recordings" if model else ""


# Recordings that a model was trained on.


def fingerprint(data: Dataset, settings: Mapping[str, Any]) -> str:
    """Hash samples, labels and settings: what the weights follow from."""
    mark = hashlib.sha256()
    facts = (json.dumps(settings, sort_keys=True), repr(data.rate_hz), repr(data.axes), repr(data.X.shape))
    for text in (*facts, *data.y.tolist()):
        mark.update(text.encode() + b"\0")
    mark.update(np.ascontiguousarray(data.X, dtype="<f8").data)
    return mark.hexdigest()


def mark_of(samples: FloatArray) -> str:
    """Hash samples (T, C), to know them again: 8 hexadecimal digits, alike once in four billion."""
    return hashlib.sha256(np.ascontiguousarray(samples, dtype="<f8").data).hexdigest()[:_MARK_DIGITS]


def known_marks(model: TrainedModel) -> frozenset[str] | None:
    """Return the marks of the recordings that a model was trained on; None where it keeps none."""
    text = model.trained.get(MARKS, "")
    return frozenset(text[k : k + _MARK_DIGITS] for k in range(0, len(text), _MARK_DIGITS)) or None


def stored_marks(data: Dataset) -> dict[str, str]:
    """Return what a model keeps to know its recordings again: nothing of too many."""
    return {MARKS: "".join(sorted(map(mark_of, data.X)))} if len(data) <= _MOST_MARKS else {}

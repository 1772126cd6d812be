"""From parts to a model: weights, what is known of the training recordings, and words about them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._core import MAX_MULTIBAND_VALUES
from granular_id.identifier.early import EarlyRule
from granular_id.identifier.parts import Parts
from granular_id.identifier.recipe import BANDED, Recipe
from granular_id.recording import Dataset
from granular_id.recording.axes import unit_of

__all__ = [
    "MAX_FILE_BYTES",
    "common_lead",
    "core_of",
    "fingerprint",
    "kept_marks",
    "marks_in",
    "marks_of",
    "refuse_large",
]

FloatArray = npt.NDArray[np.float64]

MAX_FILE_BYTES: int = _core.MAX_MODEL_FILE_BYTES
"""Largest model file that is made, and read unless more is allowed: 16 MiB."""

_HEADER_BYTES = 2**16
"""Kept free for what is no weight: names, settings, estimates."""


MARKS = "recording_marks"
"""Where hashes of the recordings stand in what is known of a training: side by side in one text."""

_MARK_DIGITS = 8
_MOST_MARKS = 4096
"""Half of what is kept free: a model of more recordings does not know them one by one."""


def core_of(
    parts: Parts,
    *,
    axes: Sequence[str],
    units: Sequence[str] | None = None,
    lead_s: float | None = None,
    trained: Mapping[str, Any] | None = None,
    training_sha256: str = "",
    coding: str = "",
    samples: FloatArray | None = None,
    rule: EarlyRule | None = None,
) -> _core.Model:
    """Build a model.

    Parameters
    ----------
    parts : Parts
    axes, units : sequence of str
        Name and unit of each axis; units default to those of a wrench.
    lead_s : float, optional
        Seconds of rest ahead of the trigger, where all recordings have the same.
    trained : mapping, optional
        See `Training`.
    training_sha256, coding : str
        Hash of what it was trained on, and name of the coding design; empty where unknown.
    samples : ndarray, shape (n, T, C), optional
        Training recordings, for provisional answers of models on raw samples.
    rule : EarlyRule, optional
    """
    ranges: dict[str, Any] = {}
    if samples is not None:
        with np.errstate(over="ignore"):  # the model refuses what is not finite
            statistics = samples.mean(axis=0), samples.min(axis=0), samples.max(axis=0)
        names = ("raw_mean", "raw_low", "raw_high")
        ranges = {name: np.ascontiguousarray(v.T).ravel() for name, v in zip(names, statistics, strict=True)}
    if parts.posterior is not None:
        ranges["sigmoid"] = np.column_stack((parts.posterior.slope, parts.posterior.offset))
        ranges["posterior_weights"] = parts.posterior.weights
    return _core.Model(
        parts.spec,
        parts.coef,
        parts.intercept,
        parts.coding_matrix,
        list(parts.classes),
        loss=parts.loss,
        decoding=parts.decoding,
        n_samples=parts.n_samples,
        n_axes=parts.n_axes,
        early=None if rule is None else rule.table(),
        metadata={
            "axes": json.dumps(list(axes)),
            "units": json.dumps([unit_of(axis) for axis in axes] if units is None else list(units)),
            "coding": coding,
            "posterior": "" if parts.posterior is None else parts.posterior.method,
            "training_sha256": training_sha256,
            "lead_s": "" if lead_s is None else repr(lead_s),
            "trained": json.dumps(trained or {}, ensure_ascii=False, sort_keys=True, allow_nan=False),
        },
        **ranges,
    )


def common_lead(data: Dataset) -> float | None:
    """Seconds ahead of the trigger, where every recording has the same."""
    triggers = {recording.trigger_index for recording in data}
    trigger = triggers.pop()
    return None if triggers or trigger is None else trigger / data.rate_hz


def fingerprint(data: Dataset, settings: Mapping[str, Any]) -> str:
    """Hash samples, labels and settings: what the weights follow from."""
    mark = hashlib.sha256()
    shape = repr(data.X.shape)
    texts = [
        json.dumps(settings, sort_keys=True),
        repr(data.rate_hz),
        repr(data.axes),
        shape,
        *data.y.tolist(),
    ]
    for text in texts:
        mark.update(text.encode() + b"\0")
    mark.update(np.ascontiguousarray(data.X, dtype="<f8").data)
    return mark.hexdigest()


def marks_of(data: Dataset) -> list[str]:
    """Hash the samples of each recording, to know it again: 8 hexadecimal digits, alike once in four billion."""
    return [
        hashlib.sha256(np.ascontiguousarray(samples, dtype="<f8").data).hexdigest()[:_MARK_DIGITS]
        for samples in data.X
    ]


def marks_in(trained: Mapping[str, Any]) -> frozenset[str] | None:
    """Return the marks of the recordings that a model was trained on; None where it does not keep them."""
    kept = trained.get(MARKS, "")
    return frozenset(kept[k : k + _MARK_DIGITS] for k in range(0, len(kept), _MARK_DIGITS)) or None


def kept_marks(data: Dataset) -> dict[str, str]:
    """Return what a model keeps to know its recordings again: nothing of too many."""
    return {MARKS: "".join(sorted(marks_of(data)))} if len(data) <= _MOST_MARKS else {}


def refuse_large(recipe: Recipe, n_classes: int, shape: tuple[int, int], most: int) -> None:
    """Refuse a model that no file could hold, before any time is spent on it.

    Parameters
    ----------
    recipe : Recipe
    n_classes : int
    shape : tuple of int
        Samples and axes of a recording.
    most : int
        Largest file, bytes.

    Raises
    ------
    ValueError
        Naming ways out.
    """
    is_banded, n_values = recipe.space in BANDED, shape[0] * shape[1]
    if is_banded and n_values > MAX_MULTIBAND_VALUES:
        raise ValueError(
            f"recordings of {shape[0]} samples of {shape[1]} axes are too long for a model of multi-band features: "
            f"{n_values} values, at most {MAX_MULTIBAND_VALUES}; shorten them, or take space='hfmh'"
        )
    n_raw, n_features = recipe.n_features(*shape)
    n_counts = recipe.n_bins * shape[1]
    n_learners = recipe.n_learners(n_classes)
    size = 8 * (n_learners * (n_features + n_classes + 4) + 3 * n_raw) + _HEADER_BYTES
    if size <= most:
        return
    ways = [f"the space 'hfmh' ({n_counts} features)"] if n_raw or is_banded else []
    ways += ["shorter recordings, or a lower rate"] if n_raw else []
    coding = f"the coding 'onevsall' ({n_classes} learners)"
    if n_learners > n_classes:
        ways.append(f"the space 'multiband' with {coding}" if recipe.space == "best" else coding)
    ways += [] if n_raw or is_banded else ["fewer bins"]
    raise ValueError(
        f"the model would take {size / 2**20:.3g} MiB, more than the {most / 2**20:.3g} MiB of a model file: "
        f"{n_learners} learners for {n_classes} materials, {n_features} features; ways out: {'; '.join(ways)}"
    )

"""Training: a model of all recordings, and what can honestly be said about it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline

from granular_id import _core
from granular_id._checks import checked_index, checked_number
from granular_id._core import MAX_MULTIBAND_VALUES
from granular_id._estimators import heard_complaints
from granular_id._parallel import single_threaded_blas
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.identifier.held_out import HeldOut, answers_held_out, honest_partitions
from granular_id.identifier.model_card import choice_of, described, estimate_of
from granular_id.identifier.recipe import BANDED, Parts, Recipe, parts_of
from granular_id.identifier.rules import KEY, EarlyRule, calibrate, checked_target, posterior_of, rules_of
from granular_id.recording import Dataset, common_units, mixed, unit_of, warnings_in
from granular_id.spaces import BestClassifier, Chosen, block_sizes, tell_blocks
from granular_id.splits import Origins, Partition, origins_of, rows_of_class

# From parts to a model: weights, what is known of the training recordings, and words about them.

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


@dataclass(frozen=True, eq=False)
class Training:
    """A trained model and what is known about it.

    Attributes
    ----------
    core : granular_id._core.Model
        Of all recordings; keeps `trained` and the early rule.
    trained : dict
        What it was trained on and how, and the estimates, in types that JSON knows.
    held : HeldOut or None
        Answers about held-out recordings; None where there are none, `why_none` says why.
    early : EarlyRule or None
        None when it was not asked for, or nothing was held out.
    why_none : str
    """

    core: _core.Model
    trained: dict[str, Any]
    held: HeldOut | None
    early: EarlyRule | None
    why_none: str = ""


def train(
    data: Dataset,
    recipe: Recipe,
    *,
    estimate: bool = True,
    early: bool = True,
    target_error: float = 0.01,
    coverage: float | None = 0.9,
    share_known: float | None = 0.95,
    n_folds: int = 5,
    max_file_bytes: int = MAX_FILE_BYTES,
    threads: int | None = None,
    progress: bool | ProgressCallback | None = None,
) -> Training:
    """Train a model on all recordings, and measure on models of parts of them what may be expected of it.

    Parameters
    ----------
    recipe : Recipe
        Settings of features and classifier.
    data, estimate, early, target_error, coverage, share_known, n_folds, max_file_bytes, threads, progress
        As in `granular_id.Identifier.fit`.

    Returns
    -------
    Training

    Raises
    ------
    TypeError, ValueError
        As `granular_id.Identifier.fit`, and before anything is trained.
    """
    target_error = checked_target(target_error)
    for name, share in (("coverage", coverage), ("share_known", share_known)):
        if share is not None and not 0 < checked_number(share, name) < 1:
            raise ValueError(f"{name} must lie between 0 and 1, got {share:g}")
    if checked_index(n_folds, "n_folds") < 2:
        raise ValueError(f"n_folds must be at least 2, got {n_folds}")
    if not isinstance(data, Dataset):
        raise TypeError(f"data must be a granular_id.Dataset, got {type(data).__name__}")
    X, y, rate_hz = data.X, data.y, data.rate_hz
    units = common_units(data)
    classes = rows_of_class(y)
    refuse_large(recipe, len(classes), X.shape[1:], max_file_bytes)
    why_none = "" if estimate else "no recordings were held out, as asked"
    drawn = None
    if estimate:
        try:
            drawn = honest_partitions(data, n_folds=n_folds, seed=recipe.random_state)
        except ValueError as why:  # a model all the same, of which nobody knows how good it is
            why_none = str(why)
    held = None
    with showing(progress or False) as callback, heard_complaints(recipe.space) as complaints:
        ticker = Ticker(1 + (0 if drawn is None else len(drawn.each)), callback)
        # The bits of a model must not depend on how many threads multiply its matrices.
        with single_threaded_blas():
            origins = origins_of(data)
            pipeline = recipe.pipeline(rate_hz, threads=threads)
            classifier = fit_pipeline(pipeline, X, y, origins)[-1]
            parts = parts_of(pipeline, rate_hz)
            chooses = isinstance(classifier, BestClassifier)
            if recipe.posterior is not None and chooses:
                parts = replace(parts, posterior=posterior_of(classifier, y, recipe.posterior))
            ticker.tick("all recordings")
            if drawn is not None:
                of_rows = _of_rows(recipe, data, origins, threads)
                held = answers_held_out(data, drawn, of_rows, tick=ticker.tick)
    rule = calibrate(held, target_error) if early and held is not None else None
    trained = {
        **described(data, recipe),
        **kept_marks(data),
        "estimate": None if held is None else estimate_of(held, tuple(classes)),
        "why_no_estimate": why_none,
        "early": None if held is None or rule is None else rule.to_dict(held, rate_hz),
        **({"choice": choice_of(classifier.choice_, held)} if chooses else {}),
        **_confidence(held, tuple(classes), parts.coding_matrix, coverage, share_known),
        "left_out": getattr(pipeline[0], "dropped_", ""),
        # What may mislead a reader of the estimate.
        "notes": [*(mixed(data) if held is None else warnings_in(data)), *complaints],
    }
    core = core_of(
        parts,
        axes=data.axes,
        units=units,
        lead_s=common_lead(data),
        trained=trained,
        training_sha256=fingerprint(data, trained["settings"]),
        coding=recipe.coding if isinstance(recipe.coding, str) else "",
        samples=X if parts.takes_samples else None,
        rule=rule,
    )
    return Training(core, trained, held, rule, why_none)


def fit_pipeline(
    pipeline: Pipeline,
    X: FloatArray,
    y: npt.NDArray[np.str_],
    origins: Origins | None = None,
    rows: npt.NDArray[np.intp] | None = None,
) -> Pipeline:
    """Fit a pipeline in place; steps that ask are told blocks of columns, sessions and order.

    Parameters
    ----------
    pipeline : Pipeline
        Feature space, steps behind it, classifier.
    X : ndarray, shape (n, T, C)
    y : ndarray, shape (n,)
    origins : Origins, optional
        Of all recordings.
    rows : ndarray of int, shape (n,), optional
        Which of them are X; default: all.
    """
    features, *steps = (step for _, step in pipeline.steps)
    values = features.fit(X, y).transform(X)
    sizes = block_sizes(features)
    for step in steps:
        tell_blocks(step, sizes)
    rest = Pipeline(pipeline.steps[1:])
    known: dict[str, Any] = {}
    if origins is not None:
        known = origins.fit_arguments(rest, np.arange(len(y)) if rows is None else rows)
    rest.fit(values, y, **known)
    return pipeline


def _confidence(
    held: HeldOut | None,
    classes: tuple[str, ...],
    coding: npt.NDArray[np.int8],
    coverage: float | None,
    share_known: float | None,
) -> dict[str, Any]:
    if held is None or (coverage is None and share_known is None):
        return {}
    return {KEY: rules_of(held, classes, coding, coverage=coverage, share_known=share_known)}


def _of_rows(
    recipe: Recipe, data: Dataset, origins: Origins, threads: int | None
) -> Callable[[Partition], tuple[_core.Model, Chosen | None]]:
    """Return the function that trains on the rows of a partition, and says what was chosen there."""

    def fitted(partition: Partition) -> tuple[_core.Model, Chosen | None]:
        X, y = data.X[partition.train], data.y[partition.train]
        pipeline = recipe.pipeline(data.rate_hz, posterior=False, threads=threads)
        fit_pipeline(pipeline, X, y, origins, partition.train)
        parts = parts_of(pipeline, data.rate_hz)
        core = core_of(parts, axes=data.axes, samples=X if parts.takes_samples else None)
        return core, Chosen.of(pipeline)

    return fitted

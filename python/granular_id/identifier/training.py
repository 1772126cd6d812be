"""Training: a model of all recordings, and what can honestly be said about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline

from granular_id import _core
from granular_id._blas import single_threaded_blas
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.best import BestClassifier
from granular_id.evaluation.chosen import Chosen
from granular_id.evaluation.complaints import heard_complaints
from granular_id.evaluation.describe import warnings_in
from granular_id.evaluation.origins import Origins, origins_of
from granular_id.evaluation.partition import Partition, rows_of_class
from granular_id.identifier.about import choice_of, described, estimate_of
from granular_id.identifier.building import (
    MAX_FILE_BYTES,
    common_lead,
    core_of,
    fingerprint,
    kept_marks,
    refuse_large,
)
from granular_id.identifier.early import EarlyRule, calibrate, checked_target
from granular_id.identifier.held_out import HeldOut, answers_held_out, honest_partitions
from granular_id.identifier.parts import parts_of
from granular_id.identifier.posterior import posterior_of
from granular_id.identifier.recipe import Recipe
from granular_id.identifier.sure import KEY, rules_of
from granular_id.recording import Dataset
from granular_id.recording._values import checked_index, checked_number
from granular_id.recording.setup import common_units, mixed
from granular_id.spaces import block_sizes, tell_blocks

__all__ = ["Training", "fit_pipeline", "train"]

FloatArray = npt.NDArray[np.float64]


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

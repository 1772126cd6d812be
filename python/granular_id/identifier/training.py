"""Training: a model of all recordings, and what held-out recordings say about it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import clone
from sklearn.pipeline import Pipeline

from granular_id import _core
from granular_id._checks import argument_error, checked_flag, checked_share
from granular_id._estimators import convergence_warnings, describe_estimator, seeded_clone, versions
from granular_id._files import json_value
from granular_id._memory import taken
from granular_id._parallel import single_threaded_blas
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.confidence import (
    N_RANDOM_FOLDS,
    Novelty,
    Parts,
    blocks_in_time,
    candidate_rule,
    fit_temperature,
    held_out_parts,
    rotated,
    scaled,
    unknown_rule,
)
from granular_id.ecoc import design
from granular_id.features import FeatureSpec
from granular_id.identifier.adapt import features_of, with_source
from granular_id.identifier.core import model_of, pipeline_of, plain_features
from granular_id.identifier.metadata import MAX_FILE_BYTES, fingerprint, stored_marks
from granular_id.identifier.rules import (
    KEY,
    EarlyRule,
    HeldOut,
    calibrate,
    checkpoints,
    provisional_answers,
)
from granular_id.recording import (
    Dataset,
    common_units,
    data_warnings,
    describe_data,
    mixed_setup_warnings,
    setups_in,
    values_in,
)
from granular_id.score import Held, fit_and_score
from granular_id.spaces import BlockScaler, Choice, choice_of, fit_on_features
from granular_id.splits import AUTO, TIME, Fold, Folds, groups_of, hold_out, rows_of_class

FloatArray = npt.NDArray[np.float64]
FloatArray32 = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.intp]

_HEADER_BYTES = 2**16
"""Room for what is no weight: names, settings, estimates."""


@dataclass(frozen=True, eq=False)
class Training:
    """A model of all recordings, and what is known about it."""

    core: _core.Model
    trained: dict[str, Any]  # what the model says of its training, in types that JSON knows
    held: HeldOut | None
    early: EarlyRule | None  # None where it was not asked for, or nothing was held out


def train(
    data: Dataset,
    space: str | Pipeline = "best",
    *,
    by: str = AUTO,
    background: Sequence[str] = (),
    estimate: bool = True,
    target_error: float | None = 0.01,
    coverage: float | None = 0.9,
    share_known: float | None = 0.95,
    random_state: int = 0,
    threads: int | None = None,
    progress: bool | ProgressCallback | None = None,
) -> Training:
    """Train a model on all recordings, and measure on models of parts of them what may be expected of it.

    Parameters and errors are those of `granular_id.Identifier.fit`; what is wrong with them is said before anything is
    trained.
    """
    for name, share in (("target_error", target_error), ("coverage", coverage), ("share_known", share_known)):
        if share is not None:
            checked_share(name, share)
    if not isinstance(data, Dataset):
        raise TypeError(f"data must be a granular_id.Dataset, got {type(data).__name__}")
    _check_background(
        background, data, has_use=checked_flag("estimate", estimate) and share_known is not None
    )
    units = common_units(data)
    recordings, data = data, data.select(where=lambda r: r.label not in background) if background else data
    X, y, rate_hz = data.X, data.y, data.rate_hz
    classes = tuple(rows_of_class(y))
    name, pipeline = pipeline_of(space, rate_hz, threads)
    refuse_large(pipeline, len(classes), X)
    folds, why_none = (
        _folds(data, by, random_state) if estimate else (None, "no recordings were held out, as asked")
    )
    held = novelty = None
    # The bits of a model must not depend on how many threads multiply its matrices: here, and where it is built.
    with showing(progress or False) as callback, convergence_warnings(name) as not_converged:
        ticker = Ticker(1 + (0 if folds is None else len(folds)), callback)
        with single_threaded_blas():
            fitted = seeded_clone(pipeline, np.random.SeedSequence(random_state, spawn_key=(4,)))
            features = fitted[0].fit(X, y).transform(X)
            fit_on_features(fitted, features, y, groups_of(data, by))
            ticker.tick("all recordings")
            if folds is not None:
                held = _answers(data, name, pipeline, folds, random_state, ticker.tick)
    early = None if target_error is None or held is None else calibrate(held, float(target_error))
    plain = model_of(fitted, rate_hz, axes=data.axes)
    rows = plain_features(fitted[0], features, plain.spec)
    rows = features_of(plain, X, threads) if rows is None else rows
    rules: dict[str, Any] = {}
    if held is not None and coverage is not None:
        rules["candidates"] = candidate_rule(
            classes, held.held.values, held.truth, _sessions(held.held), float(coverage)
        ).to_dict()
    if held is not None and share_known is not None:
        beside = recordings.select(labels=list(background)) if background else None
        rules["unknown"], novelty = _refusal(
            plain, rows, data, beside, held.held, float(share_known), threads
        )
    choice = choice_of(fitted)
    trained = {
        **_described(data, name, pipeline),
        **stored_marks(recordings),
        **(
            {"background": {label: _counts(recordings.y)[label] for label in background}}
            if background
            else {}
        ),
        "estimate": None if held is None else _estimate(held.held),
        "why_no_estimate": why_none,
        "early": None if held is None or early is None else early.to_dict(held, rate_hz),
        **({} if choice is None else {"choice": _choice(choice, held)}),
        **({KEY: rules} if rules else {}),
        **({} if held is None else {"temperature": _temperature(held.held)}),
        "left_out": getattr(fitted[0], "dropped_", ""),
        # What may mislead a reader of the estimate.
        "notes": [*(mixed_setup_warnings(data) if held is None else data_warnings(data)), *not_converged],
    }
    with single_threaded_blas():
        core = model_of(
            fitted,
            rate_hz,
            axes=data.axes,
            units=units,
            lead_s=_common_lead(data),
            samples=X,
            early=None if early is None else early.table(),
            novelty=novelty,
            trained=trained,
            training_sha256=fingerprint(recordings, trained["settings"]),
        )
    core = with_source(core, lambda: rows, y, MAX_FILE_BYTES)
    return Training(core, trained, held, early)


def _check_background(background: Sequence[str], data: Dataset, *, has_use: bool) -> None:
    """Refuse background materials of which there is no recording, or where nothing is refused."""
    if isinstance(background, str):
        raise argument_error(TypeError, "background", f"must be a sequence of labels, got {background!r}")
    missing = sorted(set(background) - set(data.y.tolist()))
    if missing:
        raise argument_error(
            ValueError, "background", f"names {missing[0]!r}, of which there is no recording"
        )
    if background and not has_use:
        problem = "has no use where nothing is refused: leave it out, or give share_known and estimate"
        raise argument_error(ValueError, "background", problem)


def refuse_large(pipeline: Pipeline, n_classes: int, X: FloatArray) -> None:
    """Refuse a model that no file could hold, before any time is spent on it; name ways out."""
    n_values = int(np.prod(X.shape[1:]))
    space, coding = pipeline[0], getattr(pipeline[-1], "coding", "onevsone")
    is_banded = hasattr(space, "blocks")
    if is_banded and n_values > _core.MAX_MULTIBAND_VALUES:
        raise ValueError(
            f"recordings of {X.shape[1]} samples of {X.shape[2]} axes are too long for a model of multi-band features: "
            f"{n_values} values, at most {_core.MAX_MULTIBAND_VALUES}; shorten them, or take space='hfmh'"
        )
    n_features = clone(space).fit(X[:1]).transform(X[:1]).shape[1]
    n_learners = design(coding, n_classes).shape[1]
    size = 8 * n_learners * (n_features + n_classes + 4) + _HEADER_BYTES
    if size > MAX_FILE_BYTES:
        ways = "shorter recordings, a lower rate, fewer bins, space='hfmh'"
        if n_learners > n_classes:
            ways += f", or a pipeline that ends in ECOCClassifier('onevsall') ({n_classes} learners)"
        raise ValueError(
            f"the model would take {size / 2**20:.3g} MiB, more than the {MAX_FILE_BYTES / 2**20:.3g} MiB of a model "
            f"file: {n_learners} learners for {n_classes} materials, {n_features} features; ways out: {ways}"
        )


# What held-out recordings say.


def _folds(data: Dataset, by: str, seed: int) -> tuple[Folds | None, str]:
    """Return the folds of the estimate; or why there are none."""
    if by != AUTO:
        return hold_out(data, by, seed=seed), ""
    try:
        return hold_out(data, seed=seed), ""
    except ValueError as why:  # a model all the same, of which nobody knows how good it is
        return None, str(why)


def _answers(
    data: Dataset, name: str, pipeline: Pipeline, folds: Folds, seed: int, tick: Callable[[str], None]
) -> HeldOut:
    """Train on the rows of each fold, and answer about the recordings that it holds out, moment by moment."""
    X, classes = data.X, np.unique(data.y)
    n_seen = checkpoints(X.shape[1])

    def observe(fitted: Pipeline, _: Any, train: IntArray, __: Any, test: IntArray) -> tuple[Any, ...]:
        core = model_of(
            fitted, data.rate_hz, axes=data.axes, samples=taken(X, train, "recordings that train")
        )
        winners, margins = zip(
            *(provisional_answers(core, X[row], n_seen) for row in test.tolist()), strict=True
        )
        known = np.searchsorted(classes, core.classes)  # a condition that is held out may leave materials out
        return known[np.array(winners)], margins, choice_of(fitted)

    held = fit_and_score(pipeline, data, folds, seed=seed, tick=tick, observe=observe, name=name)
    winners, margins, chosen = zip(*held.observed, strict=True)
    return HeldOut(held, n_seen, np.concatenate(winners), np.concatenate(margins), chosen)


def _sessions(held: Held) -> IntArray | None:
    """Return the session of each row; None where no sessions were held out."""
    return held.places if held.folds.sessions_apart else None


def _estimate(held: Held) -> dict[str, Any]:
    """Return the accuracy on held-out recordings and how it was found, in types that JSON knows."""
    low, high = held.interval
    return {
        "by": held.folds.by,
        "held_out": held.folds.name,
        "note": "; ".join(held.folds.notes),
        "n_folds": len(held.folds),
        "n_answers": len(held.rows),
        "accuracy": held.accuracy,
        "interval_95": None if math.isnan(low) else [low, high],
        "recall": dict(zip(held.classes, json_value(held.recall), strict=True)),
        "untested": dict(held.folds.untested),
    }


def _temperature(held: Held) -> float:
    return fit_temperature(held.values, held.truth, _sessions(held))


def _refusal(
    core: _core.Model,
    rows: FloatArray,
    data: Dataset,
    beside: Dataset | None,
    held: Held,
    share_known: float,
    threads: int | None,
) -> tuple[dict[str, Any], tuple[FloatArray32, FloatArray32, FloatArray32]]:
    """Set the rule of refusal on held-out recordings, and fit what their novelty is computed with.

    `rows` are plain features of the recordings. Those of background materials train in all folds.
    """
    n, codes = len(rows), np.searchsorted(core.classes, data.y)
    if beside is not None:
        own = len(core.classes) + np.unique(beside.y, return_inverse=True)[1]
        rows, codes = np.concatenate([rows, features_of(core, beside.X, threads)]), np.r_[codes, own]
    always = np.arange(n, len(codes))
    scaler = BlockScaler(_blocks(core)).fit(rows)
    scaling = np.array([scaler.mean_, scaler.factor_], dtype=np.float32)
    s = scaled(rows, scaling)
    with single_threaded_blas():
        small = rotated(s)

        def parts(folds: Sequence[Fold]) -> Parts:
            drawn = ((np.r_[fold.train, always], fold.test) for fold in folds)
            return held_out_parts(small, codes, len(core.classes), drawn).take(slice(n))

        def random_parts(n_folds: int) -> Parts:
            drawn = hold_out(data, "random", n_folds=n_folds).folds
            return parts(drawn).take(np.sort(np.concatenate([fold.test for fold in drawn])))

        rank = groups_of(data).rank
        rule = unknown_rule(
            core.classes,
            parts(held.folds.folds),
            codes[:n],
            share_known=share_known,
            of_folds=(random_parts(N_RANDOM_FOLDS), random_parts(max(2, len(held.folds)))),
            blocks=blocks_in_time(rank, codes[:n]) if held.folds.by == TIME and rank is not None else None,
            held_out=held.folds.name if held.folds.sessions_apart else "",
        )
        fitted = Novelty.fit(s, codes, len(core.classes))
    return rule.to_dict(), (scaling, fitted.directions, fitted.means)


def _blocks(core: _core.Model) -> dict[str, int]:
    """Columns of each block of plain features."""
    if not isinstance(core.spec, FeatureSpec):
        return core.spec.block_sizes
    n_raw = core.n_samples * core.n_axes if core.spec.raw else 0
    sizes = {"raw": n_raw, "hfmh": core.n_features - n_raw}
    return {name: size for name, size in sizes.items() if size}


# What a model says of its training, in types that JSON knows.


def _described(data: Dataset, name: str, pipeline: Pipeline) -> dict[str, Any]:
    """Return settings, recordings and the steps that prepared them."""
    # Rows name files: a model is handed on, and says what was done, not to which file.
    parts = ("step", "parameters", "totals")
    without = ("threads", "n_jobs")
    steps = [describe_estimator(step) for _, step in pipeline.steps]
    return {
        "settings": {
            "space": name,
            "steps": [{key: value for key, value in step.items() if key not in without} for step in steps],
        },
        "synthetic": data.is_synthetic,
        "recordings": _counts(data.y),
        "n_sessions": len(set(data.sessions.tolist()) - {None}),
        "n_triggers": sum(recording.trigger_index is not None for recording in data),
        "setup": values_in(setups_in(data)),
        "history": [{key: step[key] for key in parts} for step in describe_data(data)["history"]],
        "versions": versions(),
    }


def _counts(labels: npt.NDArray[np.str_]) -> dict[str, int]:
    """Count the recordings of each label."""
    names, counts = np.unique(labels, return_counts=True)
    return dict(zip(names.tolist(), counts.tolist(), strict=True))


def _choice(choice: Choice, held: HeldOut | None) -> dict[str, Any]:
    """Return what the model chose, and what those of the estimate chose."""
    elsewhere = [] if held is None else zip(held.held.folds, held.chosen, strict=True)
    of_each = ("chosen", "note", "accuracy_on_the_folds_that_chose")
    in_folds = [
        {"held_out": fold.held_out, **{name: chosen.to_dict()[name] for name in of_each}}
        for fold, chosen in elsewhere
        if chosen is not None
    ]
    return {**choice.to_dict(), "in_folds": in_folds}


def _common_lead(data: Dataset) -> float | None:
    """Seconds ahead of the trigger, where every recording has the same."""
    triggers = {recording.trigger_index for recording in data}
    trigger = triggers.pop()
    return None if triggers or trigger is None else trigger / data.rate_hz

"""The steps of `Identifier.fit`: weights of all recordings, answers about held-out ones, what both say."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import clone
from sklearn.pipeline import Pipeline

from granular_id import _core
from granular_id._checks import argument_error
from granular_id._core import GranularIdError
from granular_id._estimators import describe_estimator, real_steps, seeded_clone, versions, with_rate
from granular_id._files import json_value
from granular_id._parallel import single_threaded_blas
from granular_id.confidence import (
    N_RANDOM_FOLDS,
    Novelty,
    Parts,
    blocks_in_time,
    held_out_parts,
    rotated,
    scaled,
    unknown_rule,
)
from granular_id.ecoc import ECOCClassifier, design
from granular_id.features import FeatureSpec
from granular_id.identifier.early import HeldOut, checkpoints, provisional_answers
from granular_id.identifier.model import MAX_FILE_BYTES, SPACES
from granular_id.recording import Dataset, describe_data, setups_in, unit_of, values_in
from granular_id.score import Held, fit_and_score, space_pipeline
from granular_id.spaces import (
    HFMH,
    LINEAR_STEPS,
    BestClassifier,
    BlockScaler,
    Choice,
    MultiBand,
    RawHFMH,
    RawSignal,
    choice_of,
    feature_spaces,
    fit_on_features,
    folded_back,
)
from granular_id.splits import AUTO, TIME, Fold, Folds, Groups, groups_of, hold_out, rows_of_class

FloatArray = npt.NDArray[np.float64]
FloatArray32 = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.intp]

OWN = "pipeline"
"""What the space of a pipeline of one's own is called."""

_HEADER_BYTES = 2**16
"""Room for what is no weight: names, settings, estimates."""

_AT_ONCE = 1024


# Pipelines, and the compiled model that a fitted one becomes.


def pipeline_of(space: Any, rate_hz: float, threads: int | None) -> tuple[str, Pipeline]:
    """Return the name of a feature space, and it with its classifier, not fitted, for recordings of a rate."""
    if isinstance(space, Pipeline):
        _refuse_other_steps(space)
        return OWN, with_rate(clone(space), rate_hz)
    if space not in SPACES:
        raise argument_error(
            GranularIdError,
            "space",
            f"must be one of {', '.join(map(repr, SPACES))} or a pipeline, got {space!r:.60}: an identifier computes "
            "its features while samples arrive",
        )
    known = feature_spaces(rate_hz=rate_hz, threads=threads)[space]
    classifier = ECOCClassifier() if known.classifier is None else known.classifier
    return space, space_pipeline(known.transformer, classifier)


def _refuse_other_steps(pipeline: Pipeline) -> None:
    """Refuse a pipeline that does not end in one matrix of weights on features of ours."""
    space, *between, classifier = steps = real_steps(pipeline)
    if not (
        len(steps) > 1
        and type(space) in (RawSignal, HFMH, RawHFMH, MultiBand)
        and isinstance(classifier, (ECOCClassifier, BestClassifier))
        and all(isinstance(step, LINEAR_STEPS) for step in between)
    ):
        raise argument_error(
            TypeError,
            "space",
            "must be a pipeline of RawSignal, HFMH, RawHFMH or MultiBand, steps that scale or whiten, and "
            f"ECOCClassifier or BestClassifier, got {', '.join(type(step).__name__ for step in steps)}",
        )


def model_of(
    pipeline: Pipeline,
    data: Dataset,
    *,
    samples: FloatArray | None = None,
    units: Sequence[str] | None = None,
    early: FloatArray | None = None,
    novelty: tuple[FloatArray32, FloatArray32, FloatArray32] | None = None,
    trained: Mapping[str, Any] | None = None,
    training_sha256: str = "",
) -> _core.Model:
    """Build a model of a pipeline fitted on recordings: scaling and whitening end in the weights of the learners.

    `samples` (n, T, C) are the recordings that trained it: what has not been seen counts as their mean.
    """
    space, *between, classifier = real_steps(pipeline)
    own_hz = getattr(space, "rate_hz_", data.rate_hz)
    if own_hz != data.rate_hz:
        problem = f"is for {own_hz:g} Hz, the recordings have {data.rate_hz:g} Hz"
        raise argument_error(GranularIdError, "space", problem)
    triggers = {recording.trigger_index for recording in data}
    trigger = triggers.pop()
    arrays: dict[str, Any] = {}
    with np.errstate(over="ignore"):  # the model refuses what is not finite
        coef, intercept = folded_back(between, classifier.coef_, classifier.intercept_)
        spec, coef = _on_plain_features(space, coef, data.rate_hz)
        if samples is not None and isinstance(spec, FeatureSpec) and spec.raw:
            arrays["raw_mean"] = samples.mean(axis=0).T.ravel()
    return _core.Model(
        spec,
        coef,
        np.array(intercept, dtype=np.float64),
        classifier.coding_matrix_,
        classifier.classes_.tolist(),
        loss=classifier.loss,
        n_samples=int(space.n_features_in_),
        n_axes=int(space.n_axes_in_),
        early=early,
        novelty=novelty,
        metadata={
            "axes": json.dumps(data.axes),
            "units": json.dumps(units or [unit_of(axis) for axis in data.axes]),
            "training_sha256": training_sha256,
            # Where every recording has the same rest ahead of the trigger.
            "lead_s": "" if triggers or trigger is None else repr(trigger / data.rate_hz),
            "trained": json.dumps(trained or {}, ensure_ascii=False, sort_keys=True, allow_nan=False),
        },
        **arrays,
    )


def _on_plain_features(
    space: Any, coef: FloatArray, rate_hz: float
) -> tuple[FeatureSpec | _core.MultiBandExtractor, FloatArray]:
    """Return what `_core` extracts, and the weights of that, from those of a feature space's columns."""
    if isinstance(space, MultiBand):
        return _without_unused_blocks(space.extractor_, coef)
    if isinstance(space, RawHFMH):
        n_raw = space.n_features_in_ * space.n_axes_in_
        weights = np.repeat(space.block_weights_, [n_raw, coef.shape[1] - n_raw])
        return space.spec_, coef * weights
    if isinstance(space, HFMH):
        return space.spec_, coef
    # The filter is never used: a cut-off that fits any rate.
    return FeatureSpec(rate_hz=rate_hz, cutoff_hz=min(23.0, rate_hz / 4), raw=True, hfmh=False), coef


def features_of(core: _core.Model, X: FloatArray, threads: int | None = None) -> FloatArray:
    """Extract what the weights of a model are for, (n, D), from recordings (n, T, C)."""
    spec = core.spec
    features = np.empty((len(X), core.n_features))
    for start in range(0, len(X), _AT_ONCE):
        rows = slice(start, start + _AT_ONCE)
        if isinstance(spec, FeatureSpec):
            features[rows] = _core.extract_features(X[rows], spec, threads)
        else:
            features[rows] = spec.extract(X[rows], threads)
    return features


def _without_unused_blocks(
    spec: _core.MultiBandExtractor, coef: FloatArray
) -> tuple[_core.MultiBandExtractor, FloatArray]:
    """Leave blocks out of which all weights are 0: no score changes, and nobody computes them."""
    ends = np.cumsum(list(spec.block_sizes.values()))
    parts = dict(zip(spec.block_sizes, np.split(coef, ends[:-1], axis=1), strict=True))
    used = [name for name, part in parts.items() if part.any()]
    if not used or len(used) == len(parts):
        return spec, coef
    smaller = _core.MultiBandExtractor(
        spec.n_samples,
        spec.n_axes,
        rate_hz=spec.rate_hz,
        blocks=used,
        scales=spec.scales,
        level_scales=spec.level_scales,
    )
    return smaller, np.concatenate([parts[name] for name in used], axis=1)


# What trains.


def background_of(data: Dataset, background: Sequence[str], *, has_use: bool) -> Dataset | None:
    """Return the recordings of materials that are never named; refuse those that are missing, or have no use."""
    if isinstance(background, str):
        raise argument_error(TypeError, "background", f"must be a sequence of labels, got {background!r}")
    missing = sorted(set(background) - set(data.y.tolist()))
    if missing:
        raise argument_error(
            GranularIdError, "background", f"names {missing[0]!r}, of which there is no recording"
        )
    if background and not has_use:
        problem = "has no use where nothing is refused: leave it out, or give share_known and estimate"
        raise argument_error(GranularIdError, "background", problem)
    return data.select(labels=list(background)) if background else None


def refuse_large(pipeline: Pipeline, n_classes: int, X: FloatArray) -> None:
    """Refuse a model that no file could hold, before any time is spent on it; name ways out."""
    n_values = int(np.prod(X.shape[1:]))
    space, coding = pipeline[0], getattr(pipeline[-1], "coding", "onevsone")
    if hasattr(space, "blocks") and n_values > _core.MAX_MULTIBAND_VALUES:
        raise GranularIdError(
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
        raise GranularIdError(
            f"the model would take {size / 2**20:.3g} MiB, more than the {MAX_FILE_BYTES / 2**20:.3g} MiB of a model "
            f"file: {n_learners} learners for {n_classes} materials, {n_features} features; ways out: {ways}"
        )


@dataclass(frozen=True, eq=False)
class Split:
    """What of the recordings is held out, and what must not lie on both sides of a split."""

    groups: Groups
    n_classes: int
    folds: Folds | None = None  # of the estimate
    random: tuple[Folds, ...] = ()  # two, for how much stranger a recording is to models of fewer
    why_none: str = "no recordings were held out, as requested"


def split_of(data: Dataset, by: str, seed: int, *, estimate: bool) -> Split:
    """Draw the folds of the estimate, which a model does not need."""
    groups, n_classes = groups_of(data, by), len(rows_of_class(data.y))
    if not estimate:
        return Split(groups, n_classes)
    try:
        folds = hold_out(data, by, seed=seed)
    except ValueError as why:
        if by != AUTO:
            raise
        return Split(groups, n_classes, why_none=str(why))
    sizes = N_RANDOM_FOLDS, max(2, len(folds))
    try:
        drawn = tuple(hold_out(data, "random", n_folds=n) for n in sizes)
    except ValueError:  # windows that share samples with all others of their material
        drawn = ()
    return Split(groups, n_classes, folds, drawn, "")


@dataclass(frozen=True, eq=False)
class Fitted:
    """A pipeline that was fitted on all recordings."""

    pipeline: Pipeline
    plain: _core.Model  # its weights alone
    rows: FloatArray  # (n, D) what these are for
    codes: IntArray  # (n,) material of each row


def fit_all(
    pipeline: Pipeline, data: Dataset, groups: Groups, random_state: int, threads: int | None
) -> Fitted:
    """Fit a clone of a pipeline on all recordings."""
    X, y = data.X, data.y
    # The bits of a model must not depend on how many threads multiply its matrices.
    with single_threaded_blas():
        fitted = seeded_clone(pipeline, np.random.SeedSequence(random_state, spawn_key=(4,)))
        fit_on_features(fitted, fitted[0].fit(X, y).transform(X), y, groups)
        plain = model_of(fitted, data)
    return Fitted(fitted, plain, features_of(plain, X, threads), np.searchsorted(plain.classes, y))


def held_out_answers(
    pipeline: Pipeline, data: Dataset, folds: Folds, *, seed: int, tick: Callable[[str], None], name: str
) -> HeldOut:
    """Train on the rows of each fold, and answer about the recordings that it holds out, moment by moment."""
    X, classes = data.X, np.unique(data.y)
    n_seen = checkpoints(X.shape[1])

    def observe(fitted: Pipeline, _: Any, train: IntArray, __: Any, test: IntArray) -> tuple[Any, ...]:
        own = X[train]
        core = model_of(fitted, data, samples=own)
        winners, margins = zip(
            *(provisional_answers(core, X[row], n_seen) for row in test.tolist()), strict=True
        )
        known = np.searchsorted(classes, core.classes)  # a condition that is held out may leave materials out
        return known[np.array(winners)], margins, choice_of(fitted)

    held = fit_and_score(pipeline, data, folds, seed=seed, tick=tick, observe=observe, name=name)
    winners, margins, chosen = zip(*held.observed, strict=True)
    return HeldOut(held, n_seen, data.rate_hz, np.concatenate(winners), np.concatenate(margins), chosen)


def refusal(
    fitted: Fitted,
    beside: Dataset | None,
    held: Held,
    split: Split,
    share_known: float,
    threads: int | None,
) -> tuple[dict[str, Any], tuple[FloatArray32, FloatArray32, FloatArray32]]:
    """Set the rule of refusal on held-out recordings, and fit what their novelty is computed with.

    Recordings of background materials, `beside`, train in all folds.
    """
    core, rows, codes = fitted.plain, fitted.rows, fitted.codes
    n, n_classes = len(rows), len(core.classes)
    if beside is not None:
        own = n_classes + np.unique(beside.y, return_inverse=True)[1]
        rows, codes = np.concatenate([rows, features_of(core, beside.X, threads)]), np.r_[codes, own]
    always = np.arange(n, len(codes))
    scaler = BlockScaler(_blocks(core)).fit(rows)
    scaling = np.array([scaler.mean_, scaler.factor_], dtype=np.float32)
    s = scaled(rows, scaling)
    with single_threaded_blas():
        small = rotated(s)

        def parts(folds: Sequence[Fold]) -> Parts:
            drawn = ((np.r_[fold.train, always], fold.test) for fold in folds)
            return held_out_parts(small, codes, n_classes, drawn).take(slice(n))

        of_folds = [
            parts(drawn.folds).take(np.sort(np.concatenate([fold.test for fold in drawn])))
            for drawn in split.random
        ]
        rank = split.groups.rank if held.folds.by == TIME else None
        rule = unknown_rule(
            core.classes,
            parts(held.folds.folds),
            codes[:n],
            share_known=share_known,
            of_folds=(of_folds[0], of_folds[1]) if of_folds else None,
            blocks=None if rank is None else blocks_in_time(rank, codes[:n]),
            held_out=held.folds.name if held.folds.sessions_apart else "",
        )
        learned = Novelty.fit(s, codes, n_classes)
    return rule.to_dict(), (scaling, learned.directions, learned.means)


def _blocks(core: _core.Model) -> dict[str, int]:
    """Columns of each block of plain features."""
    if not isinstance(core.spec, FeatureSpec):
        return core.spec.block_sizes
    n_raw = core.n_samples * core.n_axes if core.spec.raw else 0
    sizes = {"raw": n_raw, "hfmh": core.n_features - n_raw}
    return {name: size for name, size in sizes.items() if size}


# What a model says of its training, in types that JSON knows.


def described(data: Dataset, name: str, pipeline: Pipeline) -> dict[str, Any]:
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
        "recordings": counts(data),
        "n_sessions": len(set(data.sessions.tolist()) - {None}),
        "setup": values_in(setups_in(data)),
        "history": [{key: step[key] for key in parts} for step in describe_data(data)["history"]],
        "versions": versions(),
    }


def counts(data: Dataset) -> dict[str, int]:
    """Count the recordings of each label."""
    names, found = np.unique(data.y, return_counts=True)
    return dict(zip(names.tolist(), found.tolist(), strict=True))


def estimated(held: HeldOut | None, why_none: str) -> dict[str, Any]:
    """Return the accuracy on held-out recordings and how it was found; or why it was not."""
    if held is None:
        return {"estimate": None, "why_no_estimate": why_none}
    own = held.held
    low, high = own.interval
    estimate = {
        "by": own.folds.by,
        "held_out": own.folds.name,
        "note": "; ".join(own.folds.notes),
        "n_folds": len(own.folds),
        "n_answers": len(own.rows),
        "accuracy": own.accuracy,
        "interval_95": None if math.isnan(low) else [low, high],
        "recall": dict(zip(own.classes, json_value(own.recall), strict=True)),
        "untested": dict(own.folds.untested),
    }
    return {"estimate": estimate, "why_no_estimate": why_none}


def chosen(fitted: Fitted, held: HeldOut | None) -> Mapping[str, Any]:
    """Return what the model chose, and what those of the estimate chose; nothing where it had no choice."""
    choice = choice_of(fitted.pipeline)
    if choice is None:
        return {}
    elsewhere = [] if held is None else zip(held.held.folds, held.chosen, strict=True)
    of_each = ("chosen", "note", "accuracy_on_the_folds_that_chose")
    in_folds = [
        {"held_out": fold.held_out, **{name: own.to_dict()[name] for name in of_each}}
        for fold, own in elsewhere
        if isinstance(own, Choice)
    ]
    return {"choice": {**choice.to_dict(), "in_folds": in_folds}}

"""Training: a model of all recordings, and what held-out recordings say about it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._checks import argument_error, finite_number, whole_number
from granular_id._estimators import convergence_warnings, versions
from granular_id._memory import taken
from granular_id._parallel import single_threaded_blas
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.confidence import HeldOutScores, Scores, conformal_rule, unknown_rule
from granular_id.ecoc import design
from granular_id.identifier.adapt import features_of, with_source
from granular_id.identifier.metadata import BANDED, MAX_FILE_BYTES, fingerprint, stored_marks
from granular_id.identifier.recipe import Recipe, model_of, plain_features
from granular_id.identifier.rules import (
    KEY,
    EarlyRule,
    HeldOut,
    calibrate,
    checkpoints,
    provisional_answers,
)
from granular_id.partitions import (
    Partition,
    condition_partitions,
    lone_session,
    protocol_name,
    rows_of_class,
)
from granular_id.recording import (
    Dataset,
    common_units,
    condition_of,
    data_warnings,
    describe_data,
    mixed_setup_warnings,
    setups_in,
    values_in,
)
from granular_id.spaces import BestClassifier, Choice, Chosen, fit_on_features, fit_pipeline
from granular_id.splits import Groups, groups_of, strictest_partitions
from granular_id.statistics import confusion_counts, mean_interval, recall_per_class

FloatArray = npt.NDArray[np.float64]

_HEADER_BYTES = 2**16
"""Kept free for what is no weight: names, settings, estimates."""


@dataclass(frozen=True, eq=False)
class Training:
    """A model of all recordings, and what is known about it."""

    core: _core.Model
    trained: dict[str, Any]  # what the model says of its training, in types that JSON knows
    held: HeldOut | None
    early: EarlyRule | None  # None where it was not asked for, or nothing was held out


def train(
    data: Dataset,
    recipe: Recipe,
    *,
    hold_out: str | None = None,
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

    Parameters and errors are those of `granular_id.Identifier.fit`; what is wrong with them is said before anything is
    trained.
    """
    _check_share("target_error", target_error)
    if coverage is not None:
        _check_share("coverage", coverage)
    if share_known is not None:
        _check_share("share_known", share_known)
    whole_number("n_folds", n_folds, least=2)
    if not isinstance(data, Dataset):
        raise TypeError(f"data must be a granular_id.Dataset, got {type(data).__name__}")
    X, y, rate_hz = data.X, data.y, data.rate_hz
    units = common_units(data)
    classes = tuple(rows_of_class(y))
    refuse_large(recipe, len(classes), X.shape[1:], max_file_bytes)
    if hold_out is not None and not estimate and recipe.space != "best":
        problem = f"={hold_out!r} has no use without an estimate where nothing is chosen: leave it out"
        raise argument_error(ValueError, "hold_out", problem)
    groups, partitions, note = _held_out(data, hold_out, n_folds, recipe.random_state)
    why_none = "" if partitions else note
    if not estimate:
        partitions, why_none = [], "no recordings were held out, as asked"
    held = None
    # The bits of a model must not depend on how many threads multiply its matrices: here, and where it is built.
    with showing(progress or False) as callback, convergence_warnings(recipe.space) as not_converged:
        ticker = Ticker(1 + len(partitions), callback)
        with single_threaded_blas():
            pipeline = recipe.pipeline(rate_hz, threads=threads)
            features = pipeline[0].fit(X, y).transform(X)
            fit_on_features(pipeline, features, y, groups)
            classifier = pipeline[-1]
            chooses = isinstance(classifier, BestClassifier) and recipe.space == "best"
            ticker.tick("all recordings")
            if partitions:
                held = _answers(data, recipe, groups, partitions, note, threads, ticker.tick)
    rule = calibrate(held, float(target_error)) if early and held is not None else None
    rules = {}
    if held is not None:
        rules = _fit_confidence_rules(held, classes, classifier.coding_matrix_, coverage, share_known)
    trained = {
        **_described(data, recipe),
        **stored_marks(data),
        "estimate": None if held is None else _estimate(held, classes),
        "why_no_estimate": why_none,
        "early": None if held is None or rule is None else rule.to_dict(held, rate_hz),
        **({"choice": _choice(classifier.choice_, held)} if chooses else {}),
        **({KEY: rules} if rules else {}),
        "left_out": getattr(pipeline[0], "dropped_", ""),
        # What may mislead a reader of the estimate.
        "notes": [*(mixed_setup_warnings(data) if held is None else data_warnings(data)), *not_converged],
    }
    with single_threaded_blas():
        core = model_of(
            pipeline,
            rate_hz,
            axes=data.axes,
            units=units,
            lead_s=_common_lead(data),
            samples=X,
            early=None if rule is None else rule.table(),
            trained=trained,
            training_sha256=fingerprint(data, trained["settings"]),
            coding=recipe.coding if isinstance(recipe.coding, str) else "",
        )

    def rows() -> FloatArray:
        own = plain_features(pipeline[0], features, core.spec)
        return features_of(core, X, threads) if own is None else own

    core = with_source(core, rows, y, max_file_bytes)
    return Training(core, trained, held, rule)


def _check_share(name: str, share: float) -> None:
    value = finite_number(name, share)
    if not 0 < value < 1:
        raise argument_error(ValueError, name, f"must lie between 0 and 1, got {value:g}")


def refuse_large(recipe: Recipe, n_classes: int, shape: tuple[int, int], most: int) -> None:
    """Refuse a model that no file of `most` bytes could hold, before any time is spent on it; name ways out."""
    n_samples, n_axes = shape
    n_values, n_counts = n_samples * n_axes, recipe.n_bins * n_axes
    is_banded = recipe.space in BANDED
    if is_banded and n_values > _core.MAX_MULTIBAND_VALUES:
        raise ValueError(
            f"recordings of {n_samples} samples of {n_axes} axes are too long for a model of multi-band features: "
            f"{n_values} values, at most {_core.MAX_MULTIBAND_VALUES}; shorten them, or take space='hfmh'"
        )
    if is_banded:
        n_raw, n_features = 0, _core.MultiBandExtractor(n_samples, n_axes, blocks=recipe.blocks).n_features
    else:
        n_raw = n_values if "raw" in recipe.space else 0
        n_features = n_raw + (n_counts if "hfmh" in recipe.space else 0)
    n_learners = design(recipe.coding, n_classes).shape[1]
    size = 8 * (n_learners * (n_features + n_classes + 4) + n_raw) + _HEADER_BYTES
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


# What held-out recordings say.


def _held_out(
    data: Dataset, hold_out: str | None, n_folds: int, seed: int
) -> tuple[Groups, list[Partition], str]:
    """Return groups and partitions, strictest or by the values of a condition, and a line on how, or why none."""
    groups = groups_of(data)
    if hold_out is None:
        try:
            return groups, *strictest_partitions(data, n_folds=n_folds, seed=seed)
        except ValueError as why:  # a model all the same, of which nobody knows how good it is
            return groups, [], str(why)
    name, values = condition_of(data, hold_out)
    alone = lone_session(data.y, values)
    if alone is not None:  # models of a part would not know it
        problem = (
            f"={hold_out!r}: {alone!r} has one value of it only; record it with another, or leave it out"
        )
        raise argument_error(ValueError, "hold_out", problem)
    drawn, _ = condition_partitions(data.y, name, values)
    return replace(groups, conditions=values), drawn, f"{name}: {len(drawn)} values, held out one by one"


def _answers(
    data: Dataset,
    recipe: Recipe,
    groups: Groups,
    partitions: list[Partition],
    note: str,
    threads: int | None,
    tick: Callable[[str], None],
) -> HeldOut:
    """Train on the rows of each partition, and answer about the recordings it holds out."""
    X, held_out = data.X, protocol_name(partitions[0].protocol, partitions)
    _, truth = np.unique(data.y, return_inverse=True)
    n_seen = checkpoints(X.shape[1])
    answers, values, scores, chosen = [], [], [], []
    for partition in partitions:
        samples = taken(X, partition.train, "recordings that train")
        pipeline = recipe.pipeline(data.rate_hz, threads=threads)
        fit_pipeline(pipeline, samples, data.y[partition.train], groups.take(partition.train))
        core = model_of(pipeline, data.rate_hz, axes=data.axes, samples=samples)
        chosen.append(Chosen.of(pipeline))
        answers += [provisional_answers(core, X[row], n_seen) for row in partition.test.tolist()]
        scores.append(core.scores(taken(X, partition.test, "recordings held out")))
        values.append(-core.losses(scores[-1]))
        tick(f"{held_out}: {partition.description}")
    rows = np.concatenate([partition.test for partition in partitions])
    winners, margins = zip(*answers, strict=True)
    return HeldOut(
        n_seen=n_seen,
        rows=rows,
        folds=np.repeat(np.arange(len(partitions)), [partition.test.size for partition in partitions]),
        truth=truth[rows].astype(np.intp),
        winners=np.array(winners, dtype=np.intp),
        margins=np.array(margins),
        held_out=held_out,
        note=note,
        partitions=tuple(partitions),
        values=np.concatenate(values),
        scores=np.concatenate(scores),
        chosen=tuple(chosen),
    )


def _estimate(held: HeldOut, classes: tuple[str, ...]) -> dict[str, Any]:
    """Return the accuracy on held-out recordings and how it was found, in types that JSON knows.

    The interval is corrected for the recordings that partitions share, and None with few partitions or where all agree.
    """
    right = held.right[:, -1]
    shares = np.array([right[held.folds == fold].mean() for fold in range(len(held.partitions))])
    n_train, n_test = zip(*((part.train.size, part.test.size) for part in held.partitions), strict=True)
    low, high = mean_interval(shares, n_train, n_test)
    recall = recall_per_class(confusion_counts(held.truth, held.winners[:, -1], len(classes)))
    return {
        "protocol": held.partitions[0].protocol,
        "held_out": held.held_out,
        "note": held.note,
        "n_partitions": len(held.partitions),
        "n_answers": len(held.rows),
        "accuracy": float(shares.mean()),
        "interval_95": None if math.isnan(low) else [low, high],
        "recall": dict(zip(classes, recall.tolist(), strict=True)),
    }


def _fit_confidence_rules(
    held: HeldOut,
    classes: tuple[str, ...],
    coding: npt.NDArray[np.int8],
    coverage: float | None,
    share_known: float | None,
) -> dict[str, Any]:
    """Set the rules of candidates and rejection on held-out recordings, in types that JSON knows."""
    rules: dict[str, Any] = {}
    rows, first = np.unique(held.rows, return_index=True)  # each once, however often it was held out
    scored = HeldOutScores(
        classes=classes,
        truth=held.truth[first],
        scores=Scores(held.values[first], held.scores[first], None, coding),
        rows=rows,
        folds=held.folds[first],
        groups=np.arange(rows.size, dtype=np.intp),
        held_out=held.held_out,
    )
    if coverage is not None:
        rules["conformal"] = conformal_rule(scored, [coverage]).to_dict()
    if share_known is not None:
        rules["unknown"] = unknown_rule(scored, share_known=share_known).to_dict()
    return rules


# What a model says of its training, in types that JSON knows.


def _described(data: Dataset, recipe: Recipe) -> dict[str, Any]:
    """Return settings, recordings and the steps that prepared them."""
    labels, counts = np.unique(data.y, return_counts=True)
    # Rows name files: a model is handed on, and says what was done, not to which file.
    kept = ("step", "parameters", "totals")
    return {
        "settings": recipe.to_dict(data.rate_hz),
        "synthetic": data.is_synthetic,
        "recordings": dict(zip(labels.tolist(), counts.tolist(), strict=True)),
        "n_sessions": len(set(data.sessions.tolist()) - {None}),
        "n_triggers": sum(recording.trigger_index is not None for recording in data),
        "setup": values_in(setups_in(data)),
        "history": [{key: step[key] for key in kept} for step in describe_data(data)["history"]],
        "versions": versions(),
    }


def _choice(choice: Choice, held: HeldOut | None) -> dict[str, Any]:
    """Return what the model chose, and what those of the estimate chose."""
    elsewhere = [] if held is None else zip(held.partitions, held.chosen, strict=True)
    return {
        **choice.to_dict(),
        "in_partitions": [
            {
                "partition": partition.description,
                "chosen": list(chosen.names),
                "note": chosen.note,
                "accuracy_on_the_folds_that_chose": chosen.together,
            }
            for partition, chosen in elsewhere
            if chosen is not None
        ],
    }


def _common_lead(data: Dataset) -> float | None:
    """Seconds ahead of the trigger, where every recording has the same."""
    triggers = {recording.trigger_index for recording in data}
    trigger = triggers.pop()
    return None if triggers or trigger is None else trigger / data.rate_hz

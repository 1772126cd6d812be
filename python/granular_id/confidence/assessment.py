"""Calibration, prediction sets and refusal of one model in one call."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy.typing as npt
from sklearn.pipeline import Pipeline

from granular_id._estimators import versions, with_rate
from granular_id._files import write_json
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id._text import Table
from granular_id.confidence.calibration import Reliability, probabilities_of, reliability
from granular_id.confidence.conformal import LEVELS, ConformalRule, conformal_rule
from granular_id.confidence.coverage import CoverageResult, coverage_study
from granular_id.confidence.held_out import N_FOLDS, Rows, held_out_scores, rows_of, without_fixed_steps
from granular_id.confidence.open_set import OpenSetResult, leave_one_material_out
from granular_id.confidence.unknown import UnknownRule, available_kinds, unknown_rule
from granular_id.recording import Dataset, describe_data


@dataclass(frozen=True)
class Confidence:
    """How sure a model may be, and the rules to be stored with it.

    Attributes
    ----------
    reliability : Reliability
        Whether probabilities mean what they say.
    coverage : CoverageResult
        Whether prediction sets hold what they promise.
    open_set : OpenSetResult or None
        Whether unknown materials are refused; None with fewer than three materials.
    conformal : ConformalRule
        From all rows, for the model that is trained on all of them.
    unknown : UnknownRule
        The same for refusal.
    notes : tuple of str
    data, versions : mapping
        Summary of the recordings where there are any; versions of what computed the numbers.
    synthetic : bool
        Such figures say nothing about real materials.
    name : str
        What was assessed: a feature space, or the steps of a model.
    """

    reliability: Reliability
    coverage: CoverageResult
    open_set: OpenSetResult | None
    conformal: ConformalRule
    unknown: UnknownRule
    notes: tuple[str, ...]
    data: Mapping[str, Any]
    versions: Mapping[str, str]
    synthetic: bool = False
    name: str = ""

    def tables(self) -> tuple[Table, ...]:
        """Return all figures as tables, which name the model."""
        found = [self.reliability.table(), self.coverage.table()]
        if self.open_set is not None:
            found.append(self.open_set.table())
            if len(self.open_set.kinds) > 1:
                found.append(self.open_set.comparison())
        return tuple(replace(one, title=f"{self.name}: {one.title}") if self.name else one for one in found)

    def __str__(self) -> str:
        return "\n\n".join([*map(str, self.tables()), *(["\n".join(self.notes)] if self.notes else [])])

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows."""
        return {
            "format": "granular-id confidence 1",
            "name": self.name,
            "synthetic": self.synthetic,
            "reliability": self.reliability.to_dict(),
            "coverage": self.coverage.to_dict(),
            "open_set": None if self.open_set is None else self.open_set.to_dict(),
            "conformal": self.conformal.to_dict(),
            "unknown": self.unknown.to_dict(),
            "notes": list(self.notes),
            "data": dict(self.data),
            "versions": dict(self.versions),
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write `to_dict` as one JSON file; whole or not at all."""
        write_json(path, self.to_dict())


def assess(
    data: Dataset | Rows | npt.ArrayLike,
    model: Any,
    y: npt.ArrayLike | None = None,
    *,
    sessions: Sequence[str | None] | None = None,
    in_time_order: bool = False,
    levels: Sequence[float] = LEVELS,
    kind: str = "margin",
    per_class: bool = False,
    share_known: float = 0.95,
    unknown_kind: str | None = None,
    compare: bool = False,
    n_seeds: int = 20,
    n_folds: int | None = None,
    seed: int = 0,
    n_jobs: int | None = None,
    progress: bool | ProgressCallback = False,
    name: str | None = None,
) -> Confidence:
    """Measure how sure a model may be, and set the rules to be stored with it.

    Parameters
    ----------
    data : Dataset, Rows or array-like, shape (n, ...)
    model : estimator
        Anything that scikit-learn can clone, with `decision_function`, not fitted. One whose `fit` has the parameters
        ``sessions`` and ``order``, or a pipeline that ends in one, is told those of its training rows.
    y, sessions, in_time_order
        Of arrays only: the label and the session of each row, and whether rows stand in the order of recording.
    levels, kind, per_class
        Of the prediction sets, see `conformal_rule`.
    share_known, unknown_kind
        Of the refusal, see `unknown_rule`.
    compare : bool, default False
        Also measure the other kinds of novelty score.
    n_seeds : int, default 20
        Random partitions of `coverage_study`.
    n_folds : int, optional
        Of the cross-fits. Default: 5 of whole sessions or blocks in time, 10 of random rows.
    seed : int, default 0
        Of random partitions and folds.
    n_jobs : int, optional
        Threads, as in joblib; the numbers do not depend on it.
    progress : bool or callable
        As in `granular_id.evaluate`; one bar after the other for calibration, coverage and the unknown.
    name : str, optional
        What the model is called in tables and figures. Default: the classes of its steps.

    Returns
    -------
    Confidence

    Raises
    ------
    TypeError, ValueError
        Labels or sessions that do not fit the rows, fewer than two classes, fewer than 3 rows of a class, or 4 where
        halves in time order are tested. Before anything is trained.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.confidence import assess
    >>> from granular_id import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> found = assess(X, ECOCClassifier(), y, n_seeds=2)
    >>> found.conformal.names([-0.1, -0.5, -0.9])[0]
    '0'
    """
    rows = rows_of(data, y, sessions=sessions, in_time_order=in_time_order)
    if isinstance(data, Dataset):
        model = with_rate(model, data.rate_hz)
    rows.refuse_few(n_folds)
    name = _name_of(model) if name is None else name
    model, rows = without_fixed_steps(model, rows)  # once for all that follows
    folds, held_out = rows.folds(n_folds, seed=seed)
    with showing(progress) as callback:
        tick = Ticker(len(folds), callback).tick
        scored = held_out_scores(rows, model, partitions=folds, n_jobs=n_jobs, held_out=held_out, done=tick)
    sets: dict[str, Any] = {"levels": levels, "kind": kind, "per_class": per_class}
    conformal = conformal_rule(scored, **sets)
    unknown = unknown_rule(scored, share_known=share_known, kind=unknown_kind)
    probabilities, source = probabilities_of(scored)
    seen = reliability(
        probabilities,
        scored.truth,
        groups=scored.groups if scored.groups.max() > 0 else None,
        seed=seed,
        source=source,
        held_out=scored.held_out,
        synthetic=rows.synthetic,
    )
    shared: dict[str, Any] = {"seed": seed, "n_jobs": n_jobs, "progress": progress}
    coverage = coverage_study(rows, model, n_seeds=n_seeds, n_folds=n_folds, **sets, **shared)
    notes = [*conformal.notes, *unknown.notes]
    open_set = None
    if len(rows.classes) > 2:
        others = [kind for kind in available_kinds(scored) if compare and kind != unknown.kind]
        kinds = [unknown.kind, *others]
        open_set = leave_one_material_out(
            rows, model, share_known=share_known, kinds=kinds, n_folds=n_folds or N_FOLDS, **shared
        )
    else:
        notes.append(
            "two materials only: none can be left out, so nothing is known of how the unknown is refused"
        )
    return Confidence(
        seen,
        coverage,
        open_set,
        conformal,
        unknown,
        tuple(notes),
        describe_data(data) if isinstance(data, Dataset) else {},
        versions(),
        rows.synthetic,
        name,
    )


def count_trainings(data: Dataset | Rows, *, n_seeds: int = 20, n_folds: int | None = None) -> int:
    """Count the models that `assess` trains at most with the same arguments, to say beforehand how long it may take."""
    rows = rows_of(data)
    rows.refuse_few(n_folds)
    once, drawn = (len(rows.folds(n_folds, strict=strict)[0]) for strict in (True, False))
    strictest = rows.partitions(n_folds)[0]
    strictly = 0 if strictest[0].protocol == "kfold" else len(strictest) * (1 + once)
    left_out = 0
    if len(rows.classes) > 2:
        outer, inner = rows.partitions(n_folds or N_FOLDS)[0], rows.folds(n_folds or N_FOLDS)[0]
        left_out = len(rows.classes) * len(outer) * (1 + len(inner))
    return once + n_seeds * (1 + drawn) + strictly + left_out


def _name_of(model: Any) -> str:
    steps = [step for _, step in model.steps] if isinstance(model, Pipeline) else [model]
    return ", ".join(step if isinstance(step, str) else type(step).__name__ for step in steps)

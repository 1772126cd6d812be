"""Calibration, prediction sets and refusal of one model in one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy.typing as npt
from sklearn.pipeline import Pipeline

from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.confidence.calibration import probabilities_of, reliability
from granular_id.confidence.conformal_fit import LEVELS, conformal_rule
from granular_id.confidence.coverage import coverage_study
from granular_id.confidence.held_out import held_out_scores
from granular_id.confidence.leave_one_out import leave_one_material_out
from granular_id.confidence.result import Confidence
from granular_id.confidence.rows import N_FOLDS, Rows, rows_of
from granular_id.confidence.unknown_fit import available_kinds, unknown_rule
from granular_id.evaluation.describe import describe_data, versions
from granular_id.recording import Dataset

__all__ = ["assess", "count_trainings"]


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
        Of arrays only, see `granular_id.confidence.rows.rows_of`.
    levels, kind, per_class
        Of the prediction sets, see `conformal_rule`.
    share_known, unknown_kind
        Of the refusal, see `unknown_rule`.
    compare : bool, default False
        Also measure the other kinds of strangeness.
    n_seeds : int, default 20
        Random partitions of `coverage_study`.
    n_folds : int, optional
        Of the cross-fits, see `Rows.folds`.
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
        As `granular_id.confidence.rows.rows_of`; fewer than 3 rows of a class, or 4 where halves in time order are
        tested. Before anything is trained.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.confidence import assess
    >>> from granular_id.ecoc import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> found = assess(X, ECOCClassifier(), y, n_seeds=2)
    >>> found.conformal.names([-0.1, -0.5, -0.9])[0]
    '0'
    """
    rows = rows_of(data, y, sessions=sessions, in_time_order=in_time_order)
    rows.refuse_few(n_folds)
    folds, held_out = rows.folds(n_folds, seed=seed)
    with showing(progress) as callback:
        tick = Ticker(len(folds), callback).tick
        scored = held_out_scores(model, rows, folds, n_jobs=n_jobs, held_out=held_out, done=tick)
    conformal = conformal_rule(scored, levels, kind=kind, per_class=per_class)
    unknown = unknown_rule(scored, share_known=share_known, kind=unknown_kind)
    probabilities, source = probabilities_of(scored)
    several = scored.groups.max() > 0
    seen = reliability(
        probabilities,
        scored.truth,
        groups=scored.groups if several else None,
        seed=seed,
        source=source,
        held_out=scored.held_out,
        synthetic=rows.synthetic,
    )
    shared: dict[str, Any] = {"seed": seed, "n_jobs": n_jobs, "progress": progress}
    coverage = coverage_study(
        rows, model, levels=levels, kind=kind, per_class=per_class, n_seeds=n_seeds, n_folds=n_folds, **shared
    )
    notes = [*conformal.notes, *unknown.notes]
    open_set = None
    if len(rows.classes) > 2:
        kinds = [unknown.kind]
        if compare:
            kinds += [other for other in available_kinds(scored) if other != unknown.kind]
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
        name=_name_of(model) if name is None else name,
    )


def count_trainings(data: Dataset | Rows, *, n_seeds: int = 20, n_folds: int | None = None) -> int:
    """Count the models that `assess` trains at most with the same arguments, to say beforehand how long it may take.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.confidence.assessing import count_trainings
    >>> from granular_id.confidence.rows import rows_of
    >>> count_trainings(rows_of(*load_iris(return_X_y=True)), n_seeds=2)
    122
    """
    rows = rows_of(data)
    rows.refuse_few(n_folds)
    once, drawn = (len(rows.folds(n_folds, strict=strict)[0]) for strict in (True, False))
    honest = rows.honest(n_folds)[0]
    strictly = 0 if honest[0].protocol == "kfold" else len(honest) * (1 + once)
    left_out = 0
    if len(rows.classes) > 2:
        outer, inner = rows.honest(n_folds or N_FOLDS)[0], rows.folds(n_folds or N_FOLDS)[0]
        left_out = len(rows.classes) * len(outer) * (1 + len(inner))
    return once + n_seeds * (1 + drawn) + strictly + left_out


def _name_of(model: Any) -> str:
    steps = [step for _, step in model.steps] if isinstance(model, Pipeline) else [model]
    return ", ".join(step if isinstance(step, str) else type(step).__name__ for step in steps)

"""Calibration, prediction sets and refusal of one model in one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy.typing as npt

from granular_id._progress import ProgressCallback
from granular_id.confidence.calibration import probabilities_of, reliability
from granular_id.confidence.conformal_fit import LEVELS, conformal_rule
from granular_id.confidence.coverage import coverage_study
from granular_id.confidence.held_out import held_out_scores
from granular_id.confidence.leave_one_out import leave_one_material_out
from granular_id.confidence.result import Confidence
from granular_id.confidence.rows import N_FOLDS, rows_of
from granular_id.confidence.unknown_fit import available_kinds, unknown_rule
from granular_id.evaluation.describe import describe_data, versions
from granular_id.recording import Dataset

__all__ = ["assess"]


def assess(
    data: Dataset | npt.ArrayLike,
    model: Any,
    y: npt.ArrayLike | None = None,
    *,
    sessions: Sequence[str | None] | None = None,
    in_time_order: bool = False,
    levels: Sequence[float] = LEVELS,
    kind: str = "margin",
    per_class: bool = False,
    share_known: float = 0.95,
    unknown_kind: str = "value_distance",
    compare: bool = False,
    n_seeds: int = 20,
    n_folds: int | None = None,
    seed: int = 0,
    n_jobs: int | None = None,
    progress: bool | ProgressCallback = False,
) -> Confidence:
    """Measure how sure a model may be, and set the rules to be stored with it.

    Parameters
    ----------
    data : Dataset or array-like, shape (n, ...)
    model : estimator
        Anything that scikit-learn can clone, with `decision_function`, not fitted.
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
    n_folds, seed, n_jobs, progress
        As in `leave_one_material_out`.

    Returns
    -------
    Confidence

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
    scored = held_out_scores(model, rows, n_folds=n_folds, seed=seed, n_jobs=n_jobs)
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
    shared: dict[str, Any] = {
        "y": y,
        "sessions": sessions,
        "in_time_order": in_time_order,
        "seed": seed,
        "n_jobs": n_jobs,
        "progress": progress,
    }
    coverage = coverage_study(
        data, model, levels=levels, kind=kind, per_class=per_class, n_seeds=n_seeds, n_folds=n_folds, **shared
    )
    notes = [*conformal.notes, *unknown.notes]
    open_set = None
    if len(rows.classes) > 2:
        kinds = [unknown_kind]
        if compare:
            kinds += [other for other in available_kinds(scored) if other != unknown_kind]
        open_set = leave_one_material_out(
            data, model, share_known=share_known, kinds=kinds, n_folds=n_folds or N_FOLDS, **shared
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
    )

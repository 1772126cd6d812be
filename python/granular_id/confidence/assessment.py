"""Calibration, prediction sets and refusal of one model in one call."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline

from granular_id._checks import whole_number
from granular_id._estimators import versions, with_rate
from granular_id._files import write_json
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id._text import Table
from granular_id.confidence.calibration import Reliability, probabilities_of, reliability
from granular_id.confidence.conformal import LEVELS, ConformalRule, checked_levels, conformal_rule
from granular_id.confidence.coverage import CoverageResult, coverage_study
from granular_id.confidence.held_out import Rows, held_out_scores, rows_of, without_fixed_steps
from granular_id.confidence.open_set import OpenSetResult, leave_one_material_out
from granular_id.confidence.unknown import UnknownRule, unknown_rule
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
    share_known: float = 0.95,
    n_seeds: int = 20,
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
    levels
        Of the prediction sets, see `conformal_rule`.
    share_known
        Of the refusal, see `unknown_rule`.
    n_seeds : int, default 20
        Random partitions on which the coverage of the sets is measured, of 70 % training rows each. 100 tell it to a
        fraction of a point.
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
    levels, n_seeds = checked_levels(levels), whole_number("n_seeds", n_seeds)
    rows.refuse_few()
    name = _name_of(model) if name is None else name
    model, rows = without_fixed_steps(model, rows)  # once for all that follows
    folds, held_out = rows.folds(seed=seed)
    with showing(progress) as callback:
        tick = Ticker(len(folds), callback).tick
        scored = held_out_scores(rows, model, partitions=folds, n_jobs=n_jobs, held_out=held_out, done=tick)
    conformal = conformal_rule(scored, levels)
    unknown = unknown_rule(scored, share_known=share_known)
    probabilities, source = probabilities_of(scored)
    seen = reliability(
        probabilities,
        scored.truth,
        scored.groups if scored.groups.max() > 0 else np.arange(len(scored.truth)),
        seed=seed,
        source=source,
        held_out=scored.held_out,
        synthetic=rows.synthetic,
    )
    shared: dict[str, Any] = {"seed": seed, "n_jobs": n_jobs, "progress": progress}
    coverage = coverage_study(rows, model, levels, n_seeds=n_seeds, **shared)
    notes = [*conformal.notes, *unknown.notes]
    open_set = None
    if len(rows.classes) > 2:
        open_set = leave_one_material_out(rows, model, share_known=share_known, **shared)
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


def _name_of(model: Any) -> str:
    steps = [step for _, step in model.steps] if isinstance(model, Pipeline) else [model]
    return ", ".join(step if isinstance(step, str) else type(step).__name__ for step in steps)

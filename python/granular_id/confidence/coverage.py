"""How often prediction sets hold the right material: where rows are exchangeable, and where they are not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id._checks import whole_number
from granular_id._progress import ProgressCallback
from granular_id._text import Table, percent
from granular_id.confidence.conformal import LEVELS, ConformalRule, checked_levels, conformal_rule, rank_of
from granular_id.confidence.held_out import (
    FloatArray,
    IntArray,
    Rows,
    StudyResult,
    cross_fit,
    for_each,
    rows_of,
    without_fixed_steps,
)
from granular_id.partitions import RANDOM_TEST_SHARE, Partition, random_partition
from granular_id.recording import Dataset


@dataclass(frozen=True)
class Covered:
    """Coverage of one level over the partitions of one kind."""

    held_out: str  # what the tested rows are to the training rows
    random: bool  # whether partitions were drawn at random, so that rows are exchangeable
    level: float  # asked for
    attainable: float  # with so few exchangeable calibration rows: ceil((n + 1) level) / (n + 1), or 1
    coverage: tuple[float, ...]  # share of tested rows whose set held the truth, for each partition
    size: float  # mean number of classes in a set
    empty: float  # share of empty sets

    @property
    def mean(self) -> float:
        """Mean coverage."""
        return float(np.mean(self.coverage))


@dataclass(frozen=True)
class CoverageResult(StudyResult):
    """Coverage against the level asked for.

    Attributes
    ----------
    rows : tuple of Covered
        Random partitions, then the strictest that the data allow.
    kind : str
        As `ConformalRule.kind`.
    per_class : bool
    n_classes : int
    synthetic : bool
    """

    rows: tuple[Covered, ...]
    kind: str
    per_class: bool
    n_classes: int
    synthetic: bool = False

    def table(self) -> Table:
        """Return one row per kind of partition and level."""
        rows = tuple(
            (
                row.held_out,
                f"{100 * row.level:g} %",
                percent(row.attainable),
                percent(row.mean),
                f"{round(100 * (row.mean - row.level), 1) + 0.0:+.1f}",  # no minus before zero
                f"{row.size:.2f}",
                percent(row.empty),
                str(len(row.coverage)),
            )
            for row in self.rows
        )
        header = (
            "tested",
            "asked",
            "attainable",
            "covered",
            "off",
            "classes in a set",
            "empty",
            "partitions",
        )
        notes = (
            "attainable: the least coverage of at least the level that so many calibration rows can give",
            f"sets by {self.kind}{', one threshold per class' if self.per_class else ''}, of {self.n_classes} classes",
        )
        return Table(f"Coverage of prediction sets{self._mark}", header, rows, notes)

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows."""
        return {
            "synthetic": self.synthetic,
            "kind": self.kind,
            "per_class": self.per_class,
            "n_classes": self.n_classes,
            "rows": [{**vars(row), "coverage": list(row.coverage), "mean": row.mean} for row in self.rows],
        }


def coverage_study(
    data: Dataset | Rows | npt.ArrayLike,
    model: Any,
    y: npt.ArrayLike | None = None,
    *,
    sessions: Sequence[str | None] | None = None,
    in_time_order: bool = False,
    levels: Sequence[float] = LEVELS,
    kind: str = "margin",
    per_class: bool = False,
    n_seeds: int = 20,
    n_folds: int | None = None,
    seed: int = 0,
    n_jobs: int | None = None,
    progress: bool | ProgressCallback = False,
) -> CoverageResult:
    """Measure the coverage of cross-fitted prediction sets on rows that had no say in them.

    Random partitions test what the theory promises: training and tested rows are exchangeable there. Partitions by
    sessions or halves in time show what is left of it when the world has moved on.

    Parameters
    ----------
    data, model, y, sessions, in_time_order, n_folds, n_jobs, progress
        As in `granular_id.confidence.assess`.
    levels, kind, per_class
        As in `conformal_rule`.
    n_seeds : int, default 20
        Random partitions, of 70 % training rows each. 100 tell the coverage to a fraction of a point.
    seed : int
        Of the first random partition.

    Returns
    -------
    CoverageResult

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.confidence import coverage_study
    >>> from granular_id import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> study = coverage_study(X, ECOCClassifier(), y, levels=[0.9], n_seeds=10)
    >>> [(row.held_out, round(row.attainable, 3)) for row in study.rows]
    [('random 30 %', 0.906)]
    """
    rows = rows_of(data, y, sessions=sessions, in_time_order=in_time_order)
    rows.refuse_few(n_folds)
    wanted = checked_levels(levels)
    drawn = [random_partition(rows.codes, seed + k) for k in range(whole_number("n_seeds", n_seeds))]
    parts = {(f"random {100 * RANDOM_TEST_SHARE:.0f} %", True): drawn}
    strictest, held_out = rows.partitions(n_folds, seed=seed)
    if strictest[0].protocol != "kfold":
        parts[held_out, False] = strictest
    model, rows = without_fixed_steps(model, rows)
    tasks = [(*part, k, one) for part, partitions in parts.items() for k, one in enumerate(partitions)]

    def covered(task: tuple[str, bool, int, Partition]) -> list[tuple[float, float, float, float]]:
        _, random, k, partition = task
        train, tested = rows.take(partition.train), rows.X[partition.test]
        crossed, scores = cross_fit(model, train, tested, n_folds=n_folds, seed=seed + k, strict=not random)
        rule = conformal_rule(crossed, wanted, kind=kind, per_class=per_class)
        return [_figures(rule, scores.values, rows.codes[partition.test], level) for level in wanted]

    each = for_each(covered, tasks, lambda task: task[-1].description, n_jobs, progress)
    found = []
    for name, random in parts:
        own = [figures for task, figures in zip(tasks, each, strict=True) if task[0] == name]
        for level, *of_level in zip(wanted, *own, strict=True):
            attainable, coverage, size, empty = zip(*of_level, strict=True)
            means = (float(np.mean(figure)) for figure in (size, empty))
            found.append(Covered(name, random, level, float(np.mean(attainable)), coverage, *means))
    return CoverageResult(tuple(found), kind, per_class, len(rows.classes), rows.synthetic)


def _figures(
    rule: ConformalRule, values: FloatArray, truth: IntArray, level: float
) -> tuple[float, float, float, float]:
    """Attainable and reached coverage, mean size and share of empty sets, of one level on tested rows."""
    attainable = [min(rank_of(n, level) / (n + 1), 1.0) for n in rule.n_calibration]
    weights = np.bincount(truth, minlength=len(attainable)) if rule.per_class else None
    inside = rule.sets(values, level)
    sizes = inside.sum(axis=1)
    return (
        float(np.average(attainable, weights=weights)),
        float(inside[np.arange(len(truth)), truth].mean()),
        float(sizes.mean()),
        float((sizes == 0).mean()),
    )

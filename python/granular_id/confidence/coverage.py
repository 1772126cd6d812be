"""How often prediction sets hold the right material: where rows are exchangeable, and where they are not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from granular_id._progress import ProgressCallback
from granular_id._text import Table, percent
from granular_id.confidence.conformal import ConformalRule, conformal_rule, rank_of
from granular_id.confidence.held_out import FloatArray, IntArray, Rows, StudyResult, cross_fit, for_each
from granular_id.partitions import RANDOM_TEST_SHARE, Partition, random_partition


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
    n_classes : int
    synthetic : bool
    """

    rows: tuple[Covered, ...]
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
            f"sets of {self.n_classes} classes",
        )
        return Table(f"Coverage of prediction sets{self._mark}", header, rows, notes)

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows."""
        return {
            "synthetic": self.synthetic,
            "n_classes": self.n_classes,
            "rows": [{**vars(row), "coverage": list(row.coverage), "mean": row.mean} for row in self.rows],
        }


def coverage_study(
    rows: Rows,
    model: Any,
    levels: Sequence[float],
    *,
    n_seeds: int,
    seed: int = 0,
    n_jobs: int | None = None,
    progress: bool | ProgressCallback = False,
) -> CoverageResult:
    """Measure the coverage of cross-fitted prediction sets on rows that had no say in them.

    Random partitions test what the theory promises: training and tested rows are exchangeable there. Partitions by
    sessions or halves in time show what is left of it when the world has moved on.
    """
    drawn = [random_partition(rows.codes, seed + k) for k in range(n_seeds)]
    parts = {(f"random {100 * RANDOM_TEST_SHARE:.0f} %", True): drawn}
    strictest, held_out = rows.partitions(seed=seed)
    if strictest[0].protocol != "kfold":
        parts[held_out, False] = strictest
    tasks = [(*part, k, one) for part, partitions in parts.items() for k, one in enumerate(partitions)]

    def covered(task: tuple[str, bool, int, Partition]) -> list[tuple[float, float, float, float]]:
        _, random, k, partition = task
        train, tested = rows.take(partition.train), rows.X[partition.test]
        crossed, scores = cross_fit(model, train, tested, seed=seed + k, strict=not random)
        rule = conformal_rule(crossed, levels)
        return [_figures(rule, scores.values, rows.codes[partition.test], level) for level in levels]

    each = for_each(covered, tasks, lambda task: task[-1].description, n_jobs, progress)
    found = []
    for name, random in parts:
        own = [figures for task, figures in zip(tasks, each, strict=True) if task[0] == name]
        for level, *of_level in zip(levels, *own, strict=True):
            attainable, coverage, size, empty = zip(*of_level, strict=True)
            means = (float(np.mean(figure)) for figure in (size, empty))
            found.append(Covered(name, random, level, float(np.mean(attainable)), coverage, *means))
    return CoverageResult(tuple(found), len(rows.classes), rows.synthetic)


def _figures(
    rule: ConformalRule, values: FloatArray, truth: IntArray, level: float
) -> tuple[float, float, float, float]:
    """Attainable and reached coverage, mean size and share of empty sets, of one level on tested rows."""
    n = rule.n_calibration
    inside = rule.sets(values, level)
    sizes = inside.sum(axis=1)
    return (
        min(rank_of(n, level) / (n + 1), 1.0),
        float(inside[np.arange(len(truth)), truth].mean()),
        float(sizes.mean()),
        float((sizes == 0).mean()),
    )

"""How often prediction sets hold the right material: where rows are exchangeable, and where they are not."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed

from granular_id._checks import whole_number
from granular_id._files import write_json
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id._text import Table, percent
from granular_id.confidence.conformal import LEVELS, checked_levels, conformal_rule, rank_of
from granular_id.confidence.held_out import Rows, held_out_scores, rows_of, scores_of, without_fixed_steps
from granular_id.recording import Dataset
from granular_id.splits import Partition, splittable_rows

__all__ = ["CoverageResult", "Covered", "coverage_study", "random_partition"]

TEST_SHARE = 0.3
"""Rows that a random partition tests: enough to see a point, and the model keeps most of its training."""


@dataclass(frozen=True)
class Covered:
    """Coverage of one level over the partitions of one kind.

    Attributes
    ----------
    held_out : str
        What the tested rows are to the training rows.
    random : bool
        Whether partitions were drawn at random, so that rows are exchangeable.
    level : float
        Coverage asked for.
    attainable : float
        What so few calibration rows give where rows are exchangeable: ceil((n + 1) level) / (n + 1), or 1.
    coverage : tuple of float
        Share of tested rows whose set held the truth, one for each partition.
    size : float
        Mean number of classes in a set.
    empty : float
        Share of empty sets.
    """

    held_out: str
    random: bool
    level: float
    attainable: float
    coverage: tuple[float, ...]
    size: float
    empty: float

    @property
    def mean(self) -> float:
        """Mean coverage."""
        return float(np.mean(self.coverage))


@dataclass(frozen=True)
class CoverageResult:
    """Coverage against the level asked for.

    Attributes
    ----------
    rows : tuple of Covered
        Random partitions, then the strictest that the data allow.
    kind : str
        Key of `granular_id.confidence.conformal.KINDS`.
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
        mark = " (SYNTHETIC recordings)" if self.synthetic else ""
        return Table(f"Coverage of prediction sets{mark}", header, rows, notes)

    def __str__(self) -> str:
        return str(self.table())

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows."""
        return {
            "synthetic": self.synthetic,
            "kind": self.kind,
            "per_class": self.per_class,
            "n_classes": self.n_classes,
            "rows": [{**vars(row), "coverage": list(row.coverage), "mean": row.mean} for row in self.rows],
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write `to_dict` as one JSON file; whole or not at all."""
        write_json(path, self.to_dict())


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
    >>> from granular_id.ecoc import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> study = coverage_study(X, ECOCClassifier(), y, levels=[0.9], n_seeds=10)
    >>> [(row.held_out, round(row.attainable, 3)) for row in study.rows]
    [('random 30 %', 0.906)]
    """
    rows = rows_of(data, y, sessions=sessions, in_time_order=in_time_order)
    rows.refuse_few(n_folds)
    wanted = checked_levels(levels)
    n_seeds = whole_number("n_seeds", n_seeds)
    drawn = [random_partition(rows.codes, seed + k) for k in range(n_seeds)]
    kinds = [(f"random {100 * TEST_SHARE:.0f} %", True, drawn)]
    honest, held_out = rows.honest(n_folds, seed=seed)
    if honest[0].protocol != "kfold":
        kinds.append((held_out, False, honest))
    model, rows = without_fixed_steps(model, rows)
    found = []
    with showing(progress) as callback:
        ticker = Ticker(sum(len(partitions) for _, _, partitions in kinds), callback)
        run = _Run(rows, model, wanted, kind, per_class, n_folds, ticker.tick)
        for name, random, partitions in kinds:
            each = Parallel(n_jobs=n_jobs, prefer="threads")(
                delayed(run)(partition, seed + k, strict=not random) for k, partition in enumerate(partitions)
            )
            found += [
                Covered(
                    name,
                    random,
                    level,
                    attainable=float(np.mean([one[0][j] for one in each])),
                    coverage=tuple(one[1][j] for one in each),
                    size=float(np.mean([one[2][j] for one in each])),
                    empty=float(np.mean([one[3][j] for one in each])),
                )
                for j, level in enumerate(wanted)
            ]
    return CoverageResult(tuple(found), kind, per_class, len(rows.classes), rows.synthetic)


def random_partition(codes: npt.NDArray[np.intp], seed: int) -> Partition:
    """Draw `TEST_SHARE` of each class for testing, at least one row, leaving at least two where there are three."""
    rng = np.random.default_rng(seed)
    test = []
    for own in splittable_rows(codes, "random").values():
        n_test = max(1, min(round(TEST_SHARE * own.size), own.size - 2))
        test.append(rng.permutation(own)[:n_test])
    tested = np.sort(np.concatenate(test))
    train = np.setdiff1d(np.arange(len(codes)), tested)
    return Partition("paper", seed, f"random partition {seed}", train, tested)


@dataclass(frozen=True)
class _Run:
    rows: Rows
    model: Any
    levels: tuple[float, ...]
    kind: str
    per_class: bool
    n_folds: int | None
    tick: Callable[[str], None]

    def __call__(self, partition: Partition, seed: int, *, strict: bool) -> tuple[list[float], ...]:
        """Attainable and reached coverage, size and share of empty sets, for each level."""
        train = self.rows.take(partition.train)
        if len(train.classes) < len(self.rows.classes):
            raise ValueError(f"the training part of {partition.description!r} must hold every class")
        folds, held_out = train.folds(self.n_folds, seed=seed, strict=strict)
        crossed = held_out_scores(self.model, train, folds, held_out=held_out)
        rule = conformal_rule(crossed, self.levels, kind=self.kind, per_class=self.per_class)
        values = scores_of(train.trained(self.model), self.rows.X[partition.test], train.classes).values
        truth = self.rows.codes[partition.test]
        every: tuple[list[float], ...] = ([], [], [], [])
        for level in self.levels:
            inside = rule.sets(values, level)
            counts = inside.sum(axis=1)
            attainable = [min(rank_of(n, level) / (n + 1), 1.0) for n in rule.n_calibration]
            weights = np.bincount(truth, minlength=len(attainable)) if self.per_class else None
            every[0].append(float(np.average(attainable, weights=weights)))
            every[1].append(float(inside[np.arange(len(truth)), truth].mean()))
            every[2].append(float(counts.mean()))
            every[3].append(float((counts == 0).mean()))
        self.tick(partition.description)
        return every

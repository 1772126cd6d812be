"""Leaving out one material after the other: what a model does with something it has never met."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed

from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.confidence.held_out import Scores, held_out_scores, scores_of, without_fixed_steps
from granular_id.confidence.open_set import OpenSetResult, OpenSetRow, area_under_roc, false_positives
from granular_id.confidence.rows import N_FOLDS, Rows, rows_of
from granular_id.confidence.unknown import STRANGENESS, UnknownRule
from granular_id.confidence.unknown_fit import available_kinds, unknown_rule
from granular_id.evaluation.partition import Partition
from granular_id.recording import Dataset

__all__ = ["leave_one_material_out"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class _Outcome:
    """One kind, one left-out material, one partition."""

    figures: tuple[float, ...]
    known: FloatArray
    unknown: FloatArray


def leave_one_material_out(
    data: Dataset | Rows | npt.ArrayLike,
    model: Any,
    y: npt.ArrayLike | None = None,
    *,
    sessions: Sequence[str | None] | None = None,
    in_time_order: bool = False,
    share_known: float = 0.95,
    kinds: Sequence[str] | None = None,
    n_folds: int = N_FOLDS,
    seed: int = 0,
    n_jobs: int | None = None,
    progress: bool | ProgressCallback = False,
) -> OpenSetResult:
    """Train without a material, and see whether its rows are refused; one material after the other.

    Rows of known materials are tested by models that did not train on them either, as honestly as the data allow:
    whole sessions held out, else halves in time order both ways, else random folds. The limit comes from a cross-fit
    within the training rows, so that nothing tested has a say in it.

    Parameters
    ----------
    data, model, y, sessions, in_time_order, n_folds, seed, n_jobs, progress
        As in `granular_id.confidence.assess`.
    share_known : float, default 0.95
        Share of known rows that is to be accepted.
    kinds : sequence of str, optional
        Keys of `STRANGENESS` to compare, the first is the one of interest. Default: that of
        `unknown_rule`, and all others that the model allows.

    Returns
    -------
    OpenSetResult

    Raises
    ------
    TypeError, ValueError
        As `rows_of` and `unknown_rule`; fewer than three materials; a class with fewer than 3 rows, or 4 where
        halves in time order are tested.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.confidence import leave_one_material_out
    >>> from granular_id.ecoc import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> result = leave_one_material_out(X, ECOCClassifier(), y, kinds=["value_distance"])
    >>> [row.material for row in result.rows]
    ['0', '1', '2']
    """
    rows = rows_of(data, y, sessions=sessions, in_time_order=in_time_order)
    if len(rows.classes) < 3:
        raise ValueError(f"leaving a material out needs at least 3, to keep 2; got {len(rows.classes)}")
    for kind in kinds or ():
        if kind not in STRANGENESS:
            raise ValueError(f"kinds must be among {', '.join(map(repr, STRANGENESS))}, got {kind!r}")
    rows.refuse_few(n_folds)
    partitions, held_out = rows.honest(n_folds, seed=seed)
    model, rows = without_fixed_steps(model, rows)
    tasks = [(unknown, partition) for unknown in range(len(rows.classes)) for partition in partitions]
    with showing(progress) as callback:
        ticker = Ticker(len(tasks), callback)
        run = _Run(rows, model, share_known, tuple(kinds or ()), n_folds, seed, ticker.tick)
        outcomes = Parallel(n_jobs=n_jobs, prefer="threads")(delayed(run)(*task) for task in tasks)
    found = [one for one in outcomes if one]
    if not found:
        raise ValueError("no partition tests both the material that is left out and others")
    every = tuple(found[0])
    table = [
        row
        for kind in every
        for unknown, name in enumerate(rows.classes)
        if (
            row := _mean(
                name, kind, [o[kind] for (k, _), o in zip(tasks, outcomes, strict=True) if k == unknown and o]
            )
        )
    ]
    spread = [
        np.concatenate([getattr(one[every[0]], part) for one in found]) for part in ("known", "unknown")
    ]
    known, unknown = (values[np.isfinite(values)] for values in spread)
    unlimited = sum(bool(np.isnan(one[every[0]].known).any()) for one in found)
    return OpenSetResult(
        tuple(table), every[0], float(share_known), held_out, rows.synthetic, (known, unknown), unlimited
    )


@dataclass(frozen=True)
class _Run:
    rows: Rows
    model: Any
    share_known: float
    kinds: tuple[str, ...]
    n_folds: int
    seed: int
    tick: Callable[[str], None]

    def __call__(self, unknown: int, partition: Partition) -> dict[str, _Outcome]:
        """Outcome of each kind; none where the partition does not test the material, or nothing else."""
        codes = self.rows.codes
        tested = codes[partition.test]
        is_known = tested != unknown
        found: dict[str, _Outcome] = {}
        if is_known.any() and not is_known.all():
            found = self._judged(
                self.rows.take(partition.train[codes[partition.train] != unknown]), partition, is_known
            )
        self.tick(f"without {self.rows.classes[unknown]}: {partition.description}")
        return found

    def _judged(
        self, train: Rows, partition: Partition, is_known: npt.NDArray[np.bool_]
    ) -> dict[str, _Outcome]:
        crossed = held_out_scores(self.model, train, n_folds=self.n_folds, seed=self.seed)
        scores = scores_of(train.trained(self.model), self.rows.X[partition.test], train.classes)
        right = np.array(train.classes)[scores.values.argmax(axis=1)] == self.rows.labels[partition.test]
        return {
            kind: _outcome(
                unknown_rule(crossed, share_known=self.share_known, kind=kind), scores, is_known, right
            )
            for kind in self.kinds or available_kinds(crossed)
        }


def _outcome(
    rule: UnknownRule, scores: Scores, is_known: npt.NDArray[np.bool_], right: npt.NDArray[np.bool_]
) -> _Outcome:
    strange = rule.strangeness(scores.values, scores.binary)
    accepted = strange <= rule.threshold
    known, unknown = strange[is_known], strange[~is_known]
    # Partitions differ in scale: the figure shows distances from the median known row, 1 at the limit.
    middle = np.median(known)
    scale = float(rule.threshold - middle)
    if not (np.isfinite(scale) and scale > 0):
        scale = float("nan")  # without a limit there is nothing to measure by, and nothing is drawn
    figures = (
        area_under_roc(known, unknown),
        false_positives(known, unknown),
        float(accepted[is_known].mean()),
        float((accepted & right)[is_known].mean()),
        float((~accepted)[~is_known].mean()),
        len(known),
        len(unknown),
    )
    return _Outcome(figures, (known - middle) / scale, (unknown - middle) / scale)


def _mean(material: str, kind: str, outcomes: Sequence[_Outcome]) -> OpenSetRow | None:
    if not outcomes:
        return None
    each = np.array([one.figures for one in outcomes])
    auroc, fpr95, accepted, named, refused = each[:, :-2].mean(axis=0).tolist()
    n_known, n_unknown = each[:, -2:].sum(axis=0).astype(int).tolist()
    return OpenSetRow(material, kind, auroc, fpr95, accepted, named, refused, n_known, n_unknown)

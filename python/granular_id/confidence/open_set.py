"""What leaving out one material after the other shows of the refusal of unknown ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import rankdata

from granular_id._progress import ProgressCallback
from granular_id._text import Table, percent
from granular_id.confidence.held_out import N_FOLDS, Rows, Scores, StudyResult, cross_fit, for_each
from granular_id.confidence.unknown import UnknownRule, unknown_rule
from granular_id.partitions import Partition

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class OpenSetRow:
    """One material left out, mean over the partitions; rows are tested ones."""

    material: str  # unknown to the models
    auroc: float  # probability that a row of the unknown material is more novel than a known one
    fpr95: float  # share of the unknown accepted at the limit, not known in practice, that accepts 95 % of the known
    accepted: float  # share of the known that the stored limit accepts
    named: float  # share of the known that are accepted and named rightly
    refused: float  # share of the unknown that the stored limit refuses
    n_known: int
    n_unknown: int

    @property
    def open_set(self) -> float:
        """Open-set rate: mean of the known rightly named and accepted, and the unknown refused."""
        return (self.named + self.refused) / 2


@dataclass(frozen=True)
class OpenSetResult(StudyResult):
    """Refusal of each material by models that do not know it.

    Attributes
    ----------
    rows : tuple of OpenSetRow
        One for each material.
    share_known : float
        Share of known rows that was to be accepted.
    held_out : str
        What separated training rows from tested ones.
    synthetic : bool
    novelty : tuple of two ndarrays
        Of tested known and of unknown rows, for figures: 0 is the median known row of a
        partition, 1 its limit; rows of models without one are left out.
    n_unlimited : int
        Models that had too few rows of known materials for a limit, and refuse nothing.
    """

    rows: tuple[OpenSetRow, ...]
    share_known: float
    held_out: str
    synthetic: bool = False
    novelty: tuple[FloatArray, FloatArray] = field(
        default=(np.empty(0), np.empty(0)), repr=False, compare=False
    )
    n_unlimited: int = 0

    def mean(self, figure: str) -> float:
        """Mean over the materials of a figure, an attribute of `OpenSetRow`."""
        return float(np.mean([getattr(row, figure) for row in self.rows]))

    def table(self) -> Table:
        """One row per left-out material, the least AUROC first."""
        own = sorted(self.rows, key=lambda row: row.auroc)
        rows = [_cells(row.material, [getattr(row, figure) for figure in _FIGURES]) for row in own]
        rows.append(_cells("mean", [self.mean(figure) for figure in _FIGURES]))
        notes: tuple[str, ...] = (
            "known tested rows: accepted, and accepted with the right name; unknown: refused. open set: mean of named "
            "and refused",
            f"limit set to accept {percent(self.share_known)} of cross-fitted known rows",
            f"held out: {self.held_out}",
        )
        if self.n_unlimited:
            notes += (
                f"{self.n_unlimited} models had too few rows to accept {percent(self.share_known)} of the known: they "
                "refuse nothing",
            )
        return Table(f"Each material left out{self._mark}", _HEADER, tuple(rows), notes)

    def to_dict(self) -> dict[str, Any]:
        """Return everything but the single rows' novelty scores in types that JSON knows."""
        return {
            "synthetic": self.synthetic,
            "share_known": self.share_known,
            "held_out": self.held_out,
            "n_unlimited": self.n_unlimited,
            "rows": [{**vars(row), "open_set": row.open_set} for row in self.rows],
        }


_FIGURES = ("auroc", "fpr95", "accepted", "named", "refused", "open_set")
_HEADER = ("left out", "AUROC", "FPR at 95 %", "accepted", "named", "refused", "open set")


def _cells(name: str, figures: Sequence[float]) -> tuple[str, ...]:
    return (name, f"{figures[0]:.3f}", *map(percent, figures[1:]))


def leave_one_material_out(
    rows: Rows,
    model: Any,
    *,
    share_known: float,
    seed: int = 0,
    n_jobs: int | None = None,
    progress: bool | ProgressCallback = False,
) -> OpenSetResult:
    """Train without a material, and see whether its rows are refused; one of at least three after the other.

    Rows of known materials are tested by models that did not train on them either, as strictly as the data allow:
    whole sessions held out, else halves in time order both ways, else random folds. The limit comes from a cross-fit
    within the training rows, so that nothing tested has a say in it.
    """
    partitions, held_out = rows.partitions(seed=seed)

    def judged(task: tuple[int, Partition]) -> _Judged | None:
        """Judge one model; None where the partition does not test the material, or nothing else."""
        unknown, partition = task
        is_known = rows.codes[partition.test] != unknown
        if is_known.all() or not is_known.any():
            return None
        train = rows.take(partition.train[rows.codes[partition.train] != unknown])
        crossed, scores = cross_fit(model, train, rows.X[partition.test], n_random=N_FOLDS, seed=seed)
        named = np.array(train.classes)[scores.values.argmax(axis=1)]
        right = named == rows.labels[partition.test]
        return _judged(unknown_rule(crossed, share_known=share_known), scores, is_known, right)

    tasks = [(unknown, partition) for unknown in range(len(rows.classes)) for partition in partitions]
    outcomes = for_each(
        judged,
        tasks,
        lambda task: f"without {rows.classes[task[0]]}: {task[1].description}",
        n_jobs,
        progress,
    )
    found = [(rows.classes[unknown], one) for (unknown, _), one in zip(tasks, outcomes, strict=True) if one]
    if not found:
        raise ValueError("no partition tests both the material that is left out and others")
    table = [
        _row(material, own)
        for material in rows.classes
        if (own := [one for left_out, one in found if left_out == material])
    ]
    drawn = [np.concatenate([getattr(one, part) for _, one in found]) for part in ("known", "unknown")]
    known, unknown = (values[np.isfinite(values)] for values in drawn)
    unlimited = sum(bool(np.isnan(one.known).any()) for _, one in found)
    return OpenSetResult(
        tuple(table), float(share_known), held_out, rows.synthetic, (known, unknown), unlimited
    )


class _Judged(NamedTuple):
    """What one model says of tested known rows and of those of the material that it does not know."""

    shares: tuple[float, ...]  # figures of `OpenSetRow`, from its AUROC on
    known: FloatArray  # novelty: 0 is the median known row, 1 the limit; NaN without one
    unknown: FloatArray


def _judged(
    rule: UnknownRule, scores: Scores, is_known: npt.NDArray[np.bool_], right: npt.NDArray[np.bool_]
) -> _Judged:
    strange = rule.novelty(scores.values, scores.binary)
    accepted = strange <= rule.threshold
    known, unknown = strange[is_known], strange[~is_known]
    shares = (
        area_under_roc(known, unknown),
        false_positives(known, unknown),
        float(accepted[is_known].mean()),
        float((accepted & right)[is_known].mean()),
        float((~accepted)[~is_known].mean()),
    )
    middle = np.median(known)
    scale = float(rule.threshold - middle)  # partitions differ in it
    if not (np.isfinite(scale) and scale > 0):
        scale = float("nan")  # without a limit there is nothing to measure by, and nothing is drawn
    return _Judged(shares, (known - middle) / scale, (unknown - middle) / scale)


def _row(material: str, judged: Sequence[_Judged]) -> OpenSetRow:
    shares = np.array([one.shares for one in judged]).mean(axis=0).tolist()
    counts = [sum(len(getattr(one, part)) for one in judged) for part in ("known", "unknown")]
    figures: list[Any] = [*shares, *counts]
    return OpenSetRow(material, *figures)


def area_under_roc(known: FloatArray, unknown: FloatArray) -> float:
    """Probability that an unknown row is more novel than a known one, ties counted half."""
    # By ranks: roc_auc_score integrates a curve, and rounds otherwise.
    ranks = rankdata(np.concatenate([known, unknown]))[len(known) :]
    n = len(unknown)
    return float((ranks.sum() - n * (n + 1) / 2) / (n * len(known)))


def false_positives(known: FloatArray, unknown: FloatArray, share: float = 0.95) -> float:
    """Share of unknown rows accepted at the least limit that accepts a share of the known ones."""
    limit = np.quantile(known, share, method="inverted_cdf")
    return float((unknown <= limit).mean())

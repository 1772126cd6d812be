"""What leaving out one material after the other shows of the refusal of unknown ones."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.stats import rankdata

from granular_id._files import write_json
from granular_id.evaluation.tables import Table, percent

__all__ = ["OpenSetResult", "OpenSetRow", "area_under_roc", "false_positives"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class OpenSetRow:
    """One kind of strangeness with one material left out, mean over the partitions.

    Attributes
    ----------
    material : str
        Unknown to the models.
    kind : str
        A key of `granular_id.confidence.unknown.STRANGENESS`.
    auroc : float
        Probability that a row of the unknown material is stranger than one of a known material.
    fpr95 : float
        Share of the unknown accepted at the limit that accepts 95 % of the tested known rows. That limit is not
        known in practice; what the stored one does say the next three.
    accepted : float
        Share of the tested known rows that the stored limit accepts.
    named : float
        Share of the tested known rows that are accepted and named rightly.
    refused : float
        Share of the unknown rows that are refused.
    n_known, n_unknown : int
        Tested rows.
    """

    material: str
    kind: str
    auroc: float
    fpr95: float
    accepted: float
    named: float
    refused: float
    n_known: int
    n_unknown: int

    @property
    def open_set(self) -> float:
        """Open-set rate: mean of the known rightly named and accepted, and the unknown refused."""
        return (self.named + self.refused) / 2


@dataclass(frozen=True)
class OpenSetResult:
    """Refusal of each material by models that do not know it.

    Attributes
    ----------
    rows : tuple of OpenSetRow
        Kinds of strangeness and materials.
    kind : str
        The kind of first interest.
    share_known : float
        Share of known rows that was to be accepted.
    held_out : str
        What separated training rows from tested ones.
    synthetic : bool
    strangeness : tuple of two ndarrays
        Of tested known and of unknown rows, by the first kind, for figures: 0 is the median known row of a
        partition, 1 its limit; rows of models without one are left out.
    n_unlimited : int
        Models that had too few rows of known materials for a limit, and refuse nothing.
    """

    rows: tuple[OpenSetRow, ...]
    kind: str
    share_known: float
    held_out: str
    synthetic: bool = False
    strangeness: tuple[FloatArray, FloatArray] = field(
        default=(np.empty(0), np.empty(0)), repr=False, compare=False
    )
    n_unlimited: int = 0

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds that were compared."""
        return tuple(dict.fromkeys(row.kind for row in self.rows))

    def mean(self, figure: str, kind: str | None = None) -> float:
        """Mean over the materials of a figure, an attribute of `OpenSetRow`."""
        wanted = self.kind if kind is None else kind
        return float(np.mean([getattr(row, figure) for row in self.rows if row.kind == wanted]))

    def table(self) -> Table:
        """One row per left-out material, for the kind of first interest."""
        own = sorted((row for row in self.rows if row.kind == self.kind), key=lambda row: row.auroc)
        rows = [_cells(row.material, row) for row in own]
        rows.append(self._means("mean", self.kind))
        notes: tuple[str, ...] = (
            "known tested rows: accepted, and accepted with the right name; unknown: refused. open set: mean of named "
            "and refused",
            f"limit of {self.kind!r} set to accept {percent(self.share_known)} of cross-fitted known rows",
            f"held out: {self.held_out}",
        )
        if self.n_unlimited:
            notes += (
                f"{self.n_unlimited} models had too few rows to accept {percent(self.share_known)} of the known: they "
                "refuse nothing",
            )
        return Table(f"Each material left out{self._mark}", _HEADER, tuple(rows), notes)

    def comparison(self) -> Table:
        """One row per kind of strangeness, means over the materials, the best AUROC first."""
        kinds = sorted(self.kinds, key=lambda kind: -self.mean("auroc", kind))
        rows = tuple(self._means(kind, kind) for kind in kinds)
        return Table(f"Ways to see the unknown{self._mark}", ("kind", *_HEADER[1:]), rows)

    def __str__(self) -> str:
        return str(self.table()) if len(self.kinds) == 1 else f"{self.table()}\n\n{self.comparison()}"

    def to_dict(self) -> dict[str, Any]:
        """Return everything but the single rows' strangeness in types that JSON knows."""
        return {
            "synthetic": self.synthetic,
            "kind": self.kind,
            "share_known": self.share_known,
            "held_out": self.held_out,
            "n_unlimited": self.n_unlimited,
            "rows": [{**vars(row), "open_set": row.open_set} for row in self.rows],
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write `to_dict` as one JSON file; whole or not at all."""
        write_json(path, self.to_dict())

    @property
    def _mark(self) -> str:
        return " (SYNTHETIC recordings)" if self.synthetic else ""

    def _means(self, name: str, kind: str) -> tuple[str, ...]:
        mean = {figure: self.mean(figure, kind) for figure in _FIGURES}
        return (name, f"{mean['auroc']:.3f}", *(percent(mean[figure]) for figure in _FIGURES[1:]))


_FIGURES = ("auroc", "fpr95", "accepted", "named", "refused", "open_set")
_HEADER = ("left out", "AUROC", "FPR at 95 %", "accepted", "named", "refused", "open set")


def _cells(name: str, row: OpenSetRow) -> tuple[str, ...]:
    return (name, f"{row.auroc:.3f}", *(percent(getattr(row, figure)) for figure in _FIGURES[1:]))


def area_under_roc(known: FloatArray, unknown: FloatArray) -> float:
    """Probability that an unknown row is stranger than a known one, ties counted half.

    Examples
    --------
    >>> area_under_roc(np.array([1.0, 2.0]), np.array([2.0, 3.0]))
    0.875
    """
    ranks = rankdata(np.concatenate([known, unknown]))[len(known) :]
    n = len(unknown)
    return float((ranks.sum() - n * (n + 1) / 2) / (n * len(known)))


def false_positives(known: FloatArray, unknown: FloatArray, share: float = 0.95) -> float:
    """Share of unknown rows accepted at the least limit that accepts a share of the known ones.

    Examples
    --------
    >>> false_positives(np.arange(20.0), np.array([5.0, 18.0, 18.5, 30.0]))
    0.5
    """
    limit = np.quantile(known, share, method="inverted_cdf")
    return float((unknown <= limit).mean())

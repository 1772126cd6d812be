"""Everything about how sure a model may be, in one result."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from granular_id._files import write_json
from granular_id.confidence.calibration import Reliability
from granular_id.confidence.conformal import ConformalRule
from granular_id.confidence.coverage import CoverageResult
from granular_id.confidence.open_set import OpenSetResult
from granular_id.confidence.unknown import UnknownRule
from granular_id.evaluation.tables import Table

__all__ = ["Confidence"]

FORMAT = "granular-id confidence 1"


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
            "format": FORMAT,
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

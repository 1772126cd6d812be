"""What an evaluation measured: answers about held-out recordings, and the figures that follow from them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import named
from granular_id.evaluation.baselines import Baseline
from granular_id.evaluation.compare import Pair, compare
from granular_id.evaluation.gap import Gap
from granular_id.evaluation.report_data import ReportData
from granular_id.recording import Finding
from granular_id.score import Held
from granular_id.spaces import Choice
from granular_id.splits import Folds


@dataclass(frozen=True)
class Prediction:
    """What was answered about one held-out recording.

    Attributes
    ----------
    space : str
        The feature space.
    fold : int
        Which fold held it out, from 0.
    row, recording, session
        Place of the recording in the data set, its name and its session ("" where it is not known).
    label, predicted : str
        The material, and what was answered.
    """

    space: str
    fold: int
    row: int
    recording: str
    session: str
    label: str
    predicted: str


@dataclass(frozen=True, eq=False, repr=False)
class Outcome:
    """The numbers of an `EvaluationResult`, which says what the fields hold; tables are drawn from them."""

    held: Mapping[str, Held]
    folds: Folds
    at_random: Mapping[str, tuple[float, ...]]
    gap: Gap | None
    why_no_gap: str
    baselines: tuple[Baseline, ...]
    adapted: Mapping[str, NDArray[np.float64]]
    paper_accuracies: Mapping[str, float]
    findings: tuple[Finding, ...]
    names: tuple[str, ...]
    settings: Mapping[str, Any]
    data: Mapping[str, Any]
    versions: Mapping[str, str]
    report_data: ReportData
    chosen: Mapping[str, tuple[Choice, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    synthetic: bool = False
    command: str = ""
    wall_s: float = math.nan

    @property
    def spaces(self) -> tuple[str, ...]:
        """Feature spaces, the headline's first."""
        return tuple(self.held)

    @property
    def headline(self) -> Held:
        """The answers of the space that was named first: those that count."""
        return self.held[self.spaces[0]]

    @property
    def labels(self) -> tuple[str, ...]:
        """The K materials; class number k is ``labels[k]``."""
        return self.headline.classes

    @property
    def chance(self) -> float:
        """Accuracy of guessing: one over the number of materials that were tested."""
        return self.headline.chance

    @property
    def spoiling(self) -> tuple[Finding, ...]:
        """Those of `findings` that nobody accepted: the figures mislead."""
        accepted = self.settings.get("accept", ())
        return tuple(finding for finding in self.findings if finding.code not in accepted)

    def of(self, space: str | None = None) -> Held:
        """Return the answers of a feature space, by default the headline's.

        Raises
        ------
        ValueError
            A space that was not evaluated.
        """
        held: Held = self.headline if space is None else named(self.held, "space", space)
        return held

    def accuracy(self, space: str | None = None) -> float:
        """Balanced accuracy of a feature space on held-out recordings, by default the headline's."""
        return self.of(space).accuracy

    def interval(self, space: str | None = None) -> tuple[float, float]:
        """95 % interval of `accuracy` over new sessions, or values of the condition: Student's t over those held out.

        NaN where neither was held out, and with fewer than three.
        """
        return self.of(space).interval

    def recall(self, space: str | None = None) -> NDArray[np.float64]:
        """Share of each material named right, (K,) in the order of `labels`; NaN for one that was not tested."""
        return self.of(space).recall

    def confusion(self, space: str | None = None) -> NDArray[np.int64]:
        """Return counts (K, K): row true, column named material, in the order of `labels`."""
        return self.of(space).confusion

    def comparison(self) -> tuple[Pair, ...]:
        """Each feature space against every later one on the same folds."""
        return compare(self.held)

    def predictions(self) -> Iterator[Prediction]:
        """Every answer: by space and fold, then row."""
        for space, held in self.held.items():
            for k, row in enumerate(held.rows.tolist()):
                yield Prediction(
                    space=space,
                    fold=int(held.fold[k]),
                    row=row,
                    recording=self.names[row],
                    session=held.sessions[k] or "",
                    label=self.labels[held.truth[k]],
                    predicted=self.labels[held.predicted[k]],
                )

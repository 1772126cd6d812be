"""What held-out sessions cost: the strict accuracy against as many recordings drawn at random."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from granular_id.score import Held

LOST_AT = 0.05
"""A loss is stated at this p-value: the strict accuracy is the lowest of 20."""


@dataclass(frozen=True)
class Gap:
    """What is lost where a session, a time or a condition is held out, tested against draws at random.

    In each draw as many recordings of each material train and are tested, with sessions mixed. Without an effect of
    the session the strict accuracy and those of the draws are exchangeable: its rank is an exact p-value.

    Attributes
    ----------
    space : str
        The feature space that was measured.
    points : float
        Mean balanced accuracy of the draws minus the strict one, a share of 1.
    p : float
        One-sided: (1 + draws at or below the strict accuracy) / (1 + draws).
    most : float
        What sessions could cost at most: the mean of the draws minus the lower end of the strict interval, at least 0;
        NaN without an interval.
    n_draws : int
    held_out : str
        What the strict folds hold out, in words.
    """

    space: str
    points: float
    p: float
    most: float
    n_draws: int
    held_out: str

    @classmethod
    def of(cls, space: str, strict: Held, draws: Sequence[float]) -> Gap:
        """Compare a strict accuracy with those of draws."""
        mean = sum(draws) / len(draws)
        at_or_below = sum(draw <= strict.accuracy + 1e-12 for draw in draws)
        p = (1 + at_or_below) / (1 + len(draws))
        low, _ = strict.interval
        most = math.nan if math.isnan(low) else max(0.0, mean - low)
        return cls(space, mean - strict.accuracy, p, most, len(draws), strict.folds.name)

    @property
    def is_lost(self) -> bool:
        """Whether a loss is shown at the 5 % level."""
        return self.p <= LOST_AT + 1e-12

    def __str__(self) -> str:
        points = f"{100 * self.points:.1f} points"
        if self.is_lost:
            return f"{points} are lost with {self.held_out} (p = {self.p:.2f})"
        most = "" if math.isnan(self.most) else f"; they could cost up to {100 * self.most:.1f} points"
        return f"no loss shown with {self.held_out} (p = {self.p:.2f}{most})"

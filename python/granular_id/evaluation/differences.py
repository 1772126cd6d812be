"""What differs by more than chance: held-out sessions from as many recordings at random, one space from another."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from granular_id._text import counted, points
from granular_id.recording import Dataset, recordings_cut
from granular_id.score import Held
from granular_id.splits import RANDOM, SESSION, Fold, Folds, rows_of_class
from granular_id.statistics import MIN_PARTITIONS, corrected_resampled_t, holm, mann_whitney

N_DRAWS = 19
"""Draws beside the strict folds: the least with which a rank of 1 in 20 is a p-value of 0.05."""

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
        gap = f"{points(self.points)} points"
        if self.is_lost:
            return f"{gap} are lost with {self.held_out} (p = {self.p:.2f})"
        most = "" if math.isnan(self.most) else f"; they could cost up to {points(self.most)} points"
        return f"no loss shown with {self.held_out} (p = {self.p:.2f}{most})"


def matched_draws(
    data: Dataset, strict: Folds, n_draws: int = N_DRAWS, copies: Sequence[tuple[int, int]] = ()
) -> tuple[list[Folds], str]:
    """Draw at random folds of the sizes of strict ones, so that sessions are mixed; say why not where that cannot be.

    In each draw as many recordings of each class train and are tested as in the strict folds, fold by fold: they are
    the strict folds with the rows of each class exchanged. Without an effect of what the strict folds hold out, strict
    and drawn folds are exchangeable, so that the rank of the strict one among 19 draws is an exact p-value. Windows of
    one recording resemble each other, and are exchanged as one, as are `copies`, pairs that share samples. Where
    sessions hold hardly more than one recording of a material that mixes nothing: windows that share no samples are
    then exchanged one by one, others not at all. Folds that are random themselves have no draws.
    """
    if not strict.strict:
        return [], ""
    y = data.y
    units, sessions = recordings_cut(data.recordings), data.sessions
    for one, other in copies:
        units = np.where(units == units[other], units[one], units)
    first_tested = np.full(len(y), len(strict))
    for k, fold in enumerate(strict):
        first_tested[fold.test] = np.minimum(first_tested[fold.test], k)
    for label, own in rows_of_class(y).items():
        n_units = np.unique(units[own]).size
        n_groups = len(set(sessions[own].tolist())) if strict.by == SESSION else len(strict)
        if label in strict.untested or n_units == own.size or n_units >= 2 * n_groups:
            continue
        if strict.overlapping or copies:
            held = "session" if strict.by == SESSION else "fold"
            of = "cut into windows that share samples" if strict.overlapping else "that are no copies"
            return [], (
                f"{label}: {counted(n_units, 'recording')} {of}, too few to mix what {counted(n_groups, held)} hold"
            )
        units = np.arange(len(y))
        break
    draws = []
    for draw in range(n_draws):
        rng = np.random.default_rng(np.random.SeedSequence(strict.seed, spawn_key=(8, draw)))
        exchanged = np.arange(len(y))
        for own in rows_of_class(y).values():
            in_folds = own[np.argsort(first_tested[own], kind="stable")]
            turn = rng.permutation(len(y))
            exchanged[in_folds] = own[np.argsort(turn[units[own]], kind="stable")]
        folds = []
        for fold in strict:
            train, test = np.sort(exchanged[fold.train]), np.sort(exchanged[fold.test])
            clear = ~np.isin(units[train], units[test])
            folds.append(Fold(train[clear], test, f"as many as {fold.held_out}"))
        draws.append(Folds(RANDOM, tuple(folds), untested=strict.untested, seed=strict.seed))
    return draws, ""


# Feature spaces against each other.


@dataclass(frozen=True)
class Pair:
    """Two feature spaces on the same folds; shares of 1, NaN where it cannot be computed.

    Attributes
    ----------
    first, second : str
        Names.
    difference : float
        Mean balanced accuracy over folds of the first minus that of the second.
    corrected_p : float
        Corrected resampled t-test (Nadeau and Bengio, Machine Learning 52, 2003), two-sided.
    holm_p : float
        The same, adjusted for all pairs (Holm, Scandinavian Journal of Statistics 6, 1979).
    mann_whitney_p : float
        As the paper reports it. Far too small: folds that share recordings are taken for independent.
    """

    first: str
    second: str
    difference: float
    corrected_p: float = math.nan
    holm_p: float = math.nan
    mann_whitney_p: float = math.nan


def compare(held: Mapping[str, Held]) -> tuple[Pair, ...]:
    """Compare each space with every later one; without p-values where there are fewer than three folds."""
    accuracies = {name: one.fold_accuracies() for name, one in held.items()}
    pairs = []
    for (first, a), (second, b) in combinations(accuracies.items(), 2):
        pair = Pair(first, second, float((a - b).mean()))
        if a.size >= MIN_PARTITIONS:
            folds = held[first].folds
            sizes = (
                float(np.mean([rows.size for rows in each])) for each in list(zip(*folds, strict=True))[:2]
            )
            p = corrected_resampled_t(a - b, *sizes)
            pair = replace(pair, corrected_p=p, mann_whitney_p=mann_whitney(a, b))
        pairs.append(pair)
    adjusted = holm([pair.corrected_p for pair in pairs]).tolist()
    return tuple(replace(pair, holm_p=p) for pair, p in zip(pairs, adjusted, strict=True))

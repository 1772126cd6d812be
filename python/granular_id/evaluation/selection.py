"""``select``: which feature space, block weights and C, and how sure one can be."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline

from granular_id._estimators import describe_estimator, versions
from granular_id._files import write_json
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id._text import Table, percent
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.candidates import (
    Candidate,
    Scores,
    checked_costs,
    plan_candidates,
    score_all,
    spread_of,
)
from granular_id.evaluation.compare import Comparison, Pair, compare
from granular_id.evaluation.gram import GramBank
from granular_id.evaluation.scoring import plan_seed
from granular_id.evaluation.tables import probability
from granular_id.recording import Dataset, describe_data, of_check, warnings_in
from granular_id.spaces import FeatureSpace
from granular_id.splits import HALVES, RANDOM, SESSIONS, Partition, nested_folds
from granular_id.statistics import MIN_PARTITIONS, ROPE, corrected_interval, corrected_resampled_t, sample_sd

# Choosing a feature space, block weights and C, by cross-validation inside cross-validation.


# The rule that picks one candidate and one C from accuracies on the same folds.

Floats = NDArray[np.float64]


class Pick(NamedTuple):
    """Index of a candidate, and index of its C in the grid."""

    candidate: int
    cost: int


def choose(
    accuracies: Floats,
    candidates: Sequence[Candidate],
    n_features: Sequence[int],
    n_train: float,
    n_test: float,
) -> Pick:
    """Pick the simplest candidate that is as good as the best.

    The best has the highest mean accuracy over folds. As good as the best is what loses no more than one
    standard error (of its paired differences to the best, corrected for the folds' common training rows) and no
    more than one point. Of those the one with the fewest `Candidate.parts` is taken, then the one with fewest
    features, then the first; it keeps the C with its highest mean accuracy, see `best_cost`.

    Parameters
    ----------
    accuracies : (J, n_candidates, n_costs) float array
        On J folds, C ascending.
    candidates : sequence of Candidate
    n_features : sequence of int
        Of each candidate.
    n_train, n_test : float
        Recordings in a fold.

    Returns
    -------
    Pick

    Notes
    -----
    The one-standard-error rule of Breiman et al., "Classification and Regression Trees" (1984), section 3.4.3,
    with a paired error and a limit: folds in time differ much, and the plain rule would then accept candidates
    that lose many points.
    """
    costs = [best_cost(accuracies[:, k]) for k in range(len(candidates))]
    at_best = np.stack([accuracies[:, k, cost] for k, cost in enumerate(costs)], axis=1)
    best = int(at_best.mean(axis=0).argmax())
    as_good = [
        k
        for k in range(len(candidates))
        if k == best or _as_good(at_best[:, best] - at_best[:, k], n_train, n_test)
    ]
    simplest = min(as_good, key=lambda k: (candidates[k].parts, n_features[k], k))
    return Pick(simplest, costs[simplest])


def best_cost(accuracies: Floats) -> int:
    """Index of the C with the highest mean accuracy of (J, n_costs); of equals the middle one.

    On a plateau its edges are where the next recordings fall off first.
    """
    means = accuracies.mean(axis=0)
    equals = np.flatnonzero(means >= means.max() - 1e-12)  # but for rounding of the mean
    return int(equals[(len(equals) - 1) // 2])


def _as_good(losses: Floats, n_train: float, n_test: float) -> bool:
    test = corrected_resampled_t(losses, n_train, n_test)
    # Equal on every fold, or so close that the folds could not tell; an error that is NaN accepts nothing else.
    return test.mean <= 0 or (test.mean <= ROPE and test.mean <= test.standard_error)


# What a selection found.

FORMAT = "granular_id.evaluation.selection/1"


@dataclass(frozen=True)
class Choice:
    """A candidate and a C by their places in `Selection.candidates` and `Selection.relative_costs`.

    ``accuracy`` is the mean over the folds that made the choice: too good to report, see `Selection.accuracy`.
    """

    candidate: int
    cost: int
    accuracy: float

    def same_as(self, other: Choice) -> bool:
        """Whether both chose the same candidate and the same C."""
        return (self.candidate, self.cost) == (other.candidate, other.cost)


@dataclass(frozen=True)
class OuterFold:
    """What the inner folds of one outer fold chose, and the accuracy of that on the recordings held out."""

    description: str
    n_train: int
    n_test: int
    choice: Choice
    accuracy: float


@dataclass(frozen=True, eq=False)
class Scored:
    """One candidate on the outer folds.

    Attributes
    ----------
    space, block_weights, name
        As in `granular_id.evaluation.candidates.Candidate`.
    n_features : int
        Length of the feature vector that the classifier sees.
    transformer : estimator
        Not fitted.
    accuracies : (n_outer, n_costs) float array
        Share of tested recordings named rightly, for each outer fold and C.
    """

    space: str
    block_weights: Any
    name: str
    n_features: int
    transformer: BaseEstimator
    accuracies: NDArray[np.float64]

    @property
    def best_cost(self) -> int:
        """Place of the C with the highest mean accuracy."""
        return best_cost(self.accuracies)


@dataclass(frozen=True, eq=False, repr=False)
class Selection:
    """The choice of `granular_id.select`, and what speaks for it.

    Attributes
    ----------
    candidates : tuple of Scored
        Every space with every weighting, in the order given.
    relative_costs : tuple of float
        The grid, ascending.
    final : Choice
        What was chosen, from all recordings.
    C : float
        Its C, for features as they are.
    outer : tuple of OuterFold
        The choices without the recordings held out, and how they did on those.
    n_classes : int
        Number of labels.
    held_out : {"sessions", "halves in time", "random recordings"}
        What an outer fold is, as strict as the data allowed.
    settings, data, versions : mapping
        Arguments, summary of the recordings, versions of what computed the numbers.
    notes : tuple of str
        What kind of folds were used, and what else a reader has to know.
    synthetic : bool
        True when recordings were simulated: such a choice says nothing about real materials.
    """

    candidates: tuple[Scored, ...]
    relative_costs: tuple[float, ...]
    final: Choice
    C: float
    outer: tuple[OuterFold, ...]
    n_classes: int
    held_out: str
    settings: Mapping[str, Any]
    data: Mapping[str, Any]
    versions: Mapping[str, str]
    notes: tuple[str, ...] = ()
    synthetic: bool = False

    @property
    def best(self) -> Scored:
        """The candidate that was chosen."""
        return self.candidates[self.final.candidate]

    @property
    def accuracies(self) -> NDArray[np.float64]:
        """Honest accuracy of the whole procedure on each outer fold: (n_outer,)."""
        return np.array([fold.accuracy for fold in self.outer])

    @property
    def accuracy(self) -> float:
        """Mean of `accuracies`: what to expect of recordings that had no say in the choice."""
        return float(self.accuracies.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of `accuracy`, corrected for common training rows; NaN if it cannot be said."""
        if len(self.outer) < MIN_PARTITIONS:
            return math.nan, math.nan
        n_train, n_test = self._mean_sizes()
        return corrected_interval(self.accuracies, n_train, n_test)

    @property
    def votes(self) -> Counter[str]:
        """How many outer folds chose each candidate, by name, whatever their C."""
        return Counter(self.candidates[fold.choice.candidate].name for fold in self.outer)

    @property
    def agreement(self) -> float:
        """Share of the outer folds that chose the same space and weights as the final choice."""
        return self.votes[self.best.name] / len(self.outer)

    @cached_property
    def comparison(self) -> Comparison | None:
        """Every candidate at its best C against every other, on the outer folds; None for a single candidate.

        The folds that are compared chose each C, and that a candidate is looked at because it did well: read
        close calls with care.
        """
        if len(self.candidates) < 2:
            return None
        n_train, n_test = self._mean_sizes()
        shares = {c.name: c.accuracies[:, c.best_cost] for c in self.candidates}
        return compare(list(shares), shares, n_train, n_test)

    @property
    def runner_up(self) -> Pair | None:
        """The final choice against the best other candidate; None when there was no other."""
        if self.comparison is None:
            return None
        means = self.comparison.means
        other = max((name for name in means if name != self.best.name), key=lambda name: means[name])
        return self.comparison.pair(self.best.name, other)

    def model(self) -> Pipeline:
        """Return the chosen pipeline, not fitted: features and `ECOCClassifier`.

        Returns
        -------
        sklearn.pipeline.Pipeline
            For recordings (n, T, C).
        """
        return Pipeline(
            [("features", clone(self.best.transformer)), ("classifier", ECOCClassifier(C=self.C))]
        )

    def verdict(self) -> str:
        """Say what to take, what to expect of it and how sure that is, in a few lines."""
        return verdict(self)

    def table(self) -> Table:
        """Return the candidates, best first, with how often each was chosen."""
        return candidates_table(self)

    def __str__(self) -> str:
        return f"{self.verdict()}\n\n{self.table()}"

    def __repr__(self) -> str:
        synthetic = "SYNTHETIC, " if self.synthetic else ""
        return f"Selection({synthetic}{self.best.name}, C={self.C:.3g}, accuracy {self.accuracy:.3f})"

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows; NaN becomes None."""
        pair = self.runner_up
        low, high = self.interval
        return {
            "format": FORMAT,
            "synthetic": self.synthetic,
            "space": self.best.space,
            "block_weights": _plain(self.best.block_weights),
            "C": self.C,
            "relative_cost": self.relative_costs[self.final.cost],
            "held_out": self.held_out,
            "accuracy": self.accuracy,
            "interval": None if math.isnan(low) else [low, high],
            "agreement": self.agreement,
            "runner_up": None if pair is None else pair.to_dict(),
            "outer": [
                {
                    "description": fold.description,
                    "n_train": fold.n_train,
                    "n_test": fold.n_test,
                    "chosen": self.candidates[fold.choice.candidate].name,
                    "relative_cost": self.relative_costs[fold.choice.cost],
                    "accuracy_of_the_choice_on_inner_folds": fold.choice.accuracy,
                    "accuracy": fold.accuracy,
                }
                for fold in self.outer
            ],
            "candidates": [
                {
                    "name": candidate.name,
                    "space": candidate.space,
                    "block_weights": _plain(candidate.block_weights),
                    "n_features": candidate.n_features,
                    "accuracies": candidate.accuracies.tolist(),
                }
                for candidate in self.candidates
            ],
            "notes": list(self.notes),
            "settings": dict(self.settings),
            "data": dict(self.data),
            "versions": dict(self.versions),
        }

    def to_json(self, path: str | os.PathLike[str]) -> None:
        """Write `to_dict` as one UTF-8 JSON file; whole or not at all."""
        write_json(path, self.to_dict())

    def _mean_sizes(self) -> tuple[float, float]:
        n_train, n_test = (
            float(np.mean([getattr(fold, size) for fold in self.outer])) for size in ("n_train", "n_test")
        )
        return n_train, n_test


def _plain(block_weights: Any) -> Any:
    return list(block_weights) if isinstance(block_weights, tuple) else block_weights


# A selection in words: the verdict, and the table of candidates.

SURE = 0.95

EXPECTED_OF = {
    SESSIONS: "in a session that did not train",
    HALVES: "in a stretch of time beside the one that trained; a new session may do worse",
    RANDOM: "of recordings made among those that trained; a new session may do worse",
}


def verdict(selection: Selection) -> str:
    """Say what was chosen, what to expect of it, and how sure that is."""
    lines = (
        ["SYNTHETIC recordings: this choice says nothing about real materials"] if selection.synthetic else []
    )
    best, relative = selection.best, selection.relative_costs[selection.final.cost]
    lines.append(
        f"Take {best.name} with C = {selection.C:.3g} ({relative:g} relative to the spread of the features)"
    )
    low, high = selection.interval
    folds = len(selection.outer)
    if math.isnan(low):
        reach = f" (no interval: {'too few folds' if folds < MIN_PARTITIONS else 'no two folds differ'})"
    else:
        reach = f" (95 % interval {100 * low:.1f} to {100 * high:.1f} %)"
    lines += [
        f"Expect {percent(selection.accuracy)}{reach} {EXPECTED_OF[selection.held_out]}; chance is "
        f"{percent(1 / selection.n_classes)}",
        f"That is the mean over {folds} outer folds of {selection.held_out}, of what was chosen without them",
    ]
    others = ", ".join(f"{name} {n}" for name, n in selection.votes.most_common() if name != best.name)
    same_cost = sum(fold.choice.same_as(selection.final) for fold in selection.outer)
    lines.append(
        f"Agreement: {selection.votes[best.name]} of {folds} outer folds chose the same space and weights, "
        f"{same_cost} the same C too{f'; others chose {others}' if others else ''}"
    )
    lines.append(_how_sure(selection))
    return "\n".join(lines)


def candidates_table(selection: Selection) -> Table:
    """List every candidate at its best C on the outer folds, best first."""
    rows = []
    for k, candidate in enumerate(selection.candidates):
        shares = candidate.accuracies[:, candidate.best_cost]
        rows.append(
            (
                float(shares.mean()),
                (
                    f"{'> ' if k == selection.final.candidate else '  '}{candidate.name}",
                    f"{selection.relative_costs[candidate.best_cost]:g}",
                    percent(float(shares.mean())),
                    f"{100 * sample_sd(shares):.1f}",
                    str(selection.votes[candidate.name]),
                    str(candidate.n_features),
                ),
            )
        )
    rows.sort(key=lambda row: -row[0])
    synthetic = " (SYNTHETIC recordings)" if selection.synthetic else ""
    notes = (
        "accuracy: mean over the outer folds at the candidate's best C; these figures made the choice, so the "
        "highest of them is too good",
        f"> chosen: the simplest of those within one standard error and {100 * ROPE:g} point of the best",
        "chosen by: outer folds whose inner folds chose it; relative C: C times the mean squared distance of the "
        "features from their mean",
    )
    return Table(
        f"Candidates{synthetic}",
        ("candidate", "relative C", "accuracy", "SD", "chosen by", "dimension"),
        tuple(row for _, row in rows),
        (*notes, *map(of_check, selection.notes)),
    )


def _how_sure(selection: Selection) -> str:
    pair = selection.runner_up
    if pair is None:
        return "There was no other candidate to compare with"
    if math.isnan(pair.better):
        why = selection.comparison.why_not if selection.comparison is not None else ""
        return f"Against the best other, {pair.second}: {100 * pair.difference:+.1f} points; {why}"
    shares = (
        f"{probability(pair.better)} better, {probability(pair.equivalent)} equal within "
        f"{100 * ROPE:g} point, {probability(pair.worse)} worse"
    )
    if pair.better > SURE:
        words = "it is better"
    elif pair.equivalent > SURE:
        words = "the two are equal, and this one is taken as the simpler or the first"
    elif pair.better + pair.equivalent > SURE:
        words = "it is not worse"
    elif pair.worse + pair.equivalent > SURE:
        words = "it is not better, and taken as the simpler one"
    else:
        words = "these recordings do not tell which is better"
    return f"Against the best other, {pair.second}: {words} ({shares})"


RELATIVE_COSTS = (0.1, 1.0, 10.0, 100.0, 1000.0)
"""Costs of a violated margin, times the mean squared distance of the training rows from their mean.

The multipliers of a support vector machine scale with one over that distance. In its units half of the rows or more
sit at their bound at 0.1 (the machine then is little more than the difference of class means), and on nearly all
recordings tried none does at 1000 (the margin is hard, more changes nothing). The paper's C = 1, in plain newtons
and counts, stands above 1000 on this scale: a hard margin.
"""


def select(
    data: Dataset,
    *,
    spaces: str | Sequence[str] | Mapping[str, BaseEstimator | FeatureSpace] | None = None,
    block_weights: Iterable[Any] = (None, "unit"),
    relative_costs: Sequence[float] = RELATIVE_COSTS,
    n_outer: int = 5,
    n_inner: int = 4,
    random_state: int | None = 0,
    n_jobs: int | None = None,
    progress: bool | ProgressCallback = True,
) -> Selection:
    """Choose a feature space, the weights of its blocks and C for `ECOCClassifier`, and judge the choice.

    Cross-validation inside cross-validation. Each outer fold holds recordings out, the inner folds of the others
    choose, and the chosen candidate is trained on the others and tested on what was held out: that accuracy is
    honest, since no tested recording had a say in the choice. What is returned is chosen on the outer folds,
    from all recordings. Folds are the strictest that the data allow, by the rule of `evaluate`: whole sessions where
    every label has several; else halves in time order, both ways; else random folds. Inner folds follow the same rule
    among the recordings that train: halves of a half, where halves are held out.

    Parameters
    ----------
    data : Dataset
        Recordings of equal length and rate with a label each.
    spaces : str, sequence of str or mapping, optional
        As in `evaluate`: names, or ``{name: transformer}``. Default: the paper's spaces but "pca+rica" (its time)
        and "dft" and "raw+dft" (rotations of "raw": to a linear classifier the same).
    block_weights : sequence
        Choices for spaces of several blocks, each None, "unit" or one number per block; see `BlockUnion`.
    relative_costs : sequence of float
        Grid of C times the mean squared distance of the training rows from their mean, so that the same grid
        serves newtons, counts and any weights. Default: from soft to hard, see `RELATIVE_COSTS`.
    n_outer, n_inner : int
        Folds of each level, at least 2, of sessions at most so many; halves in time are two. Default 5 and 4, the
        latter of fewer recordings.
    random_state : int or None
        Seed of random folds and of every ``random_state`` left None in transformers. None draws a fresh one,
        which the result records.
    n_jobs : int, optional
        Threads, as in joblib: None is 1, -1 all cores. The numbers do not depend on it.
    progress : bool or callable
        As in `evaluate`.

    Returns
    -------
    Selection
        ``print(selection)`` says what it would take and how sure it is; ``selection.model()`` is that pipeline.

    Raises
    ------
    TypeError
        `data` is not a `Dataset`, or an argument has the wrong type.
    ValueError
        As `evaluate` for data and spaces; a grid, weights or number of folds that cannot be; a class with too few
        recordings to be held out twice; a space in which all recordings are equal.

    Notes
    -----
    Varma & Simon, "Bias in error estimation when using cross-validation for model selection", BMC
    Bioinformatics 7:91 (2006): the accuracy that made a choice is too good to report. The rule that prefers the
    simpler of equals is documented in `granular_id.evaluation.selection.choose`.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording import Dataset, Recording
    >>> rng = np.random.default_rng(0)
    >>> level = {"oat": 1.0, "rice": 2.0}
    >>> data = Dataset(
    ...     [
    ...         Recording(level[m] + rng.normal(size=(40, 6)), rate_hz=500, label=m, name=f"{m}{k}")
    ...         for m in level
    ...         for k in range(8)
    ...     ]
    ... )
    >>> selection = select(data, spaces=["raw", "hfmh"], n_outer=4, n_inner=3)
    >>> selection.best.space, selection.accuracy
    ('raw', 1.0)
    >>> model = selection.model().fit(data.X, data.y)
    """
    if not isinstance(data, Dataset):
        raise TypeError(f"data must be a granular_id.Dataset, got {type(data).__name__}")
    if not (isinstance(progress, bool) or callable(progress)):
        raise TypeError(f"progress must be True, False or callable, got {type(progress).__name__}")
    seed = plan_seed(random_state)
    costs = checked_costs(relative_costs)
    X, y = data.X, data.y
    candidates = plan_candidates(spaces, block_weights, data.rate_hz, seed)
    planned = nested_folds(data, n_outer, n_inner, seed)
    folds = planned.nested

    bank = GramBank(X)
    every = [partition for fold in folds for partition in (fold.outer, *fold.inner)]
    with showing(progress) as callback:
        ticker = Ticker(len(every) * len(candidates), callback)
        scores, complaints = score_all(candidates, costs, every, y, bank, n_jobs=n_jobs, ticker=ticker)
    scored = iter(scores)
    outer_scores, inner_scores = [], []
    for fold in folds:
        outer_scores.append(next(scored))
        inner_scores.append([next(scored) for _ in fold.inner])

    n_features = [scores.n_features for scores in outer_scores[0]]

    def pick(scores: list[list[Scores]], partitions: Sequence[Partition]) -> Choice:
        shares = np.array([[s.accuracies for s in of_fold] for of_fold in scores])
        picked = choose(shares, candidates, n_features, *_mean_sizes(partitions))
        mean = float(shares[:, picked.candidate, picked.cost].mean())
        return Choice(picked.candidate, picked.cost, mean)

    outer = []
    for fold, tested, trained in zip(folds, outer_scores, inner_scores, strict=True):
        chosen = pick(trained, fold.inner)
        honest = float(tested[chosen.candidate].accuracies[chosen.cost])
        outer.append(
            OuterFold(fold.outer.description, fold.outer.train.size, fold.outer.test.size, chosen, honest)
        )
    final = pick(outer_scores, [fold.outer for fold in folds])
    table = tuple(
        Scored(
            candidate.space,
            candidate.block_weights,
            candidate.name,
            n_features[k],
            candidate.transformer,
            np.array([of_fold[k].accuracies for of_fold in outer_scores]),
        )
        for k, candidate in enumerate(candidates)
    )
    everything = np.arange(len(y))
    return Selection(
        candidates=table,
        relative_costs=costs,
        final=final,
        C=costs[final.cost] / spread_of(candidates[final.candidate], bank, everything),
        outer=tuple(outer),
        n_classes=np.unique(y).size,
        settings={
            "spaces": [describe_estimator(candidate.transformer) for candidate in candidates],
            "relative_costs": list(costs),
            "n_outer": n_outer,
            "n_inner": n_inner,
            "seed": seed,
        },
        data=describe_data(data),
        versions=versions(),
        held_out=planned.held_out,
        notes=(*planned.notes, *warnings_in(data), *complaints),
        synthetic=data.is_synthetic,
    )


def _mean_sizes(partitions: Sequence[Partition]) -> tuple[float, float]:
    n_train, n_test = (np.mean([getattr(p, part).size for p in partitions]) for part in ("train", "test"))
    return float(n_train), float(n_test)

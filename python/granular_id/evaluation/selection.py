"""``select``: which feature space, block weights and C, by cross-validation inside cross-validation, and how sure."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline

from granular_id._estimators import describe_estimator, versions
from granular_id._files import json_value, write_json
from granular_id._progress import ProgressCallback, Ticker, check_progress, showing
from granular_id._text import Table, percent
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.arguments import check_dataset, plan_seed
from granular_id.evaluation.candidates import (
    DEFAULT_SPACES,
    Candidate,
    checked_costs,
    plan_candidates,
    score_all,
    spread_of,
)
from granular_id.evaluation.compare import Comparison, Pair, compare, probability
from granular_id.evaluation.features import GramBank, check_disk
from granular_id.evaluation.tables import brief_note
from granular_id.partitions import Partition
from granular_id.recording import Dataset, data_warnings, describe_data
from granular_id.spaces import FeatureSpace, block_sizes, tell_blocks
from granular_id.splits import HALVES, RANDOM, SESSIONS, groups_of, nested_folds
from granular_id.statistics import MIN_PARTITIONS, ROPE, corrected_resampled_t, mean_interval, sample_sd

Floats = NDArray[np.float64]

RELATIVE_COSTS = (0.1, 1.0, 10.0, 100.0, 1000.0)
"""Costs of a violated margin, times the mean squared distance of the training rows from their mean.

The multipliers of a support vector machine scale with one over that distance. In its units half of the rows or more
sit at their bound at 0.1 (the classifier then is little more than the difference of class means), and on nearly all
recordings tried none does at 1000 (the margin is hard, more changes nothing). The paper's C = 1, in plain newtons
and counts, stands above 1000 on this scale: a hard margin.
"""

FORMAT = "granular_id.selection/1"

SURE = 0.95
"""What is more probable than this is said without a doubt."""

EXPECTED_OF = {
    SESSIONS: "in a session that did not train",
    HALVES: "in a stretch of time beside the one that trained; a new session may do worse",
    RANDOM: "of recordings made among those that trained; a new session may do worse",
}


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
    """Choose a feature space, the weights of its blocks and C of its classifier, and judge the choice.

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
        As in `evaluate`: names, or ``{name: transformer}``. Default: those that run live, "raw+hfmh", "hfmh", "raw",
        "multiband" and "best": `Identifier.fit` takes what is chosen. Others can be named; `Selection.to_train` is the
        choice among those that run live. Spaces with a classifier of their own keep it, without a C.
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
    Bioinformatics 7:91 (2006): the accuracy that made a choice is too good to report.

    Chosen is the simplest candidate that is as good as the best, which has the highest mean accuracy over folds. As
    good as the best is what loses no more than one standard error (of its paired differences to the best, corrected
    for the folds' common training rows) and no more than one point. Simplest has the fewest blocks, steps and learned
    parts, then the fewest features, then comes first. Each candidate keeps the C with its highest mean accuracy, of
    equals the middle one.

    That is the one-standard-error rule of Breiman et al., "Classification and Regression Trees" (1984), section
    3.4.3, with a paired error and a limit: folds in time differ much, and the plain rule would then accept candidates
    that lose many points.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import Dataset, Recording
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
    check_dataset(data)
    check_progress(progress)
    seed = plan_seed(random_state)
    costs = checked_costs(relative_costs)
    X, y = data.X, data.y
    candidates = plan_candidates(spaces, block_weights, data.rate_hz, seed)
    check_disk(X, [candidate.transformer for candidate in candidates], n_jobs)
    planned = nested_folds(data, n_outer, n_inner, seed)
    folds = planned.nested

    bank = GramBank(X)
    every = [partition for fold in folds for partition in (fold.outer, *fold.inner)]
    with showing(progress) as callback:
        ticker = Ticker(len(every) * len(candidates), callback)
        scores, n_features, not_converged = score_all(
            candidates, costs, every, y, bank, groups_of(data), n_jobs=n_jobs, ticker=ticker
        )

    def chosen_on(accuracies: Sequence[Floats], partitions: Sequence[Partition]) -> Choice:
        n_train, n_test = np.mean([(p.train.size, p.test.size) for p in partitions], axis=0).tolist()
        return choose(np.array(accuracies), candidates, n_features, n_train, n_test)

    of_partitions = iter(scores)
    outer, outer_scores = [], []
    for fold in folds:
        tested = next(of_partitions)
        choice = chosen_on([next(of_partitions) for _ in fold.inner], fold.inner)
        outer.append(
            OuterFold(
                description=fold.outer.description,
                n_train=fold.outer.train.size,
                n_test=fold.outer.test.size,
                choice=choice,
                accuracy=float(tested[choice.candidate, choice.cost]),
            )
        )
        outer_scores.append(tested)
    final = chosen_on(outer_scores, [fold.outer for fold in folds])
    for candidate in candidates:
        if candidate.classifier is not None:
            tell_blocks(candidate.classifier, block_sizes(clone(candidate.transformer).fit(X[:1], y[:1])))

    def cost_of(choice: Choice) -> float | None:
        candidate = candidates[choice.candidate]
        return (
            None if candidate.classifier is not None else costs[choice.cost] / spread_of(candidate, bank, y)
        )

    live = [k for k, candidate in enumerate(candidates) if candidate.live]
    to_train = None
    if live:
        n_train, n_test = np.mean([(f.outer.train.size, f.outer.test.size) for f in folds], axis=0).tolist()
        among = np.array(outer_scores)[:, live]
        choice = choose(among, [candidates[k] for k in live], [n_features[k] for k in live], n_train, n_test)
        choice = replace(choice, candidate=live[choice.candidate])
        found = candidates[choice.candidate]
        to_train = Training(found.space, found.block_weights, cost_of(choice), choice.accuracy)
    return Selection(
        candidates=tuple(
            Scored(**vars(candidate), n_features=length, accuracies=shares)
            for candidate, length, shares in zip(
                candidates, n_features, np.stack(outer_scores, axis=1), strict=True
            )
        ),
        relative_costs=costs,
        final=final,
        C=cost_of(final),
        to_train=to_train,
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
        notes=(*planned.notes, *data_warnings(data), *not_converged),
        synthetic=data.is_synthetic,
    )


def choose(
    accuracies: Floats,
    candidates: Sequence[Candidate],
    n_features: Sequence[int],
    n_train: float,
    n_test: float,
) -> Choice:
    """Pick the simplest candidate that is as good as the best, from accuracies (J, n_candidates, n_costs) on J folds.

    The rule is in the notes of `select`; `n_train` and `n_test` are the mean sizes of a fold.
    """
    costs = [best_cost(accuracies[:, k]) for k in range(len(candidates))]
    at_best = np.stack([accuracies[:, k, cost] for k, cost in enumerate(costs)], axis=1)
    best = int(at_best.mean(axis=0).argmax())

    def as_good(k: int) -> bool:
        test = corrected_resampled_t(at_best[:, best] - at_best[:, k], n_train, n_test)
        # Equal on every fold, or so close that the folds could not tell; an error that is NaN accepts nothing else.
        return test.mean <= 0 or (test.mean <= ROPE and test.mean <= test.standard_error)

    good = [k for k in range(len(candidates)) if k == best or as_good(k)]
    simplest = min(good, key=lambda k: (candidates[k].parts, n_features[k], k))
    return Choice(simplest, costs[simplest], float(at_best[:, simplest].mean()))


def best_cost(accuracies: Floats) -> int:
    """Index of the C with the highest mean accuracy of (J, n_costs); of equals the middle one.

    On a plateau its edges are where the next recordings fall off first.
    """
    means = accuracies.mean(axis=0)
    equals = np.flatnonzero(means >= means.max() - 1e-12)  # but for rounding of the mean
    return int(equals[(len(equals) - 1) // 2])


@dataclass(frozen=True)
class Choice:
    """A candidate and a C by their places in `Selection.candidates` and `Selection.relative_costs`.

    ``accuracy`` is the mean over the folds that made the choice: too good to report, see `Selection.accuracy`.
    """

    candidate: int
    cost: int
    accuracy: float


@dataclass(frozen=True)
class Training:
    """What `Identifier.fit` takes to train the best candidate that runs live.

    ``C`` is None where the classifier of the space finds its own; ``accuracy`` is the mean over the outer folds, which
    made the choice.
    """

    space: str
    block_weights: Any
    C: float | None
    accuracy: float


@dataclass(frozen=True)
class OuterFold:
    """What the inner folds of one outer fold chose, and the accuracy of that on the recordings held out."""

    description: str
    n_train: int
    n_test: int
    choice: Choice
    accuracy: float


@dataclass(frozen=True, eq=False)
class Scored(Candidate):
    """A candidate and what it reached on the outer folds.

    Attributes
    ----------
    space : str
        Name of the space.
    block_weights : None, "unit" or tuple of float
        As in `BlockUnion`; None too where there is one block only.
    transformer : estimator
        Not fitted, with these weights.
    parts : int
        Blocks and steps, and one more for each that learns from training rows: the less the simpler.
    n_features : int
        Length of the feature vector that the classifier sees.
    accuracies : (n_outer, n_costs) float array
        Share of tested recordings named rightly, for each outer fold and C.
    """

    n_features: int
    accuracies: Floats

    @property
    def best_cost(self) -> int:
        """Place of the C with the highest mean accuracy."""
        return best_cost(self.accuracies)

    @property
    def at_best_cost(self) -> Floats:
        """Accuracies with that C: (n_outer,)."""
        return self.accuracies[:, self.best_cost]


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
    C : float or None
        Its C, for features as they are; None where the space brings a classifier of its own.
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
    to_train : Training or None
        The choice among the candidates that run live, by the same rule; None where none does.
    """

    candidates: tuple[Scored, ...]
    relative_costs: tuple[float, ...]
    final: Choice
    C: float | None
    outer: tuple[OuterFold, ...]
    n_classes: int
    held_out: str
    settings: Mapping[str, Any]
    data: Mapping[str, Any]
    versions: Mapping[str, str]
    notes: tuple[str, ...] = ()
    synthetic: bool = False
    to_train: Training | None = None

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
        return mean_interval(self.accuracies, *self._sizes())

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
        shares = {candidate.name: candidate.at_best_cost for candidate in self.candidates}
        return compare(list(shares), shares, *self._sizes())

    @property
    def runner_up(self) -> Pair | None:
        """The final choice against the best other candidate; None when there was no other."""
        if self.comparison is None:
            return None
        means = self.comparison.means
        other = max((name for name in means if name != self.best.name), key=lambda name: means[name])
        return self.comparison.pair(self.best.name, other)

    def model(self) -> Pipeline:
        """Return the chosen pipeline, not fitted: features, and `ECOCClassifier` or the classifier of the space.

        Returns
        -------
        sklearn.pipeline.Pipeline
            For recordings (n, T, C).
        """
        own = self.best.classifier
        classifier = clone(own) if self.C is None else ECOCClassifier(C=self.C)
        return Pipeline([("features", clone(self.best.transformer)), ("classifier", classifier)])

    def verdict(self) -> str:
        """Say what to take, what to expect of it and how sure that is, in a few lines."""
        best, folds = self.best, len(self.outer)
        relative = self.relative_costs[self.final.cost]
        low, high = self.interval
        if math.isnan(low):
            reach = f"no interval: {'too few folds' if folds < MIN_PARTITIONS else 'no two folds differ'}"
        else:
            reach = f"95 % interval {100 * low:.1f} to {100 * high:.1f} %"
        others = ", ".join(f"{name} {n}" for name, n in self.votes.most_common() if name != best.name)
        final = (self.final.candidate, self.final.cost)
        same_cost = sum((fold.choice.candidate, fold.choice.cost) == final for fold in self.outer)
        cost = (
            ""
            if self.C is None
            else f" with C = {self.C:.3g} ({relative:g} relative to the spread of the features)"
        )
        lines = [
            f"Take {best.name}{cost}",
            f"Expect {percent(self.accuracy)} ({reach}) {EXPECTED_OF[self.held_out]}; chance is "
            f"{percent(1 / self.n_classes)}",
            f"That is the mean over {folds} outer folds of {self.held_out}, of what was chosen without them",
            f"Agreement: {self.votes[best.name]} of {folds} outer folds chose the same space and weights, "
            f"{same_cost} the same C too{f'; others chose {others}' if others else ''}",
            self._how_sure(),
        ]
        if not best.live:
            lines.append(self._what_runs_live())
        if self.synthetic:
            lines.insert(0, "SYNTHETIC recordings: this choice says nothing about real materials")
        return "\n".join(lines)

    def table(self) -> Table:
        """Return the candidates at their best C on the outer folds, best first, with how often each was chosen."""
        best_first = sorted(self.candidates, key=lambda candidate: -candidate.at_best_cost.mean())
        rows = [
            (
                f"{'> ' if candidate is self.best else '  '}{candidate.name}",
                "-" if candidate.classifier is not None else f"{self.relative_costs[candidate.best_cost]:g}",
                percent(float(candidate.at_best_cost.mean())),
                f"{100 * sample_sd(candidate.at_best_cost):.1f}",
                str(self.votes[candidate.name]),
                str(candidate.n_features),
                "yes" if candidate.live else "no",
            )
            for candidate in best_first
        ]
        notes = (
            "accuracy: mean over outer folds, which made the choice: the highest is too good",
            f"> chosen: the simplest of those within one standard error and {100 * ROPE:g} point of the best",
            "chosen by: outer folds whose inner folds chose it; live: can run while samples arrive",
            "relative C: C times the mean squared distance of the features from their mean; -: has its own",
        )
        return Table(
            f"Candidates{' (SYNTHETIC recordings)' if self.synthetic else ''}",
            ("candidate", "relative C", "accuracy", "SD", "chosen by", "dimension", "live"),
            tuple(rows),
            (*notes, *map(brief_note, self.notes)),
        )

    def __str__(self) -> str:
        return f"{self.verdict()}\n\n{self.table()}"

    def __repr__(self) -> str:
        synthetic = "SYNTHETIC, " if self.synthetic else ""
        cost = "" if self.C is None else f", C={self.C:.3g}"
        return f"Selection({synthetic}{self.best.name}{cost}, accuracy {self.accuracy:.3f})"

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows; NaN becomes None."""
        pair = self.runner_up
        low, high = self.interval
        return {
            "format": FORMAT,
            "synthetic": self.synthetic,
            "space": self.best.space,
            "block_weights": json_value(self.best.block_weights),
            "C": self.C,
            "to_train": json_value(self.to_train),
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
                    "block_weights": json_value(candidate.block_weights),
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

    def _sizes(self) -> tuple[list[int], list[int]]:
        return [fold.n_train for fold in self.outer], [fold.n_test for fold in self.outer]

    def _what_runs_live(self) -> str:
        said = f"{self.best.name} cannot run live: its features need the whole recording"
        if self.to_train is None:
            return f"{said}; nor can the other candidates (those of train can: {', '.join(DEFAULT_SPACES)})"
        return f"{said}; of those that can take {self.to_train.space} ({percent(self.to_train.accuracy)})"

    def _how_sure(self) -> str:
        pair = self.runner_up
        if pair is None or self.comparison is None:
            return "There was no other candidate to compare with"
        if math.isnan(pair.better):
            gain = f"{100 * pair.difference:+.1f} points"
            return f"Against the best other, {pair.second}: {gain}; {self.comparison.why_not}"
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
        return (
            f"Against the best other, {pair.second}: {words} ({probability(pair.better)} better, "
            f"{probability(pair.equivalent)} equal within {100 * ROPE:g} point, {probability(pair.worse)} worse)"
        )

"""``select``: which feature space, block weights and C, and how sure one can be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator

from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.evaluation.describe import (
    describe_data,
    describe_estimator,
    versions,
    warnings_in,
)
from granular_id.evaluation.gram_engine import GramBank
from granular_id.evaluation.partition import Partition
from granular_id.evaluation.plan import plan_seed
from granular_id.recording import Dataset
from granular_id.selection.candidates import checked_costs, plan_candidates
from granular_id.selection.choice import choose
from granular_id.selection.folds import nested_folds
from granular_id.selection.result import Choice, OuterFold, Scored, Selection
from granular_id.selection.scores import Scores, score_all, spread_of
from granular_id.spaces import FeatureSpace

__all__ = ["RELATIVE_COSTS", "select"]

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
    simpler of equals is documented in `granular_id.selection.choice.choose`.

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

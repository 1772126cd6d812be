"""Accuracies of every candidate with every C on every fold, on shared scalar products."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from granular_id._blas import single_threaded_blas
from granular_id._progress import Ticker
from granular_id._threads import in_threads
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.complaints import heard_complaints, named_errors
from granular_id.evaluation.gram_engine import GramBank, features_of, plan_for
from granular_id.evaluation.partition import Partition
from granular_id.gram import linear_gram
from granular_id.selection.candidates import Candidate

__all__ = ["Scores", "score_all", "spread_of"]

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Scores:
    """What one candidate reached on one fold.

    Attributes
    ----------
    accuracies : (n_costs,) float array
        Share of tested rows named rightly, for each C of the grid in ascending order.
    n_features : int
        Length of the feature vector that the classifier saw.
    """

    accuracies: Floats
    n_features: int


def score_all(
    candidates: Sequence[Candidate],
    costs: Sequence[float],
    partitions: Sequence[Partition],
    y: NDArray[np.str_],
    bank: GramBank,
    *,
    n_jobs: int | None,
    ticker: Ticker,
) -> tuple[list[list[Scores]], tuple[str, ...]]:
    """Train and test every candidate on every partition.

    Parameters
    ----------
    candidates : sequence of Candidate
    costs : sequence of float
        Relative C, ascending; see `select`.
    partitions : sequence of Partition
    y : (n,) str array
        Labels.
    bank : GramBank
        Of all recordings.
    n_jobs : int or None
        Threads, as in joblib; the numbers do not depend on it.
    ticker : Ticker
        Told once for each candidate and partition.

    Returns
    -------
    scores : list of lists of Scores
        By partition, then candidate.
    complaints : tuple of str
        What did not converge.
    """

    def run(pair: tuple[Partition, Candidate]) -> Scores:
        partition, candidate = pair
        with named_errors(candidate.space):
            scores = _score(candidate, costs, partition, y, bank)
        ticker.tick(f"{candidate.name}: {partition.description}")
        return scores

    # Threads, not processes: scalar products are shared, and libsvm works outside the interpreter lock. More than
    # one thread for the algebra of each would only take turns with the others.
    with single_threaded_blas(), heard_complaints("candidates") as complaints:
        flat = iter(in_threads(run, product(partitions, candidates), n_jobs))
    return [[next(flat) for _ in candidates] for _ in partitions], tuple(complaints)


def spread_of(candidate: Candidate, bank: GramBank, rows: Rows) -> float:
    """Mean squared distance of rows from their mean, in the features of a candidate fitted on them.

    Raises
    ------
    ValueError
        All rows are equal there: nothing can be told apart.
    """
    # What does not converge here has been told of the folds.
    with single_threaded_blas(), heard_complaints(candidate.name):
        gram, _, _ = _products(candidate, bank, rows, rows[:1])
    return _spread(candidate, gram)


def _score(
    candidate: Candidate, costs: Sequence[float], partition: Partition, y: NDArray[np.str_], bank: GramBank
) -> Scores:
    train_gram, cross_gram, n_features = _products(candidate, bank, partition.train, partition.test)
    unit = 1.0 / _spread(candidate, train_gram)
    accuracies = np.empty(len(costs))
    hard = False
    for k, cost in enumerate(costs):
        if hard:  # no multiplier reached its bound: a larger one changes nothing
            accuracies[k] = accuracies[k - 1]
            continue
        fitted = ECOCClassifier(C=cost * unit).fit_gram(train_gram, y[partition.train])
        accuracies[k] = np.mean(fitted.predict_gram(cross_gram) == y[partition.test])
        hard = fitted.alpha_at_bound_ == 0
    return Scores(accuracies, n_features)


def _products(candidate: Candidate, bank: GramBank, train: Rows, test: Rows) -> tuple[Floats, Floats, int]:
    """Scalar products of training rows, and of test rows with them; what learns is fitted on training rows."""
    plan = plan_for(candidate.transformer, candidate.space)
    if plan is not None and not plan.after:
        return *bank.sliced(plan, train, test), bank.n_features(plan)
    if plan is None:
        fitted = clone(candidate.transformer).fit(bank.X[train])
        known, new = (features_of(candidate.space, fitted, bank.X[rows]) for rows in (train, test))
    else:
        known, new = bank.components(plan, train, test)
        for step in plan.after[1:]:
            behind = clone(step).fit(known)
            known, new = behind.transform(known), behind.transform(new)
    center = known.mean(axis=0)
    return linear_gram(known, center=center), linear_gram(new, known, center=center), known.shape[1]


def _spread(candidate: Candidate, gram: Floats) -> float:
    # The diagonal about zero bounds what rounding can leave of rows that are equal.
    squares = float(np.trace(gram)) / len(gram)
    spread = squares - float(gram.mean())
    if not spread > 1e-12 * squares:
        raise ValueError(
            f"feature space {candidate.space!r}: all recordings have the same features, so nothing can be told "
            "apart; leave it out of spaces"
        )
    return spread

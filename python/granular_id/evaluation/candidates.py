"""What can be chosen: feature spaces, with every way to weight their blocks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline

from granular_id._estimators import heard_complaints, named_errors, real_steps, seeded_clone
from granular_id._parallel import in_threads, single_threaded_blas
from granular_id._progress import Ticker
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.gram import GramBank, features_of, plan_for
from granular_id.evaluation.scoring import Space, plan_spaces
from granular_id.gram import linear_gram
from granular_id.spaces import BlockUnion, FeatureSpace, RawHFMH, learns
from granular_id.splits import Partition

DEFAULT_SPACES = (
    "raw+hfmh",
    "norm-raw+hfmh",
    "norm-raw",
    "hfmh",
    "norm-raw+dft",
    "raw",
    "pca",
    "raw-histogram",
)
"""The paper's spaces but three, in its order.

The complex Fourier transform is a rotation: with a linear classifier and C in units of the spread, "dft" and
"raw+dft" are "raw" again, and three names for one candidate would split its votes. "pca+rica" takes many times
the time of all others together.
"""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A feature space with a way to weight its blocks.

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
    """

    space: str
    block_weights: Any
    transformer: BaseEstimator
    parts: int

    @property
    def name(self) -> str:
        """Space and weights in a word, such as ``raw+hfmh (unit)``."""
        if self.block_weights is None:
            return self.space
        if isinstance(self.block_weights, str):
            return f"{self.space} ({self.block_weights})"
        return f"{self.space} ({', '.join(f'{weight:g}' for weight in self.block_weights)})"


def plan_candidates(
    spaces: str | Sequence[str] | Mapping[str, BaseEstimator | FeatureSpace] | None,
    block_weights: Iterable[Any],
    rate_hz: float,
    seed: int,
) -> list[Candidate]:
    """Turn the arguments of `select` into candidates, in order.

    Parameters
    ----------
    spaces : None, str, sequence of str or mapping
        None: `DEFAULT_SPACES`. Otherwise as in `evaluate`.
    block_weights : iterable
        Each None, "unit" or one number per block. A space with several blocks becomes one candidate for each,
        in place of its own weights; a space without blocks ignores them.
    rate_hz : float
        Sampling rate of the recordings.
    seed : int
        For transformers with an open ``random_state``.

    Returns
    -------
    list of Candidate

    Raises
    ------
    TypeError, ValueError
        As `plan_spaces`; a space with a classifier of its own; no weights, weights that are none, or the same twice.
    """
    weightings = _checked_weightings(block_weights)
    if spaces is None:
        spaces = DEFAULT_SPACES
    candidates = []
    planned = plan_spaces(spaces, rate_hz)
    refuse_own_classifiers(planned)
    for k, space in enumerate(planned):
        transformer = seeded_clone(space.transformer, np.random.SeedSequence(seed, spawn_key=(5, k)))
        key = _weights_key(transformer)
        if key is None:
            candidates.append(Candidate(space.name, None, transformer, _parts(transformer)))
            continue
        for weights in weightings:
            weighted = clone(transformer).set_params(**{key: weights})
            candidates.append(Candidate(space.name, weights, weighted, _parts(weighted)))
    names = [candidate.name for candidate in candidates]
    if len(set(names)) < len(names):
        raise ValueError(
            f"spaces and block_weights must give each candidate a name of its own, got {names!r}"
        )
    return candidates


def refuse_own_classifiers(spaces: Sequence[Space | FeatureSpace]) -> None:
    """Refuse spaces that bring a classifier, whose cost cannot be chosen here.

    Raises
    ------
    ValueError
        Naming all of them, and what compares them with others.

    Examples
    --------
    >>> from granular_id.spaces import feature_spaces
    >>> refuse_own_classifiers([feature_spaces()["best"]])
    Traceback (most recent call last):
        ...
    ValueError: spaces must leave out 'best', with a classifier of its own: granular-id evaluate --spaces best, ...
    """
    names = [space.name for space in spaces]
    own = [repr(space.name) for space in spaces if space.classifier is not None]
    if own:
        raise ValueError(
            f"spaces must leave out {' and '.join(own)}, with a classifier of {'its' if len(own) == 1 else 'their'} "
            f"own: granular-id evaluate --spaces {','.join(names)}, or evaluate() in Python, compares them"
        )


def checked_costs(relative_costs: Any) -> tuple[float, ...]:
    """Return the grid of relative costs in ascending order, or say what is wrong with it."""
    try:
        costs = np.asarray(relative_costs, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"relative_costs must be a sequence of numbers, got {relative_costs!r}") from None
    if costs.ndim != 1 or costs.size == 0:
        raise ValueError(f"relative_costs must be a sequence of at least one number, got {relative_costs!r}")
    if not (np.isfinite(costs) & (costs > 0)).all():
        raise ValueError(f"relative_costs must be positive and finite, got {relative_costs!r}")
    if np.unique(costs).size < costs.size:
        raise ValueError(f"relative_costs must hold each number once, got {relative_costs!r}")
    return tuple(np.sort(costs).tolist())


def _checked_weightings(block_weights: Iterable[Any]) -> list[Any]:
    wanted = "block_weights must be a sequence of choices, each None, 'unit' or one number per block"
    if isinstance(block_weights, str) or not isinstance(block_weights, Iterable):
        raise TypeError(f"{wanted}, got {block_weights!r}: put it into a list")
    weightings: list[Any] = []
    for choice in block_weights:
        if choice is None or isinstance(choice, str):
            weightings.append(choice)
        elif isinstance(choice, Iterable):
            weightings.append(tuple(choice))
        else:
            raise TypeError(f"{wanted}, got {choice!r} among them")
    if not weightings:
        raise ValueError(f"{wanted}, got none")
    if len(set(weightings)) < len(weightings):
        raise ValueError(f"block_weights must hold each choice once, got {weightings!r}")
    return weightings


def _weights_key(transformer: Any) -> str | None:
    """Name of the parameter that weights the blocks of a space, or None where it has one block."""
    keys = [
        key
        for key, value in (("", transformer), *transformer.get_params(deep=True).items())
        if isinstance(value, BlockUnion | RawHFMH)
    ]
    if not keys:
        return None
    outermost = min(keys, key=lambda key: key.count("__"))
    return f"{outermost}__block_weights" if outermost else "block_weights"


def _parts(transformer: Any) -> int:
    steps = real_steps(transformer) if isinstance(transformer, Pipeline) else [transformer]
    return sum(_n_blocks(step) + learns(step) for step in steps)


def _n_blocks(step: Any) -> int:
    if isinstance(step, BlockUnion):
        return len(step.blocks)
    return 2 if isinstance(step, RawHFMH) else 1


# Accuracies of every candidate with every C on every fold, on shared scalar products.

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

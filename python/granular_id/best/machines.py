"""Training many machines on the same rows: one Gram matrix a block, shared by all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id.best.candidates import Machine
from granular_id.ecoc import ECOCClassifier
from granular_id.gram import linear_gram
from granular_id.spaces.folding import folded_back
from granular_id.spaces.scaling import BlockScaler
from granular_id.spaces.whitening import WithinClassWhitening, whitened_grams

__all__ = ["Line", "fitted_line", "held_out_scores"]

FloatArray = npt.NDArray[np.float64]
Rows = npt.NDArray[np.intp]

# Where more of the rows violate the margin, the classes overlap: no cost pulls them apart, and libsvm takes millions of
# steps to find that out.
_MOST_AT_BOUND = 0.5

Line = tuple[FloatArray, FloatArray]
"""Weights (L, D) and intercepts (L,) of linear learners."""


def held_out_scores(
    X: FloatArray, codes: Rows, sizes: dict[str, int], machines: Sequence[Machine], train: Rows, test: Rows
) -> FloatArray:
    """Binary scores of rows that did not train, from every machine.

    Parameters
    ----------
    X : ndarray, shape (n, D)
        Plain features.
    codes : ndarray of int, shape (n,)
        Class of each row.
    sizes : dict
        Columns of each block.
    machines : sequence of Machine
    train, test : ndarray of int
        Row numbers. Scaling, whitening and learners see `train` alone.

    Returns
    -------
    ndarray, shape (n_machines, n_test, L)
    """
    scaler = BlockScaler(sizes).fit(X[train])
    rows = scaler.transform(X[np.concatenate([train, test])])
    products = {
        name: linear_gram(rows[:, columns], rows[: train.size, columns])
        for name, columns in scaler.block_slices_.items()
    }
    labels = codes[train]
    scores: list[FloatArray] = []
    plain_of: tuple[str, ...] | None = None
    white_of: tuple[tuple[str, ...], float | None] | None = None
    learners: Any = None
    for machine in machines:  # costs of one kind lie side by side, ascending
        if machine.blocks != plain_of:
            plain_of, white_of = machine.blocks, None
            both = np.sum([products[name] for name in machine.blocks], axis=0)
            plain = _symmetric(both[: train.size]), both[train.size :]
        if (machine.blocks, machine.shrinkage) != white_of:
            white_of, learners = (machine.blocks, machine.shrinkage), None
            gram, cross = (
                plain if machine.shrinkage is None else whitened_grams(*plain, labels, machine.shrinkage)
            )
        before, learners = learners, _trained(gram, labels, machine.relative_cost, learners)
        scores.append(scores[-1] if learners is before else learners.binary_scores_gram(cross))
    return np.stack(scores)


def fitted_line(
    X: FloatArray, codes: Rows, sizes: dict[str, int], machine: Machine, lower_costs: Sequence[float] = ()
) -> Line:
    """Train a machine on all rows, and fold scaling and whitening into its weights for plain features.

    Parameters
    ----------
    X, codes, sizes, machine
        As in `held_out_scores`.
    lower_costs : sequence of float
        Relative costs below that of the machine that were tried too, ascending: where one of them will do, it does,
        as in `held_out_scores`.

    Returns
    -------
    coef : ndarray, shape (L, D)
        0 for columns of blocks that it does not see, and for constant ones.
    intercept : ndarray, shape (L,)
    """
    start, columns = 0, []
    for name, size in sizes.items():
        if name in machine.blocks:
            columns.append(np.arange(start, start + size))
        start += size
    own = np.concatenate(columns)
    scaler = BlockScaler({name: sizes[name] for name in machine.blocks}).fit(X[:, own])
    rows = scaler.transform(X[:, own])
    steps: list[Any] = [scaler]
    if machine.shrinkage is not None:
        steps.append(WithinClassWhitening(machine.shrinkage).fit(rows, codes))
        rows = steps[-1].transform(rows)
    gram = _symmetric(linear_gram(rows))
    learners: Any = None
    for cost in (*lower_costs, machine.relative_cost):
        learners = _trained(gram, codes, cost, learners)
    weights, intercept = folded_back(steps, learners.dual_coef_ @ rows, learners.intercept_)
    coef = np.zeros((len(weights), X.shape[1]))
    coef[:, own] = weights
    return coef, intercept


def _trained(gram: FloatArray, codes: Rows, relative_cost: float, cheaper: Any) -> Any:
    """Learners of a cost; those of the next lower one where more would change nothing, or not end."""
    if cheaper is not None and not 0 < cheaper.alpha_at_bound_ <= _MOST_AT_BOUND:
        return cheaper
    return ECOCClassifier(C=relative_cost / _spread(gram)).fit_gram(gram, codes)


def _symmetric(gram: FloatArray) -> FloatArray:
    both: FloatArray = (gram + gram.T) / 2
    return both


def _spread(gram: FloatArray) -> float:
    """Mean squared distance of rows from their mean; 1 where all are equal, and no cost tells them apart."""
    squares = float(np.trace(gram)) / len(gram)
    spread = squares - float(gram.mean())
    return spread if spread > 1e-12 * squares else 1.0

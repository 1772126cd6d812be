"""Scores of rows from models that have not seen them: what every figure of this package rests on.

A model with more features than rows is sure of every row that it trained on. Each row is scored by a model
that was trained on the other folds instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed
from sklearn.base import clone
from sklearn.pipeline import Pipeline

from granular_id.confidence.rows import Rows
from granular_id.evaluation.partition import Partition
from granular_id.spaces import learns

__all__ = ["HeldOutScores", "Scores", "held_out_scores", "scores_of", "without_fixed_steps"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Scores:
    """What a fitted model says of rows.

    Attributes
    ----------
    values : ndarray, shape (n, K)
        Decision value of each class, the largest wins.
    binary : ndarray, shape (n, L), or None
        Scores of the two-sided learners of an error-correcting code.
    probabilities : ndarray, shape (n, K), or None
        Where the model has `predict_proba`.
    coding : ndarray of int8, shape (K, L), or None
        Side of each class in each learner.
    """

    values: FloatArray
    binary: FloatArray | None = None
    probabilities: FloatArray | None = None
    coding: npt.NDArray[np.int8] | None = None


@dataclass(frozen=True, eq=False)
class HeldOutScores:
    """Scores of rows that did not train the model that scored them.

    Attributes
    ----------
    classes : tuple of str
    truth : ndarray of int, shape (n,)
        Class of each row.
    scores : Scores
        Of the same rows.
    rows : ndarray of int, shape (n,)
        Which row of the data each is.
    folds : ndarray of int, shape (n,)
        Number of the partition that held each out.
    groups : ndarray of int, shape (n,)
        Rows of a session share a number; without sessions each row has its own.
    held_out : str
        What the folds held out.
    """

    classes: tuple[str, ...]
    truth: IntArray
    scores: Scores
    rows: IntArray
    folds: IntArray
    groups: IntArray
    held_out: str

    @property
    def accuracy(self) -> float:
        """Share of rows whose largest value is that of their class."""
        return float((self.scores.values.argmax(axis=1) == self.truth).mean())


def held_out_scores(
    model: Any,
    rows: Rows,
    partitions: Sequence[Partition] | None = None,
    *,
    n_folds: int | None = None,
    seed: int = 0,
    n_jobs: int | None = None,
    held_out: str = "",
    done: Callable[[str], None] = lambda _: None,
) -> HeldOutScores:
    """Score each row with a model that was trained without its fold.

    Parameters
    ----------
    model : estimator
        Anything that scikit-learn can clone, with `decision_function`; not changed. Where it ends in
        `ECOCClassifier` the scores of its learners are kept too, where it has `predict_proba` the probabilities.
    rows : Rows
    partitions : sequence of Partition, optional
        Each row tested at most once, every class in every training part. Default: `Rows.folds`, as strict
        as the rows allow.
    n_folds, seed : int
        Of the default, see `Rows.folds`.
    n_jobs : int, optional
        Threads over folds, as in joblib; the numbers do not depend on it.
    held_out : str
        What `partitions` hold out, for a reader.
    done : callable
        Told the name of each fold that is done.

    Returns
    -------
    HeldOutScores

    Raises
    ------
    TypeError
        A model without `decision_function`.
    ValueError
        Partitions that test a row twice, or train without a class.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.confidence.held_out import held_out_scores
    >>> from granular_id.confidence.rows import rows_of
    >>> from granular_id.ecoc import ECOCClassifier
    >>> scored = held_out_scores(ECOCClassifier(), rows_of(*load_iris(return_X_y=True)))
    >>> scored.scores.values.shape, scored.scores.binary.shape, round(scored.accuracy, 2)
    ((150, 3), (150, 3), 0.97)
    """
    if partitions is None:
        partitions, held_out = rows.folds(n_folds, seed=seed)
    tested = np.concatenate([partition.test for partition in partitions])
    if np.unique(tested).size < tested.size:
        raise ValueError("partitions must test each row at most once")
    model, rows = without_fixed_steps(model, rows)

    def one(partition: Partition) -> Scores:
        fitted = rows.take(partition.train).trained(model)
        scores = scores_of(fitted, rows.X[partition.test], rows.classes)
        done(partition.description)
        return scores

    each = Parallel(n_jobs=n_jobs, prefer="threads")(delayed(one)(partition) for partition in partitions)
    folds = np.repeat(np.arange(len(partitions)), [partition.test.size for partition in partitions])
    groups = _groups(rows, tested)
    return HeldOutScores(rows.classes, rows.codes[tested], _joined(each), tested, folds, groups, held_out)


def scores_of(fitted: Any, X: npt.NDArray[Any], classes: Sequence[str]) -> Scores:
    """Scores of rows by a fitted model that knows exactly these classes, in this order."""
    if not hasattr(fitted, "decision_function"):
        raise TypeError(
            f"model must have decision_function, larger for what is likelier, got {type(fitted).__name__}"
        )
    if [str(label) for label in fitted.classes_] != list(classes):
        raise ValueError(
            f"the training part of each partition must hold every class, got {len(fitted.classes_)} of {len(classes)}"
        )
    last, features = fitted, X
    if isinstance(fitted, Pipeline):
        last = fitted.steps[-1][1]
        for _, step in fitted.steps[:-1]:
            features = features if step in (None, "passthrough") else step.transform(features)
    values = np.asarray(last.decision_function(features), dtype=np.float64)
    if values.ndim == 1:  # two classes: the second minus the first
        values = np.column_stack([-values / 2, values / 2])
    if values.shape != (len(X), len(classes)):
        raise ValueError(
            f"decision_function must give a value per class, ({len(X)}, {len(classes)}), got {values.shape}"
        )
    binary = coding = None
    if hasattr(last, "binary_scores"):
        binary = np.asarray(last.binary_scores(features), dtype=np.float64)
        coding = np.asarray(last.coding_matrix_)
    probabilities = None
    if hasattr(last, "predict_proba"):
        probabilities = np.asarray(last.predict_proba(features), dtype=np.float64)
    return Scores(values, binary, probabilities, coding)


def without_fixed_steps(model: Any, rows: Rows) -> tuple[Any, Rows]:
    """Apply the first steps of a pipeline that learn nothing from data once, instead of once a fold."""
    X = rows.X
    while isinstance(model, Pipeline) and len(model.steps) > 1 and not learns(model.steps[0][1]):
        X = clone(model.steps[0][1]).fit(X).transform(X)
        model = Pipeline(model.steps[1:])
    return model, replace(rows, X=X)


def _joined(each: Sequence[Scores]) -> Scores:
    values = np.concatenate([one.values for one in each])
    coding = each[0].coding
    binary = [one.binary for one in each if one.binary is not None]
    # Random codings without a seed differ from fold to fold: their scores cannot be compared.
    if coding is None or not all(
        one.coding is not None and np.array_equal(coding, one.coding) for one in each
    ):
        binary, coding = [], None
    shares = [one.probabilities for one in each if one.probabilities is not None]
    return Scores(
        values,
        np.concatenate(binary) if binary else None,
        np.concatenate(shares) if shares else None,
        coding,
    )


def _groups(rows: Rows, tested: IntArray) -> IntArray:
    if rows.sessions is None:
        return np.arange(len(tested), dtype=np.intp)
    return np.unique(rows.sessions[tested], return_inverse=True)[1].astype(np.intp)

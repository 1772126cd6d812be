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

from granular_id._estimators import asked_for, learns
from granular_id.recording import Dataset
from granular_id.splits import (
    Partition,
    block_partitions,
    chronological_partitions,
    describe_order,
    kfold_partitions,
    protocol_name,
    session_partitions,
    splittable_rows,
    why_no_sessions,
)

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
    >>> from granular_id.confidence.held_out import rows_of
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


# Recordings or features with their labels, and the strictest folds that they allow.

N_FOLDS = 5
"""Sessions or blocks in time are held out in so many folds: larger blocks have fewer neighbours that train."""

N_RANDOM_FOLDS = 10
"""Random folds: nine tenths of the rows train. With five, sets come out up to 2 points too large where rows are few."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows to learn from, with what is known of how they were recorded.

    Attributes
    ----------
    X : ndarray, shape (n, ...)
        Whatever the model takes: recordings (n, T, C) or features (n, D).
    codes : ndarray of int, shape (n,)
        Class of each row, an index into `classes`.
    classes : tuple of str
        Sorted labels.
    sessions : ndarray of str, shape (n,), or None
        None where the session of some row is not known.
    order : ndarray of int, shape (n,), or None
        Rows from the earliest to the latest; None where that is not known.
    no_order : str
        Why there is no order; empty where there is one.
    synthetic : bool
    """

    X: npt.NDArray[Any]
    codes: IntArray
    classes: tuple[str, ...]
    sessions: npt.NDArray[np.str_] | None
    order: IntArray | None
    no_order: str = ""
    synthetic: bool = False

    def __len__(self) -> int:
        return len(self.codes)

    @property
    def labels(self) -> npt.NDArray[np.str_]:
        """Label of each row (n,)."""
        named: npt.NDArray[np.str_] = np.array(self.classes)[self.codes]
        return named

    def take(self, rows: IntArray) -> Rows:
        """Return some of the rows, in the order given, with the classes that they hold."""
        kept, codes = np.unique(self.codes[rows], return_inverse=True)
        order = None
        if self.order is not None:
            order = np.argsort(np.argsort(self.order)[rows], kind="stable")
        return replace(
            self,
            X=self.X[rows],
            codes=codes.astype(np.intp),
            classes=tuple(self.classes[k] for k in kept),
            sessions=None if self.sessions is None else self.sessions[rows],
            order=order,
        )

    def trained(self, model: Any) -> Any:
        """Return a clone of a model, fitted on the rows; one that asks is told their sessions and their order."""
        known = asked_for(model, {"sessions": self.sessions, "order": self.order})
        return clone(model).fit(self.X, self.labels, **known)

    def folds(
        self, n_folds: int | None = None, *, seed: int = 0, strict: bool = True
    ) -> tuple[list[Partition], str]:
        """Folds in which every row is tested once, and a line on what they hold out.

        Whole sessions where every class has two or more; else contiguous blocks in time of each class; else, or
        when not `strict`, stratified random folds. Default: `N_FOLDS`, or `N_RANDOM_FOLDS` random ones.

        Raises
        ------
        ValueError
            A class with a single row, or one class only.
        """
        largest = max(own.size for own in splittable_rows(self.labels, "cross-fitting").values())
        n_random = min(N_RANDOM_FOLDS if n_folds is None else n_folds, largest)
        n_folds = min(N_FOLDS if n_folds is None else n_folds, largest)
        if strict and self._has_sessions:
            folds = session_partitions(self.codes, self.sessions, max_folds=n_folds)  # type: ignore[arg-type]
            return folds, f"{len(folds)} folds of whole sessions"
        if strict and self.order is not None:
            return (
                block_partitions(self.codes, self.order, n_folds=n_folds),
                f"{n_folds} blocks of each class in time order",
            )
        why = f" ({self._why_lenient})" if strict else ""
        return kfold_partitions(self.codes, n_folds=n_random, seed=seed), f"{n_random} random folds{why}"

    def honest(self, n_folds: int | None = None, *, seed: int = 0) -> tuple[list[Partition], str]:
        """Partitions to judge by: sessions, else halves in time order both ways, else random folds."""
        if not self._has_sessions and self.order is not None:
            splittable_rows(self.labels, "chronological")
            halves = chronological_partitions(self.codes, self.order)
            return halves, protocol_name(halves[0].protocol, halves)
        folds, _ = self.folds(n_folds, seed=seed)
        return folds, protocol_name(folds[0].protocol, folds)

    def refuse_few(self, n_folds: int | None = None) -> None:
        """Refuse materials of which `honest` or random partitions would train on a single row.

        Nothing could be held out within such a part, and a fit long after others would say so.

        Raises
        ------
        ValueError
            Naming the materials, their counts and what is needed.
        """
        counts = np.bincount(self.codes)
        in_halves = not self._has_sessions and self.order is not None
        needed = 4 if in_halves or n_folds == 2 else 3
        few, why = (
            counts < needed,
            f"at least {needed} of each are needed, so that 2 train while others are held out",
        )
        if in_halves:
            why = "at least 4 of each are needed, so that either half in time order holds 2"
        if self._has_sessions and not few.any():
            trains = [
                np.bincount(self.codes[part.train], minlength=len(counts)) for part in self.honest(n_folds)[0]
            ]
            few, why = (
                np.min(trains, axis=0) < 2,
                "at least 2 of each must train while whole sessions are held out",
            )
        if few.any():
            names = [repr(name) for name, is_few in zip(self.classes, few.tolist(), strict=True) if is_few]
            said = ", ".join(f"{name} ({n})" for name, n in zip(names, counts[few].tolist(), strict=True))
            raise ValueError(
                f"too few recordings of {said}: {why}; leave out {', '.join(names)}, or record more"
            )

    @property
    def _has_sessions(self) -> bool:
        return not why_no_sessions(self.codes, self.sessions)

    @property
    def _why_lenient(self) -> str:
        why = why_no_sessions(self.codes, self.sessions)
        return f"{why}; {self.no_order}" if self.no_order else why


def rows_of(
    data: Dataset | Rows | npt.ArrayLike,
    y: npt.ArrayLike | None = None,
    *,
    sessions: Sequence[str | None] | npt.NDArray[Any] | None = None,
    in_time_order: bool = False,
) -> Rows:
    """Take a data set, or arrays, as rows.

    Parameters
    ----------
    data : Dataset, Rows or array-like, shape (n, ...)
        Recordings with labels, sessions and times; or what the model takes, with labels in `y`. Rows stay as they are.
    y : array-like, shape (n,), optional
        Labels, of arrays only.
    sessions : sequence of n str, optional
        Session of each row, of arrays only.
    in_time_order : bool, default False
        Rows of arrays stand in the order in which they were recorded. A data set knows its order itself.

    Raises
    ------
    TypeError, ValueError
        Labels that are missing, given twice or do not fit the rows; fewer than two classes.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.confidence.held_out import rows_of
    >>> rows = rows_of(np.zeros((6, 2)), ["a", "b"] * 3, in_time_order=True)
    >>> rows.classes, rows.folds(3)[1]
    (('a', 'b'), '3 blocks of each class in time order')
    """
    if isinstance(data, Dataset | Rows):
        if y is not None or sessions is not None:
            raise ValueError("y and sessions come from the data set: leave them out, or pass data.X as data")
        return data if isinstance(data, Rows) else _of_dataset(data)
    if y is None:
        raise ValueError("y must hold a label for each row where data is an array, got None")
    X = np.asarray(data)
    labels = np.asarray(y)
    if labels.ndim != 1 or X.ndim < 2 or len(labels) != len(X):
        raise ValueError(
            f"data (n, ...) and y (n,) must hold a row and a label each, got shapes {X.shape} and {labels.shape}"
        )
    known = None
    if sessions is not None:
        given = list(sessions)
        if len(given) != len(X):
            raise ValueError(f"sessions must hold one for each of the {len(X)} rows, got {len(given)}")
        known = _known(given)
    order = np.arange(len(X)) if in_time_order else None
    no_order = "" if in_time_order else "no order in time is known"
    return _checked(X, labels, known, order, no_order)


def _of_dataset(data: Dataset) -> Rows:
    order, no_order = None, ""
    try:
        describe_order(data.start_times, data.y, data.names)
    except ValueError as why:
        no_order = str(why)
    else:
        order = np.asarray(data.chronological_order()[0], dtype=np.intp)
    return _checked(data.X, data.y, _known(data.sessions.tolist()), order, no_order, data.is_synthetic)


def _checked(
    X: npt.NDArray[Any],
    labels: npt.NDArray[Any],
    sessions: npt.NDArray[np.str_] | None,
    order: IntArray | None,
    no_order: str,
    synthetic: bool = False,
) -> Rows:
    classes, codes = np.unique(labels.astype(np.str_), return_inverse=True)
    if len(classes) < 2:
        raise ValueError(f"confidence needs rows of at least 2 classes, got {len(classes)}")
    names = tuple(classes.tolist())
    return Rows(X, codes.astype(np.intp), names, sessions, order, no_order, synthetic)


def _known(sessions: Sequence[Any]) -> npt.NDArray[np.str_] | None:
    if any(session is None or session == "" for session in sessions):
        return None
    return np.array([str(session) for session in sessions], dtype=np.str_)

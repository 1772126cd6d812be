"""Scores of rows from models that have not seen them: what every figure of this package rests on.

A model with more features than rows is sure of every row that it trained on. Each row is scored by a model
that was trained on the other folds instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from sklearn.base import clone
from sklearn.pipeline import Pipeline

from granular_id._estimators import learns
from granular_id._parallel import in_threads
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id._text import Table
from granular_id.partitions import (
    Partition,
    block_partitions,
    kfold_partitions,
    protocol_name,
    splittable_rows,
    why_no_sessions,
)
from granular_id.recording import Dataset
from granular_id.splits import Groups, checked_groups, groups_of, strict_partitions

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

Task = TypeVar("Task")
Found = TypeVar("Found")

N_FOLDS = 5
"""Sessions or blocks in time are held out in so many folds: larger blocks have fewer neighbours that train."""

N_RANDOM_FOLDS = 10
"""Random folds: nine tenths of the rows train. With five, sets come out up to 2 points too large where rows are few."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Recordings or features to learn from, with what is known of how they were recorded."""

    X: npt.NDArray[Any]  # whatever the model takes: recordings (n, T, C) or features (n, D)
    codes: IntArray  # class of each row, an index into `classes`
    classes: tuple[str, ...]  # sorted labels
    groups: Groups  # sessions, all or none, and the order in time
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
        classes = tuple(self.classes[k] for k in kept)
        return Rows(self.X[rows], codes.astype(np.intp), classes, self.groups.take(rows), self.synthetic)

    def trained(self, model: Any) -> Any:
        """Return a clone of a model, fitted on the rows; one that asks is told their sessions and their order."""
        known = self.groups.fit_arguments(model, np.arange(len(self)))
        return clone(model).fit(self.X, self.labels, **known)

    def folds(
        self, *, n_random: int = N_RANDOM_FOLDS, seed: int = 0, strict: bool = True
    ) -> tuple[list[Partition], str]:
        """Folds in which every row is tested once, and a line on what they hold out.

        Whole sessions where every class has two or more; else contiguous blocks in time of each class; else, or
        when not `strict`, `n_random` stratified random folds.
        """
        largest = max(own.size for own in splittable_rows(self.labels, "cross-fitting").values())
        n_random, n_folds = min(n_random, largest), min(N_FOLDS, largest)
        why = ""
        if strict:
            blocks = partial(block_partitions, n_folds=n_folds)
            folds, left_out = strict_partitions(self.codes, self.groups, max_folds=n_folds, in_time=blocks)
            if not left_out:
                return folds, f"{len(folds)} folds of whole sessions"
            if folds:
                return folds, f"{n_folds} blocks of each class in time order"
            why = f" ({why_no_sessions(self.codes, self.groups.sessions)}; {self.groups.basis})"
        return kfold_partitions(self.codes, n_folds=n_random, seed=seed), f"{n_random} random folds{why}"

    def partitions(self, *, seed: int = 0) -> tuple[list[Partition], str]:
        """Partitions to judge by: sessions, else halves in time order both ways, else random folds."""
        drawn, _ = strict_partitions(self.codes, self.groups, max_folds=N_FOLDS)
        drawn = drawn or self.folds(n_random=N_FOLDS, seed=seed, strict=False)[0]
        return drawn, protocol_name(drawn[0].protocol, drawn)

    def refuse_few(self) -> None:
        """Refuse materials of which `partitions` or random ones would train on a single row.

        Nothing could be held out within such a part, and a fit long after others would say so.
        """
        in_sessions = not why_no_sessions(self.codes, self.groups.sessions)
        in_halves = not in_sessions and self.groups.rank is not None
        counts = np.bincount(self.codes)
        needed = 4 if in_halves else 3
        few = counts < needed
        reason = "either half in time order holds 2" if in_halves else "2 train while others are held out"
        why = f"at least {needed} of each are needed, so that {reason}"
        if in_sessions and not few.any():
            trained = [self.codes[part.train] for part in self.partitions()[0]]
            few = np.min([np.bincount(codes, minlength=len(counts)) for codes in trained], axis=0) < 2
            why = "at least 2 of each must train while whole sessions are held out"
        if few.any():
            names = [repr(self.classes[k]) for k in np.flatnonzero(few)]
            said = ", ".join(f"{name} ({n})" for name, n in zip(names, counts[few].tolist(), strict=True))
            raise ValueError(
                f"too few recordings of {said}: {why}; leave out {', '.join(names)}, or record more"
            )


def rows_of(
    data: Dataset | Rows | npt.ArrayLike,
    y: npt.ArrayLike | None = None,
    *,
    sessions: Sequence[str | None] | npt.NDArray[Any] | None = None,
    in_time_order: bool = False,
) -> Rows:
    """Take a data set, or arrays (n, ...) with labels, as rows; rows stay as they are.

    `sessions`, and whether rows stand in the order of recording, are of arrays only: a data set knows its own. Where
    the session of some row is not known, none counts.
    """
    if isinstance(data, Dataset | Rows):
        if y is not None or sessions is not None:
            raise ValueError("y and sessions come from the data set: leave them out, or pass data.X as data")
        if isinstance(data, Rows):
            return data
        X, labels, groups, synthetic = data.X, data.y, groups_of(data), data.is_synthetic
    else:
        if y is None:
            raise ValueError("y must hold a label for each row where data is an array, got None")
        X, labels, synthetic = np.asarray(data), np.asarray(y), False
        if labels.ndim != 1 or X.ndim < 2 or len(labels) != len(X):
            raise ValueError(
                f"data (n, ...) and y (n,) must hold a row and a label each, got shapes {X.shape} and {labels.shape}"
            )
        groups = checked_groups(len(X), sessions, np.arange(len(X)) if in_time_order else None)
    if any(session is None for session in groups.sessions):
        groups = replace(groups, sessions=np.full(len(X), None, dtype=object))
    classes, codes = np.unique(labels.astype(np.str_), return_inverse=True)
    if len(classes) < 2:
        raise ValueError(f"confidence needs rows of at least 2 classes, got {len(classes)}")
    return Rows(X, codes.astype(np.intp), tuple(classes.tolist()), groups, synthetic)


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
    data: Dataset | Rows | npt.ArrayLike,
    model: Any,
    y: npt.ArrayLike | None = None,
    *,
    sessions: Sequence[str | None] | npt.NDArray[Any] | None = None,
    in_time_order: bool = False,
    partitions: Sequence[Partition] | None = None,
    seed: int = 0,
    n_jobs: int | None = None,
    held_out: str = "",
    done: Callable[[str], None] = lambda _: None,
) -> HeldOutScores:
    """Score each row with a model that was trained without its fold.

    Parameters
    ----------
    data : Dataset or array-like, shape (n, ...)
        Recordings, or rows that `model` takes.
    model : estimator
        Anything that scikit-learn can clone, with `decision_function`; not changed. Where it ends in
        `ECOCClassifier` the scores of its learners are kept too, where it has `predict_proba` the probabilities.
    y, sessions, in_time_order
        Of arrays only: the label and the session of each row, and whether rows stand in the order of recording.
    partitions : sequence of Partition, optional
        Each row tested at most once, every class in every training part. Default: folds of whole sessions where
        every class has several, or blocks in time, 5 at most; else 10 stratified random folds.
    seed : int, default 0
        Of random folds.
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
        Labels or sessions that do not fit the rows; partitions that test a row twice, or train without a class.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.confidence import held_out_scores
    >>> from granular_id import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> scored = held_out_scores(X, ECOCClassifier(), y)
    >>> scored.scores.values.shape, scored.scores.binary.shape, round(scored.accuracy, 2)
    ((150, 3), (150, 3), 0.97)
    """
    rows = rows_of(data, y, sessions=sessions, in_time_order=in_time_order)
    if partitions is None:
        partitions, held_out = rows.folds(seed=seed)
    tested = np.concatenate([partition.test for partition in partitions])
    if np.unique(tested).size < tested.size:
        raise ValueError("partitions must test each row at most once")
    model, rows = without_fixed_steps(model, rows)

    def scored(partition: Partition) -> Scores:
        fitted = rows.take(partition.train).trained(model)
        scores = scores_of(fitted, rows.X[partition.test], rows.classes)
        done(partition.description)
        return scores

    scores = _joined(in_threads(scored, partitions, n_jobs))
    folds = np.repeat(np.arange(len(partitions)), [partition.test.size for partition in partitions])
    groups = np.arange(len(tested), dtype=np.intp)
    of_tested = rows.groups.sessions[tested]
    if None not in of_tested.tolist():
        groups = np.unique(of_tested, return_inverse=True)[1].astype(np.intp)
    return HeldOutScores(rows.classes, rows.codes[tested], scores, tested, folds, groups, held_out)


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
    binary = coding = probabilities = None
    if hasattr(last, "binary_scores"):
        binary = np.asarray(last.binary_scores(features), dtype=np.float64)
        coding = np.asarray(last.coding_matrix_)
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
    def together(name: str) -> Any:
        parts = [getattr(one, name) for one in each]
        return None if any(part is None for part in parts) else np.concatenate(parts)

    coding, binary = each[0].coding, together("binary")
    # Scores of learners that differ from fold to fold cannot be compared.
    if binary is None or not all(np.array_equal(coding, one.coding) for one in each):  # type: ignore[arg-type]
        coding = binary = None
    return Scores(together("values"), binary, together("probabilities"), coding)


# What the studies of rules share: who is held out, what is scored, how it is reported.


def cross_fit(
    model: Any,
    train: Rows,
    X: npt.NDArray[Any],
    *,
    seed: int,
    n_random: int = N_RANDOM_FOLDS,
    strict: bool = True,
) -> tuple[HeldOutScores, Scores]:
    """Score training rows by models of their folds, to set a rule on, and other rows by a model of all, to judge it."""
    folds, held_out = train.folds(n_random=n_random, seed=seed, strict=strict)
    crossed = held_out_scores(train, model, partitions=folds, held_out=held_out)
    return crossed, scores_of(train.trained(model), X, train.classes)


def for_each(
    work: Callable[[Task], Found],
    tasks: Sequence[Task],
    name_of: Callable[[Task], str],
    n_jobs: int | None,
    progress: bool | ProgressCallback,
) -> list[Found]:
    """Do every task in threads, and say which are done."""
    with showing(progress) as callback:
        ticker = Ticker(len(tasks), callback)

        def told(task: Task) -> Found:
            found = work(task)
            ticker.tick(name_of(task))
            return found

        return in_threads(told, tasks, n_jobs)


class StudyResult:
    """Figures that can be printed."""

    synthetic: bool
    table: Callable[[], Table]

    def __str__(self) -> str:
        return str(self.table())

    @property
    def _mark(self) -> str:
        return " (SYNTHETIC recordings)" if self.synthetic else ""

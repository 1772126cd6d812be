"""BestClassifier: scaling, whitening and cost chosen on held-out rows, folded into one linear model."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from granular_id._blas import single_threaded_blas
from granular_id._threads import in_threads
from granular_id.best.candidates import Machine, plan_machines
from granular_id.best.choice import Choice, choose
from granular_id.best.folds import NONE, ChoiceFolds, choice_folds
from granular_id.best.machines import Line, fitted_line, held_out_scores
from granular_id.ecoc.codings import onevsone
from granular_id.ecoc.decoding import class_values
from granular_id.ecoc.learners import line_scores
from granular_id.ecoc.losses import fitting_loss
from granular_id.ecoc.training import checked_n_jobs, class_indices
from granular_id.spaces.multiband import BAND_LOSS
from granular_id.spaces.ordered import BlockSizes, SizesParameter
from granular_id.spaces.scaling import block_slices

__all__ = ["DECODING", "BestClassifier"]

FloatArray = npt.NDArray[np.float64]
Rows = npt.NDArray[np.intp]

DECODING = "loss_weighted"


class BestClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """A linear one-vs-one classifier that chooses its own preparation of the features.

    Every machine it tries standardises the columns, gives each block the same weight, may whiten within classes
    (`granular_id.spaces.BlockScaler`, `granular_id.spaces.WithinClassWhitening`) and trains a linear support
    vector machine for each pair of classes. Which of them generalise is found by holding out what will be new
    later: whole sessions, else halves in time, else random rows. The mean of the scores of those that come within
    one standard error of the best, or one recording, is the model. All of it is linear, so the model is one matrix of
    weights for plain features.

    Parameters
    ----------
    blocks : mapping of name to number of columns, sequence of int, or None, default None
        Blocks of columns, as in `BlockScaler`.
    optional_blocks : sequence of str, default ()
        Blocks that may hurt: each is tried with and without. The level of the raw signal, for instance, tells
        materials apart until the zero of the sensor has moved.
    shrinkages : sequence of float or None, default (None, 1e-3)
        Of `WithinClassWhitening`; None: no whitening. Whitening helps where recordings of a class drift and there are
        enough of them to tell in which directions, and costs a few points where there are not.
    relative_costs : sequence of float, default (1.0, 10.0)
        C times the mean squared distance of the training rows from their mean. At 1 some rows may violate the
        margin, at 10 hardly any does: more changes nothing.
    loss : str, default "root"
        Binary loss that the scores are decoded with, see `granular_id.ecoc.ECOCClassifier`. How far a score reaches
        beyond zero shifts with the session, its sign rarely does: the root names nearly the same classes as counting
        votes of the pairs ("hamming") would, but grades them, so that margins come without steps and ties.
    n_folds : int, default 5
        Folds that choose; fewer where a class has fewer sessions or recordings. Random folds are drawn anew until
        500 rows were held out, at most ten times. Without sessions, but with an order, the earlier and the later
        half of each class are held out, whatever this number.
    n_jobs : int, optional
        Threads over folds, as in joblib. The numbers do not depend on it.
    random_state : int or RandomState, default 0
        Seed of random folds, where such are needed.

    Attributes
    ----------
    classes_ : ndarray, shape (K,)
        Sorted labels.
    coding_matrix_ : ndarray of int8, shape (K, L)
        One-vs-one: +1 for the class that comes first, -1 for the other, 0 for the rest.
    coef_, intercept_ : ndarray, shapes (L, D) and (L,)
        Learners on plain features: a score is ``coef_ @ x + intercept_``. 0 for columns that are constant in training.
    choice_ : Choice
        What was tried, on which folds, and what was chosen; ``print(choice_)`` shows a table.
    held_out_scores_ : ndarray, shape (n, L)
        Binary scores of each training row by the chosen machines trained without it (without its session, or
        block in time), the mean over repeats; NaN for rows that were never held out. For calibration.
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    TypeError, ValueError
        From `fit`: parameters out of range, blocks that do not add up to the columns, one class only, NaN or
        infinity in X, sessions or an order that do not fit.

    Notes
    -----
    Where no two classes have two recordings nothing can be held out, and nothing chosen: the model is then the mean
    of all machines. `choice_` says so. A class with one recording always trains. A single machine, one shrinkage and
    one relative cost without optional blocks, needs no choice, and nothing is held out.

    The accuracy in `choice_` made the choice, and is too good by what the choice won; judge with folds around `fit`,
    as `granular_id.evaluate` does.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.best import BestClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> clf = BestClassifier(blocks={"sepal": 2, "petal": 2}, optional_blocks=["sepal"]).fit(X, y)
    >>> clf.coef_.shape
    (3, 4)
    >>> clf.choice_.held_out
    'random recordings'
    """

    blocks = SizesParameter()
    classes_: npt.NDArray[Any]
    coding_matrix_: npt.NDArray[np.int8]
    coef_: FloatArray
    intercept_: FloatArray
    choice_: Choice
    held_out_scores_: FloatArray
    n_features_in_: int

    def __init__(
        self,
        *,
        blocks: BlockSizes = None,
        optional_blocks: Sequence[str] = (),
        shrinkages: Sequence[float | None] = (None, 1e-3),
        relative_costs: Sequence[float] = (1.0, 10.0),
        loss: str = BAND_LOSS,
        n_folds: int = 5,
        n_jobs: int | None = None,
        random_state: int | np.random.RandomState | None = 0,
    ) -> None:
        self.blocks = blocks
        self.optional_blocks = optional_blocks
        self.shrinkages = shrinkages
        self.relative_costs = relative_costs
        self.loss = loss
        self.n_folds = n_folds
        self.n_jobs = n_jobs
        self.random_state = random_state

    def fit(
        self,
        X: npt.ArrayLike,
        y: npt.ArrayLike,
        sessions: Sequence[Any] | npt.NDArray[Any] | None = None,
        order: npt.ArrayLike | None = None,
    ) -> BestClassifier:
        """Choose, and train on all rows.

        Parameters
        ----------
        X : array-like, shape (n, D)
            Plain features, finite.
        y : array-like, shape (n,)
            Labels: strings, integers or other values that can be sorted.
        sessions : sequence of n, optional
            Session of each row; None or "" where it is not known.
        order : array-like of int, shape (n,), optional
            Row numbers from the earliest to the latest recording, see `Dataset.chronological_order`.

        Returns
        -------
        self
        """
        checked_n_jobs(self.n_jobs)
        loss = fitting_loss(self.loss, "real")
        rows, labels = validate_data(self, X, y, dtype=np.float64)
        classes, codes = class_indices(labels, None)
        slices = block_slices(self.blocks, rows.shape[1])
        sizes = {name: columns.stop - columns.start for name, columns in slices.items()}
        machines = plan_machines(list(sizes), self.optional_blocks, self.shrinkages, self.relative_costs)
        seed = int(check_random_state(self.random_state).randint(np.iinfo(np.int32).max))
        planned = choice_folds(codes, sessions, order, n_folds=self.n_folds, seed=seed)
        if len(machines) == 1:
            planned = ChoiceFolds((), NONE, "no folds: one machine leaves nothing to choose")
        matrix = onevsone(len(classes))

        def scored(fold: tuple[Rows, Rows]) -> FloatArray:
            return held_out_scores(rows, codes, sizes, machines, *fold)

        def decoded(scores: FloatArray) -> Rows:
            winners: Rows = class_values(scores, matrix, loss, DECODING).argmax(axis=1)
            return winners

        # One thread of algebra: with more the last bits would depend on their number.
        with single_threaded_blas():
            scores = in_threads(scored, planned.folds, self.n_jobs)
            accuracies = np.array(
                [
                    [np.mean(decoded(one) == codes[test]) for one in of_fold]
                    for of_fold, (_, test) in zip(scores, planned.folds, strict=True)
                ]
            ).reshape(len(planned.folds), len(machines))
            n_held_out = np.unique(np.concatenate([test for _, test in planned.folds] or [codes[:1]])).size
            chosen = choose(accuracies, n_held_out) if planned.folds else tuple(range(len(machines)))
            together = [of_fold[list(chosen)].mean(axis=0) for of_fold in scores]
            lines = in_threads(lambda k: _line(rows, codes, sizes, machines, k), chosen, self.n_jobs)
        joint = np.array(
            [
                np.mean(decoded(own) == codes[test])
                for own, (_, test) in zip(together, planned.folds, strict=True)
            ]
        )
        self.classes_, self.coding_matrix_ = classes, matrix
        self.coef_ = np.mean([coef for coef, _ in lines], axis=0)
        self.intercept_ = np.mean([intercept for _, intercept in lines], axis=0)
        self.held_out_scores_ = _means_of_rows(together, planned, len(rows), matrix.shape[1])
        number = int(self.random_state) if isinstance(self.random_state, Integral) else None
        self.choice_ = Choice(machines, chosen, accuracies, joint, planned.held_out, planned.note, number)
        return self

    def binary_scores(self, X: npt.ArrayLike) -> FloatArray:
        """Scores (n, L) of the pairs for features (n, D); positive speaks for the class that comes first."""
        check_is_fitted(self)
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        return line_scores("X", rows, self.coef_, self.intercept_)

    def decision_function(self, X: npt.ArrayLike) -> FloatArray:
        """Decision value of each class for features (n, D).

        Returns
        -------
        ndarray, shape (n, K), or (n,) for two classes
            Minus the mean binary loss of each class: the largest wins. For two classes the score of the pair, with
            the sign that is positive for ``classes_[1]``.
        """
        scores = self.binary_scores(X)
        if len(self.classes_) == 2:
            return -scores[:, 0]
        return self._values(scores)

    def predict(self, X: npt.ArrayLike) -> npt.NDArray[Any]:
        """Label of each row of features (n, D); of tied classes the first in `classes_`."""
        values = self._values(self.binary_scores(X))
        labels: npt.NDArray[Any] = self.classes_[values.argmax(axis=1)]
        return labels

    def _values(self, scores: FloatArray) -> FloatArray:
        return class_values(scores, self.coding_matrix_, fitting_loss(self.loss, "real"), DECODING)


def _line(X: FloatArray, codes: Rows, sizes: dict[str, int], machines: Sequence[Machine], k: int) -> Line:
    own = machines[k].relative_cost
    lower = sorted({machine.relative_cost for machine in machines if machine.relative_cost < own})
    return fitted_line(X, codes, sizes, machines[k], lower)


def _means_of_rows(
    scores: list[FloatArray], planned: ChoiceFolds, n_rows: int, n_learners: int
) -> FloatArray:
    """Mean over folds of the scores of each row; NaN where it was in none."""
    sums, times = np.zeros((n_rows, n_learners)), np.zeros(n_rows)
    for own, (_, test) in zip(scores, planned.folds, strict=True):
        sums[test] += own
        times[test] += 1
    with np.errstate(invalid="ignore"):
        means: FloatArray = sums / times[:, np.newaxis]
    return means

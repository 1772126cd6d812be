"""The classifier behind the preset "best": chooses among few linear machines on held-out rows, and is one of them."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from granular_id._checks import checked_n_jobs
from granular_id._parallel import in_threads, single_threaded_blas
from granular_id.ecoc import ECOCClassifier, class_indices, class_values, fitting_loss, line_scores, onevsone
from granular_id.gram import linear_gram
from granular_id.spaces.candidates import Choice, Machine, choose, plan_machines
from granular_id.spaces.multiband import BAND_LOSS
from granular_id.spaces.scaling import (
    BlockScaler,
    WithinClassWhitening,
    block_slices,
    folded_back,
    whitened_grams,
)
from granular_id.spaces.union import BlockSizes, SizesParameter
from granular_id.splits import NONE, ChoiceFolds, choice_folds

# BestClassifier: scaling, whitening and cost chosen on held-out rows, folded into one linear model.

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
    >>> from granular_id.spaces.best import BestClassifier
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


# Training many machines on the same rows: one Gram matrix a block, shared by all of them.

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

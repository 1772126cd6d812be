"""The classifier of the preset "best": a steady model, and with it the candidate that does best on held-out rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import groupby, product
from numbers import Integral
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from granular_id._checks import named, positive_number
from granular_id._core import GranularIdError
from granular_id._parallel import single_threaded_blas
from granular_id._text import Table, percent
from granular_id.ecoc import (
    LOSSES,
    Learners as Machines,
    class_indices,
    decode,
    linear_scores,
    onevsone,
    train_learners,
)
from granular_id.spaces.adaptation import Learners, SourceStatistics, adapted_to_all
from granular_id.spaces.multiband import BAND_LOSS, BAND_SHRINKAGE
from granular_id.spaces.scaling import (
    BlockScaler,
    BlockSizes,
    WithinClassWhitening,
    block_slices,
    folded_back,
    whitened_grams,
)
from granular_id.splits import CONDITIONS, NONE, SESSIONS, ChoiceFolds, checked_groups, choice_folds

FloatArray = npt.NDArray[np.float64]
Rows = npt.NDArray[np.intp]

# Where more of the rows violate the margin, the classes overlap: no cost pulls them apart, and libsvm takes millions of
# steps to find that out.
_MOST_AT_BOUND = 0.5


class BestClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """A linear one-vs-one classifier that chooses its own preparation of the features.

    Every candidate model standardises the columns, gives each block the same weight, may whiten within classes
    (`BlockScaler`, `WithinClassWhitening`) and trains a linear support vector machine for each pair of classes. Which
    of them generalises is found by holding out what will be new later: whole groups or sessions, else halves in time,
    else random rows. The model is the mean of the scores of two: the candidate whose true classes lead most on the
    rows held out, and the first candidate, whatever it reaches there. What wins within one set-up may lose in another,
    where the first, whitened mildly and trained with a soft margin, is steady. All of it is linear, so the model is
    one matrix of weights for plain features.

    Parameters
    ----------
    blocks : mapping of name to number of columns, or None, default None
        Blocks of columns, as in `BlockScaler`. None: one block.
    optional_blocks : sequence of str, default ()
        Blocks that may hurt, such as the level of the raw signal, which tells materials apart until the zero of the
        sensor has moved. They are tried where whole groups or sessions are held out, and left out unless they gain in
        every one: inside of one session nothing shows whether a block knows the material or the session.
    shrinkages : sequence of float or None, default (0.03, None, 1e-3)
        Of `WithinClassWhitening`; None: no whitening. Whitening helps where recordings of a class drift and there are
        enough of them to tell in which directions, and costs a few points where there are not. The less is added, the
        more it helps within a set-up, and the less in another. The first belongs to the first candidate.
    relative_costs : sequence of float, default (1.0, 10.0)
        C times the mean squared distance of the training rows from their mean. At 1 some rows may violate the
        margin, at 10 hardly any does: more changes nothing. The lowest belongs to the first candidate.
    loss : str, default "root"
        Binary loss that the scores are decoded with, see `ECOCClassifier`. How far a score reaches
        beyond zero shifts with the session, its sign rarely does: the root names nearly the same classes as counting
        votes of the pairs would, but grades them, so that margins come without steps and ties.
    n_folds : int, default 5
        Folds that choose; fewer where a class has fewer sessions or recordings. Random folds are drawn anew until
        500 rows were held out, at most ten times. Without sessions, but with an order, the earlier and the later
        half of each class are held out, whatever this number.
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
    n_features_in_, feature_names_in_
        As in every scikit-learn estimator.

    Raises
    ------
    TypeError, ValueError
        From `fit`: parameters out of range, blocks that do not add up to the columns, one class only, NaN or
        infinity in X, sessions, groups, overlaps or an order that do not fit.

    Notes
    -----
    Where no two classes have two recordings nothing can be held out: the model is then the first candidate, and
    `choice_` says so. A class with one recording always trains. A single candidate needs no choice, and nothing is held
    out. Rows that share samples with held-out ones, or equal one of them, do not train beside them.

    The accuracy in `choice_` made the choice, and is too good by what the choice won; judge with folds around `fit`,
    as `granular_id.evaluate` does.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id import BestClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> clf = BestClassifier(blocks={"sepal": 2, "petal": 2}).fit(X, y)
    >>> clf.coef_.shape
    (3, 4)
    >>> clf.choice_.held_out
    'random recordings'
    """

    classes_: npt.NDArray[Any]
    coding_matrix_: npt.NDArray[np.int8]
    coef_: FloatArray
    intercept_: FloatArray
    choice_: Choice
    n_features_in_: int

    def __init__(
        self,
        *,
        blocks: BlockSizes = None,
        optional_blocks: Sequence[str] = (),
        shrinkages: Sequence[float | None] = (BAND_SHRINKAGE, None, 1e-3),
        relative_costs: Sequence[float] = (1.0, 10.0),
        loss: str = BAND_LOSS,
        n_folds: int = 5,
        random_state: int | np.random.RandomState | None = 0,
    ) -> None:
        self.blocks = blocks
        self.optional_blocks = optional_blocks
        self.shrinkages = shrinkages
        self.relative_costs = relative_costs
        self.loss = loss
        self.n_folds = n_folds
        self.random_state = random_state

    def fit(
        self,
        X: npt.ArrayLike,
        y: npt.ArrayLike,
        sessions: Sequence[Any] | npt.NDArray[Any] | None = None,
        order: npt.ArrayLike | None = None,
        groups: Sequence[Any] | npt.NDArray[Any] | None = None,
        overlaps: npt.ArrayLike | None = None,
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
            Row numbers from the earliest to the latest recording.
        groups : sequence of n, optional
            What new recordings will not share with these, such as the tool of each row: where every class has two or
            more, they are held out whole in place of sessions.
        overlaps : array-like of int, shape (P, 2), optional
            Pairs of row numbers that share samples, as overlapping windows of one recording do: while one of a pair is
            held out, the other does not train.

        Returns
        -------
        self
        """
        named(LOSSES, "loss", self.loss)
        rows, labels = validate_data(self, X, y, dtype=np.float64)
        classes, codes = class_indices(labels)
        slices = block_slices(self.blocks, rows.shape[1])
        sizes = {name: columns.stop - columns.start for name, columns in slices.items()}
        candidates = plan_candidates(list(sizes), self.optional_blocks, self.shrinkages, self.relative_costs)
        seed = int(check_random_state(self.random_state).randint(np.iinfo(np.int32).max))
        copies = np.unique(rows, axis=0, return_inverse=True)[1].ravel()  # numpy 2.0.0 gives (n, 1)
        known = checked_groups(len(codes), sessions, order, groups, overlaps)
        planned = choice_folds(codes, known, n_folds=self.n_folds, seed=seed, copies=copies)
        if planned.held_out not in (SESSIONS, CONDITIONS):
            optional = set(self.optional_blocks)
            candidates = tuple(one for one in candidates if not optional.intersection(one.blocks))
        if len(candidates) == 1:
            planned = ChoiceFolds((), NONE, "no folds: one machine leaves nothing to choose")
        tests = [test for _, test in planned.folds]
        matrix = onevsone(len(classes))

        def judge(scores: FloatArray, test: Rows) -> tuple[float, float]:
            return _accuracy_and_lead(decode(scores, matrix, self.loss), codes[test])

        # One thread of algebra: with more the last bits would depend on their number.
        with single_threaded_blas():
            scores = [held_out_scores(rows, codes, sizes, candidates, *fold) for fold in planned.folds]
            each = [[judge(own, test) for own in of] for of, test in zip(scores, tests, strict=True)]
            accuracies, leads = np.moveaxis(np.array(each).reshape(len(tests), len(candidates), 2), 2, 0)
            chosen = choose(candidates, leads)
            lines = fitted_lines(rows, codes, sizes, candidates, chosen)
        together = [of_fold[list(chosen)].mean(axis=0) for of_fold in scores]
        joint = np.array([judge(own, test)[0] for own, test in zip(together, tests, strict=True)])
        self.classes_, self.coding_matrix_ = classes, matrix
        self.coef_ = np.mean([coef for coef, _ in lines], axis=0)
        self.intercept_ = np.mean([intercept for _, intercept in lines], axis=0)
        number = int(self.random_state) if isinstance(self.random_state, Integral) else None
        self.choice_ = Choice(
            candidates, chosen, accuracies, leads, joint, planned.held_out, planned.note, number
        )
        return self

    def binary_scores(self, X: npt.ArrayLike) -> FloatArray:
        """Scores (n, L) of the pairs for features (n, D); positive speaks for the class that comes first."""
        check_is_fitted(self)
        rows = validate_data(self, X, dtype=np.float64, reset=False)
        return linear_scores(rows, self.coef_, self.intercept_)

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
        return decode(scores, self.coding_matrix_, self.loss)


def adapted_classifier(
    classifier: BestClassifier, X: FloatArray, y: npt.NDArray[Any], X_new: FloatArray
) -> BestClassifier:
    """Return a classifier for the set-up of rows that hold all classes about equally; the old one had `X` and `y`."""
    own = classifier.coef_, classifier.intercept_, classifier.coding_matrix_
    learners = Learners(*own, lambda scores: -classifier._values(scores))
    rows, new_rows = (np.asarray(each, dtype=np.float64) for each in (X, X_new))
    source = SourceStatistics.of(rows, np.searchsorted(classifier.classes_, y), learners)
    slices = block_slices(classifier.blocks, X.shape[1])
    blocks = {name: columns.stop - columns.start for name, columns in slices.items()}
    made, _ = adapted_to_all(learners, source, new_rows, blocks)
    new = copy(classifier)
    new.coef_, new.intercept_ = made.coef, made.intercept
    return new


@dataclass(frozen=True, eq=False)
class Choice:
    """The choice of a `BestClassifier`.

    Attributes
    ----------
    machines : tuple of Candidate
        All candidate models that were tried.
    chosen : tuple of int
        Which of them make up the model: the first, and the best where it is another one.
    accuracies : ndarray, shape (J, n_candidates)
        Of each on each fold; J is 0 where there were no folds.
    leads : ndarray, shape (J, n_candidates)
        Mean lead of the true class over the next, over the mean size of the leads: 1 where all rows are right, -1 where
        all are wrong. The largest mean over folds is the best: it says what accuracy says, and grades it.
    joint : ndarray, shape (J,)
        Accuracy of the chosen ones together. They were chosen on these folds: too good by as much as the choice won.
    held_out : {"conditions", "sessions", "blocks in order", "random recordings", "nothing"}
        What a fold was.
    note : str
        How the folds were made, as a line to read.
    random_state : int or None, default None
        What drew random folds, where it was a number.
    """

    machines: tuple[Candidate, ...]
    chosen: tuple[int, ...]
    accuracies: FloatArray
    leads: FloatArray
    joint: FloatArray
    held_out: str
    note: str
    random_state: int | None = None

    @property
    def accuracy(self) -> float:
        """Mean of `joint`; NaN where there were no folds."""
        return float(self.joint.mean()) if self.joint.size else float("nan")

    @property
    def names(self) -> tuple[str, ...]:
        """The candidates that make up the model."""
        return tuple(self.machines[k].name for k in self.chosen)

    @property
    def words(self) -> str:
        """What makes up the model, as a line to read."""
        count = f"{len(self.chosen)} of {len(self.machines)}"
        return f"the mean of the candidate models that were chosen, {count}: {'; '.join(self.names)}"

    def table(self) -> Table:
        """All candidates, in the order of their leads on the folds; ``>`` marks the chosen ones."""
        notes = [f"chosen on {self.note}"]
        figures = [("-", "-")] * len(self.machines)
        if len(self.leads):
            notes.append(
                "> chosen: the first candidate, and that of the largest lead of the true class (1: all right, -1: all "
                "wrong), without optional blocks that do not gain throughout; the mean of their scores reaches "
                f"{percent(self.accuracy)} on the same folds"
            )
            means = zip(self.accuracies.mean(axis=0).tolist(), self.leads.mean(axis=0).tolist(), strict=True)
            figures = [(percent(accuracy), f"{lead:.3f}") for accuracy, lead in means]
        rows = tuple(
            (f"{'> ' if k in self.chosen else '  '}{self.machines[k].name}", *figures[k])
            for k in np.argsort(-self.leads.sum(axis=0), kind="stable").tolist()
        )
        return Table("Candidate models tried", ("candidate", "accuracy", "lead"), rows, tuple(notes))

    def __str__(self) -> str:
        return str(self.table())

    def to_dict(self) -> dict[str, Any]:
        """Everything in types that JSON knows."""
        return {
            "held_out": self.held_out,
            "note": self.note,
            "random_state": self.random_state,
            "n_folds": len(self.accuracies),
            "accuracy_on_the_folds_that_chose": self.accuracy if self.joint.size else None,
            "chosen": list(self.names),
            "machines": [
                {
                    "name": machine.name,
                    "blocks": list(machine.blocks),
                    "shrinkage": machine.shrinkage,
                    "relative_cost": machine.relative_cost,
                    "chosen": k in self.chosen,
                    "accuracies": self.accuracies[:, k].tolist(),
                }
                for k, machine in enumerate(self.machines)
            ],
        }


def choice_of(pipeline: Any) -> Choice | None:
    """Return what the last step of a fitted pipeline chose; None of another than ours, or where there was no choice."""
    last = pipeline[-1]
    return last.choice_ if isinstance(last, BestClassifier) and len(last.choice_.machines) > 1 else None


@dataclass(frozen=True)
class Candidate:
    """One way to train linear learners on blocks of columns.

    `shrinkage` is that of `WithinClassWhitening`, None without whitening; `relative_cost` is C times the mean squared
    distance of the training rows from their mean.
    """

    blocks: tuple[str, ...]
    shrinkage: float | None
    relative_cost: float
    left_out: tuple[str, ...] = ()
    """Optional blocks that it does not see."""

    @property
    def name(self) -> str:
        """What makes it differ, in a few words, such as ``without level, whitened 0.001, C 1``."""
        parts = [f"without {' and '.join(self.left_out)}"] if self.left_out else ["all blocks"]
        parts.append("plain" if self.shrinkage is None else f"whitened {self.shrinkage:g}")
        return ", ".join((*parts, f"C {self.relative_cost:g}"))


def plan_candidates(
    blocks: Sequence[str], optional: Any, shrinkages: Any, relative_costs: Any
) -> tuple[Candidate, ...]:
    """Every combination: without optional blocks first, then as whitening is listed, then the lowest cost."""
    extra = _checked("optional_blocks", optional, "names of blocks", empty=True)
    unknown = [name for name in extra if name not in blocks]
    if unknown:
        raise GranularIdError(
            f"optional_blocks must name blocks ({', '.join(map(repr, blocks))}), got {unknown[0]!r}"
        )
    if len(extra) == len(blocks):
        raise GranularIdError(
            f"optional_blocks must leave a block that always stays, got all of them: {extra!r}"
        )
    amounts = [
        None if value is None else positive_number("shrinkages", value, "None or a number")
        for value in _checked("shrinkages", shrinkages, "numbers or None")
    ]
    costs = [
        positive_number("relative_costs", value)
        for value in _checked("relative_costs", relative_costs, "numbers")
    ]
    with_extra = sorted(product((False, True), repeat=len(extra)), key=sum)
    candidates = []
    for with_each, shrinkage, cost in product(with_extra, amounts, sorted(costs)):
        left_out = tuple(name for name, stays in zip(extra, with_each, strict=True) if not stays)
        own = tuple(name for name in blocks if name not in left_out)
        candidates.append(Candidate(own, shrinkage, cost, left_out))
    return tuple(candidates)


def _checked(argument: str, values: Any, what: str, *, empty: bool = False) -> list[Any]:
    if isinstance(values, (str, bytes)) or not hasattr(values, "__iter__"):
        raise TypeError(f"{argument} must be a sequence of {what}, got {values!r}")
    every = list(values)
    if not every and not empty:
        raise GranularIdError(f"{argument} must hold at least one of {what}, got none")
    if len(set(every)) < len(every):
        raise GranularIdError(f"{argument} must hold each once, got {every!r}")
    return every


def choose(candidates: Sequence[Candidate], leads: FloatArray) -> tuple[int, ...]:
    """Return the first candidate and the best by leads (J, n_candidates); optional blocks must gain in every fold."""
    if not len(leads):
        return (0,)
    means = leads.mean(axis=0)
    for name in {name for candidate in candidates for name in candidate.left_out}:
        sees = np.array([name in candidate.blocks for candidate in candidates])
        # Candidates come in pairs that differ in this block alone: the means compare like with like.
        if sees.any() and not (leads[:, sees].mean(axis=1) > leads[:, ~sees].mean(axis=1) + 1e-12).all():
            means[sees] = -np.inf
    return tuple(sorted({0, int(means.argmax())}))


def _accuracy_and_lead(values: FloatArray, codes: Rows) -> tuple[float, float]:
    """Share of right rows, and the mean lead of the true class over the mean size of leads, of class values (m, K)."""
    every = np.arange(len(codes))
    own, right = values[every, codes], values.argmax(axis=1) == codes
    values[every, codes] = -np.inf
    lead = own - values.max(axis=1)
    return float(right.mean()), float(lead.mean() / (np.abs(lead).mean() or 1.0))


def held_out_scores(
    X: FloatArray,
    codes: Rows,
    sizes: dict[str, int],
    candidates: Sequence[Candidate],
    train: Rows,
    test: Rows,
) -> FloatArray:
    """Binary scores (n_candidates, n_test, L) of rows that did not train, from one Gram matrix a choice of blocks."""
    scaler = BlockScaler(sizes).fit(X[train])
    rows = scaler.transform(X[np.concatenate([train, test])])
    labels = codes[train]
    scores: list[FloatArray] = []
    for blocks, of_blocks in groupby(candidates, key=lambda candidate: candidate.blocks):
        own = rows[:, _columns(sizes, blocks)]
        both = own @ own[: train.size].T
        plain = both[: train.size], both[train.size :]
        for shrinkage, of_kind in groupby(of_blocks, key=lambda candidate: candidate.shrinkage):
            gram, cross = plain if shrinkage is None else whitened_grams(*plain, labels, shrinkage)
            costs = [candidate.relative_cost for candidate in of_kind]
            scores.extend(
                linear_scores(cross, machines.dual_coef, machines.intercept)
                for machines in _trained(gram, labels, costs)
            )
    return np.stack(scores)


def fitted_lines(
    X: FloatArray, codes: Rows, sizes: dict[str, int], candidates: Sequence[Candidate], chosen: Sequence[int]
) -> list[tuple[FloatArray, FloatArray]]:
    """Train candidates on all rows: weights (L, D) of each and intercepts (L,), for plain features."""
    lines = []
    for (blocks, shrinkage), group in groupby(
        chosen, key=lambda k: (candidates[k].blocks, candidates[k].shrinkage)
    ):
        wanted = [candidates[k].relative_cost for k in group]
        own = _columns(sizes, blocks)
        steps: list[Any] = [BlockScaler({name: sizes[name] for name in blocks}).fit(X[:, own])]
        rows = steps[0].transform(X[:, own])
        if shrinkage is not None:
            steps.append(WithinClassWhitening(shrinkage).fit(rows, codes))
            rows = steps[1].transform(rows)
        # From the lowest cost on: where it will do, it does, as on the folds.
        costs = sorted({c.relative_cost for c in candidates if c.relative_cost <= max(wanted)})
        for cost, machines in zip(costs, _trained(rows @ rows.T, codes, costs), strict=True):
            if cost in wanted:
                weights, intercept = folded_back(steps, machines.dual_coef @ rows, machines.intercept)
                coef = np.zeros((len(weights), X.shape[1]))
                coef[:, own] = weights
                lines.append((coef, intercept))
    return lines


def _columns(sizes: dict[str, int], blocks: Sequence[str]) -> Rows:
    slices = block_slices(sizes, sum(sizes.values()))
    return np.concatenate([np.r_[columns] for name, columns in slices.items() if name in blocks])


def _trained(gram: FloatArray, codes: Rows, costs: Sequence[float]) -> Iterator[Machines]:
    """Machines of each cost, ascending; those of the one before where more would change nothing, or not end."""
    matrix = onevsone(int(codes.max()) + 1)
    spread = float(np.trace(gram)) / len(gram)
    machines: Machines | None = None
    for cost in costs:
        if machines is None or 0 < machines.share_at_bound <= _MOST_AT_BOUND:
            machines = train_learners(gram, matrix, codes, cost / (spread or 1.0))
        yield machines

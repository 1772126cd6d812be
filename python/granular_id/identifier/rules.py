"""What a model keeps beside its weights to say how sure it is: candidates of a stated coverage, and strangers.

The rules are those of `granular_id.confidence`, set on the recordings that were held out for the estimate, and stored
among what is known of the training. The core checks them with the model, and applies them to whole recordings:
provisional answers have none.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._checks import checked_number
from granular_id._text import fixed
from granular_id.ecoc import Posterior, Task, check_posterior, fit_posterior
from granular_id.spaces import BestClassifier

if TYPE_CHECKING:
    from granular_id.confidence import ConformalRule, UnknownRule
    from granular_id.identifier.held_out import HeldOut
KEY = "confidence"
"""Where the rules stand in what is known of a training."""


@dataclass(frozen=True)
class Rules:
    """The rules of a model, None where it has none.

    Attributes
    ----------
    conformal : ConformalRule or None
    unknown : UnknownRule or None
    """

    conformal: ConformalRule | None = None
    unknown: UnknownRule | None = None

    @classmethod
    def of(cls, core: _core.Model) -> Rules:
        """Read the rules of a model, which the core has found to fit it.

        Raises
        ------
        TypeError, ValueError
            A number is written as no rule of the library writes it.
        """
        stored = json.loads(core.metadata["trained"]).get(KEY)
        if stored is None:
            return cls()
        from granular_id.confidence import (
            ConformalRule,  # few models have them
            UnknownRule,
        )

        kinds: dict[str, Any] = {"conformal": ConformalRule, "unknown": UnknownRule}
        return cls(**{name: kinds[name].from_dict(rule) for name, rule in stored.items() if rule is not None})


def rules_of(
    held: HeldOut,
    classes: tuple[str, ...],
    coding: npt.NDArray[np.int8],
    *,
    coverage: float | None,
    share_known: float | None,
) -> dict[str, Any]:
    """Set the rules on held-out recordings.

    Parameters
    ----------
    held : HeldOut
    classes : tuple of K str
    coding : ndarray of int8, shape (K, L)
    coverage : float or None
        Share of recordings of which the candidates hold the right material; None: no rule.
    share_known : float or None
        Share of recordings of known materials that are not called unknown; None: no rule.

    Returns
    -------
    dict
        In types that JSON knows.
    """
    from granular_id.confidence import (
        HeldOutScores,
        Scores,
        conformal_rule,
        unknown_rule,
    )

    rows, first = np.unique(held.rows, return_index=True)  # each once, however often it was held out
    scored = HeldOutScores(
        classes=classes,
        truth=held.truth[first],
        scores=Scores(held.values[first], held.scores[first], None, coding),
        rows=rows,
        folds=held.folds[first],
        groups=np.arange(rows.size, dtype=np.intp),
        held_out=held.held_out,
    )
    rules: dict[str, Any] = {}
    if coverage is not None:
        rules["conformal"] = conformal_rule(scored, [coverage]).to_dict()
    if share_known is not None:
        rules["unknown"] = unknown_rule(scored, share_known=share_known).to_dict()
    return rules


# Probabilities of the space "best", from the recordings that it held out to choose.


def posterior_of(classifier: BestClassifier, y: npt.NDArray[np.str_], method: str) -> Posterior:
    """Fit probabilities to scores of training rows by machines that had not seen them.

    Parameters
    ----------
    classifier : BestClassifier
        Fitted.
    y : ndarray, shape (n,)
        Labels of its training rows.
    method : str
        As `posterior` of `granular_id.ECOCClassifier`.

    Raises
    ------
    ValueError
        An unknown method, or a class of which no recording was held out.
    """
    matrix, scores = classifier.coding_matrix_, classifier.held_out_scores_
    check_posterior(method, matrix)
    rows = np.flatnonzero(~np.isnan(scores).any(axis=1))
    index = np.searchsorted(classifier.classes_, y[rows])
    missing = [str(name) for k, name in enumerate(classifier.classes_) if not (index == k).any()]
    if missing:
        raise ValueError(
            f"posterior needs recordings of every class that were held out, {missing[0]!r} has none: record more "
            "of it, or leave posterior out"
        )
    task = Task(
        matrix, index.astype(np.intp), None, np.arange(rows.size), [str(c) for c in classifier.classes_]
    )
    return fit_posterior(method, scores[rows], task)


# When an answer may be given before the recording ends: calibrated on recordings that were held out.
#
# The rule has two numbers: from `n_seen` samples on, the first provisional answer whose margin reaches `margin` is
# given.
# Among all pairs of them the one is taken that answers soonest, while the share of wrong early answers stays within a
# level. Each partition is then answered by the pair that the *others* choose, and the level is lowered until the
# answers
# so found are wrong in at most the share that was asked for.
#
# That one level is chosen on the answers whose share of errors is shown: the share is a little lower there than on
# fresh
# recordings. What was asked for is kept on those as well, on the average over sets of recordings; a test draws many.
#
# Shares are counted as (wrong + 1) / (answered + 1), as if the next recording were answered wrongly: ten right answers
# out of ten say little about an error of one in a hundred. A small set of recordings therefore gives no rule for a
# small
# error, and the result says how many would be needed.
#
# Two numbers, and not a margin for each moment: with some hundred recordings those follow chance, and early answers
# then
# err more often than asked for.
#
# Source of the count: Angelopoulos, Bates, Fisch, Lei, Schuster, "Conformal risk control", ICLR 2024 (arXiv
# 2208.02814);
# there for a share of all recordings, here for a share of those answered early, which is larger.

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_N_BEGINNINGS, _N_MARGINS = 40, 60
"""Pairs that are tried: moments from which on to answer, and margins."""

_LEVELS = (1.0, 0.75, 0.5, 0.35, 0.25, 0.15, 0.1, 0.05, 0.0)
"""Shares of wrong answers that a pair may have where it is chosen, in units of the share asked for."""

_OTHER_TARGETS = (0.01, 0.02, 0.03, 0.05, 0.1, 0.2)
"""Proposed where the one asked for cannot be reached."""


@dataclass(frozen=True, eq=False)
class EarlyRule:
    """From when on, and from which margin on, an answer is given; and what that is worth.

    Attributes
    ----------
    n_seen : int
        Samples that must have been seen; 0 without a rule.
    margin : float
        Margin needed.
    target_error : float
        Share of early answers that may be wrong.
    stops : ndarray of int, shape (n,)
        Where each held-out recording was answered, by the rule of the other partitions: a place among the moments of
        `HeldOut`, -1 where it was not. Empty without a rule.
    why_not : str
        Why there is no rule; empty when there is one.
    """

    n_seen: int
    margin: float
    target_error: float
    stops: IntArray
    why_not: str = ""

    @classmethod
    def none(cls, target_error: float, why_not: str) -> EarlyRule:
        """Return the absence of a rule."""
        return cls(0, math.nan, target_error, np.empty(0, dtype=np.intp), why_not)

    def __bool__(self) -> bool:
        """Whether there is a rule."""
        return self.n_seen > 0

    def table(self) -> FloatArray | None:
        """Return the rule as a model keeps it, shape (1, 2): samples seen and margin needed; None without one."""
        return np.array([[self.n_seen, self.margin]]) if self else None

    def to_dict(self, held: HeldOut, rate_hz: float) -> dict[str, Any]:
        """Return what a reader of the model should know, in types that JSON knows.

        Shares and seconds are those of the held-out recordings, answered by the rules of the other partitions at
        the one level that reaches the target: a little better than those of fresh recordings.
        """
        said: dict[str, Any] = {"target_error": self.target_error, "why_not": self.why_not}
        if not self:
            return said
        answered = np.flatnonzero(self.stops >= 0)
        moments = self.stops[answered]
        return said | {
            "answered_early": len(answered) / len(self.stops),
            "error": float((~held.right[answered, moments]).mean()),
            "mean_seconds": float(held.n_seen[moments].mean() / rate_hz),
        }


def calibrate(held: HeldOut, target_error: float = 0.01) -> EarlyRule:
    """Find the rule that answers soonest, with early answers wrong in at most a share of cases.

    Parameters
    ----------
    held : HeldOut
        Provisional answers about held-out recordings.
    target_error : float, default 0.01
        Share of early answers that may be wrong, in (0, 1). It takes at least ``1 / target_error - 1`` recordings
        to show it.

    Returns
    -------
    EarlyRule
        Without numbers, and with the reason, where no rule reaches the target.

    Raises
    ------
    TypeError, ValueError
        `target_error` is no number, or outside (0, 1).

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.identifier.rules import calibrate
    >>> from granular_id.identifier.held_out import HeldOut
    >>> truth = np.repeat([0, 1], 20)
    >>> winners = np.stack((np.zeros(40, dtype=int), truth, truth), axis=1)  # right from the second moment on
    >>> margins = np.tile([0.9, 0.5, 1.0], (40, 1))
    >>> folds = np.tile([0, 1], 20)
    >>> held = HeldOut(np.array([1, 2, 3]), np.arange(40), folds, truth, winners, margins, "kfold", "", "", ())
    >>> calibrate(held, 0.05).table()
    array([[2. , 0.5]])
    >>> calibrate(held, 0.01).why_not
    'an error of 1 % can be shown by 99 held-out recordings or more, there are 40: 2.44 % is the least'
    """
    target = checked_target(target_error)
    n = len(held.rows)
    if 1 / (n + 1) > target:
        least = math.ceil(1 / target - 1e-9) - 1
        return EarlyRule.none(
            target,
            f"an error of {100 * target:g} % can be shown by {least} held-out recordings or more, there are {n}: "
            f"{100 / (n + 1):.3g} % is the least",
        )
    if len(held.n_seen) < 2:
        return EarlyRule.none(target, "recordings of one sample leave nothing to wait for")
    pairs = _Pairs(held)
    found = pairs.found(target)
    if found is not None:
        return found
    kept = next(
        (other for other in _OTHER_TARGETS if other > target and pairs.found(other) is not None), None
    )
    hint = "" if kept is None else f"; one of {100 * kept:g} % could be kept"
    return EarlyRule.none(target, f"no rule keeps the error of early answers within {100 * target:g} %{hint}")


def checked_target(target_error: object) -> float:
    """Return the share of early answers that may be wrong, or say what it must be."""
    target = checked_number(target_error, "target_error")
    if not 0 < target < 1:
        raise ValueError(f"target_error must lie between 0 and 1, got {target:g}")
    return target


def first_reached(margins: FloatArray, margin: float, beginning: int = 0) -> IntArray:
    """Return the first moment (n,), from a beginning on, at which margins (n, M) reach one; -1 where they never do."""
    reached = margins[:, beginning:] >= margin
    return np.where(reached.any(axis=1), beginning + reached.argmax(axis=1), -1)


def outcome_text(answered: float, mean_seconds: float, error: float, target_error: float) -> str:
    """Say in words what a rule did with held-out recordings.

    Examples
    --------
    >>> from granular_id.identifier.rules import outcome_text
    >>> outcome_text(0.95, 2.35, 0.032, 0.05).partition(", ")[2]
    '3.2 % of them wrong (of fresh ones a little more; aim: at most 5 %)'
    """
    return (
        f"{100 * answered:.0f} % of held-out recordings after {fixed(mean_seconds, 2)} s on average, "
        f"{100 * error:.2g} % of them wrong (of fresh ones a little more; aim: at most {100 * target_error:g} %)"
    )


class _Pairs:
    """What each pair of a beginning and a margin would have done with each held-out recording."""

    def __init__(self, held: HeldOut) -> None:
        self._held = held
        # The last moment has seen everything: an answer then is not early.
        self._margins = held.margins[:, :-1]
        self._whole = int(held.n_seen[-1])
        n_moments = self._margins.shape[1]
        beginnings = np.unique(np.linspace(0, n_moments - 1, _N_BEGINNINGS).round().astype(int))
        levels = np.unique(np.quantile(self._margins, np.linspace(0, 1, _N_MARGINS), method="lower"))
        self.each = [(int(beginning), float(level)) for beginning in beginnings for level in levels]
        self._wrong = np.zeros((len(self.each), len(held.rows)), dtype=np.bool_)
        self._answered = np.zeros_like(self._wrong)
        self._seen = np.empty(self._wrong.shape, dtype=np.int32)
        places = np.arange(len(held.rows))
        for k in range(len(self.each)):
            stops = self.stops(k)
            self._answered[k] = stops >= 0
            self._wrong[k] = self._answered[k] & ~held.right[places, stops]
            self._seen[k] = np.where(self._answered[k], held.n_seen[stops], self._whole)

    def found(self, target: float) -> EarlyRule | None:
        """Return the rule that reaches a target; None where none does."""
        held = self._held
        everything = np.ones(len(held.rows), dtype=np.bool_)
        folds = [held.folds == fold for fold in np.unique(held.folds)]
        for level in _LEVELS:
            chosen = self.soonest(everything, level * target)
            if chosen is None:
                continue
            stops = np.full(len(held.rows), -1, dtype=np.intp)
            for fold in folds:
                own = self.soonest(~fold, level * target) if len(folds) > 1 else chosen
                if own is not None:
                    stops[fold] = self.stops(own)[fold]
            answered = np.flatnonzero(stops >= 0)
            wrong = int((~held.right[answered, stops[answered]]).sum())
            if (wrong + 1) / (answered.size + 1) <= target:
                beginning, margin = self.each[chosen]
                return EarlyRule(int(held.n_seen[beginning]), margin, target, stops)
        return None

    def stops(self, pair: int) -> IntArray:
        """Return where each recording is answered by a pair; -1 where it is not."""
        beginning, margin = self.each[pair]
        return first_reached(self._margins, margin, beginning)

    def soonest(self, members: npt.NDArray[np.bool_], level: float) -> int | None:
        """Return the pair that answers some recordings soonest, with at most a share of wrong answers.

        A recording that is not answered early counts as answered at its end. None where no pair keeps within the
        level and answers any; of equally soon pairs the one that asks for more.
        """
        answered = self._answered[:, members].sum(axis=1)
        wrong = self._wrong[:, members].sum(axis=1)
        fits = np.flatnonzero((answered > 0) & (wrong <= level * answered))
        if not fits.size:
            return None
        seen = self._seen[fits][:, members].sum(axis=1)
        return int(fits[len(fits) - 1 - np.argmin(seen[::-1])])

"""When an answer may be given before the recording ends: margins calibrated on recordings that were held out.

An early answer is the first provisional one whose margin reaches what the rule needs at that moment. The rule is a
list of moments with a margin each. All of them follow from one number, the tail error r: the margin of a moment is the
least from which on the provisional answers of that moment are wrong in at most a share r of cases. r is the largest
for which the rule as a whole, with its many looks at each recording, errs in at most the share that was asked for,
when each partition is answered by the margins of the others.

Shares are counted as (wrong + 1) / (answered + 1), as if the next recording were answered wrongly: ten right answers
out of ten say little about an error of one in a hundred. A small set of recordings therefore gives no rule for a small
error, and the result says how many would be needed.

Source of the count: Angelopoulos, Bates, Fisch, Lei, Schuster, "Conformal risk control", ICLR 2024 (arXiv 2208.02814);
there for a share of all recordings, here for a share of those answered early, which is larger.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id.identifier.held_out import HeldOut
from granular_id.recording._values import checked_number

__all__ = ["NEVER", "EarlyRule", "calibrate", "first_reached"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]

NEVER = float(np.finfo(np.float64).max)
"""Margin of a moment at which no answer is given: no margin reaches it, and a file may hold it."""


_TAIL_ERRORS = tuple(np.geomspace(0.5, 0.0005, 40).tolist())
"""Tail errors to try, the most daring first."""


@dataclass(frozen=True, eq=False)
class EarlyRule:
    """From which margin on an answer is given at each moment, and what that is worth.

    Attributes
    ----------
    n_seen : ndarray of int, shape (M,)
        Moments, in samples seen, ascending; the first is the earliest at which an answer can be given.
        Empty: no rule could be had.
    margins : ndarray, shape (M,)
        Margin needed from that moment until the next; `NEVER` where there is no answer.
    target_error : float
        Share of early answers that may be wrong.
    stops : ndarray of int, shape (n,)
        Where each held-out recording was answered, by margins of the other partitions: a place among the moments of
        `HeldOut`, -1 where it was not. Empty without a rule.
    why_not : str
        Why there is no rule; empty when there is one.
    """

    n_seen: IntArray
    margins: FloatArray
    target_error: float
    stops: IntArray
    why_not: str = ""

    @classmethod
    def none(cls, target_error: float, why_not: str) -> EarlyRule:
        """Return the absence of a rule."""
        empty = np.empty(0, dtype=np.intp)
        return cls(empty, np.empty(0), target_error, empty, why_not)

    def __bool__(self) -> bool:
        """Whether there is a rule."""
        return bool(self.n_seen.size)

    def table(self) -> FloatArray | None:
        """Return the rule as a model keeps it, shape (M, 2): samples seen and margin needed; None without one."""
        return np.column_stack((self.n_seen, self.margins)).astype(np.float64) if self else None

    def to_dict(self, held: HeldOut, rate_hz: float) -> dict[str, Any]:
        """Return what a reader of the model should know, in types that JSON knows.

        Shares and seconds are those of the held-out recordings, answered by margins of the other partitions; the tail
        error was chosen on them, the margins were not.
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
    """Find the rule whose early answers are wrong in at most a share of cases.

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
        Without moments, and with the reason, where no rule reaches the target.

    Raises
    ------
    TypeError, ValueError
        `target_error` is no number, or outside (0, 1).

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.identifier.early import calibrate
    >>> from granular_id.identifier.held_out import HeldOut
    >>> truth = np.repeat([0, 1], 20)
    >>> winners = np.stack((np.zeros(40, dtype=int), truth, truth), axis=1)  # right from the second moment on
    >>> margins = np.tile([0.1, 0.5, 1.0], (40, 1))
    >>> folds = np.tile([0, 1], 20)
    >>> held = HeldOut(np.array([1, 2, 3]), np.arange(40), folds, truth, winners, margins, "kfold", "", "", ())
    >>> calibrate(held, 0.05).table()
    array([[2. , 0.5]])
    >>> calibrate(held, 0.01).why_not
    'an error of 1 % can be shown by 99 held-out recordings or more, there are 40: 2.44 % is the least'
    """
    target = checked_number(target_error, "target_error")
    if not 0 < target < 1:
        raise ValueError(f"target_error must lie between 0 and 1, got {target:g}")
    n = len(held.rows)
    if 1 / (n + 1) > target:
        least = math.ceil(1 / target - 1e-9) - 1
        return EarlyRule.none(
            target,
            f"an error of {100 * target:g} % can be shown by {least} held-out recordings or more, there are {n}: "
            f"{100 / (n + 1):.3g} % is the least",
        )
    # The last moment has seen everything: an answer then is not early.
    margins, right = held.margins[:, :-1], held.right[:, :-1]
    folds = [held.folds == fold for fold in np.unique(held.folds)]
    of_others = [_Tails(margins[~fold], right[~fold]) for fold in folds]
    of_all = _Tails(margins, right)
    for tail_error in _TAIL_ERRORS:
        stops = np.full(n, -1, dtype=np.intp)
        for fold, others in zip(folds, of_others, strict=True):
            stops[fold] = first_reached(margins[fold], others.thresholds(tail_error))
        answered = np.flatnonzero(stops >= 0)
        wrong = int((~right[answered, stops[answered]]).sum())
        thresholds = of_all.thresholds(tail_error)
        if (wrong + 1) / (answered.size + 1) <= target and (thresholds < NEVER).any():
            first = int(np.argmax(thresholds < NEVER))
            return EarlyRule(held.n_seen[:-1][first:], thresholds[first:], target, stops)
    return EarlyRule.none(target, f"no margins keep the error of early answers within {100 * target:g} %")


def first_reached(margins: FloatArray, thresholds: FloatArray) -> IntArray:
    """Return the first moment (n,) at which margins (n, M) reach thresholds (M,); -1 where they never do."""
    reached = margins >= thresholds
    if not reached.shape[1]:
        return np.full(len(margins), -1, dtype=np.intp)
    return np.where(reached.any(axis=1), reached.argmax(axis=1), -1)


class _Tails:
    """For each moment, which share of the answers with at least a margin is wrong."""

    def __init__(self, margins: FloatArray, right: BoolArray) -> None:
        self._margins = margins
        self._shares = np.empty(margins.shape)
        for k in range(margins.shape[1]):
            order = np.argsort(-margins[:, k], kind="stable")
            descending = -margins[order, k]
            wrong = np.cumsum(~right[order, k])
            # Of equal margins all count or none: each has the counts of the last.
            last = np.searchsorted(descending, descending, side="right") - 1
            self._shares[order, k] = (wrong[last] + 1) / (last + 2)

    def thresholds(self, tail_error: float) -> FloatArray:
        """Least margin (M,) of each moment from which on at most a share is wrong; `NEVER` without one."""
        within: FloatArray = np.where(self._shares <= tail_error, self._margins, NEVER).min(
            axis=0, initial=NEVER
        )
        return within

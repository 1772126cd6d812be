"""Early answers: what held-out recordings show of answers before their end, and the rule that is set on them.

Shares are counted as (wrong + 1) / (answered + 1), as if the next recording were answered wrongly: ten right answers
out of ten say little about an error of one in a hundred. Source of the count: Angelopoulos, Bates, Fisch, Lei,
Schuster, "Conformal risk control", ICLR 2024 (arXiv 2208.02814); there for a share of all recordings, here for a share
of those answered early, which is larger.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._files import json_value
from granular_id._text import fixed

if TYPE_CHECKING:
    from granular_id.score import Held
    from granular_id.spaces import Choice

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

N_CHECKPOINTS = 20
"""Number of moments of a recording with a provisional answer: every 160 ms of the paper's 3.2 s. A live identification
looks no more often for an early answer: each look is another chance to be wrong, and takes its time."""

_N_BEGINNINGS, _N_MARGINS = 20, 60
"""Pairs that are tried: moments from which on to answer, and margins. Two numbers, and not a margin for each moment:
with some hundred recordings those follow chance, and early answers then err more often than requested."""

MIN_SESSIONS = 3
"""Held-out sessions below which there is no rule."""

_TOO_UNLIKELY = 0.01
"""No rule where a session errs so much more often than the target that it happens by chance less often than this."""

_LEVELS = (0.2, 0.1, 0.05, 0.0)
"""Shares of wrong answers that a pair may have where it is chosen, in units of the share requested. Far below 1, as
there is a rule only where the sessions at hand look well: where half of the variance is that of sessions, four of them
and levels from 1 on gave 7 % of wrong answers in new sessions for 5 % requested, these 6 %."""

_OTHER_TARGETS = (0.01, 0.02, 0.03, 0.05, 0.1, 0.2)
"""Proposed where the one requested cannot be reached."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Answers about n held-out recordings at M moments, the last of which has seen everything."""

    held: Held
    n_seen: IntArray  # (M,) samples at each moment, ascending
    rate_hz: float
    winners: IntArray  # (n, M) class with the least mean loss; the first of equal ones
    margins: FloatArray  # (n, M) second least mean loss minus the least
    chosen: tuple[Choice | None, ...] = ()  # what the model of each fold chose

    @property
    def truth(self) -> IntArray:
        """Material of each recording (n,)."""
        return self.held.truth

    @property
    def right(self) -> npt.NDArray[np.bool_]:
        """Whether each answer (n, M) is the truth."""
        same: npt.NDArray[np.bool_] = self.winners == self.truth[:, None]
        return same

    @property
    def sessions(self) -> IntArray | None:
        """Session of each recording (n,), as a number; None where no sessions were held out."""
        return self.held.places if self.held.folds.sessions_apart else None


def checkpoints(n_samples: int) -> IntArray:
    """Return the moments, in samples seen, at which provisional answers are looked at: evenly up to the end."""
    steps = min(N_CHECKPOINTS, n_samples)
    return np.array([-(-k * n_samples // steps) for k in range(1, steps + 1)], dtype=np.intp)


def provisional_answers(
    core: _core.Model, wrench: FloatArray, n_seen: Sequence[int] | IntArray
) -> tuple[IntArray, FloatArray]:
    """Return winners and margins (M,) of one recording at some moments, exactly as a live identification would."""
    stream = _core.StreamingIdentifier(core)
    losses = np.empty((len(n_seen), len(core.classes)))
    start = 0
    for k, stop in enumerate(n_seen):
        stream.push(wrench[start:stop])
        losses[k] = stream.losses()
        start = int(stop)
    least = np.partition(losses, 1, axis=1)
    return losses.argmin(axis=1), least[:, 1] - least[:, 0]


# The rule has two numbers: from `n_seen` samples on, the first provisional answer whose margin reaches `margin` is
# given. Among all pairs the one is taken that answers soonest while the share of wrong early answers stays within a
# level. Each held-out session is then answered by the pair that the *others* choose, and the level is lowered until the
# answers so found are wrong in at most the share that was requested: of all, in the mean over sessions, and not
# surprisingly more often in any of them.


@dataclass(frozen=True, eq=False)
class EarlyRule:
    """From when on, and from which margin on, an answer is given; false, and with a reason, where there is no rule.

    `stops` says where each held-out recording was answered by the rule of the other sessions: a place among the moments
    of `HeldOut`, -1 where it was not. `error` counts one more that is wrong: the rule was picked for having few of them
    here. `worst` is the share of wrong answers in the worst session; without sessions that of all.
    """

    target_error: float
    why_not: str = ""
    n_seen: int = 0
    margin: float = math.nan
    stops: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    answered_early: float = 0.0
    error: float = math.nan
    worst: float = math.nan
    mean_seconds: float = math.nan

    def __bool__(self) -> bool:
        return self.n_seen > 0

    def table(self) -> FloatArray | None:
        """Return the rule as a model keeps it, shape (1, 2): samples seen and margin needed; None without one."""
        return np.array([[self.n_seen, self.margin]]) if self else None

    def to_dict(self) -> dict[str, Any]:
        """Return what the rule did with the held-out recordings, in types that JSON knows."""
        outcome = ("answered_early", "error", "worst", "mean_seconds") if self else ()
        return {name: getattr(self, name) for name in ("target_error", "why_not", *outcome)}


def calibrate(held: HeldOut, target: float) -> EarlyRule:
    """Find the rule that answers soonest, with early answers wrong in at most a share of cases."""
    n = len(held.truth)
    if 1 / (n + 1) > target:
        least = math.ceil(1 / target - 1e-9) - 1
        return EarlyRule(
            target,
            f"an error of {100 * target:g} % can be shown by {least} held-out recordings or more, there are {n}: "
            f"{math.ceil(10_000 / (n + 1)) / 100:g} % is the least",
        )
    if len(held.n_seen) < 2:
        return EarlyRule(target, "recordings of one sample leave nothing to wait for")
    if held.sessions is not None and np.unique(held.sessions).size < MIN_SESSIONS:
        return EarlyRule(target, "two sessions do not show how often early answers are wrong in a third")
    pairs = _Pairs(held)
    found = pairs.rule(target)
    if found is not None:
        return found
    larger = (other for other in _OTHER_TARGETS if other > target)
    reached = next((other for other in larger if pairs.rule(other) is not None), None)
    hint = "" if reached is None else f"; one of {100 * reached:g} % could be reached"
    return EarlyRule(target, f"no rule keeps the error of early answers within {100 * target:g} %{hint}")


def first_reached(margins: FloatArray, margin: float, beginning: int = 0) -> IntArray:
    """Return the first moment (n,), from a beginning on, at which margins (n, M) reach one; -1 where they never do."""
    reached = margins[:, beginning:] >= margin
    return np.where(reached.any(axis=1), beginning + reached.argmax(axis=1), -1)


def outcome_text(
    answered_early: float, mean_seconds: float, error: float, target_error: float, worst: float
) -> str:
    """Say in words what a rule did with held-out recordings."""
    of_worst = f", {100 * worst:.2g} % in the worst session" if worst > error else ""
    return (
        f"{100 * answered_early:.0f} % of held-out recordings after {fixed(mean_seconds, 2)} s on average, "
        f"{100 * error:.2g} % of them wrong{of_worst} (aim: at most {100 * target_error:g} %)"
    )


class _Pairs:
    """What each pair of a beginning and a margin would have done with each held-out recording: arrays (pairs, n)."""

    def __init__(self, held: HeldOut) -> None:
        self.held = held
        margins = held.margins[:, :-1]  # the last moment has seen everything: an answer then is not early
        n, n_moments = margins.shape
        beginnings = np.unique(np.linspace(0, n_moments - 1, _N_BEGINNINGS).round().astype(int))
        levels = np.unique(np.quantile(margins, np.linspace(0, 1, _N_MARGINS), method="lower"))
        self.each = [(int(beginning), float(level)) for beginning in beginnings for level in levels]
        self.stops = np.array(
            [first_reached(margins, level, beginning) for beginning, level in self.each], dtype=np.int32
        )
        self.answered = self.stops >= 0
        self.wrong = self.answered & ~held.right[np.arange(n), self.stops]
        # A recording that is not answered early, -1, is answered at its end.
        self.seen = held.n_seen.astype(np.int32)[self.stops]

    def rule(self, target: float) -> EarlyRule | None:
        """Return the rule that reaches a target in sessions that did not choose it; None where none does."""
        from scipy.stats import binom  # slow to import, and a model that is read does without

        held, n = self.held, len(self.held.truth)
        places = held.held.places
        apart = [places == place for place in np.unique(places)]
        for level in _LEVELS:
            chosen = self.soonest(np.ones(n, dtype=np.bool_), level * target)
            if chosen is None:
                continue
            stops = np.full(n, -1, dtype=np.intp)
            for own in apart:
                other = self.soonest(~own, level * target) if len(apart) > 1 else chosen
                if other is not None:
                    stops[own] = self.stops[other, own]
            answered = stops >= 0
            wrong = answered & ~held.right[np.arange(n), stops]
            n_wrong, n_answered = int(wrong.sum()), int(answered.sum())
            counts = [(int(wrong[own].sum()), int(answered[own].sum())) for own in apart]
            counts = [(own_wrong, own_answered) for own_wrong, own_answered in counts if own_answered]
            errors = [own_wrong / own_answered for own_wrong, own_answered in counts]
            error = (n_wrong + 1) / (n_answered + 1)
            if (
                error <= target
                and np.mean(errors or [0.0]) <= target
                and all(binom.sf(k - 1, m, target) >= _TOO_UNLIKELY for k, m in counts)
            ):
                beginning, margin = self.each[chosen]
                return EarlyRule(
                    target,
                    n_seen=int(held.n_seen[beginning]),
                    margin=margin,
                    stops=stops,
                    answered_early=n_answered / n,
                    error=error,
                    worst=float(n_wrong / n_answered if held.sessions is None else max(errors, default=0.0)),
                    mean_seconds=float(held.n_seen[stops[answered]].mean() / held.rate_hz),
                )
        return None

    def soonest(self, members: npt.NDArray[np.bool_], level: float) -> int | None:
        """Return the pair that answers some recordings soonest, with at most a share of wrong answers; None: no pair.

        Of equally soon pairs the one that asks for more.
        """
        answered = self.answered[:, members].sum(axis=1)
        wrong = self.wrong[:, members].sum(axis=1)
        fits = np.flatnonzero((answered > 0) & (wrong <= level * answered))
        if not fits.size:
            return None
        seen = self.seen[fits][:, members].sum(axis=1)
        return int(fits[len(fits) - 1 - np.argmin(seen[::-1])])


# Accuracy against seconds of signal seen: what waiting longer would bring.


@dataclass(frozen=True, eq=False)
class OverTime:
    """Answers about held-out recordings against seconds of signal seen; ``print`` it for a summary.

    Attributes
    ----------
    seconds : ndarray, shape (M,)
        Signal seen at each moment, s, from the first sample of a recording (its lead before the motion included).
    accuracy : ndarray, shape (M,)
        Share of the provisional answers of that moment that are right, of all together. The accuracy that a model
        states is the mean over materials: another number where these are not of one size.
    answered : ndarray, shape (M,)
        Share of recordings that the early rule has answered by then.
    error : ndarray, shape (M,)
        Share of those answers that are wrong; NaN before the first. Lower than on fresh recordings, with two
        sessions by half: the rule was chosen on these.
    chance : float
        Accuracy of guessing with every class as likely.
    n_answers : int
        Held-out recordings, each counted once, as it is held out once.
    held_out : str
        What was held out, in words.
    target_error : float or None
        Of the early rule; None where there is none, and `why_not` says why.
    why_not : str
    mean_seconds : float
        Mean signal seen at an early answer, s; NaN without any.
    worst : float
        Share of wrong early answers in the worst held-out session, without sessions of all; NaN without any.
    synthetic : bool
        Recordings were simulated: figures show that the program works, not how well it knows materials.

    Examples
    --------
    >>> import granular_id as gid
    >>> data = gid.synthesize(["rice", "fine sugar"], n_per_class=10, duration_s=0.5)
    >>> course = gid.Identifier.fit(data, target_error=0.1).over_time_
    >>> course.seconds[-1], bool(course.accuracy[-1] > 0.8)
    (np.float64(0.5), True)
    """

    seconds: FloatArray
    accuracy: FloatArray
    answered: FloatArray
    error: FloatArray
    chance: float
    n_answers: int
    held_out: str
    target_error: float | None
    why_not: str
    mean_seconds: float
    worst: float
    synthetic: bool

    @classmethod
    def of(cls, held: HeldOut, rule: EarlyRule | None, *, synthetic: bool) -> OverTime:
        """Count what is right, answered early, and wrong among that, at each moment."""
        right, moments = held.right, np.arange(len(held.n_seen))
        answered, error = np.zeros(len(moments)), np.full(len(moments), np.nan)
        if rule:
            given = np.flatnonzero(rule.stops >= 0)
            stops = rule.stops[given]
            by_then = stops[:, None] <= moments
            counts = by_then.sum(axis=0)
            answered = counts / len(rule.stops)
            wrong = (~right[given, stops][:, None] & by_then).sum(axis=0)
            np.divide(wrong, counts, out=error, where=counts > 0)
        return cls(
            seconds=held.n_seen / held.rate_hz,
            accuracy=right.mean(axis=0),
            answered=answered,
            error=error,
            chance=1 / np.unique(held.truth).size,
            n_answers=len(held.truth),
            held_out=held.held.folds.name,
            target_error=rule.target_error if rule else None,
            why_not="no early rule was requested" if rule is None else rule.why_not,
            mean_seconds=math.nan if rule is None else rule.mean_seconds,
            worst=math.nan if rule is None else rule.worst,
            synthetic=synthetic,
        )

    def __str__(self) -> str:
        """Say in two lines what the figures show."""
        whole = f"{100 * self.accuracy[-1]:.1f} % of whole recordings right ({self.seconds[-1]:g} s)"
        near = np.flatnonzero(self.accuracy >= self.accuracy[-1] - 0.01)
        first = f"within 1 % of that from {fixed(self.seconds[near[0]], 2)} s on"
        mark = "SYNTHETIC: " if self.synthetic else ""
        early = f"no early answers: {self.why_not}"
        if self.target_error is not None and self.answered[-1] > 0:
            answered, error = float(self.answered[-1]), float(self.error[-1])
            text = outcome_text(answered, self.mean_seconds, error, self.target_error, self.worst)
            early = f"early answers: {text}"
        return f"{mark}{self.n_answers} answers, {self.held_out}: {whole}; {first}\n{early}"

    def to_dict(self) -> dict[str, Any]:
        """Return all figures, in types that JSON knows (NaN as None)."""
        return {name: json_value(value) for name, value in vars(self).items()}

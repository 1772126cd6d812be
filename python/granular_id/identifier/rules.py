"""Rules that a model keeps beside its weights, all set on held-out recordings: early answers, candidates, rejection.

Shares of the early rule are counted as (wrong + 1) / (answered + 1), as if the next recording were answered wrongly:
ten right answers out of ten say little about an error of one in a hundred. Source of the count: Angelopoulos, Bates,
Fisch, Lei, Schuster, "Conformal risk control", ICLR 2024 (arXiv 2208.02814); there for a share of all recordings, here
for a share of those answered early, which is larger.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._text import fixed
from granular_id.confidence import CandidateRule, UnknownRule, softmax
from granular_id.identifier.metadata import Metadata

if TYPE_CHECKING:
    from granular_id.score import Held
    from granular_id.spaces import Choice

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

KEY = "confidence"
"""Where the rules of candidates and refusal stand in what a model says of its training."""

N_CHECKPOINTS = 20
"""Number of moments of a recording with a provisional answer: every 160 ms of the paper's 3.2 s. A live identification
looks no more often for an early answer: each look is another chance to be wrong, and takes its time."""

_N_BEGINNINGS, _N_MARGINS = 20, 60
"""Pairs that are tried: moments from which on to answer, and margins. Two numbers, and not a margin for each moment:
with some hundred recordings those follow chance, and early answers then err more often than asked for."""

MIN_SESSIONS = 3
"""Held-out sessions below which there is no rule."""

_TOO_UNLIKELY = 0.01
"""No rule where a session errs so much more often than the target that it happens by chance less often than this."""

_LEVELS = (0.2, 0.1, 0.05, 0.0)
"""Shares of wrong answers that a pair may have where it is chosen, in units of the share asked for. Far below 1, as
there is a rule only where the sessions at hand look well: where half of the variance is that of sessions, four of them
and levels from 1 on gave 7 % of wrong answers in new sessions for 5 % asked for, these 6 %."""

_OTHER_TARGETS = (0.01, 0.02, 0.03, 0.05, 0.1, 0.2)
"""Proposed where the one asked for cannot be reached."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Answers about n held-out recordings at M moments, the last of which has seen everything."""

    held: Held
    n_seen: IntArray  # (M,) samples at each moment, ascending
    winners: IntArray  # (n, M) class with the least mean loss; the first of equal ones
    margins: FloatArray  # (n, M) second least mean loss minus the least
    chosen: tuple[Choice | None, ...]  # what the model of each fold chose

    @property
    def truth(self) -> IntArray:
        """Material of each recording (n,)."""
        return self.held.truth

    @property
    def right(self) -> npt.NDArray[np.bool_]:
        """Whether each answer (n, M) is the truth."""
        same: npt.NDArray[np.bool_] = self.winners == self.truth[:, None]
        return same


def checkpoints(n_samples: int, n_checkpoints: int = N_CHECKPOINTS) -> IntArray:
    """Return the moments, in samples seen, at which provisional answers are looked at: evenly up to the end."""
    steps = min(n_checkpoints, n_samples)
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


# Early answers. The rule has two numbers: from `n_seen` samples on, the first provisional answer whose margin reaches
# `margin` is given. Among all pairs the one is taken that answers soonest while the share of wrong early answers stays
# within a level. Each held-out session is then answered by the pair that the *others* choose, and the level is lowered
# until the answers so found are wrong in at most the share that was asked for: of all, in the mean over sessions, and
# not surprisingly more often in any of them.


@dataclass(frozen=True, eq=False)
class EarlyRule:
    """From when on, and from which margin on, an answer is given; false, and with a reason, where there is no rule.

    `stops` says where each held-out recording was answered by the rule of the other sessions: a place among the moments
    of `HeldOut`, -1 where it was not. `worst` is the share of wrong answers in the worst session; without sessions that
    of all.
    """

    target_error: float
    n_seen: int = 0
    margin: float = math.nan
    stops: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    worst: float = math.nan
    why_not: str = ""

    def __bool__(self) -> bool:
        return self.n_seen > 0

    def table(self) -> FloatArray | None:
        """Return the rule as a model keeps it, shape (1, 2): samples seen and margin needed; None without one."""
        return np.array([[self.n_seen, self.margin]]) if self else None

    def to_dict(self, held: HeldOut, rate_hz: float) -> dict[str, Any]:
        """Return what the rule did with the held-out recordings, in types that JSON knows."""
        outcome: dict[str, Any] = {"target_error": self.target_error, "why_not": self.why_not}
        if not self:
            return outcome
        answered = np.flatnonzero(self.stops >= 0)
        moments = self.stops[answered]
        return outcome | {
            "answered_early": len(answered) / len(self.stops),
            # With one more that is wrong: the rule was picked for having few of them here.
            "error": (int((~held.right[answered, moments]).sum()) + 1) / (len(answered) + 1),
            "worst": self.worst,
            "mean_seconds": float(held.n_seen[moments].mean() / rate_hz),
        }


def calibrate(held: HeldOut, target: float) -> EarlyRule:
    """Find the rule that answers soonest, with early answers wrong in at most a share of cases."""
    n = len(held.truth)
    if 1 / (n + 1) > target:
        least = math.ceil(1 / target - 1e-9) - 1
        why = (
            f"an error of {100 * target:g} % can be shown by {least} held-out recordings or more, there are {n}: "
            f"{100 / (n + 1):.3g} % is the least"
        )
        return EarlyRule(target, why_not=why)
    if len(held.n_seen) < 2:
        return EarlyRule(target, why_not="recordings of one sample leave nothing to wait for")
    if held.held.folds.sessions_apart and np.unique(held.held.places).size < MIN_SESSIONS:
        return EarlyRule(
            target, why_not="two sessions do not show how often early answers are wrong in a third"
        )
    pairs = _Pairs(held)
    found = pairs.rule(target)
    if found is not None:
        return found
    larger = (other for other in _OTHER_TARGETS if other > target)
    reached = next((other for other in larger if pairs.rule(other) is not None), None)
    hint = "" if reached is None else f"; one of {100 * reached:g} % could be kept"
    why = f"no rule keeps the error of early answers within {100 * target:g} %{hint}"
    return EarlyRule(target, why_not=why)


def first_reached(margins: FloatArray, margin: float, beginning: int = 0) -> IntArray:
    """Return the first moment (n,), from a beginning on, at which margins (n, M) reach one; -1 where they never do."""
    reached = margins[:, beginning:] >= margin
    return np.where(reached.any(axis=1), beginning + reached.argmax(axis=1), -1)


def outcome_text(
    answered: float, mean_seconds: float, error: float, target_error: float, worst: float
) -> str:
    """Say in words what a rule did with held-out recordings."""
    of_worst = f", {100 * worst:.2g} % in the worst session" if worst > error else ""
    return (
        f"{100 * answered:.0f} % of held-out recordings after {fixed(mean_seconds, 2)} s on average, "
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
        self.stops = np.empty((len(self.each), n), dtype=np.int32)
        for k, (beginning, level) in enumerate(self.each):
            self.stops[k] = first_reached(margins, level, beginning)
        self.answered = self.stops >= 0
        self.wrong = self.answered & ~held.right[np.arange(n), self.stops]
        # A recording that is not answered early, -1, is answered at its end.
        self.seen = held.n_seen.astype(np.int32)[self.stops]

    def rule(self, target: float) -> EarlyRule | None:
        """Return the rule that reaches a target in sessions that did not choose it; None where none does."""
        from scipy.stats import binom  # slow to import, and a model that is read does without

        held = self.held
        everything = np.ones(len(held.truth), dtype=np.bool_)
        places = held.held.places
        apart = [places == place for place in np.unique(places)]
        for level in _LEVELS:
            chosen = self.soonest(everything, level * target)
            if chosen is None:
                continue
            stops = np.full(len(held.truth), -1, dtype=np.intp)
            for own in apart:
                other = self.soonest(~own, level * target) if len(apart) > 1 else chosen
                if other is not None:
                    stops[own] = self.stops[other, own]
            answered = stops >= 0
            wrong = answered & ~held.right[np.arange(len(stops)), stops]
            counts = [
                (int(wrong[own].sum()), int(answered[own].sum())) for own in apart if answered[own].any()
            ]
            errors = [n_wrong / n for n_wrong, n in counts]
            if (
                (wrong.sum() + 1) / (answered.sum() + 1) <= target
                and np.mean(errors or [0.0]) <= target
                and all(binom.sf(n_wrong - 1, n, target) >= _TOO_UNLIKELY for n_wrong, n in counts)
            ):
                beginning, margin = self.each[chosen]
                worst = (
                    max(errors, default=0.0)
                    if held.held.folds.sessions_apart
                    else wrong.sum() / answered.sum()
                )
                return EarlyRule(target, int(held.n_seen[beginning]), margin, stops, float(worst))
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


# What a model keeps. The core checks the rules with it, and applies them to whole recordings alone.


def confidence_rules(core: _core.Model) -> tuple[CandidateRule | None, UnknownRule | None]:
    """Read the rules of candidates and refusal that a model keeps."""
    stored = Metadata(core).trained.get(KEY) or {}
    candidates, unknown = stored.get("candidates"), stored.get("unknown")
    return (
        None if candidates is None else CandidateRule.from_dict(candidates),
        None if unknown is None else UnknownRule.from_dict(unknown),
    )


def probabilities(temperature: float | None, losses: FloatArray) -> FloatArray | None:
    """Probability (..., K) of each class from mean losses (..., K); None where a model has no temperature."""
    return None if temperature is None else softmax(-losses, temperature)

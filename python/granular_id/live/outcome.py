"""What came of one push: an answer, a recording, or why there is neither."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

from granular_id._text import fixed
from granular_id.live.rows import timing_in_words
from granular_id.recording import Recording

if TYPE_CHECKING:
    from granular_id.identifier import Decision

__all__ = ["CaptureError", "FailureReason", "Fault", "Push"]


class FailureReason(Enum):
    """Why there is no recording."""

    TRIGGER_TOO_EARLY = "trigger too early"
    """Triggered before enough rows at rest were there."""
    NO_REST = "no rest"
    """The tool never rested as long as it should before the motion."""
    OVERFLOW = "overflow"
    """Rows were overwritten before they were read."""
    GAP = "gap"
    """More instants without a sample than `max_gap`."""
    SATURATION = "saturation"
    """The sensor was at the end of its range."""
    STATUS = "status"
    """The sensor reported an error with a sample (`SampleFlag.BAD_STATUS`)."""
    RESTART = "restart"
    """The sensor's time began anew."""
    RATE = "rate"
    """The samples came at another rate than the source's."""
    LIMIT = "limit"
    """Force or torque was larger than it may be, or could not be measured while the robot moved."""
    LATE_CONTACT = "late contact"
    """The force came so late that the robot would stand before the recording ends."""
    LAG = "lag"
    """Samples without a time of the sensor's own came in late for too long."""
    NO_TRIGGER = "no trigger"
    """Nothing triggered within the time."""
    NO_ROWS = "no rows"
    """The source delivered nothing any more."""
    SOURCE = "source"
    """The source died or came to its end."""
    ROBOT = "robot"
    """The robot refused the motion, or it failed."""
    INTERRUPTED = "interrupted"
    """Ended from outside: Ctrl-C or another signal, or the program went on to something else."""

    @property
    def is_lasting(self) -> bool:
        """Whether no other push should follow by itself.

        It would fail as well: nobody delivers, nobody moves, the program is to end. Or the tool has met something.
        """
        why = FailureReason
        return self in (why.SOURCE, why.ROBOT, why.LIMIT, why.NO_ROWS, why.NO_TRIGGER, why.INTERRUPTED)


class Fault(NamedTuple):
    """Why a capture fails, and an arm is stopped."""

    reason: FailureReason
    text: str


class CaptureError(RuntimeError):
    """A capture that gave no recording.

    Parameters
    ----------
    reason : FailureReason
    text : str
        What happened, in words.
    """

    def __init__(self, reason: FailureReason, text: str) -> None:
        super().__init__(text)
        self.reason = reason

    def __reduce__(self) -> tuple[type[CaptureError], tuple[FailureReason, str]]:
        return type(self), (self.reason, str(self))


@dataclass(frozen=True)
class Push:
    """What came of one push.

    Attributes
    ----------
    decision : Decision or None
        The answer; None where the capture failed before there was one.
    reason : FailureReason or None
        Why the capture failed, if it did; `text` says it in words.
    text : str
    truth : str or None
        The material, where the source knows it: simulations and recordings played again.
    time_s : float or None
        Device time of the newest row, of an answer at a hop; None of pushes.
    recording : Recording or None
        What was captured, with the answer in its ``meta["answer"]``. An answer is no label: its `label` is the truth,
        where the source knows it. None where the capture failed or was ended early, and of an answer at a hop.
    timing : dict of str to float, or None
        How its rows came in: ``rate_hz`` as measured; ``jitter_s``, the standard deviation of their delays, and
        ``late_s``, how late they were at most, where the source runs in real time. None where there is no recording.
    """

    decision: Decision | None = None
    reason: FailureReason | None = None
    text: str = ""
    truth: str | None = None
    time_s: float | None = None
    recording: Recording | None = field(default=None, repr=False, compare=False)
    timing: dict[str, float] | None = field(default=None, compare=False)

    @property
    def is_right(self) -> bool | None:
        """Whether the answer is the truth; None where either is missing.

        An answer that it is like no known material is right where the model does not know the truth.
        """
        if self.decision is None or self.truth is None:
            return None
        if self.decision.unknown:
            return self.truth not in dict(self.decision.ranking)
        return self.decision.label == self.truth

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as plain JSON-like values."""
        known = {"time_s": self.time_s, "timing": self.timing}
        return {
            "decision": None if self.decision is None else self.decision.to_dict(),
            "failure": None if self.reason is None else {"reason": self.reason.value, "text": self.text},
            "truth": self.truth,
            **{name: value for name, value in known.items() if value is not None},
        }

    def __str__(self) -> str:
        if self.decision is None:
            return f"no answer: {self.text}"
        answer, right = str(self.decision), self.is_right
        if self.time_s is not None:
            answer = f"{fixed(self.time_s, 2)} s: {self.decision.sentence()}"
        if right is not None:
            answer += "  right" if right else "  WRONG"
            answer += f", it was {self.truth}" * (not right or bool(self.decision.unknown))
            answer += ", which the model does not know" * (self.truth not in dict(self.decision.ranking))
        timing = ", ".join(" ".join(pair) for pair in timing_in_words(self.timing))
        return f"{answer}; {timing}" if timing else answer

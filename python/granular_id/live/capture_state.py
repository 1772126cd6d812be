"""Where a capture stands, and why one failed."""

from __future__ import annotations

from enum import Enum

__all__ = ["CaptureError", "CaptureState", "FailureReason"]


class CaptureState(Enum):
    """States of a capture, in the order it goes through them."""

    IDLE = "idle"
    """Nothing was fed yet."""
    ARMING = "arming"
    """Rows at rest are gathered, as many as belong before the trigger."""
    ARMED = "armed"
    """They are there: the motion may begin."""
    TRIGGERED = "triggered"
    """The motion has begun, its rows are taken."""
    COMPLETE = "complete"
    """All rows are there, and nothing is wrong with them."""
    FAILED = "failed"
    """There will be no recording; `Capture.reason` says why."""

    @property
    def is_over(self) -> bool:
        """Whether nothing more will change."""
        return self in (CaptureState.COMPLETE, CaptureState.FAILED)


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
    RESTART = "restart"
    """The sensor's time began anew."""
    RATE = "rate"
    """The samples came at another rate than the source's."""
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
        """Whether the next capture would fail as well: nobody delivers, nobody moves, the program is to end."""
        return self in _LASTING


_LASTING = frozenset(
    (
        FailureReason.SOURCE,
        FailureReason.ROBOT,
        FailureReason.NO_ROWS,
        FailureReason.NO_TRIGGER,
        FailureReason.INTERRUPTED,
    )
)


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

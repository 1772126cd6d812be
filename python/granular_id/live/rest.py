"""Rest before the trigger: the rows that belong ahead of a motion, and what broke them last."""

from __future__ import annotations

from granular_id.live.capture_state import FailureReason
from granular_id.live.rows import Rows
from granular_id.live.runs import Break

__all__ = ["Rest"]

_NEW_LOOKS = 10
"""How often rows are looked at anew for being at rest, within the time that they are to rest."""


class Rest:
    """Gathers the newest rows at rest, as many as belong before the trigger.

    Parameters
    ----------
    n_rows : int
        Rows that belong before the trigger.
    timeout_s, rate_hz : float
        How long the trigger is waited for: so many rows at that rate, those that are no rest too.

    Attributes
    ----------
    rows : Rows
        The newest ones, `n_rows` of them at most.
    """

    def __init__(self, n_rows: int, timeout_s: float, rate_hz: float) -> None:
        self.rows = Rows.none()
        self._n_rows = n_rows
        self._timeout_s = timeout_s
        self._n_left = round(timeout_s * rate_hz)
        self._broken: Break | None = None

    @property
    def n_wanted(self) -> int:
        """Rows that are not there yet."""
        return self._n_rows - len(self.rows)

    @property
    def n_left(self) -> int:
        """Rows for which the trigger may still be waited for."""
        return max(self._n_left, 0)

    def add(self, rows: Rows) -> None:
        """Go on resting."""
        self._n_left -= len(rows)
        kept = Rows.joined([self.rows, rows])
        self.rows = kept[max(0, len(kept) - self._n_rows) :]

    def begin_anew(self, why: Break) -> None:
        """Forget the rows before a break."""
        self._n_left -= why.n_rows
        self.rows, self._broken = Rows.none(), why

    def look_again(self, complaint: str) -> None:
        """Let the oldest rows go, because the trigger sees no rest in all of them."""
        # A fixed share, so that nothing depends on how rows come in.
        self.rows = self.rows[max(1, self._n_rows // _NEW_LOOKS) :]
        self._broken = Break(FailureReason.NO_REST, complaint)

    def is_accepted(self) -> None:
        """Take the rows for the rest: what broke it before is of no interest any more."""
        self._broken = None

    def why_early(self, n_more: int) -> Break:
        """Say why a trigger after `n_more` more rows comes too early."""
        text = f"triggered after {len(self.rows) + n_more} rows at rest, wanted {self._n_rows}"
        if self._broken is None:
            return Break(FailureReason.TRIGGER_TOO_EARLY, text)
        return Break(self._broken.reason, f"{text}: {self._broken.text}")

    def why_over(self) -> Break:
        """Say that the trigger was waited for in vain."""
        text = f"nothing triggered within {self._timeout_s:g} s"
        if self._broken is not None:
            text += f"; the rest was broken last by this: {self._broken.text}"
        return Break(FailureReason.NO_TRIGGER, text)

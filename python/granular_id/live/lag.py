"""When a stream is late for so long that it is no stumble any more."""

from __future__ import annotations

from granular_id._checks import finite_number
from granular_id._text import fixed

__all__ = ["LagWatch"]


class LagWatch:
    """Watches how late the newest row is.

    Parameters
    ----------
    max_lag_s : float
        Lag that is no cause for alarm.
    patience_s : float
        So long may it be larger than that.
    rate_hz : float

    Examples
    --------
    >>> from granular_id.live.lag import LagWatch
    >>> watch = LagWatch(0.02, 0.1, 500)
    >>> watch.complaint(n_rows=10, lag_s=0.05) is None
    True
    >>> watch.complaint(n_rows=40, lag_s=0.05)
    'rows came in 50 ms late; wanted at most 20 ms, or more for 100 ms at most'
    """

    def __init__(self, max_lag_s: float, patience_s: float, rate_hz: float) -> None:
        self.max_lag_s = finite_number("max_lag_s", max_lag_s, least=0)
        self._patience_s = finite_number("lag_patience_s", patience_s, least=0)
        self._rate_hz = rate_hz
        self._n_late = 0

    def complaint(self, n_rows: int, lag_s: float) -> str | None:
        """Note the lag after `n_rows` more rows; return what is wrong, once it is."""
        if lag_s <= self.max_lag_s:
            self._n_late = 0
            return None
        self._n_late += n_rows
        if self._n_late < self._patience_s * self._rate_hz and lag_s <= self.max_lag_s + self._patience_s:
            return None
        wanted = f"at most {1e3 * self.max_lag_s:g} ms, or more for {1e3 * self._patience_s:g} ms at most"
        return f"rows came in {fixed(1e3 * lag_s, 0)} ms late; wanted {wanted}"

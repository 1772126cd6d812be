"""The host's clocks: the monotonic one that rows are stamped with, and the time of day."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id import _core

__all__ = ["ArrivalClock", "host_ns", "late_s", "start_utc_s", "utc_at_origin_s"]

_DRIFT = 1e-4
"""No two clocks agree better than this, relative, whatever tolerance is asked for."""


def host_ns() -> int:
    """Return nanoseconds of the host's monotonic clock, the one that stamps rows (`granular_id._core.host_ns`)."""
    return _core.host_ns()


def utc_at_origin_s() -> float:
    """Return the time of day (seconds since 1970 UTC) at which the monotonic clock stood at zero."""
    return time.time() - 1e-9 * host_ns()


def start_utc_s(time_s: NDArray[np.float64], arrived_ns: NDArray[Any], origin_utc_s: float) -> float:
    """Return the time of day of the first of some rows, seconds since 1970 UTC.

    Rows arrive late, never early: the row that needed least time after its device time tells how the clocks
    stand (the lower envelope of host minus device).

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Device time.
    arrived_ns : ndarray, shape (n,)
        Host time at which each row came in.
    origin_utc_s : float
        See `utc_at_origin_s`.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.live.clock import start_utc_s
    >>> start_utc_s(np.array([7.0, 7.002]), np.array([2_000_900_000, 2_002_100_000]), 100.0)
    102.0001
    """
    offset_s = float(np.min(1e-9 * arrived_ns - time_s))
    return round(origin_utc_s + float(time_s[0]) + offset_s, 6)


def late_s(time_s: NDArray[np.float64], arrived_ns: NDArray[Any]) -> float:
    """Return how late rows came in at most, against the one that came soonest after its device time.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.live.clock import late_s
    >>> late_s(np.array([7.0, 7.002]), np.array([2_000_000_000, 2_152_000_000]))
    0.15
    """
    return round(float(np.ptp(1e-9 * (arrived_ns - arrived_ns[0]) - (time_s - time_s[0]))), 6)


class ArrivalClock:
    """Tells when rows were due by the host's clock: rows that come late do not count, only those that came soonest.

    Parameters
    ----------
    speed : float
        Seconds of device time per second.
    drift : float
        So much faster or slower than the host's, relative, may the sensor's clock run.
    """

    def __init__(self, speed: float, drift: float) -> None:
        self._per_second, self._drift = 1e9 / speed, max(drift, _DRIFT)
        self._first: tuple[float, int] | None = None
        self._offset = float("inf")

    def due_ns(self, time_s: NDArray[np.float64], arrived_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return when the next rows were due, shape (n,): not later than they came, and the same in any pieces."""
        if not len(time_s):
            return arrived_ns
        if self._first is None:
            self._first = float(time_s[0]), int(arrived_ns[0])
        device_ns = self._per_second * (time_s - self._first[0])
        host_ns = arrived_ns - self._first[1]
        # The offset of a clock that is slower grows: what is least of (offset - drift) follows it.
        tilted = (1 + self._drift) * device_ns
        offset = np.minimum.accumulate(np.concatenate([[self._offset], host_ns - tilted]))[1:]
        self._offset = float(offset[-1])
        return self._first[1] + np.rint(tilted + offset).astype(np.int64)

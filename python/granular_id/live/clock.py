"""The host's clocks: the monotonic one that rows are stamped with, and the time of day."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id import _core

__all__ = ["host_ns", "start_utc_s", "utc_at_origin_s"]


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

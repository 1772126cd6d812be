"""Where a stream is broken, and how fast it runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from granular_id._text import counted, fixed, verb
from granular_id.live.capture_state import FailureReason
from granular_id.live.rows import Rows
from granular_id.recording import SampleFlag

__all__ = ["Break", "measured_rate_hz", "runs"]


@dataclass(frozen=True)
class Break:
    """Something between two rows, after which they do not belong together."""

    reason: FailureReason
    text: str
    n_rows: int = 0
    """Rows that came and are left out for it."""


def runs(rows: Rows, rate_hz: float, *, allow_saturated: bool, first: bool) -> Iterator[Rows | Break]:
    """Cut rows where something is wrong.

    Parameters
    ----------
    rows : Rows
        Gaps that are tolerable are filled already (`rows.filled`).
    rate_hz : float
        For the words.
    allow_saturated : bool
        Saturated rows are none of what is wrong.
    first : bool
        These are the first rows of all: what is missing before them is nobody's loss.

    Yields
    ------
    Rows or Break
        Rows without a fault among them, and what lies between; saturated rows are left out.
    """
    gap = rows.missing_before > 0
    if first and len(gap):
        gap[0] = False
    saturated = np.zeros(len(rows), dtype=np.bool_) if allow_saturated else rows.has(SampleFlag.SATURATED)
    start = 0
    for at in np.flatnonzero(gap | saturated).tolist():
        if at > start:
            yield rows[start:at]
        when = f"at {fixed(rows.time_s[at], 3)} s of the sensor's time"
        if gap[at]:
            n = int(rows.missing_before[at])
            yield Break(
                FailureReason.GAP,
                f"{counted(n, 'sample')} ({1e3 * n / rate_hz:g} ms) {verb(n, 'is', 'are')} missing {when}",
            )
        start = at
        if saturated[at]:
            yield Break(FailureReason.SATURATION, f"the sensor was at the end of its range {when}", 1)
            start = at + 1
    if start < len(rows):
        yield rows[start:]


def measured_rate_hz(rows: Rows, *, device_clock: bool) -> float:
    """Return the rate at which rows came: the slope of a straight line through their times.

    Parameters
    ----------
    rows : Rows
        At least two, without gaps.
    device_clock : bool
        By the sensor's own time; False: by when they came in, where a single late row weighs little.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.live.rows import Rows
    >>> from granular_id.live.runs import measured_rate_hz
    >>> n = np.zeros(100, dtype=np.int64)
    >>> rows = Rows(np.zeros((100, 6)), np.arange(100) / 400, n, n.astype(np.uint8), n)
    >>> round(measured_rate_hz(rows, device_clock=True), 6)
    400.0
    """
    times = rows.time_s if device_clock else 1e-9 * (rows.host_ns - rows.host_ns[0])
    step = np.arange(len(rows)) - 0.5 * (len(rows) - 1)
    slope_s = float(step @ (times - times[0])) / float(step @ step)
    return 1.0 / slope_s if slope_s > 0 else float("inf")

"""Rows that a capture has taken: whether their rate fits, and the recording that they make."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from granular_id.live.clock import start_utc_s, utc_at_origin_s
from granular_id.live.rows import Rows
from granular_id.live.runs import measured_rate_hz
from granular_id.live.source import SourceInfo
from granular_id.recording import Recording

__all__ = ["meta_of", "rate_complaint", "recording_of"]


def rate_complaint(rows: Rows, rate_hz: float, tolerance: float, info: SourceInfo | None) -> str | None:
    """Return what is wrong with the rate at which rows came; None: nothing.

    Parameters
    ----------
    rows : Rows
    rate_hz, tolerance : float
        What is wanted, and how far it may be off, relative.
    info : SourceInfo, optional
        Without a device clock, the rate is measured by when rows came in.
    """
    device_clock = info is None or info.device_clock
    measured_hz = measured_rate_hz(rows, device_clock=device_clock)
    if info is not None and not device_clock:
        measured_hz /= info.speed
    if abs(measured_hz / rate_hz - 1) <= tolerance:
        return None
    return f"measured {measured_hz:.6g} Hz, wanted {rate_hz:g} Hz within {100 * tolerance:g} %"


def recording_of(
    rows: Rows,
    facts: Mapping[str, Any],
    *,
    info: SourceInfo | None,
    utc_at_zero_s: float | None,
    **parts: Any,
) -> Recording:
    """Make a recording of rows.

    Parameters
    ----------
    rows : Rows
    facts : mapping
        Metadata beside what `info` says.
    info : SourceInfo, optional
    utc_at_zero_s : float, optional
        Time of day at device time 0; None: it follows from when rows came in.
    **parts
        The other arguments of `Recording`.
    """
    if utc_at_zero_s is None:
        start_time = start_utc_s(rows.time_s, rows.host_ns, utc_at_origin_s())
    else:
        start_time = round(utc_at_zero_s + float(rows.time_s[0]), 6)
    return Recording(rows.wrench, start_time=start_time, meta=meta_of(info, facts), flags=rows.flags, **parts)


def meta_of(info: SourceInfo | None, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the metadata of a recording: what its source says, and `facts`."""
    of_source = {} if info is None else {"source": info.to_dict(), "synthetic": info.synthetic}
    return {**of_source, **facts}

"""All checks, one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from granular_id.recording._values import checked_number
from granular_id.recording.checking.clipping import check_clipping
from granular_id.recording.checking.drift import check_drift
from granular_id.recording.checking.duplicates import check_duplicates
from granular_id.recording.checking.finding import Finding, count, found
from granular_id.recording.checking.labels import check_axes, check_labels
from granular_id.recording.checking.leaks import check_leaks
from granular_id.recording.checking.marks import check_flags
from granular_id.recording.checking.outliers import check_outliers
from granular_id.recording.checking.report import CheckReport
from granular_id.recording.checking.resolution import check_resolution, signatures
from granular_id.recording.checking.rest import rest_of
from granular_id.recording.checking.sensor_range import SensorRange, resolve_range
from granular_id.recording.checking.sessions import check_sessions
from granular_id.recording.checking.spikes import check_spikes
from granular_id.recording.checking.stuck import check_stuck
from granular_id.recording.checking.timing import check_timing, pace
from granular_id.recording.checking.units import check_units
from granular_id.recording.one import Recording

ABSURD = 1e100
"""No sensor reads this, in any unit; the squares of such readings would overflow in the checks that follow."""


def check_recordings(
    recordings: Sequence[Recording],
    sensor_range: SensorRange | None = None,
    false_alarm_rate: float = 0.01,
) -> CheckReport:
    """Run all checks; see :meth:`Dataset.check`, which calls this."""
    rate = checked_number(false_alarm_rate, "false_alarm_rate")
    if not 0 < rate < 1:
        raise ValueError(f"false_alarm_rate must lie between 0 and 1, got {rate:g}")
    axes = list(dict.fromkeys(axis for r in recordings for axis in r.axes))
    ranges = None if sensor_range is None else resolve_range(sensor_range, axes)
    return CheckReport.of(list(_findings(recordings, ranges, rate)), recordings)


def _findings(
    recordings: Sequence[Recording], ranges: dict[str, float] | None, rate: float
) -> Iterator[Finding]:
    yield from check_labels(recordings)
    yield from check_axes(recordings)
    peaks = [np.abs(r.wrench).max(axis=0) for r in recordings]
    absurd = [i for i, peak in enumerate(peaks) if peak.max() > ABSURD]
    if absurd:
        message = (
            f"{count(len(absurd))} with readings above {ABSURD:g}: repair or leave out, then check again"
        )
        yield found("error", "beyond-range", message, recordings, absurd)
        return
    yield from check_duplicates(recordings)
    sessions = list(check_sessions(recordings))
    yield from sessions
    paces = [pace(r) for r in recordings]
    rests = [rest_of(r) for r in recordings]
    resolutions = signatures(recordings)
    yield from check_leaks(
        recordings,
        paces,
        rests,
        resolutions,
        rate,
        sessions_are_labels=any(finding.code == "session-is-label" for finding in sessions),
    )
    yield from check_timing(recordings, paces)
    yield from check_units(recordings, peaks)
    yield from check_clipping(recordings, ranges, rate)
    yield from check_stuck(recordings, rate)
    yield from check_spikes(recordings)
    yield from check_resolution(recordings, resolutions)
    yield from check_drift(recordings, rests, rate)
    yield from check_outliers(recordings, rate)
    yield from check_flags(recordings)

"""All checks, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id._words import counted
from granular_id.recording._values import checked_number
from granular_id.recording.checking.clipping import check_clipping
from granular_id.recording.checking.drift import check_drift
from granular_id.recording.checking.duplicates import check_duplicates
from granular_id.recording.checking.finding import Finding, found
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

_STEPS = 14
"""Steps that `_findings` tells of; a test counts them."""

_T = TypeVar("_T")


def check_recordings(
    recordings: Sequence[Recording],
    sensor_range: SensorRange | None = None,
    false_alarm_rate: float = 0.01,
    progress: bool | ProgressCallback = False,
) -> CheckReport:
    """Run all checks; see :meth:`Dataset.check`, which calls this."""
    rate = checked_number(false_alarm_rate, "false_alarm_rate")
    if not 0 < rate < 1:
        raise ValueError(f"false_alarm_rate must lie between 0 and 1, got {rate:g}")
    axes = list(dict.fromkeys(axis for r in recordings for axis in r.axes))
    ranges = None if sensor_range is None else resolve_range(sensor_range, axes)
    with showing(progress) as callback:
        ticker = Ticker(_STEPS, callback)
        return CheckReport.of(list(_findings(recordings, ranges, rate, ticker.tick)), recordings)


def _findings(
    recordings: Sequence[Recording],
    ranges: dict[str, float] | None,
    rate: float,
    tick: Callable[[str], None],
) -> Iterator[Finding]:
    def done(what: str, values: Iterable[_T]) -> list[_T]:
        taken = list(values)
        tick(what)
        return taken

    yield from check_labels(recordings)
    yield from check_axes(recordings)
    peaks = done("readings", (np.abs(r.wrench).max(axis=0) for r in recordings))
    absurd = [i for i, peak in enumerate(peaks) if peak.max() > ABSURD]
    if absurd:
        message = (
            f"{counted(len(absurd))} with readings above {ABSURD:g}: repair or leave out, then check again"
        )
        yield found("error", "beyond-range", message, recordings, absurd)
        return
    yield from done("copies", check_duplicates(recordings))
    sessions = list(check_sessions(recordings))
    yield from sessions
    paces = done("clocks", map(pace, recordings))
    rests = done("rest levels", map(rest_of, recordings))
    resolutions = signatures(recordings)
    tick("resolution")
    leaks = check_leaks(
        recordings,
        paces,
        rests,
        resolutions,
        rate,
        sessions_are_labels=any(finding.code == "session-is-label" for finding in sessions),
    )
    yield from done("leaks", leaks)
    yield from done("gaps", check_timing(recordings, paces))
    yield from check_units(recordings, peaks)
    yield from done("clipping", check_clipping(recordings, ranges, rate))
    yield from done("standing still", check_stuck(recordings, rate))
    yield from done("spikes", check_spikes(recordings))
    yield from done("resolution", check_resolution(recordings, resolutions))
    yield from done("drift", check_drift(recordings, rests, rate))
    yield from done("outliers", check_outliers(recordings, rate))
    yield from done("flags", check_flags(recordings))

"""All checks, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from granular_id._checks import checked_number
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id._text import counted
from granular_id.recording.checks.duplicates import check_duplicates
from granular_id.recording.checks.leaks import check_axes, check_labels, check_leaks, check_sessions
from granular_id.recording.checks.level import check_drift, check_outliers, rest_of
from granular_id.recording.checks.report import CheckReport, Finding, found
from granular_id.recording.checks.signal import (
    SensorRange,
    check_clipping,
    check_flags,
    check_resolution,
    check_spikes,
    check_stuck,
    check_units,
    resolve_range,
    signatures,
)
from granular_id.recording.checks.timing import check_timing, pace
from granular_id.recording.recording import Recording

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

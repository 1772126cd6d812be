"""All checks, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from granular_id._checks import argument_error, finite_number
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.recording.checks.duplicates import check_duplicates
from granular_id.recording.checks.leaks import check_leaks
from granular_id.recording.checks.measured import Measured
from granular_id.recording.checks.report import CheckReport, Finding
from granular_id.recording.checks.sensor_ranges import SensorRange, resolve_range
from granular_id.recording.checks.signal import (
    check_absurd,
    check_clipping,
    check_drift,
    check_outliers,
    check_resolution,
    check_spikes,
    check_stuck,
    check_units,
)
from granular_id.recording.checks.stated import (
    check_axes,
    check_flags,
    check_gaps,
    check_labels,
    check_lengths,
    check_rates,
    check_sessions,
    check_steps,
)
from granular_id.recording.recording import Recording

CHECKS: dict[str, Callable[[Measured], Iterator[Finding]]] = {
    "labels": check_labels,
    "axes": check_axes,
    "readings": check_absurd,
    "copies": check_duplicates,
    "sessions": check_sessions,
    "leaks": check_leaks,
    "rates": check_rates,
    "gaps": check_gaps,
    "steps": check_steps,
    "lengths": check_lengths,
    "units": check_units,
    "clipping": check_clipping,
    "standing still": check_stuck,
    "spikes": check_spikes,
    "resolution": check_resolution,
    "drift": check_drift,
    "outliers": check_outliers,
    "flags": check_flags,
}
"""In the order of their findings in a report."""


def check_recordings(
    recordings: Sequence[Recording],
    sensor_range: SensorRange | None,
    false_alarm_rate: float,
    progress: bool | ProgressCallback,
) -> CheckReport:
    """Run all checks; see :meth:`Dataset.check`, which calls this."""
    rate = finite_number("false_alarm_rate", false_alarm_rate)
    if not 0 < rate < 1:
        raise argument_error(ValueError, "false_alarm_rate", f"must lie between 0 and 1, got {rate:g}")
    axes = list(dict.fromkeys(axis for r in recordings for axis in r.axes))
    data = Measured(recordings, None if sensor_range is None else resolve_range(sensor_range, axes), rate)
    findings: list[Finding] = []
    with showing(progress) as callback:
        ticker = Ticker(len(CHECKS), callback)
        for what, check in CHECKS.items():
            found = list(check(data))
            findings += found
            ticker.tick(what)
            if check is check_absurd and found:
                break
    return CheckReport.of(findings, recordings)

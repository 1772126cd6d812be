"""All checks, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from granular_id._checks import checked_share
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.recording.checks import copies, leaks, signal, stated
from granular_id.recording.checks.measured import Measured, SensorRange, resolve_range
from granular_id.recording.checks.report import SEVERITIES, CheckReport, Finding
from granular_id.recording.recording import Recording

# In the order of their findings in a report.
CHECKS: dict[str, Callable[[Measured], Iterator[Finding]]] = {
    "labels": stated.check_labels,
    "axes": stated.check_axes,
    "readings": signal.check_absurd,
    "copies": copies.check_duplicates,
    "sessions": stated.check_sessions,
    "leaks": leaks.check_leaks,
    "rates": stated.check_rates,
    "gaps": stated.check_gaps,
    "steps": stated.check_steps,
    "lengths": stated.check_lengths,
    "units": signal.check_units,
    "clipping": signal.check_clipping,
    "standing still": signal.check_stuck,
    "outliers": signal.check_outliers,
    "flags": stated.check_flags,
}


def check_recordings(
    recordings: Sequence[Recording],
    sensor_range: SensorRange | None,
    false_alarm_rate: float,
    progress: bool | ProgressCallback,
) -> CheckReport:
    """Run all checks; see :meth:`Dataset.check`, which calls this."""
    rate = checked_share("false_alarm_rate", false_alarm_rate)
    axes = list(dict.fromkeys(axis for r in recordings for axis in r.axes))
    data = Measured(recordings, None if sensor_range is None else resolve_range(sensor_range, axes), rate)
    findings: list[Finding] = []
    with showing(progress) as callback:
        ticker = Ticker(len(CHECKS), callback)
        for what, check in CHECKS.items():
            found = list(check(data))
            findings += found
            ticker.tick(what)
            if check is signal.check_absurd and found:
                break
    findings.sort(key=lambda finding: SEVERITIES.index(finding.severity))
    return CheckReport(tuple(findings), len(recordings))

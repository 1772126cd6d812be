"""All checks, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from granular_id.recording.checks import copies, leaks, signal, stated
from granular_id.recording.checks.measured import Measured
from granular_id.recording.checks.report import SEVERITIES, CheckReport, Finding
from granular_id.recording.recording import Recording

# In the order of their findings in a report.
CHECKS: tuple[Callable[[Measured], Iterator[Finding]], ...] = (
    stated.check_labels,
    stated.check_axes,
    copies.check_duplicates,
    stated.check_sessions,
    stated.check_setups,
    leaks.check_leaks,
    stated.check_rates,
    stated.check_gaps,
    stated.check_steps,
    signal.check_units,
    signal.check_clipping,
    signal.check_stuck,
    signal.check_outliers,
    stated.check_flags,
)


def check_recordings(recordings: Sequence[Recording]) -> CheckReport:
    """Run all checks; see :meth:`Dataset.check`, which calls this."""
    data = Measured(recordings)
    with np.errstate(all="ignore"):  # of readings that no sensor gives squares overflow
        findings = [finding for check in CHECKS for finding in check(data)]
    findings.sort(key=lambda finding: SEVERITIES.index(finding.severity))
    return CheckReport(tuple(findings), len(recordings))

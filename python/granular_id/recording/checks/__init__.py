"""Checks of a data set: each takes what was measured of the recordings and yields findings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from granular_id.recording.checks.report import SEVERITIES, CheckReport, Finding
from granular_id.recording.recording import Recording

__all__ = ["CheckReport", "Finding", "check_recordings"]


def check_recordings(recordings: Sequence[Recording], session_hint: str = "") -> CheckReport:
    """Run all checks; see :meth:`Dataset.check`, which calls this."""
    # slow to import, and few programs look their recordings over
    from granular_id.recording.checks import copies, leaks, signal, stated
    from granular_id.recording.checks.measured import Measured

    in_order = (
        stated.check_labels,
        stated.check_axes,
        copies.check_duplicates,
        stated.check_sessions,
        stated.check_setups,
        leaks.check_leaks,
        stated.check_rates,
        stated.check_lengths,
        stated.check_gaps,
        stated.check_steps,
        signal.check_units,
        signal.check_clipping,
        signal.check_stuck,
        signal.check_outliers,
        stated.check_flags,
    )
    data = Measured(recordings, session_hint)
    with np.errstate(all="ignore"):  # of readings that no sensor gives squares overflow
        findings = [finding for check in in_order for finding in check(data)]
    findings.sort(key=lambda finding: SEVERITIES.index(finding.severity))
    return CheckReport(tuple(findings), len(recordings))

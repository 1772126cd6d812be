"""Checks of a data set: one theme a file, gathered in a report with a verdict per recording.

Every check takes the recordings and yields findings; `run.check_recordings` runs them all.
"""

from __future__ import annotations

from granular_id.recording.checks.report import CheckReport, Finding, Verdict
from granular_id.recording.checks.signal import SENSOR_RANGES

__all__ = ["SENSOR_RANGES", "CheckReport", "Finding", "Verdict"]

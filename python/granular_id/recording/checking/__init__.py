"""Checks of a data set: one theme a file, gathered in a report with a verdict per recording.

Every check takes the recordings and yields findings; `run.check_recordings` runs them all.
"""

from granular_id.recording.checking.finding import Finding
from granular_id.recording.checking.report import CheckReport, Verdict
from granular_id.recording.checking.sensor_range import SENSOR_RANGES

__all__ = ["SENSOR_RANGES", "CheckReport", "Finding", "Verdict"]

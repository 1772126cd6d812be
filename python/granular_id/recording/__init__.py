"""Recordings of a 6-axis wrench: the data model and what can be done to it.

``Recording`` is one push, ``Dataset`` an ordered set of them. Both are frozen: every step (select, resample,
align, concatenate) gives a new ``Dataset`` whose ``history[-1]`` reports what was done.
"""

from granular_id._core import AXES
from granular_id.recording.checks import SENSOR_RANGES, CheckReport, Finding, Verdict
from granular_id.recording.dataset import Dataset, Summary
from granular_id.recording.onset import Onset, find_onset
from granular_id.recording.recording import Recording, SampleFlag
from granular_id.recording.report import StepReport
from granular_id.recording.setup import Setup

__all__ = [
    "AXES",
    "SENSOR_RANGES",
    "CheckReport",
    "Dataset",
    "Finding",
    "Onset",
    "Recording",
    "SampleFlag",
    "Setup",
    "StepReport",
    "Summary",
    "Verdict",
    "find_onset",
]

"""Recordings of a 6-axis wrench: the data model and what can be done to it.

``Recording`` is one push, ``Dataset`` an ordered set of them. Both are frozen: every step (select, resample,
align, concatenate) gives a new ``Dataset`` whose ``history[-1]`` reports what was done.
"""

from granular_id._core import AXES
from granular_id.recording.checks import SENSOR_RANGES, CheckReport, Finding, Verdict
from granular_id.recording.dataset import Dataset, Summary, describe_data
from granular_id.recording.onset import FALSE_ALARM_RATE, REST_S, STEP, Onset, find_onset, onsets_of
from granular_id.recording.recording import (
    AXIS_COLOURS,
    KNOWN_FLAGS,
    Recording,
    SampleFlag,
    checked_axes,
    shared_base,
    unit_of,
)
from granular_id.recording.report import StepReport, text_table
from granular_id.recording.resampling import (
    STATED_TOLERANCE,
    RepairedTime,
    largest_offset,
    repair_time,
    uniform_rate,
)
from granular_id.recording.setup import (
    SEVERE,
    Difference,
    Setup,
    common_units,
    mixed,
    of_check,
    other_setup,
    other_units,
    other_values,
    settled,
    setups_in,
    values_in,
    warnings_in,
)

__all__ = [
    "AXES",
    "AXIS_COLOURS",
    "FALSE_ALARM_RATE",
    "KNOWN_FLAGS",
    "REST_S",
    "SENSOR_RANGES",
    "SEVERE",
    "STATED_TOLERANCE",
    "STEP",
    "CheckReport",
    "Dataset",
    "Difference",
    "Finding",
    "Onset",
    "Recording",
    "RepairedTime",
    "SampleFlag",
    "Setup",
    "StepReport",
    "Summary",
    "Verdict",
    "checked_axes",
    "common_units",
    "describe_data",
    "find_onset",
    "largest_offset",
    "mixed",
    "of_check",
    "onsets_of",
    "other_setup",
    "other_units",
    "other_values",
    "repair_time",
    "settled",
    "setups_in",
    "shared_base",
    "text_table",
    "uniform_rate",
    "unit_of",
    "values_in",
    "warnings_in",
]

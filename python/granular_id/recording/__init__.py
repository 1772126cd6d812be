"""Recordings of a 6-axis wrench: the data model and what can be done to it.

``Recording`` is one push, ``Dataset`` an ordered set of them. Both are frozen: every step (select, resample,
align, concatenate) gives a new ``Dataset`` whose ``history[-1]`` reports what was done.
"""

from granular_id._core import AXES
from granular_id.recording.checks import CheckReport, Finding
from granular_id.recording.checks.stated import SHORT as SHORT
from granular_id.recording.clock import samples_in as samples_in
from granular_id.recording.columns import (
    ABOUT as ABOUT,
    FLAGS as FLAGS,
    LABEL as LABEL,
    LABEL_NAMES as LABEL_NAMES,
    RECORDING as RECORDING,
    SCALED_UNITS as SCALED_UNITS,
    SESSION as SESSION,
    SESSION_NAMES as SESSION_NAMES,
    TIME as TIME,
    UNIT_NAMES as UNIT_NAMES,
    TableError as TableError,
    cell_text as cell_text,
    column_names as column_names,
    columns_of as columns_of,
    factor as factor,
    is_unit as is_unit,
    meaning_of as meaning_of,
    refuse_tables as refuse_tables,
    same_unit as same_unit,
    units_by_axis as units_by_axis,
)
from granular_id.recording.conversion import (
    Made as Made,
    restated as restated,
    to_recordings as to_recordings,
)
from granular_id.recording.dataset import Dataset
from granular_id.recording.descriptions import (
    PAUSE_S as PAUSE_S,
    SEVERE_PREFIXES as SEVERE_PREFIXES,
    common_units as common_units,
    data_warnings as data_warnings,
    describe_data as describe_data,
    labelled_check_note as labelled_check_note,
    mixed_setup_warnings as mixed_setup_warnings,
    setups_in as setups_in,
    short_warnings as short_warnings,
)
from granular_id.recording.frames import (
    names_in as names_in,
    padded_by_zeros as padded_by_zeros,
    stated_beside as stated_beside,
)
from granular_id.recording.onset import ONSET_STEP as ONSET_STEP
from granular_id.recording.payload import Payload
from granular_id.recording.recording import (
    AXIS_COLOURS as AXIS_COLOURS,
    Recording,
    SampleFlag,
    checked_axes as checked_axes,
    shared_base as shared_base,
    single_values as single_values,
    unit_of as unit_of,
)
from granular_id.recording.report import (
    SESSION_MAY_BE as SESSION_MAY_BE,
    StepReport,
    noticed_lines as noticed_lines,
    skipped_lines as skipped_lines,
    text_table as text_table,
)
from granular_id.recording.setup import (
    UNSTATED as UNSTATED,
    Difference as Difference,
    Setup,
    refuse_or_list as refuse_or_list,
    setup_differences as setup_differences,
    setup_mismatch as setup_mismatch,
    taken_off as taken_off,
    unit_differences as unit_differences,
    values_in as values_in,
)
from granular_id.recording.steps import (
    overlapping_windows as overlapping_windows,
    recordings_cut as recordings_cut,
)
from granular_id.recording.summary import (
    Summary,
    axes_in_words as axes_in_words,
    headline as headline,
)
from granular_id.recording.table import (
    Stated as Stated,
    Table as Table,
    refuse_units_unread as refuse_units_unread,
)
from granular_id.recording.wrench import (
    TARE_S as TARE_S,
    rest_zero as rest_zero,
    transform,
)

__all__ = [
    "AXES",
    "CheckReport",
    "Dataset",
    "Finding",
    "Payload",
    "Recording",
    "SampleFlag",
    "Setup",
    "StepReport",
    "Summary",
    "transform",
]

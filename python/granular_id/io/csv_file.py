"""One CSV file to one ``Recording``.

Line 1 names the columns, in any order and case: ``fx fy fz tx ty tz`` (N, N m), optionally ``time`` or
``timestamp`` (seconds) and ``flags`` (bits of ``SampleFlag``). Names with units (``fx_mN``) and other columns
are refused: what they hold would have to be guessed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id.io.csv_numbers import parse_numbers, split_header
from granular_id.io.errors import RecordingFileError
from granular_id.io.files import read_bounded
from granular_id.io.options import LoadOptions
from granular_id.recording import AXES, Recording, SampleFlag
from granular_id.recording.timing import (
    STATED_TOLERANCE,
    RepairedTime,
    largest_offset,
    repair_time,
    uniform_rate,
)

TIME_NAMES = ("time", "timestamp")
FLAGS_NAME = "flags"

_SINCE_1970 = 1e8
"""Stamps above this (1973) are seconds since 1970; below, a clock of the recording's own."""

_NOT_SECONDS = 1e11
"""Stamps above this (the year 5138) count milliseconds or less since 1970."""


@dataclass(frozen=True)
class CsvSource:
    """A CSV file and what is known about it from outside.

    Attributes
    ----------
    path : Path
    name, label, session, start_time, trigger_index, meta
        As in :class:`Recording`.
    rate_hz : float or None
        A rate stated for this file; the one in the options otherwise.
    irregular : bool
        Keep the stamps even where they lie on an even grid, and whatever rate the options state.
    """

    path: Path
    name: str
    label: str | None = None
    session: str | None = None
    start_time: float | None = None
    rate_hz: float | None = None
    irregular: bool = False
    trigger_index: int | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)


@dataclass
class _Samples:
    wrench: NDArray[np.float64]
    flags: NDArray[np.uint8] | None
    stamps: NDArray[np.float64] | None
    trigger: int | None


def read_csv(source: CsvSource, root: Path, options: LoadOptions) -> tuple[Recording, dict[str, Any]]:
    """Read one file.

    Returns
    -------
    recording : Recording
        Uniform when its stamps are (see ``timing.uniform_rate``), irregular otherwise.
    remarks : dict
        What a reader should know: repaired stamps, a missing line end, a clock that does not begin at 0.

    Raises
    ------
    RecordingFileError
        With the line and column of the first fault.
    """
    data = read_bounded(source.path, root, options.max_file_bytes)
    header, start = split_header(data, source.path)
    columns = _checked_columns(header, source.path)
    values = parse_numbers(data, start, columns, source.path)
    remarks: dict[str, Any] = {}
    if not data.endswith(b"\n"):
        remarks["remark"] = "no line end after the last line: it may be cut off"
    samples = _Samples(
        wrench=np.ascontiguousarray(values[:, [columns.index(axis) for axis in AXES]]),
        flags=_flags(values[:, columns.index(FLAGS_NAME)], source.path) if FLAGS_NAME in columns else None,
        stamps=None,
        trigger=source.trigger_index,
    )
    time_name = next((name for name in TIME_NAMES if name in columns), None)
    if time_name is not None:
        samples.stamps = np.ascontiguousarray(values[:, columns.index(time_name)])
        _order_time(samples, source, time_name, options, remarks)
    rate_hz, time_s, start_time = _clock(samples, source, time_name, options, remarks)
    try:
        recording = Recording(
            samples.wrench,
            rate_hz=rate_hz,
            label=source.label,
            session=source.session,
            start_time=start_time if source.start_time is None else source.start_time,
            trigger_index=samples.trigger,
            time_s=time_s,
            meta=source.meta,
            flags=samples.flags,
            name=source.name,
        )
    except (TypeError, ValueError) as error:
        raise RecordingFileError(source.path, str(error)) from error
    return recording, remarks


def _checked_columns(header: list[str], path: Path) -> list[str]:
    known = (*AXES, *TIME_NAMES, FLAGS_NAME)
    wanted = f"wanted {', '.join(AXES)}, and optionally time or timestamp (seconds)"
    for i, name in enumerate(header):
        if name not in known:
            problem = f"unknown column {name[:40]!r}; {wanted}; neither units in names nor other columns"
            raise RecordingFileError(path, problem, line=1, column=str(i + 1))
        if name in header[:i]:
            raise RecordingFileError(path, f"column {name!r} occurs twice", line=1, column=str(i + 1))
    missing = [axis for axis in AXES if axis not in header]
    if missing:
        raise RecordingFileError(path, f"column {missing[0]!r} is missing; {wanted}", line=1)
    if all(name in header for name in TIME_NAMES):
        raise RecordingFileError(path, "has both a time and a timestamp column; wanted one of them", line=1)
    return header


def _flags(column: NDArray[np.float64], path: Path) -> NDArray[np.uint8]:
    wrong = np.flatnonzero((column != np.floor(column)) | (column < 0) | (column > sum(SampleFlag)))
    if len(wrong):
        problem = f"{column[wrong[0]]:g} is not a sum of SampleFlag bits (0 to {sum(SampleFlag)})"
        raise RecordingFileError(path, problem, line=int(wrong[0]) + 2, column=FLAGS_NAME)
    return column.astype(np.uint8)


def _order_time(
    samples: _Samples, source: CsvSource, column: str, options: LoadOptions, remarks: dict[str, Any]
) -> None:
    """Make sure that stamps ascend: refuse the first one that does not, or repair them all if asked to."""
    stamps = samples.stamps
    assert stamps is not None
    if abs(stamps[0]) > _NOT_SECONDS:
        problem = (
            f"{stamps[0]:.6g} cannot be seconds since 1970 (milliseconds or nanoseconds?); wanted seconds"
        )
        raise RecordingFileError(source.path, problem, line=2, column=column)
    wrong = np.flatnonzero(stamps[1:] <= stamps[:-1])
    if not len(wrong):
        return
    first = int(wrong[0])
    before, after = float(stamps[first]), float(stamps[first + 1])
    if options.on_time_error == "raise":
        what = f"time runs back from {before!r} to {after!r}"
        if after == before:
            what = f"the stamp {after!r} is repeated"
        problem = f"{what}; on_time_error='repair' sorts samples and averages those that share a stamp"
        raise RecordingFileError(source.path, problem, line=first + 3, column=column)
    repaired = repair_time(stamps, samples.wrench)
    remarks.update(moved=repaired.n_moved, merged=repaired.n_merged)
    if samples.trigger is not None and samples.trigger < len(stamps):
        samples.trigger = int(np.searchsorted(repaired.stamps, stamps[samples.trigger]))
    samples.flags = _repaired_flags(samples.flags, repaired)
    samples.wrench, samples.stamps = repaired.values, repaired.stamps


def _repaired_flags(flags: NDArray[np.uint8] | None, repaired: RepairedTime) -> NDArray[np.uint8]:
    marks: NDArray[np.uint8] = repaired.touched.astype(np.uint8) * np.uint8(SampleFlag.TIME_REPAIRED)
    if flags is not None:
        marks |= np.bitwise_or.reduceat(flags[repaired.order], repaired.first)
    return marks


def _clock(
    samples: _Samples, source: CsvSource, column: str | None, options: LoadOptions, remarks: dict[str, Any]
) -> tuple[float | None, NDArray[np.float64] | None, float | None]:
    """Return rate_hz, time_s (one of the two is None) and the time of the first sample since 1970."""
    stated = options.rate_hz if source.rate_hz is None else source.rate_hz
    stamps = samples.stamps
    if stamps is None and source.irregular:
        raise RecordingFileError(source.path, "has no time column, but is called irregular", line=1)
    if stamps is None:
        if stated is None:
            problem = (
                "has no time column and no rate is stated; pass rate_hz=, or a rate_hz column in index.csv"
            )
            raise RecordingFileError(source.path, problem, line=1)
        return stated, None, None
    first = float(stamps[0])
    time_s = stamps - first
    if not time_s[-1] < np.inf:
        raise RecordingFileError(source.path, f"the stamps span {time_s[-1]:g} s", column=column)
    since_1970 = first if first > _SINCE_1970 else None
    if since_1970 is None and first:
        remarks["first_stamp_s"] = first
    if source.irregular:
        return None, time_s, since_1970
    if stated is not None:
        offset = largest_offset(time_s, stated)
        if offset > STATED_TOLERANCE / stated:
            problem = (
                f"the stated rate of {stated:g} Hz does not fit the stamps (off by up to {offset:.3g} s); "
                "leave the rate out to use the stamps, then call .resample(rate_hz)"
            )
            raise RecordingFileError(source.path, problem, column=column)
        return stated, None, since_1970
    rate = uniform_rate(time_s, resolution_s=float(np.spacing(np.abs(stamps).max())))
    return (None, time_s, since_1970) if rate is None else (rate, None, since_1970)

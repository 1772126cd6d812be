"""The argument PATH, and the options that say how its recordings are read."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from granular_id._text import counted, verb
from granular_id.cli.errors import in_options
from granular_id.cli.method import option, positive

if TYPE_CHECKING:
    from granular_id.recording import Dataset, StepReport
PANEL = "Recordings"


class Handling(str, Enum):
    """Choices of ``--on-error``, ``--on-gap`` and the like."""

    refuse = "raise"
    skip = "skip"


class Repair(str, Enum):
    """Choices of ``--on-time-error``."""

    refuse = "raise"
    repair = "repair"


class Accepted(str, Enum):
    """Choices of ``--accept``."""

    frame = "frame"
    transform = "transform"
    sign = "sign"
    units = "units"


class Unit(str, Enum):
    """Choices of ``--time-unit``."""

    s = "s"
    ms = "ms"
    us = "us"
    ns = "ns"
    sample = "sample"


ACCEPT = "Goes on though this is not as in the training, with a warning. Repeatable."
"""Help of ``--accept``."""

OnError = Annotated[
    Handling, option("--on-error", PANEL, "A file that cannot be read: refuse, or leave it out.")
]
OnTimeError = Annotated[
    Repair,
    option("--on-time-error", PANEL, "Time running backwards or repeated: refuse, or sort and merge."),
]
RecordedHz = Annotated[
    float | None,
    option(
        "--recorded-hz", PANEL, "Rate at which files without a clock were recorded (--rate-hz resamples)."
    ),
]
Topic = Annotated[
    str | None,
    option(
        "--topic",
        PANEL,
        "Topic of a bag, where several hold a wrench; with .field after it one inside its messages.",
    ),
]
TimeUnit = Annotated[
    Unit | None,
    option("--time-unit", PANEL, "What stamps count, where a file does not state it. Default: seconds."),
]
ArrayName = Annotated[
    str | None,
    option("--array", PANEL, "Array or group of a file that holds the samples, where several may."),
]
LabelName = Annotated[
    str | None,
    option("--label", PANEL, "Array or column of a file that holds the labels, where several may."),
]
MaxFileMb = Annotated[
    float | None,
    option("--max-file-mb", PANEL, "Largest file to read. Default: 8 of text, 2048 of binary."),
]


class Reading:
    """Recordings to read, with every option checked."""

    def __init__(
        self,
        path: Annotated[Path, typer.Argument(metavar="PATH", help="Folder or file of recordings.")],
        *,
        on_error: OnError = Handling.refuse,
        on_time_error: OnTimeError = Repair.refuse,
        recorded_hz: RecordedHz = None,
        topic: Topic = None,
        time_unit: TimeUnit = None,
        array: ArrayName = None,
        label: LabelName = None,
        max_file_mb: MaxFileMb = None,
    ) -> None:
        self.path = path
        self.settings = load_settings(
            on_error=on_error,
            on_time_error=on_time_error,
            recorded_hz=recorded_hz,
            topic=topic,
            time_unit=time_unit,
            array=array,
            label=label,
            max_file_mb=max_file_mb,
        )

    def refuse_absent(self) -> None:
        """Refuse a path with nothing there, before an import that takes longer than a look."""
        from granular_id._files import check_source

        check_source(self.path)

    def load(self, *, quiet: bool) -> Dataset:
        """Read the recordings and say what was read; when quiet, only what was skipped."""
        data = loaded(self.path, self.settings, quiet=quiet)
        say_loaded(data, quiet=quiet)
        return data


def say_loaded(data: Dataset, *, quiet: bool) -> None:
    """Say what was read; when quiet, only what was skipped."""
    said = skipped_text(data.history[-1]) if quiet else loaded_text(data)
    if said:
        Console(highlight=False).print(said, soft_wrap=True, markup=False)


def load_settings(
    *,
    on_error: Handling,
    on_time_error: Repair,
    recorded_hz: float | None,
    topic: str | None,
    time_unit: Unit | None,
    array: str | None,
    label: str | None,
    max_file_mb: float | None,
) -> dict[str, Any]:
    """Check the options of reading, and return them as `granular_id.load` takes them."""
    positive("--recorded-hz", recorded_hz)
    positive("--max-file-mb", max_file_mb)
    return {
        "rate_hz": recorded_hz,
        "on_error": on_error.value,
        "on_time_error": on_time_error.value,
        "topic": topic,
        "time_unit": None if time_unit is None else time_unit.value,
        "array": array,
        "label": label,
        "max_file_bytes": None if max_file_mb is None else math.ceil(max_file_mb * 2**20),
    }


def loaded(path: Path, settings: Mapping[str, Any], *, quiet: bool) -> Dataset:
    """Read one file or folder, with messages that name options."""
    from granular_id.io import RecordingFileError, load

    try:
        return load(path, progress=not quiet, **settings)
    except ValueError as error:
        skippable = isinstance(error, RecordingFileError) and error.skippable
        hint = "; add --on-error skip to leave such files out" if skippable else ""
        raise ValueError(in_options(str(error), rate_option="--recorded-hz") + hint) from None


# Files and folders to identify, as one data set.


def load_all(paths: Sequence[Path], settings: Mapping[str, Any], *, quiet: bool) -> Dataset:
    """Read several files and folders into one data set.

    Parameters
    ----------
    paths : sequence of Path
        Of any format.
    settings : mapping
        See `granular_id.cli.reading.load_settings`.
    quiet : bool
        No progress.

    Returns
    -------
    Dataset
        Of several paths, recordings are named after the path they came from.
    """
    from granular_id.recording import Dataset

    parts = [loaded(path, settings, quiet=quiet) for path in paths]
    if len(parts) == 1:
        return parts[0]
    named = [
        Dataset([replace(r, name=_place(path, r.name, alone=len(part) == 1)) for r in part], part.history)
        for path, part in zip(paths, parts, strict=True)
    ]
    return Dataset.concatenate(named)


def _place(path: Path, name: str, *, alone: bool) -> str:
    if path.is_dir():
        return str(path / name)
    return str(path) if alone else f"{path}: {name}"


# What was read and left out, in words.

MOST_LINES = 10


def loaded_text(data: Dataset) -> str:
    """Say what was read: numbers, length and rate, and else only what deserves mention.

    Parameters
    ----------
    data : Dataset
        As loaded: the last step of its history is the reading.

    Returns
    -------
    str
        One line, and one more for each remark.
    """
    report = data.history[-1]
    lengths = [recording.n_samples for recording in data]
    lines = [", ".join((_size(data), f"{_span(lengths)} {_times(data, max(lengths))}"))]
    skipped = skipped_text(report)
    lines += [skipped] if skipped else []
    repaired = [row["name"] for row in report.rows if row.get("moved") or row.get("merged")]
    if repaired:
        moved, merged = (report.totals.get(name, 0) for name in ("moved_samples", "merged_samples"))
        did = [f"{counted(moved, 'sample')} moved"] * bool(moved) + [f"{merged} merged"] * bool(merged)
        lines.append(f"time repaired in {_named(repaired, ' (' + ', '.join(did) + ')')}")
    remarks: dict[str, list[str]] = {}
    for row in report.rows:
        if row.get("remark"):
            remarks.setdefault(row["remark"], []).append(row["name"])
    lines += [f"{remark}, in {_named(names)}" for remark, names in remarks.items()]
    return "\n".join((*lines, *(f"note: {note}" for note in report.notes)))


def skipped_text(report: StepReport) -> str:
    """Name what a step left out because it could not be used; empty when nothing was."""
    reading = report.step == "load"
    rows = [row for row in report.rows if "skipped" in row]
    if not rows:
        return ""
    lines = [f"{counted(len(rows), 'file' if reading else 'recording')} skipped:"]
    # The problem of a file names it, with its folder.
    lines += [f"  {'' if reading else row['name'] + ': '}{row['skipped']}" for row in rows[:MOST_LINES]]
    if len(rows) > MOST_LINES:
        lines.append(f"  ... and {len(rows) - MOST_LINES} more")
    return "\n".join(lines)


def excluded_text(before: Dataset, after: Dataset) -> str:
    """Say which materials ``--exclude`` left out, and what remains."""
    counts = Counter(recording.label for recording in before if recording.label not in after.labels)
    out = ", ".join(f"{label or 'no label'} ({counted(n, 'recording')})" for label, n in counts.items())
    return f"--exclude left out {out}; {_size(after)} remain"


def _named(names: Sequence[str], remark: str = "") -> str:
    shown = ", ".join(names[:MOST_LINES]) + (" ..." if len(names) > MOST_LINES else "")
    return f"{counted(len(names), 'recording')}{remark}: {shown}"


def _size(data: Dataset) -> str:
    return f"{counted(len(data), 'recording')}, {counted(len(data.labels), 'material')}"


def _span(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _times(data: Dataset, longest: int) -> str:
    rates = [recording.rate_hz for recording in data if recording.rate_hz is not None]
    irregular = len(data) - len(rates)
    samples = verb(longest, "sample", "samples")
    if not rates:
        return f"{samples}, irregular in time"
    remark = f", {irregular} of them irregular in time" if irregular else ""
    return f"{samples} at {_span(rates)} Hz{remark}"

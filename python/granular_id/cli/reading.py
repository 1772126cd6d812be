"""The argument PATH, and the options that say how its recordings are read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from granular_id.cli.errors import in_options
from granular_id.cli.groups import option
from granular_id.cli.sentences import loaded_text, skipped_text
from granular_id.cli.settings import positive

if TYPE_CHECKING:
    from granular_id.recording import Dataset

__all__ = [
    "ACCEPT",
    "PANEL",
    "Accepted",
    "ArrayName",
    "Handling",
    "LabelName",
    "MaxFileMb",
    "OnError",
    "OnTimeError",
    "Reading",
    "RecordedHz",
    "Repair",
    "TimeUnit",
    "Topic",
    "load_settings",
    "loaded",
    "say_loaded",
]

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
        from granular_id._files import check_source  # noqa: PLC0415 (--help must not wait)

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
    from granular_id.io import RecordingFileError, load  # noqa: PLC0415 (--help must not wait for numpy)

    try:
        return load(path, progress=not quiet, **settings)
    except ValueError as error:
        skippable = isinstance(error, RecordingFileError) and error.skippable
        hint = "; add --on-error skip to leave such files out" if skippable else ""
        raise ValueError(in_options(str(error), rate_option="--recorded-hz") + hint) from None

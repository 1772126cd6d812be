"""The argument FOLDER, and the options that say how its recordings are read and prepared."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from granular_id.cli.errors import in_options
from granular_id.cli.groups import option
from granular_id.cli.prepare import Preparation, prepare
from granular_id.cli.sentences import loaded_text, skipped_text
from granular_id.cli.settings import length_of, names_in, positive

if TYPE_CHECKING:
    from granular_id.recording import Dataset

__all__ = ["Source"]

PANEL = "Recordings"


class Handling(str, Enum):
    """Choices of ``--on-error``, ``--on-gap`` and ``--on-short``."""

    refuse = "raise"
    skip = "skip"


class Repair(str, Enum):
    """Choices of ``--on-time-error``."""

    refuse = "raise"
    repair = "repair"


class Source:
    """A folder of recordings and how to read and prepare them, with every option checked."""

    def __init__(
        self,
        folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of recordings.")],
        *,
        rate_hz: Annotated[
            float | None, option("--rate-hz", PANEL, "Resample to this rate (linear interpolation).")
        ] = None,
        max_gap_s: Annotated[
            float, option("--max-gap-s", PANEL, "Longest gap to fill when resampling; inf: any.")
        ] = 0.25,
        on_gap: Annotated[
            Handling, option("--on-gap", PANEL, "A longer gap: refuse, or leave the recording out.")
        ] = Handling.refuse,
        duration_s: Annotated[
            float | None, option("--duration-s", PANEL, "Keep this many seconds from the start.")
        ] = None,
        n_samples: Annotated[
            str | None, option("--n-samples", PANEL, "Keep this many samples, or: shortest.")
        ] = None,
        on_short: Annotated[
            Handling, option("--on-short", PANEL, "A shorter recording: refuse, or leave it out.")
        ] = Handling.refuse,
        on_error: Annotated[
            Handling, option("--on-error", PANEL, "A file that cannot be read: refuse, or leave it out.")
        ] = Handling.refuse,
        on_time_error: Annotated[
            Repair,
            option(
                "--on-time-error", PANEL, "Time running backwards or repeated: refuse, or sort and merge."
            ),
        ] = Repair.refuse,
        recorded_hz: Annotated[
            float | None, option("--recorded-hz", PANEL, "Rate of files that have no time column.")
        ] = None,
        exclude: Annotated[
            str, option("--exclude", PANEL, "Materials to leave out, separated by commas.")
        ] = "",
    ) -> None:
        if duration_s is not None and n_samples is not None:
            raise ValueError("give one of --duration-s and --n-samples, not both")
        for name, value in (
            ("--rate-hz", rate_hz),
            ("--recorded-hz", recorded_hz),
            ("--duration-s", duration_s),
        ):
            positive(name, value)
        positive("--max-gap-s", max_gap_s, infinite=True)
        self.folder = folder
        self.reading: dict[str, Any] = {
            "rate_hz": recorded_hz,
            "on_error": on_error.value,
            "on_time_error": on_time_error.value,
        }
        self.preparation = Preparation(
            rate_hz=rate_hz,
            max_gap_s=max_gap_s,
            duration_s=duration_s,
            n_samples=length_of(n_samples),
            exclude=names_in(exclude),
            on_gap=on_gap.value,
            on_short=on_short.value,
        )

    def load(self, *, quiet: bool) -> Dataset:
        """Read and prepare the recordings, saying what was done; when quiet, only what was skipped."""
        from granular_id.io import RecordingFileError, load  # noqa: PLC0415 (--help must not wait for numpy)

        if self.folder.is_file():
            raise ValueError(f"{self.folder} is a file; wanted a folder of recordings")
        console = Console(highlight=False)

        def say(text: str, always: str) -> None:
            shown = always if quiet else text
            if shown:
                console.print(shown, soft_wrap=True, markup=False)

        try:
            data = load(self.folder, progress=not quiet, **self.reading)
        except ValueError as error:
            skippable = isinstance(error, RecordingFileError) and error.skippable
            hint = "; add --on-error skip to leave such files out" if skippable else ""
            raise ValueError(in_options(str(error), rate_option="--recorded-hz") + hint) from None
        say(loaded_text(data), skipped_text(data.history[-1]))
        if not data.labels:
            notes = (note for note in data.history[-1].notes if "no column label" in note)
            raise ValueError(f"{self.folder}: {next(notes, 'no recording has a label')}")
        return prepare(data, self.preparation, say)

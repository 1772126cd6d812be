"""The options that say how recordings are prepared: resampled, aligned, cropped, left out."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Annotated

from rich.console import Console

from granular_id.cli.groups import option
from granular_id.cli.prepare import Preparation, prepare, refuse_unequal
from granular_id.cli.reading import PANEL, Handling, Reading
from granular_id.cli.settings import length_of, names_in, onsets_in, positive

if TYPE_CHECKING:
    from granular_id.recording import Dataset

__all__ = ["MaxGapS", "OnGap", "OnShort", "OnsetAt", "RateHz", "RestS", "Steps", "equal_recordings", "saying"]


MAX_GAP_S = 0.25
"""Default of ``--max-gap-s``."""


class Beginning(str, Enum):
    """Choices of ``--begin-at``."""

    first = "first"
    trigger = "trigger"
    onset = "onset"


RateHz = Annotated[
    float | None,
    option(
        "--rate-hz",
        PANEL,
        "Resample to this rate (linear interpolation). Files without a clock: see --recorded-hz.",
    ),
]
MaxGapS = Annotated[float, option("--max-gap-s", PANEL, "Longest gap to fill when resampling; inf: any.")]
OnGap = Annotated[Handling, option("--on-gap", PANEL, "A longer gap: refuse, or leave the recording out.")]
RestS = Annotated[float, option("--rest-s", PANEL, "Rest at the start from which the onset is judged.")]
OnsetAt = Annotated[
    list[str] | None,
    option("--onset-at", PANEL, "Overrule an onset: NAME=SECONDS, or NAME=none. May be repeated."),
]
OnShort = Annotated[
    Handling,
    option(
        "--on-short", PANEL, "A recording too short, or without trigger or onset: refuse, or leave it out."
    ),
]


class Steps:
    """What to do with recordings once they are read, with every option checked."""

    def __init__(
        self,
        *,
        rate_hz: RateHz = None,
        max_gap_s: MaxGapS = MAX_GAP_S,
        on_gap: OnGap = Handling.refuse,
        begin_at: Annotated[
            Beginning,
            option(
                "--begin-at",
                PANEL,
                "Keep from the first sample, the stored trigger, or the onset of motion found in the forces.",
            ),
        ] = Beginning.first,
        lead_s: Annotated[
            float, option("--lead-s", PANEL, "Seconds to keep ahead of trigger or onset.")
        ] = 0.0,
        rest_s: RestS = 0.1,
        onset_at: OnsetAt = None,
        duration_s: Annotated[
            float | None, option("--duration-s", PANEL, "Keep this many seconds from there on.")
        ] = None,
        n_samples: Annotated[
            str | None, option("--n-samples", PANEL, "Keep this many samples, or: shortest.")
        ] = None,
        on_short: OnShort = Handling.refuse,
        exclude: Annotated[
            str, option("--exclude", PANEL, "Materials to leave out, separated by commas.")
        ] = "",
    ) -> None:
        if duration_s is not None and n_samples is not None:
            raise ValueError("give one of --duration-s and --n-samples, not both")
        if begin_at is not Beginning.first and duration_s is None and n_samples is None:
            raise ValueError(
                f"--begin-at {begin_at.value} crops recordings: add --duration-s or --n-samples (a number, or "
                "shortest)"
            )
        if lead_s and begin_at is Beginning.first:
            raise ValueError("--lead-s is time kept ahead of a trigger: add --begin-at trigger or onset")
        for name, value in (("--rate-hz", rate_hz), ("--duration-s", duration_s)):
            positive(name, value)
        positive("--max-gap-s", max_gap_s, infinite=True)
        if rate_hz is None and (max_gap_s != MAX_GAP_S or on_gap is not Handling.refuse):
            unused = "--max-gap-s" if max_gap_s != MAX_GAP_S else "--on-gap"
            raise ValueError(f"{unused} is about gaps that resampling fills: add --rate-hz")
        positive("--rest-s", rest_s)
        self.preparation = Preparation(
            rate_hz=rate_hz,
            max_gap_s=max_gap_s,
            begin_at=begin_at.value,
            lead_s=lead_s,
            rest_s=rest_s,
            onset_at=onsets_in(onset_at or []),
            duration_s=duration_s,
            n_samples=length_of(n_samples),
            exclude=names_in(exclude),
            on_gap=on_gap.value,
            on_short=on_short.value,
        )

    def taken(self, data: Dataset, *, quiet: bool, onsets: bool = False) -> Dataset:
        """Take the steps asked for, saying what each did; when quiet, only what was left out.

        `onsets`: they are looked for afterwards, so stating some makes sense without ``--begin-at onset``.
        """
        if self.preparation.onset_at and self.preparation.begin_at != "onset" and not onsets:
            raise ValueError("--onset-at states an onset, but nothing begins there: add --begin-at onset")
        return prepare(data, self.preparation, saying(quiet=quiet))


def saying(*, quiet: bool) -> Callable[[str, str], None]:
    """Return what prints the reports of steps: what each did or, when quiet, only what it left out."""
    console = Console(highlight=False)

    def say(text: str, always: str) -> None:
        shown = always if quiet else text
        if shown:
            console.print(shown, soft_wrap=True, markup=False)

    return say


def equal_recordings(reading: Reading, steps: Steps, *, quiet: bool) -> Dataset:
    """Read and prepare labelled recordings of one rate and one length, as every method needs them.

    Raises
    ------
    ValueError
        No labels; or recordings are irregular, differ in rate or in length and no option says what to do; the
        message proposes the option.
    """
    data = reading.load(quiet=quiet)
    if not data.labels:
        notes = (note for note in data.history[-1].notes if "no column label" in note)
        raise ValueError(f"{reading.path}: {next(notes, 'no recording has a label')}")
    data = steps.taken(data, quiet=quiet)
    refuse_unequal(data)
    return data

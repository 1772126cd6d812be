"""From a folder to recordings of one rate and one length, by the steps that were asked for and no others."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING, Annotated, Literal

from rich.console import Console

from granular_id._text import counted, verb
from granular_id.cli.method import length_of, names_in, onsets_in, option, positive
from granular_id.cli.reading import PANEL, Handling, Reading, excluded_text, skipped_text

if TYPE_CHECKING:
    from granular_id.recording import Dataset, StepReport
Choice = Literal["raise", "skip"]


@dataclass(frozen=True)
class Preparation:
    """What was asked for on the command line; None leaves a step out.

    Parameters
    ----------
    rate_hz : float or None
        Resample to this rate, Hz.
    max_gap_s : float
        Longest gap that resampling may fill, s; infinity for no limit.
    begin_at : {"first", "trigger", "onset"}
        Where cropping begins: the first sample, the stored trigger, the onset of motion found in the forces.
    lead_s : float
        Seconds kept ahead of trigger or onset.
    rest_s : float
        Rest at the start from which an onset is judged, s.
    onset_at : mapping
        Onsets stated by the user, s from the first sample, by name of the recording; None: it has none.
    duration_s, n_samples : float or None, int, "shortest" or None
        Common length to crop to; at most one of the two.
    exclude : sequence of str
        Labels to leave out.
    on_gap, on_short : {"raise", "skip"}
        What to do with a gap that is too long, a recording that is too short.
    """

    rate_hz: float | None
    max_gap_s: float
    duration_s: float | None
    n_samples: int | Literal["shortest"] | None
    begin_at: Literal["first", "trigger", "onset"] = "first"
    lead_s: float = 0.0
    rest_s: float = 0.1
    onset_at: Mapping[str, float | None] = field(default_factory=dict)
    exclude: Sequence[str] = ()
    on_gap: Choice = "raise"
    on_short: Choice = "raise"


def prepare(data: Dataset, wanted: Preparation, say: Callable[[str, str], None]) -> Dataset:
    """Leave out labels, resample, find onsets and crop as asked; say what each step did.

    Parameters
    ----------
    data : Dataset
        As loaded.
    wanted : Preparation
    say : callable
        Gets two texts per step: what it did, and what even a brief report must say (may be empty).

    Returns
    -------
    Dataset

    Raises
    ------
    ValueError
        A step cannot be taken; the message proposes the option.
    """
    if wanted.exclude:
        unknown = sorted(set(wanted.exclude) - set(data.labels))
        if unknown:
            known = ", ".join(data.labels)
            raise ValueError(f"--exclude names {unknown[0]!r}, which is no label here; there are {known}")
        kept = [label for label in data.labels if label not in wanted.exclude]
        if not kept:
            raise ValueError("--exclude leaves no recording")
        before, data = data, data.select(labels=kept)
        say(excluded_text(before, data), "")
    if wanted.rate_hz is not None and any(recording.rate_hz != wanted.rate_hz for recording in data):
        limit = None if math.isinf(wanted.max_gap_s) else wanted.max_gap_s
        data = told(data.resample(wanted.rate_hz, max_gap_s=limit, on_gap=wanted.on_gap), say)
    if wanted.begin_at == "onset":
        data = told(with_onsets(data, wanted), say)
        _refuse_missing_onsets(data, wanted)
    if wanted.duration_s is not None or wanted.n_samples is not None:
        _refuse_unequal_rates(data)
        aligned = data.align(
            wanted.n_samples,
            duration_s=wanted.duration_s,
            trigger=None if wanted.begin_at == "first" else "recorded",
            lead_s=wanted.lead_s,
            on_short=wanted.on_short,
            on_missing=wanted.on_short,
        )
        data = told(aligned, say)
    return data


def with_onsets(data: Dataset, wanted: Preparation) -> Dataset:
    """Find the onsets of recordings that share a rate, as asked; triggers that were stored give way."""
    _refuse_unequal_rates(data)
    return data.find_onsets(rest_s=wanted.rest_s, overrule=wanted.onset_at or None, replace=True)


def _refuse_missing_onsets(data: Dataset, wanted: Preparation) -> None:
    without = [recording.name for recording in data if recording.trigger_index is None]
    if without and wanted.on_short == "raise":
        raise ValueError(
            f"no onset in {len(without)} of {len(data)} recordings, the first is {without[0]!r}: state it "
            "with --onset-at NAME=SECONDS, try another --rest-s, or add --on-short skip to leave them out"
        )


def refuse_unequal(data: Dataset) -> None:
    """Raise ValueError proposing an option where recordings differ in rate or length."""
    _refuse_unequal_rates(data)
    _refuse_unequal_lengths(data)


def told(data: Dataset, say: Callable[[str, str], None]) -> Dataset:
    """Say what the last step of a data set did, and return the data set."""
    step = data.history[-1]
    say(_step_text(step), skipped_text(step))
    return data


def _step_text(step: StepReport) -> str:
    """Print a step with its totals and notes, naming only the recordings left out; the JSON file has all."""
    return str(replace(step, rows=[row for row in step.rows if "skipped" in row]))


def _refuse_unequal_rates(data: Dataset) -> None:
    irregular = [recording for recording in data if recording.rate_hz is None]
    rates = sorted({recording.rate_hz for recording in data if recording.rate_hz is not None})
    if not irregular and len(rates) == 1:
        return
    if irregular:
        import numpy as np

        steps = np.concatenate([np.diff(recording.times()) for recording in irregular])
        if not steps.size:
            raise ValueError(
                f"{len(irregular)} of {counted(len(data))} "
                f"{verb(len(irregular), 'holds', 'hold')} a single sample, the first is "
                f"{irregular[0].name!r}: wanted recordings of a whole push"
            )
        step_s = float(np.median(steps))
        raise ValueError(
            f"{len(irregular)} of {counted(len(data))} "
            f"{verb(len(irregular), 'is', 'are')} sampled irregularly, with a median step of "
            f"{1000 * step_s:.3g} ms; nothing is resampled unasked: "
            f"add --rate-hz {_round_below(1 / step_s):g}"
        )
    raise ValueError(
        f"recordings were sampled at {rates[0]:g} to {rates[-1]:g} Hz; nothing is resampled unasked: "
        f"add --rate-hz {rates[0]:g}"
    )


def _refuse_unequal_lengths(data: Dataset) -> None:
    lengths = sorted(recording.n_samples for recording in data)
    if lengths[0] == lengths[-1]:
        return
    short = min(data, key=lambda recording: recording.n_samples)
    middle = lengths[len(lengths) // 2]
    raise ValueError(
        f"recordings last {lengths[0]} to {lengths[-1]} samples ({lengths[0] / data.rate_hz:g} to "
        f"{lengths[-1] / data.rate_hz:g} s), the shortest is {short.name!r}; nothing is cropped unasked: "
        f"add --n-samples shortest to keep the first {lengths[0]} of all, or a larger number with "
        f"--on-short skip to leave out the shorter ones (half have at least {middle})"
    )


def _round_below(rate_hz: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20, 50, ... that is not above a rate."""
    power = 10.0 ** math.floor(math.log10(rate_hz))
    return max(step * power for step in (1, 2, 5) if step * power <= rate_hz * (1 + 1e-9))


# The options that say how recordings are prepared: resampled, aligned, cropped, left out.

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

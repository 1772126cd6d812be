"""``granular-id identify``: name the materials in recordings, with a trained model."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from granular_id._files import MODELS
from granular_id.cli.errors import guarded, words_of
from granular_id.cli.method import onsets_in, option, positive, taking
from granular_id.cli.prepare import (
    MAX_GAP_S,
    MaxGapS,
    OnGap,
    OnsetAt,
    OnShort,
    Preparation,
    RateHz,
    RestS,
    prepare,
    saying,
    told,
    with_onsets,
)
from granular_id.cli.reading import (
    ACCEPT,
    PANEL,
    Accepted,
    ArrayName,
    Handling,
    LabelName,
    MaxFileMb,
    OnError,
    OnTimeError,
    RecordedHz,
    Repair,
    TimeUnit,
    Topic,
    load_all,
    load_settings,
    say_loaded,
)
from granular_id.cli.session import ANSWERS, JSON_FILE, Force, check_outputs, say_written

if TYPE_CHECKING:
    from granular_id.identifier import Identifier
    from granular_id.recording import Dataset

__all__ = ["identify"]

TEXT = """
Name the material in each recording, with a model that `granular-id train` has written.

PATH is a file or folder of any format, as for `granular-id evaluate`; labels are not needed. Where recordings have some
that the model knows, its answers are compared with them.

Recordings must have the rate of the model (`granular-id model info MODEL`) and at least its length. Longer ones begin
as those of the training: at their stored trigger, less the rest ahead of it, or at their first sample; --begin-at says
otherwise.

A model knows what its recordings were made with. Another frame or sign is refused, another sensor, filter, tool,
trigger or speed is said; what is not known is not compared. `--accept` takes what is the same under another name.

Examples:

`granular-id identify kitchen.safetensors fresh`

`granular-id identify -m kitchen.safetensors push_1.npz push_2.csv --csv answers.csv`

`granular-id identify kitchen.safetensors bags --rate-hz 500 --begin-at onset --lead-s 0.1`
"""

OUTPUT = "Output"


class Beginning(str, Enum):
    """Choices of ``--begin-at``."""

    auto = "auto"
    first = "first"
    trigger = "trigger"
    onset = "onset"


class Recordings:
    """A model and the recordings to identify, with every option of reading checked."""

    def __init__(
        self,
        files: Annotated[
            list[Path] | None,
            typer.Argument(
                metavar="MODEL PATH",
                help="Model file, then folders and files of recordings.",
                show_default=False,
            ),
        ] = None,
        *,
        model: Annotated[
            Path | None,
            option("--model -m", PANEL, "Model file; all arguments are recordings then."),
        ] = None,
        on_error: OnError = Handling.refuse,
        on_time_error: OnTimeError = Repair.refuse,
        recorded_hz: RecordedHz = None,
        topic: Topic = None,
        time_unit: TimeUnit = None,
        array: ArrayName = None,
        label: LabelName = None,
        max_file_mb: MaxFileMb = None,
    ) -> None:
        self.is_named = model is not None
        given = [*([] if model is None else [model]), *(files or [])]
        if self.is_named and not files:
            raise ValueError("no recordings given: granular-id identify -m MODEL PATH...")
        if len(given) < 2:
            got = f"{given[0]} alone" if given else "neither"
            raise ValueError(
                f"a model file and recordings are needed, got {got}: granular-id identify MODEL PATH..., with the "
                "MODEL that granular-id train wrote"
            )
        self.model, *self.paths = given
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

    def load(self, *, quiet: bool) -> Dataset:
        """Read the recordings and say what was read; when quiet, only what was skipped."""
        data = load_all(self.paths, self.settings, quiet=quiet)
        say_loaded(data, quiet=quiet)
        return data


class Fitting:
    """How recordings come to the rate and length of the model, with every option checked."""

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
                "Where the model's length begins: the first sample, the stored trigger, the onset of motion found in "
                "the forces; auto: as in the training.",
            ),
        ] = Beginning.auto,
        lead_s: Annotated[
            float | None,
            option("--lead-s", PANEL, "Seconds ahead of trigger or onset. Default: as in the training."),
        ] = None,
        rest_s: RestS = 0.1,
        onset_at: OnsetAt = None,
        on_short: OnShort = Handling.refuse,
        accept: Annotated[list[Accepted] | None, option("--accept", PANEL, ACCEPT)] = None,
    ) -> None:
        positive("--rate-hz", rate_hz)
        positive("--max-gap-s", max_gap_s, infinite=True)
        positive("--rest-s", rest_s)
        if lead_s is not None and begin_at is Beginning.first:
            raise ValueError("--lead-s is time kept ahead of a trigger: leave it out, or --begin-at first")
        onsets = onsets_in(onset_at or [])
        if onsets and begin_at is not Beginning.onset:
            raise ValueError("--onset-at states an onset, but nothing begins there: add --begin-at onset")
        self.begin_at, self.lead_s, self.on_short = begin_at, lead_s, on_short
        self.accept = [one.value for one in accept or []]
        self.preparation = Preparation(
            rate_hz=rate_hz,
            max_gap_s=max_gap_s,
            duration_s=None,
            n_samples=None,
            rest_s=rest_s,
            onset_at=onsets,
            on_gap=on_gap.value,
        )

    def taken(self, data: Dataset, identifier: Identifier, *, quiet: bool) -> tuple[Dataset, tuple[str, ...]]:
        """Bring recordings to the rate and length of a model, saying what each step did; return how they differ."""
        from granular_id.identifier import fitted, refuse_others

        say = saying(quiet=quiet)
        data = prepare(data, self.preparation, say)
        differences = refuse_others(data, identifier.core, self.accept)
        if self.begin_at is Beginning.onset:
            data = told(with_onsets(data, self.preparation), say)
            differences = refuse_others(data, identifier.core, self.accept)  # the trigger is another one
        cropped = fitted(
            data,
            identifier.core,
            begin_at="trigger" if self.begin_at is Beginning.onset else self.begin_at.value,
            lead_s=self.lead_s,
            on_short=self.on_short.value,
        )
        return cropped if cropped is data else told(cropped, say), differences


@guarded
@taking(Recordings, Fitting)
def identify(
    recordings: Recordings,
    fitting: Fitting,
    *,
    json: Annotated[Path | None, option("--json", OUTPUT, "Write answers with their rankings.")] = None,
    csv: Annotated[Path | None, option("--csv", OUTPUT, "Write answers as a table.")] = None,
    force: Force = False,
    quiet: Annotated[bool, option("--quiet", OUTPUT, "Print recording and answer only.")] = False,
) -> None:
    """Name the material in each recording; see `TEXT`."""
    for path in (recordings.model, *recordings.paths):
        check_outputs(("--json", json, JSON_FILE), ("--csv", csv, ANSWERS), source=path, force=force)

    from granular_id.identifier import Identifier

    try:
        identifier = Identifier.load(recordings.model)
    except (OSError, ValueError) as error:
        if recordings.is_named or not any(path.suffix in MODELS for path in recordings.paths):
            raise
        raise ValueError(
            f"{words_of(error)}; the model comes first: granular-id identify MODEL PATH..."
        ) from None
    data = recordings.load(quiet=quiet)
    data, differences = fitting.taken(data, identifier, quiet=quiet)

    from granular_id.cli.session import print_table
    from granular_id.identifier import identify_all
    from granular_id.recording import other_setup

    answers = identify_all(identifier, data, differences)
    console = Console(highlight=False)
    if quiet:
        for answer in answers:
            said = f"like no known material, nearest {answer.label}" if answer.unknown else answer.label
            typer.echo(f"{answer.name}\t{said}")  # rich would turn the tab into blanks
        for difference in differences:
            Console(stderr=True).print(
                f"warning: {other_setup(difference)}", style="yellow", soft_wrap=True, markup=False
            )
        if answers.synthetic:
            Console(stderr=True).print(answers.synthetic, style="bold yellow")
    else:
        print_table(console, answers.table(), strong=bool(answers.synthetic))
    if json is not None:
        from granular_id._files import write_json

        write_json(json, answers.to_dict())
    if csv is not None:
        answers.to_csv(csv)
    say_written(console, [path for path in (json, csv) if path is not None], None)


identify.__doc__ = TEXT

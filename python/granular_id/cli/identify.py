"""``granular-id identify``: name the materials in recordings, with a trained model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from granular_id._files import MODELS, write_json
from granular_id.cli.errors import words_of
from granular_id.cli.options import FORCE, command, option
from granular_id.cli.outputs import (
    ANSWERS,
    JSON_FILE,
    check_outputs,
    print_table,
    show,
    warn_of_setups,
    write_files,
)
from granular_id.cli.recordings import (
    ACCEPT,
    PANEL,
    Difference,
    ReadingOptions,
    StepOptions,
    say_loaded,
    say_step,
)

if TYPE_CHECKING:
    from granular_id.identifier import Identifier
    from granular_id.recording import Dataset

OUTPUT = "Output"


@dataclass(kw_only=True)
class Recordings(ReadingOptions):
    """A model and the recordings to identify."""

    files: list[Path] | None = typer.Argument(
        metavar="MODEL PATH",
        help="Model file, then folders and files of recordings.",
        show_default=False,
        default=None,
    )
    model: Path | None = option(PANEL, "Model file; all arguments are recordings then.", "--model", "-m")

    def __post_init__(self) -> None:
        super().__post_init__()
        given = [*([] if self.model is None else [self.model]), *(self.files or [])]
        if self.model is not None and not self.files:
            raise ValueError("no recordings given: granular-id identify -m MODEL PATH...")
        if len(given) < 2:
            got = f"{given[0]} alone" if given else "neither"
            raise ValueError(
                f"a model file and recordings are needed, got {got}: granular-id identify MODEL PATH..., with the "
                "MODEL that granular-id train wrote"
            )
        self.model_file, *self.paths = given

    def load_model(self) -> Identifier:
        """Read the model; where it may stand in another place, say which is the first."""
        from granular_id.identifier import Identifier

        try:
            return Identifier.load(self.model_file)
        except (OSError, ValueError) as error:
            if self.model is not None or not any(path.suffix in MODELS for path in self.paths):
                raise
            raise ValueError(
                f"{words_of(error)}; the model comes first: granular-id identify MODEL PATH..."
            ) from None

    def load(self, identifier: Identifier, *, quiet: bool) -> Dataset:
        """Read the recordings into one data set and say what was read; when quiet, only what was skipped.

        Without ``--axes`` files have the axes of the model.
        """
        from granular_id.recording import AXES, Dataset

        axes = None if identifier.axes == AXES else identifier.axes
        parts = [self.load_path(path, axes=axes, quiet=quiet) for path in self.paths]
        data = parts[0]
        if len(parts) > 1:
            data = Dataset.concatenate([_placed(*each) for each in zip(self.paths, parts, strict=True)])
        say_loaded(data, quiet=quiet)
        return data


def _placed(path: Path, data: Dataset) -> Dataset:
    """Name the recordings of one of several paths after it."""

    def place(name: str) -> str:
        if path.is_dir():
            return str(path / name)
        return str(path) if len(data) == 1 else f"{path}: {name}"

    return type(data)([replace(one, name=place(one.name)) for one in data], data.history)


@dataclass(kw_only=True)
class Fitting(StepOptions):
    """How recordings come to the rate and length of the model."""

    begin_at: Literal["auto", "first", "trigger", "onset"] = option(
        PANEL,
        "Where the model's length begins: the first sample, the stored trigger, the onset of motion found in "
        "the forces; auto: as in the training.",
        default="auto",
    )
    lead_s: float | None = option(PANEL, "Seconds ahead of trigger or onset. Default: as in the training.")
    accept: list[Difference] | None = option(PANEL, ACCEPT)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lead_s is not None and self.begin_at == "first":
            raise ValueError("--lead-s is time kept ahead of a trigger: leave it out, or --begin-at first")
        if self.onsets and self.begin_at != "onset":
            raise ValueError("--onset-at states an onset, but nothing begins there: add --begin-at onset")

    def taken(self, data: Dataset, identifier: Identifier, *, quiet: bool) -> tuple[Dataset, tuple[str, ...]]:
        """Bring recordings to the rate and length of a model, saying what each step did; return how they differ."""
        from granular_id.identifier import check_recordings, cropped_to_model

        accepted = [one.value for one in self.accept or []]
        data = self.resampled(data, quiet=quiet)
        differences = check_recordings(data, identifier.core, accepted)
        if self.begin_at == "onset":
            data = say_step(self.with_onsets(data), quiet=quiet)
            differences = check_recordings(data, identifier.core, accepted)  # the trigger is another one
        cropped = cropped_to_model(
            data,
            identifier.core,
            begin_at="trigger" if self.begin_at == "onset" else self.begin_at,
            lead_s=self.lead_s,
            on_short=self.on_short,
        )
        return cropped if cropped is data else say_step(cropped, quiet=quiet), differences


@command
def identify(
    recordings: Recordings,
    fitting: Fitting,
    *,
    json: Path | None = option(OUTPUT, "Write answers with their rankings."),
    csv: Path | None = option(OUTPUT, "Write answers as a table."),
    force: bool = FORCE,
    quiet: bool = option(OUTPUT, "Print recording and answer only.", "--quiet", default=False),
) -> None:
    """Name the material in each recording, with a model that `granular-id train` has written.

    PATH is a file or folder of any format, as for `granular-id evaluate`; labels are not needed. Where
    recordings have some that the model knows, its answers are compared with them.

    Recordings must have the rate of the model (`granular-id model info MODEL`) and at least its length.
    Longer ones begin as those of the training: at their stored trigger, less the rest ahead of it, or at
    their first sample; --begin-at says otherwise.

    A model knows what its recordings were made with. Another frame or sign is refused, another sensor,
    filter, tool, trigger or speed is said; what is not known is not compared. `--accept` takes what is the
    same under another name.

    Examples:

    `granular-id identify kitchen.safetensors fresh`
    `granular-id identify -m kitchen.safetensors push_1.npz push_2.csv --csv answers.csv`
    `granular-id identify kitchen.safetensors bags --rate-hz 500 --begin-at onset --lead-s 0.1`
    """
    for path in (recordings.model_file, *recordings.paths):
        check_outputs(("--json", json, JSON_FILE), ("--csv", csv, ANSWERS), source=path, force=force)
    identifier = recordings.load_model()
    data, differences = fitting.taken(recordings.load(identifier, quiet=quiet), identifier, quiet=quiet)

    from granular_id.identifier import identify_all

    answers = identify_all(identifier, data, differences)
    if quiet:
        for answer in answers:
            said = f"like no known material, nearest {answer.label}" if answer.unknown else answer.label
            typer.echo(f"{answer.name}\t{said}")  # rich would turn the tab into blanks
        warn_of_setups(differences, err=True)
        if answers.synthetic:
            show(answers.synthetic, "bold yellow", err=True)
    else:
        print_table(answers.table(), strong=bool(answers.synthetic))
    write_files((json, lambda path: write_json(path, answers.to_dict())), (csv, answers.to_csv))

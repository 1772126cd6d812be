"""``granular-id identify``: name the materials in recordings, with a trained model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import typer

from granular_id._core import GranularIdError
from granular_id._files import MODELS, check_source, write_json
from granular_id._text import counted
from granular_id.cli.archive import WorkerOptions, check_is_archive, typed_reader, working_on
from granular_id.cli.errors import words_of
from granular_id.cli.options import FORCE, command, given_flags, option, positive
from granular_id.cli.outputs import (
    ANSWERS,
    JSON_FILE,
    PICTURE,
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
    from granular_id.archive import Extraction
    from granular_id.identifier import Identifier, Timeline
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
            raise GranularIdError("no recordings given: granular-id identify -m MODEL PATH...")
        if len(given) < 2:
            got = f"{given[0]} alone" if given else "neither"
            raise GranularIdError(
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
            raise GranularIdError(
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

    answers_over_all: ClassVar[bool] = True

    begin_at: Literal["auto", "first", "trigger", "onset"] = option(
        PANEL,
        "Where the model's length begins: the first sample, the stored trigger, the onset of motion found in "
        "the forces; auto: as in the training.",
        default="auto",
    )
    lead_s: float | None = option(PANEL, "Seconds ahead of trigger or onset. Default: as in the training.")
    accept: list[Difference] | None = option(PANEL, ACCEPT)
    hop_s: float | None = option(
        PANEL,
        "Answer over all of each recording: every so many seconds, about the model's length before.",
        "--hop-s",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        positive("--hop-s", self.hop_s)
        if self.hop_s is not None and (self.begin_at != "auto" or self.lead_s is not None):
            unused = "--lead-s" if self.begin_at == "auto" else "--begin-at"
            raise GranularIdError(
                f"{unused} says where the one answer begins; with --hop-s there are many: leave it out"
            )
        if self.lead_s is not None and self.begin_at == "first":
            raise GranularIdError(
                "--lead-s is time kept ahead of a trigger: leave it out, or --begin-at first"
            )
        if self.onsets and self.begin_at != "onset":
            raise GranularIdError(
                "--onset-at states an onset, but nothing begins there: add --begin-at onset"
            )

    @property
    def accepted(self) -> list[str]:
        """What may differ from the training."""
        return [one.value for one in self.accept or []]

    def taken(self, data: Dataset, identifier: Identifier, *, quiet: bool) -> tuple[Dataset, tuple[str, ...]]:
        """Bring recordings to the length of a model, saying what each step did; return how they differ."""
        wanted, accepted = identifier.requirements, self.accepted
        differences = wanted.check(data, accepted)
        if self.begin_at == "onset":
            data = say_step(self.with_onsets(data), quiet=quiet)
            differences = wanted.check(data, accepted)  # the trigger is another one
        cropped = wanted.crop(
            data,
            begin_at="trigger" if self.begin_at == "onset" else self.begin_at,
            lead_s=self.lead_s,
            on_short=self.on_short,
            over_all=self.answers_over_all,
        )
        return cropped if cropped is data else say_step(cropped, quiet=quiet), differences

    def over_all(self, data: Dataset, identifier: Identifier, *, quiet: bool) -> list[Timeline]:
        """Answer over all of each recording, but those that are too short where these are to be left out."""
        whole = [one for one in data if one.n_samples >= identifier.n_samples or self.on_short == "raise"]
        if not whole:
            raise GranularIdError(f"every recording is shorter than the model's {_window_s(identifier):g} s")
        if len(whole) < len(data) and not quiet:
            show(
                f"left out {counted(len(data) - len(whole))} shorter than the model's {_window_s(identifier):g} s"
            )
        return [identifier.predict_over(one, self.hop_s, accept=self.accepted) for one in whole]


def _window_s(identifier: Identifier) -> float:
    return identifier.n_samples / identifier.rate_hz


def _say_how_little(data: Dataset, identifier: Identifier, *, quiet: bool) -> None:
    """Say of recordings much longer than the model's length that most of them was not looked at."""
    window_s, longest_s = _window_s(identifier), max(one.n_samples for one in data) / identifier.rate_hz
    if longest_s >= 2 * window_s:
        show(
            f"note: of {'the recording' if len(data) == 1 else 'each recording'} only {window_s:g} s of up to "
            f"{longest_s:g} s were looked at; --hop-s {window_s:g} answers over all of it",
            "yellow",
            err=quiet,
        )


@command
def identify(
    recordings: Recordings,
    fitting: Fitting,
    workers: WorkerOptions,
    *,
    output: Path | None = option(
        OUTPUT, "Of an archive: folder to write the answers into, or to go on with.", "--output", "-o"
    ),
    json: Path | None = option(OUTPUT, "Write answers with their rankings."),
    csv: Path | None = option(OUTPUT, "Write answers as a table; with --hop-s each of them."),
    figure: Path | None = option(OUTPUT, "Draw the answers over one recording; needs --hop-s."),
    force: bool = FORCE,
    quiet: bool = option(OUTPUT, "Print recording and answer only.", "--quiet", default=False),
) -> None:
    """Name the material in each recording, with a model that `granular-id train` has written.

    PATH is a file or folder of any format, as for `granular-id evaluate`; labels are not needed. Where
    recordings have some that the model knows, its answers are compared with them.

    Recordings must have the rate of the model (`granular-id model info MODEL`) and at least its length.
    Longer ones begin as those of the training: at their stored trigger, less the rest ahead of it, or at
    their first sample; --begin-at says otherwise. With --hop-s long recordings are answered from beginning
    to end, each answer about the model's length before it; --figure draws them.

    A model knows what its recordings were made with. Another frame or sign is refused, another sensor,
    filter, tool, trigger or speed is said; what is not known is not compared. `--accept` takes what is the
    same under another name.

    With -o PATH is an archive of any size: its answers become Parquet files in that folder, each recording
    exactly once, by threads or a Dask cluster (see `granular-id extract`). After a Ctrl-C or a crash the same
    command does what is missing.

    Examples:

    `granular-id identify kitchen.safetensors fresh`
    `granular-id identify -m kitchen.safetensors push_1.npz push_2.csv --csv answers.csv`
    `granular-id identify kitchen.safetensors bags --rate-hz 500 --begin-at onset --lead-s 0.1`
    `granular-id identify grounds.safetensors drive.csv --hop-s 0.5 --figure answers.png`
    `granular-id identify kitchen.safetensors fleet -o answers --jobs 8`
    """
    if output is not None:
        _refuse_beside_output(recordings, fitting, json=json, csv=csv, figure=figure, force=force)
        _answer_archive(recordings, fitting, workers, output, quiet=quiet)
        return
    if flags := given_flags(workers):
        raise GranularIdError(f"{flags[0]} is about archives: add -o OUT, a folder for the answers")
    if figure is not None and fitting.hop_s is None:
        raise GranularIdError("--figure draws answers over time: add --hop-s")
    outputs = ("--json", json, JSON_FILE), ("--csv", csv, ANSWERS), ("--figure", figure, PICTURE)
    for path in (recordings.model_file, *recordings.paths):
        check_outputs(*outputs, source=path, force=force)
        check_source(path)  # before imports that take longer than a look
    identifier = recordings.load_model()
    loaded = recordings.load(identifier, quiet=quiet)
    data = fitting.resample(loaded)
    if data is not loaded:
        say_step(data, quiet=quiet)
    if fitting.hop_s is None:
        _answer_each(data, fitting, identifier, json, csv, quiet=quiet)
    else:
        _answer_over(data, fitting, identifier, json, csv, figure, quiet=quiet)


_OF_ARCHIVES = ("--model", "--accept")


def _refuse_beside_output(recordings: Recordings, fitting: Fitting, **others: Path | bool | None) -> None:
    """Refuse what is not for answers into a folder."""
    if len(recordings.paths) > 1:
        raise GranularIdError(
            f"-o takes the answers about one archive, got {len(recordings.paths)}: name one"
        )
    for name, value in others.items():
        if value:
            raise GranularIdError(
                f"--{name} does not go with -o, whose folder holds the answers: leave it out"
            )
    for flag in given_flags(recordings, fitting):
        if flag not in _OF_ARCHIVES:
            as_they_are = "recordings of an archive are answered as they are"
            raise GranularIdError(
                f"{flag} does not go with -o: {as_they_are}; granular-id data convert prepares them"
            )


def _answer_archive(
    recordings: Recordings, fitting: Fitting, workers: WorkerOptions, output: Path, *, quiet: bool
) -> None:
    """Write one answer for each recording of an archive, and print what they are in all."""
    (path,) = recordings.paths
    check_source(recordings.model_file)
    check_is_archive(path)
    from granular_id.archive import Answers, identify as identify_archive

    model = recordings.load_model()

    def say(done: Extraction, *, partial: bool = False) -> None:
        if done.n_partitions and not quiet:
            there = Answers(output, partial=partial)
            print_table(there.summary(), strong=there.model.synthetic)
            show("")
        show(str(done))
        if done.n_partitions:
            show(f"read them with: {typed_reader('Answers', output, partial=partial)}  # .table")

    with working_on(path, say):
        answers = identify_archive(
            path,
            model,
            output,
            accept=fitting.accepted,
            progress=not quiet,
            **workers.given(),
        )
    if answers.extraction is not None:
        say(answers.extraction)


def _answer_each(
    data: Dataset,
    fitting: Fitting,
    identifier: Identifier,
    json: Path | None,
    csv: Path | None,
    *,
    quiet: bool,
) -> None:
    """Print and write one answer for each recording."""
    from granular_id.identifier import identify_all

    taken, differences = fitting.taken(data, identifier, quiet=quiet)
    answers = identify_all(identifier, taken, differences)
    if quiet:
        for answer in answers.each():
            nearest = "like no known material, nearest " if answer["unknown"] else ""
            typer.echo(f"{answer['name']}\t{nearest}{answer['label']}")  # rich would turn the tab into blanks
        warn_of_setups(differences, err=True)
        if answers.synthetic:
            show(answers.synthetic, "bold yellow", err=True)
    else:
        print_table(answers.table(), strong=bool(answers.synthetic))
    _say_how_little(data, identifier, quiet=quiet)
    write_files((json, lambda path: write_json(path, answers.to_dict())), (csv, answers.to_csv))


def _answer_over(
    data: Dataset,
    fitting: Fitting,
    identifier: Identifier,
    json: Path | None,
    csv: Path | None,
    figure: Path | None,
    *,
    quiet: bool,
) -> None:
    """Print and write answers over all of each recording: of one in a table, of several a line each."""
    from granular_id.identifier import notes_of_all, write_csv

    if figure is not None and len(data) > 1:
        raise GranularIdError(
            f"--figure draws one recording, got {len(data)}: name its file, or leave --figure out"
        )
    each = fitting.over_all(data, identifier, quiet=quiet)
    if quiet:
        for answers in each:
            typer.echo(f"{answers.name}\t{answers.sentence()}")
        warn_of_setups(dict.fromkeys(one for answers in each for one in answers.differences), err=True)
        if each[0].synthetic:
            show(each[0].synthetic, "bold yellow", err=True)
    elif len(each) == 1:
        print_table(each[0].table(), strong=bool(each[0].synthetic))
    else:
        for answers in each:
            show(str(answers))
        for note in notes_of_all(each):
            show(note)
        warn_of_setups(dict.fromkeys(one for answers in each for one in answers.differences))

    def draw(path: Path) -> None:
        from granular_id.plotting import plot_answers

        plot_answers(each[0], next(one for one in data if one.name == each[0].name), path=path)

    write_files(
        (json, lambda path: write_json(path, {"recordings": [one.to_dict() for one in each]})),
        (csv, lambda path: write_csv(path, each)),
        (figure, draw),
    )

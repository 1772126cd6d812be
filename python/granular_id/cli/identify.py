"""``granular-id identify``: name the materials in recordings, with a trained model."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from granular_id._core import GranularIdError
from granular_id._files import MODELS, check_source
from granular_id._text import known_label
from granular_id.cli import options as opt
from granular_id.cli.archive import check_is_archive, say_made, working_on
from granular_id.cli.outputs import (
    ANSWERS,
    PICTURE,
    ROOM,
    check_outputs,
    drawing,
    json_of,
    numbers,
    print_table,
    show,
    warn_of_setups,
    write_files,
)
from granular_id.cli.recordings import about, read, say_step

if TYPE_CHECKING:
    from granular_id.archive import Extraction
    from granular_id.identifier import Batch, Identifier, Timeline
    from granular_id.recording import Dataset

_MOST_LINES, _ABOUT_LENGTH = 12, 6
"""Of answers over several recordings; of what was cropped, and what was not looked at."""

_OF_READING = ("units", "csv", "id", "time", "time_unit", "array", "topic", "rate_hz")


def identify(
    model: opt.Model,
    paths: Annotated[list[Path], Argument(metavar="PATH...", help="Recordings, or an archive.")],
    *,
    hop_s: Annotated[
        float | None, Option(callback=opt.POSITIVE, help="Answer over all, every so often.")
    ] = None,
    accept: opt.Accept = None,
    output: Annotated[Path | None, Option("--output", "-o", help="Folder for an archive's answers.")] = None,
    jobs: opt.Jobs = None,
    scheduler: opt.Scheduler = None,
    json: opt.Json = None,
    csv: Annotated[Path | None, Option(help="Write every answer as a table.")] = None,
    figure: opt.Figure = None,
    force: opt.Force = False,
    details: opt.Details = False,
    quiet: opt.Quiet = False,
) -> None:
    """Name the material in each recording, with a model that `granular-id train` has written.

    Labels are not needed; where the model knows them, its answers are compared. What was chosen to read the recordings
    of the training (axes, units ...) is taken for these, too. Longer ones begin as those of the training: at their
    trigger, less the rest ahead of it, or at their first sample. With `--hop-s` they are answered to their end.

    Another frame or sign than in the training is refused unless `--accept` names it; another sensor, filter, tool,
    trigger or speed is a warning.

    With -o PATH is an archive of any size, each recording is answered exactly once, and the same command goes on after
    a Ctrl-C or a crash: see `granular-id extract`.

    Examples:

    - `granular-id identify kitchen.safetensors fresh`
    - `granular-id identify kitchen.safetensors push_1.npz push_2.csv --csv answers.csv`
    - `granular-id identify grounds.safetensors drive.csv --hop-s 0.5 --figure answers.png`
    - `granular-id identify kitchen.safetensors fleet -o answers --jobs 8`
    """
    if model.suffix not in MODELS and any(path.suffix in MODELS for path in paths):
        raise GranularIdError(f"MODEL comes first, got {model}: granular-id identify MODEL PATH...")
    accepted = [one.value for one in accept or ()]
    if output is not None:
        beside = {"--json": json, "--csv": csv, "--figure": figure, "--hop-s": hop_s, "--force": force}
        opt.refuse(beside, "does not go with -o, whose folder holds the answers")
        if len(paths) > 1:
            raise GranularIdError(f"-o takes the answers about one archive, got {len(paths)}: name one")
        n_jobs = opt.jobs_of(jobs, scheduler)
        options = {"accept": accepted, "n_jobs": n_jobs, "scheduler": scheduler, "progress": not quiet}
        _answer_archive(model, paths[0], output, quiet=quiet, **options)
        return
    opt.refuse(
        {"--jobs": jobs, "--scheduler": scheduler}, "is about archives and -o, a folder for the answers"
    )
    if hop_s is None:
        opt.refuse({"--figure": figure}, "draws answers over all of a recording, with --hop-s")
    outputs = ("--json", json, json_of("answers")), ("--csv", csv, ANSWERS), ("--figure", figure, PICTURE)
    for path in (model, *paths):
        check_outputs(*outputs, source=path, force=force)
    from granular_id.identifier import Identifier, write_csv

    identifier = Identifier.load(model)
    data = _read_all(paths, identifier, quiet=quiet)
    with about(paths[0]):
        if hop_s is None:
            n_files = (json is not None) + (csv is not None)
            answers = _answer_each(
                data, identifier, accepted, details=details, quiet=quiet, room=ROOM - n_files
            )
            write_files((json, numbers("answers", answers.to_dict)), (csv, answers.to_csv))
            return
        if figure is not None and len(data) > 1:
            raise GranularIdError(
                f"--figure draws one recording, got {len(data)}: name its file, or leave it out"
            )
        each = [identifier.predict_over(one, hop_s, accept=accepted) for one in data]
    _print_over(each, details=details, quiet=quiet)
    write_files(
        (json, numbers("answers", lambda: {"recordings": [one.to_dict() for one in each]})),
        (csv, lambda path: write_csv(path, each)),
        (figure, drawing("plot_answers", each[0], data[0])),
    )


def read_for(path: Path, identifier: Identifier, *, quiet: bool) -> Dataset:
    """Read recordings as those of a model's training were read, or else without any option but its axes."""
    from granular_id.io import RecordingFileError
    from granular_id.recording import AXES

    axes: dict[str, Any] = {} if identifier.axes == AXES else {"axes": identifier.axes}
    steps = (step["parameters"] for step in identifier.trained.get("history", ()) if step["step"] == "load")
    chosen: dict[str, Any] = next(steps, {})
    known = {name: chosen[name] for name in _OF_READING if name in chosen}
    if "csv" in known:
        known["csv"] = {name: ast.literal_eval(text) for name, text in known["csv"].items()}
    if path.is_dir():
        places = ("folder", "parent", "file")
        known |= {name: chosen[name] for name in ("label", "session") if chosen.get(name) in places}
    try:
        data = read(path, quiet=quiet, **known, **axes)
    except GranularIdError as error:
        if isinstance(error, RecordingFileError) and {"array", "topic"} & known.keys():
            raise  # another array or topic is another signal
        try:
            data = read(path, quiet=quiet, **axes)
        except GranularIdError:
            raise error from None
    return _labelled_as(data, identifier.classes)


def _labelled_as(data: Dataset, classes: Sequence[str]) -> Dataset:
    """Call materials as a model does: names of files and folders have underscores where its labels have blanks."""
    from granular_id.recording import Dataset

    other = {label: known_label(label, classes) for label in data.labels if label not in classes}
    if all(label == known for label, known in other.items()):
        return data
    made = [replace(one, label=other.get(one.label or "", one.label)) for one in data]
    return Dataset(made, data.history)


def _read_all(paths: list[Path], identifier: Identifier, *, quiet: bool) -> Dataset:
    """Read the recordings of several paths into one data set, named after their paths."""
    from granular_id.recording import Dataset

    parts = [read_for(path, identifier, quiet=quiet) for path in paths]
    if len(parts) == 1:
        return parts[0]

    def place(path: Path, data: Dataset, name: str) -> str:
        return str(path / name) if path.is_dir() else str(path) if len(data) == 1 else f"{path}: {name}"

    return Dataset.concatenate(
        [
            Dataset([replace(one, name=place(path, data, one.name)) for one in data], data.history)
            for path, data in zip(paths, parts, strict=True)
        ]
    )


def _answer_each(
    data: Dataset, identifier: Identifier, accepted: list[str], *, details: bool, quiet: bool, room: int
) -> Batch:
    """Print one answer for each recording, and return them."""
    from granular_id.identifier import identify_all

    taken, differences = fitted(data, identifier, accepted, quiet=quiet)
    room -= _ABOUT_LENGTH * (taken is not data)
    answers = identify_all(identifier, taken, differences)
    if quiet:
        for answer in answers.each():
            nearest = "like no known material, nearest " if answer["unknown"] else ""
            typer.echo(f"{answer['name']}\t{nearest}{answer['label']}")  # rich would turn the tab into blanks
        _warn(differences, answers.synthetic)
    else:
        print_table(answers.table(), strong=bool(answers.synthetic), details=details, room=room)
    window_s = identifier.n_samples / identifier.rate_hz
    longest_s = max(one.n_samples for one in data) / identifier.rate_hz
    if longest_s >= 2 * window_s:
        looked = f"note: only {window_s:g} s of up to {longest_s:g} s were looked at"
        show(f"{looked}; --hop-s {window_s:g} answers over all", "yellow", err=quiet)
    return answers


def fitted(
    data: Dataset, identifier: Identifier, accepted: list[str], *, quiet: bool, over_all: bool = True
) -> tuple[Dataset, tuple[str, ...]]:
    """Bring recordings to the length of a model; return how their set-up differs, too."""
    wanted = identifier.requirements
    differences = wanted.check(data, accepted)
    cropped = wanted.crop(data, over_all=over_all)
    if cropped is not data and not quiet:
        say_step(cropped, err=True)
    return cropped, differences


def _warn(differences: Iterable[str], synthetic: str) -> None:
    warn_of_setups(differences, err=True)
    if synthetic:
        show(synthetic, "bold yellow", err=True)


def _print_over(each: list[Timeline], *, details: bool, quiet: bool) -> None:
    """Print answers over all of each recording: of one in a table, of several a line each."""
    from granular_id.identifier import notes_of_all

    synthetic, differences = (
        each[0].synthetic,
        dict.fromkeys(one for all_ in each for one in all_.differences),
    )
    if quiet:
        for answers in each:
            typer.echo(f"{answers.name}\t{answers.sentence()}")
        _warn(differences, synthetic)
    elif len(each) == 1:
        print_table(each[0].table(), strong=bool(synthetic), details=details)
    else:
        show("\n".join(map(str, each)), most=None if details else _MOST_LINES)
        show("\n".join(notes_of_all(each)))
        warn_of_setups(differences)


def _answer_archive(model: Path, archive: Path, output: Path, *, quiet: bool, **options: Any) -> None:
    """Write one answer for each recording of an archive, and print what they are in all."""
    check_source(model)
    check_is_archive(archive)
    from granular_id.archive import Answers, identify as identify_archive
    from granular_id.identifier import Identifier

    def say(done: Extraction, *, partial: bool = False) -> None:
        if done.n_partitions and not quiet:
            there = Answers(output, partial=partial)
            print_table(there.summary(), strong=there.model.synthetic, details=False)
        say_made("Answers", output, done, partial=partial)

    with working_on(archive, say):
        answers = identify_archive(archive, Identifier.load(model), output, **options)
    if answers.extraction is not None:
        say(answers.extraction)

"""``granular-id identify``: name the materials in recordings, with a trained model."""

from __future__ import annotations

import ast
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from granular_id._core import GranularIdError
from granular_id._files import MODELS, check_source, write_json
from granular_id.cli.archive import check_is_archive, reader_line, working_on
from granular_id.cli.options import (
    Accept,
    Details,
    Figure,
    Force,
    Jobs,
    Json,
    Model,
    Quiet,
    Scheduler,
    within,
)
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
from granular_id.cli.recordings import about, read, say_step

if TYPE_CHECKING:
    from granular_id.archive import Extraction
    from granular_id.identifier import Identifier
    from granular_id.recording import Dataset

_MOST_LINES = 12

_OF_READING = ("units", "csv", "id", "time", "time_unit", "array", "topic", "rate_hz")


def identify(
    model: Model,
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Files and folders of recordings, or an archive.")
    ],
    *,
    hop_s: Annotated[
        float | None,
        typer.Option(
            callback=within(0),
            help="Answer over all of each recording: every so many seconds, about those before.",
        ),
    ] = None,
    accept: Accept = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Of an archive: folder to write the answers into, or to go on with."
        ),
    ] = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    json: Json = None,
    csv: Annotated[Path | None, typer.Option(help="Write every answer as a table.")] = None,
    figure: Figure = None,
    force: Force = False,
    details: Details = False,
    quiet: Quiet = False,
) -> None:
    """Name the material in each recording, with a model that `granular-id train` has written.

    Labels are not needed. Where recordings have some that the model knows, its answers are compared with them.
    Axes, units and what else was chosen to read the recordings of the training is taken for these, too.

    Recordings must have the rate of the model (`granular-id model MODEL`) and at least its length. Longer ones
    begin as those of the training: at their stored trigger, less the rest ahead of it, or at their first sample. With
    `--hop-s` long recordings are answered from beginning to end; `--figure` draws the answers over one.

    A model knows what its recordings were made with. Another frame or sign is refused, another sensor,
    filter, tool, trigger or speed is said; what is not known is not compared. `--accept` takes what is the
    same under another name.

    With -o PATH is an archive of any size: its answers become Parquet files in that folder, each recording
    exactly once, by threads or a Dask cluster (see `granular-id extract`). After a Ctrl-C or a crash the same
    command does what is missing.

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
        _answer_archive(model, paths, output, beside, accepted, jobs, scheduler, quiet=quiet)
        return
    if jobs is not None or scheduler is not None:
        raise GranularIdError("--jobs and --scheduler are about archives: add -o, a folder for the answers")
    if figure is not None and (hop_s is None or len(paths) > 1):
        raise GranularIdError("--figure draws answers over one recording: add --hop-s, and name one PATH")
    for path in (model, *paths):
        check_outputs(
            *(("--json", json, JSON_FILE), ("--csv", csv, ANSWERS), ("--figure", figure, PICTURE)),
            source=path,
            force=force,
        )
        check_source(path)  # before imports that take longer than a look
    from granular_id.identifier import Identifier

    identifier = Identifier.load(model)
    data = _read_all(paths, identifier, quiet=quiet)
    with about(paths[0]):
        if hop_s is None:
            _answer_each(data, identifier, accepted, json, csv, details=details, quiet=quiet)
        else:
            _answer_over(data, identifier, accepted, hop_s, json, csv, figure, details=details, quiet=quiet)


def read_for(path: Path, identifier: Identifier, *, quiet: bool) -> Dataset:
    """Read recordings as those of a model's training were read, or else without any option but its axes."""
    known = read_as(identifier, path)
    try:
        return read(path, quiet=quiet, **known)
    except GranularIdError:
        if not known.keys() - {"axes"}:
            raise
        with suppress(GranularIdError):
            return read(path, quiet=quiet, axes=known.get("axes"))
        raise


def read_as(identifier: Identifier, path: Path) -> dict[str, Any]:
    """Return what was chosen to read the recordings of a model's training; where labels stand in folders only."""
    from granular_id.recording import AXES

    steps = (step["parameters"] for step in identifier.trained.get("history", ()) if step["step"] == "load")
    chosen: dict[str, Any] = next(steps, {})
    known = {name: chosen[name] for name in _OF_READING if name in chosen}
    if "csv" in known:
        known["csv"] = {name: ast.literal_eval(text) for name, text in known["csv"].items()}
    if path.is_dir():
        places = ("folder", "parent", "file")
        known |= {name: chosen[name] for name in ("label", "session") if chosen.get(name) in places}
    return known | ({} if identifier.axes == AXES else {"axes": identifier.axes})


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
    data: Dataset,
    identifier: Identifier,
    accepted: list[str],
    json: Path | None,
    csv: Path | None,
    *,
    details: bool,
    quiet: bool,
) -> None:
    """Print and write one answer for each recording."""
    from granular_id.identifier import identify_all

    taken, differences = fitted(data, identifier, accepted, quiet=quiet)
    answers = identify_all(identifier, taken, differences)
    if quiet:
        for answer in answers.each():
            nearest = "like no known material, nearest " if answer["unknown"] else ""
            typer.echo(f"{answer['name']}\t{nearest}{answer['label']}")  # rich would turn the tab into blanks
        _warn_quietly(differences, answers.synthetic)
    else:
        print_table(answers.table(), strong=bool(answers.synthetic), details=details)
    window_s, longest_s = _window_s(identifier), max(one.n_samples for one in data) / identifier.rate_hz
    if longest_s >= 2 * window_s:
        show(
            f"note: only {window_s:g} s of up to {longest_s:g} s were looked at; --hop-s {window_s:g} answers over all",
            "yellow",
            err=quiet,
        )
    write_files((json, lambda path: write_json(path, answers.to_dict())), (csv, answers.to_csv))


def fitted(
    data: Dataset, identifier: Identifier, accepted: list[str], *, quiet: bool, over_all: bool = True
) -> tuple[Dataset, tuple[str, ...]]:
    """Bring recordings to the length of a model; return how their set-up differs, too."""
    wanted = identifier.requirements
    differences = wanted.check(data, accepted)
    cropped = wanted.crop(data, over_all=over_all)
    if cropped is not data and not quiet:
        say_step(cropped)
    return cropped, differences


def _window_s(identifier: Identifier) -> float:
    return identifier.n_samples / identifier.rate_hz


def _warn_quietly(differences: Any, synthetic: str) -> None:
    warn_of_setups(differences, err=True)
    if synthetic:
        show(synthetic, "bold yellow", err=True)


def _answer_over(
    data: Dataset,
    identifier: Identifier,
    accepted: list[str],
    hop_s: float,
    json: Path | None,
    csv: Path | None,
    figure: Path | None,
    *,
    details: bool,
    quiet: bool,
) -> None:
    """Print and write answers over all of each recording: of one in a table, of several a line each."""
    from granular_id.identifier import notes_of_all, write_csv

    if figure is not None and len(data) > 1:
        raise GranularIdError(
            f"--figure draws one recording, got {len(data)}: name its file, or leave it out"
        )
    each = [identifier.predict_over(one, hop_s, accept=accepted) for one in data]
    differences = dict.fromkeys(one for answers in each for one in answers.differences)
    if quiet:
        for answers in each:
            typer.echo(f"{answers.name}\t{answers.sentence()}")
        _warn_quietly(differences, each[0].synthetic)
    elif len(each) == 1:
        print_table(each[0].table(), strong=bool(each[0].synthetic), details=details)
    else:
        show("\n".join(map(str, each)), most=None if details else _MOST_LINES)
        for note in notes_of_all(each):
            show(note)
        warn_of_setups(differences)

    def draw(path: Path) -> None:
        from granular_id.plotting import plot_answers

        plot_answers(each[0], next(one for one in data if one.name == each[0].name), path=path)

    write_files(
        (json, lambda path: write_json(path, {"recordings": [one.to_dict() for one in each]})),
        (csv, lambda path: write_csv(path, each)),
        (figure, draw),
    )


def _answer_archive(
    model: Path,
    paths: list[Path],
    output: Path,
    beside: dict[str, Any],
    accepted: list[str],
    jobs: int | None,
    scheduler: str | None,
    *,
    quiet: bool,
) -> None:
    """Write one answer for each recording of an archive, and print what they are in all."""
    if len(paths) > 1:
        raise GranularIdError(f"-o takes the answers about one archive, got {len(paths)}: name one")
    for name, value in beside.items():
        if value:
            raise GranularIdError(f"{name} does not go with -o, whose folder holds the answers: leave it out")
    check_source(model)
    check_is_archive(paths[0])
    from granular_id.archive import Answers, identify as identify_archive
    from granular_id.identifier import Identifier

    def say(done: Extraction, *, partial: bool = False) -> None:
        if done.n_partitions and not quiet:
            there = Answers(output, partial=partial)
            print_table(there.summary(), strong=there.model.synthetic, details=False)
        show(str(done))
        if done.n_partitions:
            show(f"read them with: {reader_line('Answers', output, partial=partial)}  # .table")

    with working_on(paths[0], say):
        answers = identify_archive(
            paths[0],
            Identifier.load(model),
            output,
            accept=accepted,
            progress=not quiet,
            n_jobs=-1 if jobs is None and scheduler is None else jobs,
            scheduler=scheduler,
        )
    if answers.extraction is not None:
        say(answers.extraction)

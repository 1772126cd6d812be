"""``granular-id adapt`` and ``recalibrate``: a model for another set-up, made of a model and recordings of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from granular_id._files import MODELS, check_source
from granular_id._text import counted
from granular_id.cli.identify import Fitting
from granular_id.cli.options import FORCE, command, count, option
from granular_id.cli.outputs import (
    MODEL,
    check_outputs,
    print_table,
    say_written,
    show,
    typed_command,
)
from granular_id.cli.recordings import ReadingOptions, say_loaded, say_step

if TYPE_CHECKING:
    from granular_id.identifier import Identifier
    from granular_id.recording import Dataset

METHOD, OUTPUT = "Method", "Output"


@dataclass(kw_only=True)
class Recordings(ReadingOptions):
    """A model, and recordings of the new set-up."""

    model: Path = typer.Argument(metavar="MODEL", help="Model file, from `granular-id train`.")
    path: Path = typer.Argument(
        metavar="RECORDINGS", help="Folder or file of recordings of the new set-up, of any format."
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.path.suffix in MODELS:
            raise ValueError(
                f"{self.path} is no recordings but a model file: MODEL comes first, then RECORDINGS"
            )

    def load(self, identifier: Identifier, *, quiet: bool) -> Dataset:
        """Read the recordings and say what was read; without ``--axes`` files have the axes of the model."""
        from granular_id.recording import AXES

        axes = None if identifier.axes == AXES else identifier.axes
        data = self.load_path(self.path, axes=axes, quiet=quiet)
        say_loaded(data, quiet=quiet)
        return data


@dataclass(kw_only=True)
class OneStretch(Fitting):
    """How recordings come to the rate and length of the model: one stretch of each."""

    answers_over_all = False
    hop_s: float | None = field(init=False, default=None)


NEW: Path = option(OUTPUT, "Model file to write: .safetensors.", "--output", "-o", default=...)
QUIET: bool = option(OUTPUT, "Print what was done only.", "--quiet", default=False)


@command
def adapt(
    recordings: Recordings,
    fitting: OneStretch,
    *,
    output: Path = NEW,
    all_materials: bool = option(
        METHOD, "The recordings hold all materials, about equally.", "--all-materials", default=False
    ),
    rounds: int | None = option(
        METHOD, "Rounds of self-training. Default: 2 with --all-materials, else 0.", callback=count(0)
    ),
    force: bool = FORCE,
    quiet: bool = QUIET,
) -> None:
    """Bring a model to another set-up (tool, mounting, zero, room) by recordings of it; labels are not needed.

    Three recordings at least, better ten of each of many materials: with one material the set-up cannot be
    told from the material, and the model gets worse. By default a common offset is taken away, whatever the
    shares of the materials.
    `--all-materials` declares that all are there, about equally often: that gains more, and loses where it
    is not so. Where recordings have labels that the model knows, the accuracy before and after is told.

    The new model is a file like any other, with other weights and its history (`granular-id model info`).
    What was measured on the old one is dropped: estimate, early answers, candidates, refusal of unknown
    materials, probabilities. MODEL stays as it is. A few labelled recordings of each material gain more:
    `granular-id recalibrate`.

    Recordings are read and cropped as by `granular-id identify`, which says what of the set-up is refused;
    `--accept` takes it.

    Examples:

    `granular-id adapt kitchen.safetensors fresh -o kitchen-new-tool.safetensors`
    `granular-id adapt kitchen.safetensors fresh -o kitchen-new-tool.safetensors --all-materials`
    `granular-id adapt kitchen.safetensors bags -o turned.safetensors --rate-hz 500 --begin-at onset --lead-s 0.1`
    """
    _make(
        recordings,
        fitting,
        output,
        lambda model, data: model.adapt(
            data, all_materials=all_materials, rounds=rounds, accept=fitting.accepted
        ),
        force=force,
        quiet=quiet,
    )


@command
def recalibrate(
    recordings: Recordings,
    fitting: OneStretch,
    *,
    output: Path = NEW,
    allow_missing: bool = option(
        METHOD, "Go on without some of the materials, which gain nothing.", "--allow-missing", default=False
    ),
    force: bool = FORCE,
    quiet: bool = QUIET,
) -> None:
    """Bring a model to another set-up by a few labelled recordings of each material; three of each are good.

    Each needs a label that the model knows (`granular-id model info MODEL`). What some materials show does
    not carry over to others: those that are missing are named, and refused without `--allow-missing`. MODEL
    may be one that `granular-id adapt` has written.

    What the new model keeps and drops, and how recordings are read and cropped: see `granular-id adapt`.
    The accuracy after is that of models made without the recordings that they name.

    Examples:

    `granular-id recalibrate kitchen.safetensors three_of_each -o kitchen-new-tool.safetensors`
    `granular-id recalibrate kitchen.safetensors some -o some.safetensors --allow-missing`
    """

    def make(model: Identifier, data: Dataset) -> Identifier:
        without = [one.name for one in data if one.label is None]
        if without:
            raise ValueError(
                f"{len(without)} of {counted(len(data))} {'has' if len(without) == 1 else 'have'} no label, the first "
                f"is {without[0]!r}: label them, or use granular-id adapt, which needs no labels"
            )
        return model.recalibrate(data, allow_missing=allow_missing, accept=fitting.accepted)

    _make(recordings, fitting, output, make, force=force, quiet=quiet)


def _make(
    recordings: Recordings,
    fitting: OneStretch,
    output: Path,
    make: Callable[[Identifier, Dataset], Identifier],
    *,
    force: bool,
    quiet: bool,
) -> None:
    """Read a model and recordings, make the new model, write it and say what became of it."""
    if not force and output.exists() and recordings.model.exists() and output.samefile(recordings.model):
        raise FileExistsError(
            f"--output {output} is MODEL itself: give the new model another name, or add --force to replace MODEL"
        )
    check_outputs(("--output", output, MODEL), source=recordings.path, force=force)
    for path in (recordings.model, recordings.path):
        check_source(path)  # before imports that take longer than a look

    from granular_id.identifier import Identifier, synthetic_words

    identifier = Identifier.load(recordings.model)
    loaded = recordings.load(identifier, quiet=quiet)
    data = fitting.resample(loaded)
    if data is not loaded:
        say_step(data, quiet=quiet)
    data, _ = fitting.taken(data, identifier, quiet=quiet)
    new = make(identifier, data)
    new.save(output)
    done = new.adaptations[-1]
    if quiet:
        show("\n".join(done.lines))
    else:
        print_table(done.table())
    if simulated := synthetic_words(recordings=data.is_synthetic, model=identifier.synthetic):
        show(f"{simulated}: this says nothing about real materials", "bold yellow", err=quiet)
    say_written([output])
    if not quiet:
        show(f"name materials with: {typed_command('identify', output, 'PATH')}")
        rest = () if new.lead_s is not None else ("--pre-s", "SECONDS")
        show(f"while the tool moves: {typed_command('live', '--model', output, '--source', 'URL', *rest)}")

"""``granular-id adapt``: a model for another set-up, made of a model and recordings of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from granular_id._core import GranularIdError
from granular_id._files import MODELS, check_source
from granular_id.cli.identify import Fitting
from granular_id.cli.options import FORCE, command, option
from granular_id.cli.outputs import MODEL, check_outputs, say_written, show, show_sentence, typed_command
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
            raise GranularIdError(
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


@command
def adapt(
    recordings: Recordings,
    fitting: OneStretch,
    *,
    output: Path = option(OUTPUT, "Model file to write: .safetensors.", "--output", "-o", default=...),
    labelled: bool = option(
        METHOD, "Take the labels of the recordings: a few of each material.", "--labelled", default=False
    ),
    all_materials: bool = option(
        METHOD, "The recordings hold all materials, about equally.", "--all-materials", default=False
    ),
    allow_missing: bool = option(
        METHOD,
        "With --labelled, go on without some of the materials, which gain nothing.",
        "--allow-missing",
        default=False,
    ),
    force: bool = FORCE,
    quiet: bool = option(OUTPUT, "Print what was done only.", "--quiet", default=False),
) -> None:
    """Bring a model to another set-up (tool, mounting, zero, room) by recordings of it, in one of two ways.

    `--labelled` takes the labels of a few recordings of each material; three of each are good. Each label is one that
    the model knows (`granular-id model info MODEL`). What some materials show does not carry over to others:
    those that are missing are named, and refused without `--allow-missing`.

    `--all-materials` needs no labels, and declares that the recordings hold all materials about equally often; three
    recordings a material at least, better ten. It loses where that is not so. Where recordings have
    labels that the model knows, the accuracy before and after is told.

    The new model is a file like any other, with other weights and a line on how it was made (`granular-id model info`).
    What was measured on the old one is dropped: estimate, early answers, candidates, refusal of unknown materials,
    probabilities. MODEL stays as it is, and may be one that `--all-materials` has made where labels follow.

    Recordings are read and cropped as by `granular-id identify`, which says what of the set-up is refused;
    `--accept` takes it.

    Examples:

    `granular-id adapt kitchen.safetensors three_of_each -o kitchen-new-tool.safetensors --labelled`
    `granular-id adapt kitchen.safetensors fresh -o kitchen-new-tool.safetensors --all-materials`
    `granular-id adapt kitchen.safetensors bags -o turned.safetensors --labelled --begin-at onset --lead-s 0.1`
    """
    if labelled == all_materials:
        came = "not both" if labelled else "neither is given"
        raise GranularIdError(
            "give --labelled, to take the labels of a few recordings of each material, or --all-materials, where the "
            f"recordings hold all materials about equally: {came}"
        )
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
    new = identifier.adapt(
        data,
        data.y if labelled else None,
        all_materials=all_materials,
        allow_missing=allow_missing,
        accept=fitting.accepted,
    )
    new.save(output)
    show_sentence(f"adapted {new.trained['adapted']}")
    if simulated := synthetic_words(recordings=data.is_synthetic, model=identifier.synthetic):
        show(f"{simulated}: this says nothing about real materials", "bold yellow", err=quiet)
    say_written([output])
    if not quiet:
        show(f"name materials with: {typed_command('identify', output, 'PATH')}")
        rest = () if new.lead_s is not None else ("--pre-s", "SECONDS")
        show(f"while the tool moves: {typed_command('live', '--model', output, '--source', 'URL', *rest)}")

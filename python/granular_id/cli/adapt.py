"""``granular-id adapt``: a model for another set-up, made of a model and recordings of it."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from granular_id._core import GranularIdError
from granular_id._files import MODELS, check_source
from granular_id.cli import options as opt
from granular_id.cli.identify import fitted, read_for
from granular_id.cli.outputs import MODEL, check_outputs, show
from granular_id.cli.recordings import about


def adapt(
    model: opt.Model,
    path: opt.Recordings,
    *,
    output: opt.NewModel,
    labelled: Annotated[
        bool, Option("--labelled", help="Take the labels of a few of each material.")
    ] = False,
    all_materials: Annotated[bool, Option("--all-materials", help="All materials, about equally.")] = False,
    allow_missing: Annotated[bool, Option("--allow-missing", help="Go on without some materials.")] = False,
    accept: opt.Accept = None,
    force: opt.Force = False,
    quiet: opt.Quiet = False,
) -> None:
    """Bring a model to another set-up (tool, mounting, zero, room) by recordings of it, in one of two ways.

    `--labelled` takes the labels of a few recordings of each material that the model knows; three of each are good.
    Missing materials are refused without `--allow-missing`, as what others show does not carry over to them.

    `--all-materials` needs no labels, and declares that the recordings hold all materials about equally often; three
    recordings a material at least, better ten. It loses where that is not so.

    The new model is a file like any other, with a line on how it was made (`granular-id model`). What was measured on
    the old one is dropped: estimate, early answers, candidates, refusal of unknown materials, probabilities.

    Examples:

    - `granular-id adapt kitchen.safetensors three_of_each -o kitchen-new-tool.safetensors --labelled`
    - `granular-id adapt kitchen.safetensors fresh -o kitchen-new-tool.safetensors --all-materials`
    """
    if path.suffix in MODELS:
        raise GranularIdError(f"{path} is no recordings but a model file: MODEL comes first, then PATH")
    if labelled == all_materials:
        came = "not both" if labelled else "neither is given"
        raise GranularIdError(
            "give --labelled, to take the labels of a few recordings of each material, or --all-materials, where the "
            f"recordings hold all materials about equally: {came}"
        )
    if not force and output.exists() and model.exists() and output.samefile(model):
        raise FileExistsError(
            f"--output {output} is MODEL itself: give the new model another name, or add --force to replace MODEL"
        )
    check_outputs(("--output", output, MODEL), source=path, force=force)
    check_source(model)

    from granular_id.identifier import Identifier, synthetic_words

    identifier = Identifier.load(model)
    accepted = [one.value for one in accept or ()]
    loaded = read_for(path, identifier, quiet=quiet)
    with about(path):
        data, _ = fitted(loaded, identifier, accepted, quiet=quiet, over_all=False)
        new = identifier.adapt(
            data,
            data.y if labelled else None,
            all_materials=all_materials,
            allow_missing=allow_missing,
            accept=accepted,
        )
    new.save(output)
    show(f"adapted {new.trained['adapted']}")
    if simulated := synthetic_words(recordings=data.is_synthetic, model=identifier.synthetic):
        show(f"{simulated}: this says nothing about real materials", "bold yellow", err=quiet)
    show(f"wrote {output}")

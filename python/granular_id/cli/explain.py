"""``granular-id explain``: what decides between two materials of a set of recordings."""

from __future__ import annotations

from typing import Annotated

from typer import Argument

from granular_id._checks import named
from granular_id._core import GranularIdError
from granular_id._text import known_label
from granular_id.cli import options as opt
from granular_id.cli.outputs import PICTURE, check_outputs, drawing, json_of, numbers, show, write_files
from granular_id.cli.recordings import read
from granular_id.cli.train import pipeline_of

_MOST_LINES = 14


def explain(
    path: opt.Recordings,
    first: Annotated[str, Argument(metavar="FIRST", help="A material.")],
    second: Annotated[str, Argument(metavar="SECOND", help="Another material.")],
    *,
    space: opt.Space = "best",
    figure: opt.Figure = None,
    json: opt.Json = None,
    force: opt.Force = False,
    details: opt.Details = False,
) -> None:
    """Add up what blocks, bands, axes and times contribute to distinguishing two materials.

    The materials are named as in the recordings; oat_flakes names "oat flakes". The method is trained on one fold of
    `granular-id evaluate` and explained on recordings of the two materials that are held out: what is shown decides
    for recordings that it has not seen.

    Examples:

    - `granular-id explain recordings rice oat_flakes`
    - `granular-id explain recordings rice oat_flakes --space hfmh --figure rice_oat.png --json rice_oat.json`
    """
    check_outputs(
        ("--figure", figure, PICTURE), ("--json", json, json_of("explanation")), source=path, force=force
    )
    from granular_id.spaces import feature_spaces

    named(feature_spaces(), "space", space)
    data = read(path, prepared=True)
    first, second = (known_label(name, data.labels) for name in (first, second))
    for name, label in (("FIRST", first), ("SECOND", second)):
        if label not in data.labels:
            raise GranularIdError(
                f"{name} is {label!r}, which is no label here; there are {', '.join(data.labels)}"
            )
    if first == second:
        raise GranularIdError(f"FIRST and SECOND must be two materials, got {first!r} twice")

    from granular_id.explanation import explain_held_out

    explanation, model, split = explain_held_out(data, pipeline_of(space, data.rate_hz), first, second)
    show(str(explanation), most=None if details else _MOST_LINES)
    show(f"{space}: {model}; explained on recordings held out: {split['held_out']}", most=4)
    title = f"{space}, explained on {split['folds']}" + ", SYNTHETIC recordings" * data.is_synthetic
    about = {"space": space, "model": model, "split": split}
    draw = drawing("plot_explanation", explanation, title=title)
    write_files((figure, draw), (json, numbers("explanation", lambda: about | explanation.to_dict())))

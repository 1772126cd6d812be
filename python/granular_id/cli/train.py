"""``granular-id train``: a model that names materials, in one safe file; ``granular-id model`` looks into it."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from granular_id._checks import named
from granular_id._core import GranularIdError
from granular_id._text import known_label
from granular_id.cli import options as opt
from granular_id.cli.outputs import (
    MODEL,
    PICTURE,
    ROOM,
    check_outputs,
    drawing,
    json_of,
    numbers,
    show,
    write_files,
)
from granular_id.cli.recordings import read

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sklearn.pipeline import Pipeline

_FIRST = ("SYNTHETIC", "materials", "background", "takes")
"""Lines about a model that stand before how well it did."""


def train(
    path: opt.Recordings,
    *,
    output: opt.NewModel,
    space: opt.Space = "best",
    hold_out: opt.HoldOut = "auto",
    target_error: Annotated[
        float, Option(callback=opt.SHARE, help="Share of early answers that may be wrong.")
    ] = 0.01,
    coverage: Annotated[
        float, Option(callback=opt.SHARE, help="Share of recordings whose candidates hold the material.")
    ] = 0.9,
    share_known: opt.ShareKnown = 0.95,
    background: Annotated[
        str | None, Option(help="Materials recorded, but never named: gravel,sand.")
    ] = None,
    cutoff_hz: opt.CutoffHz = None,
    bin_range: opt.BinRange = None,
    seed: opt.Seed = 0,
    figure: opt.Figure = None,
    json: opt.Json = None,
    force: opt.Force = False,
    quiet: opt.Quiet = False,
) -> None:
    """Train a model on all recordings and write it into one file.

    `granular-id identify` and `granular-id live` use it. What may be expected of it is measured on recordings that are
    held out, as strictly as they allow: whole sessions, else halves in the order of time or files, else random folds.
    They also set from which margin on an answer may be given before the push is over.

    Examples:

    - `granular-id train recordings -o kitchen.safetensors --figure over_time.png`
    - `granular-id train recordings -o any-tool.safetensors --hold-out tool`
    - `granular-id train recordings -o paper.safetensors --space raw+hfmh --bin-range auto`
    """
    from granular_id.identifier import SPACES

    settings = opt.histogram_settings(cutoff_hz, bin_range)
    named(dict.fromkeys(SPACES), "space", space)
    if settings and "hfmh" not in space:
        raise GranularIdError(f"--cutoff-hz and --bin-range are about the histogram (hfmh), {space} has none")
    check_outputs(
        ("--output", output, MODEL),
        ("--figure", figure, PICTURE),
        ("--json", json, json_of("training")),
        source=path,
        force=force,
    )
    data = read(path, prepared=True, quiet=quiet)

    from granular_id.identifier import Identifier, describe_performance

    identifier = Identifier.fit(
        data,
        pipeline_of(space, data.rate_hz, **settings) if settings else space,
        by=hold_out,
        target_error=target_error,
        coverage=coverage,
        share_known=share_known,
        background=[known_label(name, data.labels) for name in opt.names_in(background or "")],
        random_state=seed,
        progress=not quiet,
    )
    course = identifier.over_time_
    if figure is not None and course is None:
        why = identifier.trained["why_no_estimate"]
        raise GranularIdError(f"--figure shows held-out recordings, and there are none: {why}")
    room = ROOM - sum(file is not None for file in (output, figure, json))
    whole = f"granular-id model {shlex.quote(str(output))} --details"
    print_lines(describe_performance(identifier), rest=whole, most=room)
    identifier.save(output)  # first: what goes wrong with a figure must not cost the training
    show(f"wrote {output}")
    known = {name: value for name, value in identifier.trained.items() if name != "source"}
    known["over_time"] = None if course is None else course.to_dict()
    write_files((figure, drawing("plot_over_time", course)), (json, numbers("training", lambda: known)))


def pipeline_of(space: str, rate_hz: float, **settings: Any) -> Pipeline:
    """Return a feature space with its own classifier, or the paper's, unfitted."""
    from granular_id.ecoc import ECOCClassifier
    from granular_id.score import space_pipeline
    from granular_id.spaces import feature_spaces

    chosen = named(feature_spaces(rate_hz=rate_hz, **settings), "space", space)
    return space_pipeline(chosen.transformer, chosen.classifier or ECOCClassifier())


def print_lines(lines: Sequence[str], *, rest: str, most: int = ROOM) -> None:
    """Print what is known of a model: one screen, and what has the rest, if anything has."""
    if any("SYNTHETIC" in line for line in lines):
        most -= show(lines[0], "bold yellow")
        lines = lines[1:]
    show("\n".join(lines), most=most if rest else None, rest=rest)


def model(
    file: opt.Model, *, json: opt.Json = None, force: opt.Force = False, details: opt.Details = False
) -> None:
    """Say what a model knows, takes and was trained on, how well it did, and when it answers early.

    The file is checked as strictly as for use: what this prints is a model that works.

    Examples:

    - `granular-id model kitchen.safetensors --details --json kitchen.json`
    """
    check_outputs(("--json", json, json_of("model")), source=file, force=force)

    from granular_id.identifier import Identifier, describe_model, describe_performance, model_facts

    identifier = Identifier.load(file)
    about, performance = describe_model(identifier), describe_performance(identifier)
    first = [line for line in about if line.startswith(_FIRST)]
    rest = [line for line in about if line not in first]
    print_lines([*first, *performance, *rest], rest="" if details else "--details")
    write_files((json, numbers("model", lambda: model_facts(identifier))))

"""``granular-id explain``: what decides between two materials of a set of recordings."""

from __future__ import annotations

from pathlib import Path

import typer

from granular_id._core import GranularIdError
from granular_id._files import write_json
from granular_id._text import known_label
from granular_id.cli.method import OneSpace
from granular_id.cli.options import FORCE, command, option
from granular_id.cli.outputs import JSON_FILE, PICTURE, check_outputs, say_written, show, show_sentence
from granular_id.cli.recordings import Reading, Steps, equal_recordings

OUTPUT = "Output"


def _refuse_twice(first: str, second: str) -> None:
    if first == second:
        raise GranularIdError(f"FIRST and SECOND must be two materials, got {first!r} twice")


@command
def explain(
    reading: Reading,
    steps: Steps,
    method: OneSpace,
    *,
    first: str = typer.Argument(metavar="FIRST", help="A material."),
    second: str = typer.Argument(metavar="SECOND", help="Another material."),
    figure: Path | None = option(OUTPUT, "Draw it: png, svg or pdf."),
    json: Path | None = option(OUTPUT, "Write the tables and all weights."),
    force: bool = FORCE,
    quiet: bool = option(OUTPUT, "Print the tables only.", "--quiet", default=False),
) -> None:
    """Add up what blocks, bands, axes and times contribute to telling two materials apart.

    The materials are named as in the recordings; oat_flakes names "oat flakes".

    The method is trained on one fold of `granular-id evaluate` and explained on recordings of the two
    materials that are held out, so that what is shown decides for recordings it has not seen: of whole
    sessions, else of the earlier or the later half in time, else random ones. What is printed says which.
    The method is that of `granular-id train`, --space best.

    Examples:

    `granular-id explain recordings rice oat`
    `granular-id explain recordings rice oat --space hfmh --figure rice_oat.png --json rice_oat.json`
    """
    method.refuse_impossible(steps.rate_hz)
    check_outputs(
        ("--figure", figure, PICTURE), ("--json", json, JSON_FILE), source=reading.path, force=force
    )
    _refuse_twice(first, second)
    reading.refuse_absent()
    method.refuse_unused()
    data = equal_recordings(reading, steps, quiet=quiet)
    first, second = (known_label(name, data.labels) for name in (first, second))
    for name, label in (("FIRST", first), ("SECOND", second)):
        if label not in data.labels:
            raise GranularIdError(
                f"{name} is {label!r}, which is no label here; there are {', '.join(data.labels)}"
            )
    _refuse_twice(first, second)  # typed with a blank and with an underscore

    from granular_id.explanation import explain_held_out

    pipeline = method.pipeline(data.rate_hz)
    explanation, model, split = explain_held_out(data, pipeline, first, second)

    show_sentence(f"\n{method.space}: {model}")
    show(f"explained on recordings held out: {split['held_out']}")
    show(str(explanation))
    if figure is not None:
        from granular_id.plotting import plot_explanation

        title = f"{method.space}, explained on {split['folds']}"
        title += ", SYNTHETIC recordings" if data.is_synthetic else ""
        plot_explanation(explanation, title=title, path=figure)
    if json is not None:
        write_json(json, {"space": method.space, "model": model, "split": split, **explanation.to_dict()})
    say_written([figure, json], repeat=not quiet)

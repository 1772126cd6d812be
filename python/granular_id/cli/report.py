"""``granular-id report``: the page of an evaluation that was stored as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from granular_id.cli.errors import guarded
from granular_id.cli.session import Force, Outputs, say_written

__all__ = ["report"]

TEXT = """
Turn the JSON of `granular-id evaluate --json` into the HTML report, without computing anything again.

Examples:

`granular-id report result.json`

`granular-id report result.json -o for_the_boss.html --figures figures`
"""


@guarded
def report(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="JSON file of an evaluation.")],
    *,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="HTML file. Default: RESULT with the ending .html.")
    ] = None,
    figures: Annotated[
        Path | None, typer.Option("--figures", help="Write the figures into this folder, too.")
    ] = None,
    force: Force = False,
) -> None:
    """Write the report of a stored result; see `TEXT`."""
    page = result.with_suffix(".html") if output is None else output
    if output is None and page == result:
        raise ValueError(f"{result} is no JSON file of an evaluation; evaluate --json writes one")
    if page == result:
        raise ValueError(f"--output {page} is the result itself: give another file")
    outputs = Outputs(report=page, figures=figures, force=force, named={"--report": "--output"})
    with outputs.ready():
        from granular_id.evaluation import EvaluationResult  # noqa: PLC0415 (slow to import)

        written = outputs.write(EvaluationResult.from_json(result), None)
    say_written(Console(highlight=False), written, None)


report.__doc__ = TEXT

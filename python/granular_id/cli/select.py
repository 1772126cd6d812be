"""``granular-id select``: which feature space, weights and C to take for a set of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from granular_id.cli.errors import guarded
from granular_id.cli.method import Method, Weights, at_least, chosen_spaces, option, taking
from granular_id.cli.prepare import Steps, equal_recordings
from granular_id.cli.reading import Reading
from granular_id.cli.session import Force, Outputs, repeated_command, say_written

__all__ = ["select"]

TEXT = """
Choose a feature space, the weights of its blocks and C, and say how sure the choice is.

Cross-validation inside cross-validation: what is chosen is judged on recordings that had no say in the choice.
Whole sessions are held out where the recordings have several of each material; else halves in time order, as
`granular-id evaluate` does; else random folds. The output says which.

Spaces that bring their own classifier, multiband and best, are none of the candidates: best chooses for itself.
`granular-id evaluate --spaces` compares them with others.

PATH is a file or folder of any format, as for `granular-id evaluate`.

Examples:

`granular-id select recordings`

`granular-id select recordings --spaces raw,hfmh,raw+hfmh --json choice.json`

`granular-id select irregular --rate-hz 100 --max-gap-s 1 --n-samples shortest`
"""

CHOICE, OUTPUT = "Choice", "Output"


@guarded
@taking(Reading, Steps, Method)
def select(
    reading: Reading,
    steps: Steps,
    method: Method,
    *,
    spaces: Annotated[
        str,
        option("--spaces", CHOICE, "Candidates separated by commas. Default: the paper's, but slow ones."),
    ] = "",
    outer: Annotated[
        int, option("--outer", CHOICE, "Folds that judge the choice. Halves in time are 2.")
    ] = 5,
    inner: Annotated[int, option("--inner", CHOICE, "Folds that choose, within each outer fold.")] = 4,
    seed: Annotated[int, option("--seed", CHOICE, "Same seed, same choice.")] = 0,
    json: Annotated[Path | None, option("--json", OUTPUT, "Write everything the choice rests on.")] = None,
    force: Force = False,
    quiet: Annotated[bool, option("--quiet", OUTPUT, "Print the choice only.")] = False,
) -> None:
    """Print the choice; see `TEXT`."""
    for name, count, least in (("--outer", outer, 2), ("--inner", inner, 2), ("--seed", seed, 0)):
        at_least(name, count, least)
    method.fits(steps.preparation.rate_hz)
    chosen = None
    if spaces:
        from granular_id.evaluation import (
            in_paper_order,
            refuse_own_classifiers,
        )
        from granular_id.spaces import feature_spaces

        known = feature_spaces()
        chosen = chosen_spaces(spaces, None) or in_paper_order(known)
        refuse_own_classifiers([known[name] for name in chosen])
    outputs = Outputs(json=json, source=reading.path, force=force)
    with outputs.ready():
        notes = method.unused_in(chosen, Weights.plain) if chosen else []
        data = equal_recordings(reading, steps, quiet=quiet)

        from granular_id.cli.session import print_table
        from granular_id.evaluation import DEFAULT_SPACES
        from granular_id.evaluation import select as select_space

        for note in [] if quiet else notes:
            typer.echo(f"note: {note}")
        made = method.spaces(data.rate_hz)
        selection = select_space(
            data,
            spaces={name: made[name] for name in chosen or DEFAULT_SPACES},
            n_outer=outer,
            n_inner=inner,
            random_state=seed,
            n_jobs=method.n_jobs,
            progress=not quiet,
        )
        console = Console(highlight=False)
        console.print()
        console.print(Text(selection.verdict()))
        if not quiet:
            print_table(console, selection.table(), strong=selection.synthetic)
        if json is not None:
            selection.to_json(json)
        say_written(console, [] if json is None else [json], None if quiet else repeated_command())


select.__doc__ = TEXT

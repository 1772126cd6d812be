"""``granular-id confidence``: how sure a model of a set of recordings may be."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from granular_id.cli.method import OneSpace
from granular_id.cli.options import FORCE, a_share, command, count, numbers_in, option
from granular_id.cli.outputs import JSON_FILE, PICTURE, check_outputs, print_table, say_written, show
from granular_id.cli.recordings import Reading, Steps, equal_recordings

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline

    from granular_id.recording import Dataset

SURE, OUTPUT = "Confidence", "Output"


@command
def confidence(
    reading: Reading,
    steps: Steps,
    method: OneSpace,
    *,
    levels: str = option(SURE, "Coverages of the sets, separated by commas.", default="0.8,0.9,0.95"),
    known: float = option(SURE, "Share of known recordings to be accepted.", default=0.95, callback=a_share),
    seeds: int = option(SURE, "Random partitions.", default=20, callback=count(1)),
    seed: int = option(SURE, "Same seed, same figures.", default=0, callback=count(0)),
    figure: Path | None = option(OUTPUT, "Draw it: png, svg or pdf."),
    json: Path | None = option(OUTPUT, "Write all figures, and both rules."),
    force: bool = FORCE,
    quiet: bool = option(OUTPUT, "Print the tables only.", "--quiet", default=False),
) -> None:
    """Say how sure a model of these recordings may be.

    Three questions. Do probabilities mean what they say? Do sets of materials hold the right one as often as
    asked for, on random recordings, and in sessions or halves in time that did not train? Is a material
    refused that the model has never met: each one is left out in turn.

    The model is that of `granular-id train`. It is trained many times over, and --space best chooses anew
    each time: for a first look take --space multiband or fewer --seeds.

    Examples:

    `granular-id confidence recordings`
    `granular-id confidence recordings --space multiband --seeds 5`
    `granular-id confidence recordings --space hfmh --levels 0.9,0.99 --figure sure.png --json sure.json`
    """
    wanted = _levels(levels)
    method.refuse_impossible(steps.rate_hz)
    check_outputs(
        ("--figure", figure, PICTURE), ("--json", json, JSON_FILE), source=reading.path, force=force
    )
    reading.refuse_absent()
    method.refuse_unused()
    data = equal_recordings(reading, steps, quiet=quiet)

    from granular_id.confidence import assess

    found = assess(
        data,
        _model(method, data),
        levels=wanted,
        share_known=known,
        n_seeds=seeds,
        seed=seed,
        n_jobs=method.n_jobs,
        progress=not quiet,
        name=method.space,
    )
    for table in found.tables():
        print_table(table, strong=found.synthetic)
    for note in found.notes:
        show(note)
    if figure is not None:
        from granular_id.plotting import plot_confidence

        plot_confidence(found, path=figure)
    if json is not None:
        found.save(json)
    say_written([figure, json], repeat=not quiet)


def _model(method: OneSpace, data: Dataset) -> Pipeline:
    from sklearn.base import clone

    from granular_id.spaces import block_sizes, tell_blocks

    model = method.pipeline(data.rate_hz)
    if method.spaces(data.rate_hz)[method.space].classifier is not None:
        # How many columns a block has follows from the shape of a recording alone: any one says it.
        tell_blocks(model[-1], block_sizes(clone(model[0]).fit(data.X[:1])))
    return model


def _levels(text: str) -> list[float]:
    """Read ``--levels``."""
    wanted = "numbers between 0 and 1, separated by commas, each once"
    found = numbers_in("--levels", text, wanted)
    if not all(0 < share < 1 for share in found) or len(set(found)) < len(found):
        raise ValueError(f"--levels must be {wanted}, got {text!r}")
    return found

"""``granular-id confidence``: how sure a model of a set of recordings may be."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.console import Console

from granular_id.cli.errors import guarded
from granular_id.cli.method import (
    BlockWeights,
    Method,
    Space,
    Weights,
    at_least,
    between,
    option,
    positive,
    taking,
)
from granular_id.cli.prepare import Steps, equal_recordings
from granular_id.cli.reading import Reading
from granular_id.cli.session import JSON_FILE, PICTURE, Force, check_outputs, repeated_command, say_written

if TYPE_CHECKING:
    from granular_id.recording import Dataset
    from granular_id.spaces import FeatureSpace

__all__ = ["confidence"]

TEXT = """
Say how sure a model of these recordings may be.

Three questions. Do probabilities mean what they say? Do sets of materials hold the right one as often as asked for, on
random recordings, and in sessions or halves in time that did not train? Is a material refused that the model has never
met: each one is left out in turn.

The model is that of `granular-id train`. It is trained many times over, and --space best chooses anew each time: for a
first look take --space multiband or fewer --seeds.

PATH is a file or folder of any format, as for `granular-id evaluate`.

Examples:

`granular-id confidence recordings`

`granular-id confidence recordings --space multiband --seeds 5`

`granular-id confidence recordings --space hfmh --levels 0.9,0.99 --figure sure.png --json sure.json`
"""

SURE, OUTPUT = "Confidence", "Output"


class Sets(str, Enum):
    """Choices of ``--sets``."""

    margin = "margin"
    probability = "probability"
    cumulative = "cumulative"


@guarded
@taking(Reading, Steps, Method)
def confidence(
    reading: Reading,
    steps: Steps,
    method: Method,
    *,
    space: Space = "best",
    block_weights: BlockWeights = Weights.plain,
    c: Annotated[
        float, option("--C", "Method", "Box constraint, where the space has no classifier of its own.")
    ] = 1.0,
    levels: Annotated[
        str, option("--levels", SURE, "Coverages of the sets, separated by commas.")
    ] = "0.8,0.9,0.95",
    sets: Annotated[Sets, option("--sets", SURE, "What a material is judged by.")] = Sets.margin,
    per_class: Annotated[
        bool, option("--per-class", SURE, "Cover each material as often as asked for, not all together.")
    ] = False,
    known: Annotated[float, option("--known", SURE, "Share of known recordings to be accepted.")] = 0.95,
    compare: Annotated[
        bool, option("--compare", SURE, "Also compare other ways to see the unknown.")
    ] = False,
    seeds: Annotated[int, option("--seeds", SURE, "Random partitions.")] = 20,
    seed: Annotated[int, option("--seed", SURE, "Same seed, same figures.")] = 0,
    figure: Annotated[Path | None, option("--figure", OUTPUT, "Draw it: png, svg or pdf.")] = None,
    json: Annotated[Path | None, option("--json", OUTPUT, "Write all figures, and both rules.")] = None,
    force: Force = False,
    quiet: Annotated[bool, option("--quiet", OUTPUT, "Print the tables only.")] = False,
) -> None:
    """Print how sure a model may be; see `TEXT`."""
    positive("--C", c)
    at_least("--seeds", seeds, 1)
    at_least("--seed", seed, 0)
    wanted = _levels(levels)
    between("--known", known)
    method.fits(steps.preparation.rate_hz)
    check_outputs(
        ("--figure", figure, PICTURE), ("--json", json, JSON_FILE), source=reading.path, force=force
    )
    reading.refuse_absent()
    method.refuse_unused(space, block_weights, c)
    data = equal_recordings(reading, steps, quiet=quiet)

    from granular_id.cli.session import print_table
    from granular_id.confidence import assess

    console = Console(highlight=False)
    if not quiet:
        console.print(_effort(data, space, seeds), soft_wrap=True)
    found = assess(
        data,
        _model(data, method.spaces(data.rate_hz, block_weights)[space], c),
        levels=wanted,
        kind=sets.value,
        per_class=per_class,
        share_known=known,
        compare=compare,
        n_seeds=seeds,
        seed=seed,
        n_jobs=method.n_jobs,
        progress=not quiet,
        name=space,
    )
    for table in found.tables():
        print_table(console, table, strong=found.synthetic)
    for note in found.notes:
        console.print(note, markup=False)
    if figure is not None:
        from granular_id.plotting import plot_confidence

        plot_confidence(found, path=figure)
    if json is not None:
        found.save(json)
    written = [path for path in (figure, json) if path is not None]
    say_written(console, written, None if quiet else repeated_command())


confidence.__doc__ = TEXT


def _effort(data: Dataset, space: str, n_seeds: int) -> str:
    """Say how many models will be trained, and what is cheaper."""
    from granular_id.confidence import count_trainings

    said = f"{space}: up to {count_trainings(data, n_seeds=n_seeds)} models are trained"
    if space != "best":
        return said
    return f"{said}, each of which chooses among several: --space multiband or fewer --seeds are quicker"


def _model(data: Dataset, space: FeatureSpace, cost: float) -> Any:
    """Feature space, and its own classifier or the paper's."""
    from sklearn.base import clone
    from sklearn.pipeline import make_pipeline

    from granular_id.ecoc import ECOCClassifier
    from granular_id.spaces import block_sizes, tell_blocks

    if space.classifier is None:
        return make_pipeline(space.transformer, ECOCClassifier(C=cost))
    classifier = clone(space.classifier)
    # How many columns a block has follows from the shape of a recording alone: any one says it.
    tell_blocks(classifier, block_sizes(clone(space.transformer).fit(data.X[:1])))
    return make_pipeline(space.transformer, classifier)


def _levels(text: str) -> list[float]:
    """Read ``--levels``."""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if not found or not all(0 < share < 1 for share in found) or len(set(found)) < len(found):
        raise ValueError(
            f"--levels must be numbers between 0 and 1, separated by commas, each once, got {text!r}"
        )
    return found

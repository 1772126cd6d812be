"""``granular-id explain``: what decides between two materials of a set of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from granular_id.cli.errors import guarded
from granular_id.cli.method import BlockWeights, Method, Space, Weights, option, positive, taking
from granular_id.cli.prepare import Steps, equal_recordings
from granular_id.cli.reading import Reading
from granular_id.cli.session import JSON_FILE, PICTURE, Force, check_outputs, repeated_command, say_written

if TYPE_CHECKING:
    from granular_id.explanation import Explanation
    from granular_id.recording import Dataset
    from granular_id.spaces import FeatureSpace

__all__ = ["explain"]

TEXT = """
Say which instants, axes, bins and bands decide between two materials.

The method is trained on about one half of the recordings of the two materials and explained on the other, so that what
is shown decides for recordings it has not seen. The halves are as strict as the two materials allow, as those of
`granular-id evaluate`: whole sessions, else the earlier and the later half in time, else random. Text, figure and JSON
say which. The method is that of `granular-id train`, --space best.

PATH is a file or folder of any format, as for `granular-id evaluate`.

Examples:

`granular-id explain recordings rice oat`

`granular-id explain recordings rice oat --space hfmh --figure rice_oat.png --json rice_oat.json`

`granular-id explain recordings rice oat --figure bands.png`
"""

OUTPUT = "Output"

SPLITS = {
    "session": "held-out sessions",
    "chronological": "the later half in time",
    "kfold": "a random half",
}
"""What is explained, by protocol, in the heading of the figure."""


@guarded
@taking(Reading, Steps, Method)
def explain(
    reading: Reading,
    steps: Steps,
    method: Method,
    first: Annotated[str, typer.Argument(metavar="FIRST", help="A material.")],
    second: Annotated[str, typer.Argument(metavar="SECOND", help="Another material.")],
    *,
    space: Space = "best",
    block_weights: BlockWeights = Weights.plain,
    c: Annotated[
        float,
        option("--C", "Method", "Box constraint, where the space has no classifier of its own."),
    ] = 1.0,
    figure: Annotated[Path | None, option("--figure", OUTPUT, "Draw it: png, svg or pdf.")] = None,
    json: Annotated[Path | None, option("--json", OUTPUT, "Write all weights and contributions.")] = None,
    force: Force = False,
    quiet: Annotated[bool, option("--quiet", OUTPUT, "Print the explanation only.")] = False,
) -> None:
    """Print what decides between two materials; see `TEXT`."""
    positive("--C", c)
    method.fits(steps.preparation.rate_hz)
    check_outputs(
        ("--figure", figure, PICTURE), ("--json", json, JSON_FILE), source=reading.path, force=force
    )
    if first == second:
        raise ValueError(f"FIRST and SECOND must be two materials, got {first!r} twice")
    reading.refuse_absent()
    method.refuse_unused(space, block_weights, c)
    data = equal_recordings(reading, steps, quiet=quiet)
    for name, label in (("FIRST", first), ("SECOND", second)):
        if label not in data.labels:
            raise ValueError(
                f"{name} is {label!r}, which is no label here; there are {', '.join(data.labels)}"
            )
    explanation, model, split = _explained(
        data, method.spaces(data.rate_hz, block_weights)[space], c, first, second
    )

    console = Console(highlight=False)
    console.print()
    console.print(Text(f"{space}: {model}"), soft_wrap=True)
    console.print(Text(f"explained on recordings held out: {split['held_out']}"), soft_wrap=True)
    console.print(Text(str(explanation)), soft_wrap=True)
    if figure is not None:
        from granular_id.plotting import plot_explanation

        title = f"{space}, explained on {SPLITS[split['protocol']]}"
        title += ", SYNTHETIC recordings" if data.is_synthetic else ""
        plot_explanation(explanation, title=title, path=figure)
    if json is not None:
        from granular_id._files import write_json

        write_json(json, {"space": space, "model": model, "split": split, **explanation.to_dict()})
    written = [path for path in (figure, json) if path is not None]
    say_written(console, written, None if quiet else repeated_command())


explain.__doc__ = TEXT


def _explained(
    data: Dataset, space: FeatureSpace, cost: float, first: str, second: str
) -> tuple[Explanation, str, dict[str, Any]]:
    """Train on some recordings, explain those held out of the two materials; say what was trained, and the split."""
    from granular_id.explanation import explain as explain_pair
    from granular_id.spaces import Chosen
    from granular_id.splits import pair_partition

    X, y = data.X, data.y
    for label in (first, second):
        if (y == label).sum() < 2:
            raise ValueError(f"{label!r} has 1 recording; one to train and one to explain are needed")
    part, held_out = pair_partition(data, first, second)
    model = _trained(data, X, y, part.train, space, cost)
    chosen = Chosen.of(model[-1])
    said = (
        f"trained on {len(part.train)} of {len(y)} recordings{'' if chosen is None else f'; {chosen.words}'}"
    )
    split = {
        "protocol": part.protocol,
        "held_out": held_out,
        "train": [data.names[row] for row in part.train.tolist()],
        "explained": [data.names[row] for row in part.test.tolist()],
    }
    return explain_pair(model, first, second, X[part.test], y[part.test], axes=data.axes), said, split


def _trained(data: Dataset, X: Any, y: Any, rows: Any, space: FeatureSpace, cost: float) -> Any:
    """Train the classifier of the space, or the paper's."""
    from sklearn.base import clone
    from sklearn.pipeline import Pipeline

    from granular_id.ecoc import ECOCClassifier
    from granular_id.identifier import fit_pipeline
    from granular_id.splits import origins_of

    classifier = ECOCClassifier(C=cost) if space.classifier is None else clone(space.classifier)
    pipeline = Pipeline([("features", clone(space.transformer)), ("classifier", classifier)])
    return fit_pipeline(pipeline, X[rows], y[rows], origins_of(data), rows)

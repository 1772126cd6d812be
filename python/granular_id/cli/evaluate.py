"""``granular-id evaluate``: how well the materials in recordings are told apart."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from granular_id.cli.errors import guarded
from granular_id.cli.method import (
    BlockWeights,
    Method,
    Weights,
    at_least,
    chosen_spaces,
    option,
    positive,
    taking,
)
from granular_id.cli.prepare import Steps, equal_recordings
from granular_id.cli.reading import Reading
from granular_id.cli.session import Force, Outputs, Run, evaluate_and_show, say_written

EXAMPLES = """
Measure how well the materials in a set of recordings are told apart.

PATH is a file that holds the whole set (NumPy, MATLAB, HDF5, Parquet), or a folder of files of any format, CSV and
ROS bags among them: one sub-folder per material (`rice/01.csv`), files named after it (`rice_01.csv`), or an
`index.csv`. Forces are in N, torques in N m; `granular-id data info PATH` says what is found. Nothing is resampled,
cropped or left out unless an option asks for it; a refusal names the option.

Examples:

`granular-id evaluate recordings --report report.html`

`granular-id evaluate recordings --train 40 --test 10 --json result.json --csv predictions.csv`

`granular-id evaluate irregular --rate-hz 100 --max-gap-s 1 --n-samples shortest --bin-range auto`

`granular-id evaluate recordings --protocol session --spaces raw,raw+hfmh --figures figures`

`granular-id evaluate few --protocol kfold --folds 5`

Random partitions (the paper's protocol) flatter a method that recognises the session instead of the material.
The strictest protocol that the recordings allow runs beside them: whole sessions held out, or halves in time
order; the gap between the two is shown. Controls say what can be had without touching the material.

Ctrl-C keeps what is finished: the same command goes on from there.
"""


class Protocol(str, Enum):
    """Choices of ``--protocol``."""

    auto = "auto"
    paper = "paper"
    session = "session"
    chronological = "chronological"
    kfold = "kfold"


SPLIT, METHOD, OUTPUT = "Partitions", "Method", "Output"


@guarded
@taking(Reading, Steps, Method)
def evaluate(
    reading: Reading,
    steps: Steps,
    method: Method,
    *,
    protocol: Annotated[
        Protocol, option("--protocol", SPLIT, "auto: paper, and the strictest that the recordings allow.")
    ] = Protocol.auto,
    train: Annotated[
        int, option("--train", SPLIT, "Training recordings of each class (random partitions).")
    ] = 50,
    test: Annotated[int, option("--test", SPLIT, "Test recordings of each class (random partitions).")] = 12,
    partitions: Annotated[int, option("--partitions", SPLIT, "Number of random partitions.")] = 20,
    folds: Annotated[
        int, option("--folds", SPLIT, "Folds of kfold, and of session with one session per class.")
    ] = 5,
    seed: Annotated[int, option("--seed", SPLIT, "Same seed, same numbers.")] = 0,
    controls: Annotated[
        bool,
        option("--controls/--no-controls", SPLIT, "What the rest, the means, the clock alone would give."),
    ] = True,
    spaces: Annotated[
        str, option("--spaces", METHOD, "Feature spaces separated by commas; paper: the paper's.")
    ] = "all",
    block_weights: BlockWeights = Weights.plain,
    c: Annotated[float, option("--C", METHOD, "Box constraint of the support vector machines.")] = 1.0,
    report: Annotated[Path | None, option("--report", OUTPUT, "Write one HTML file with everything.")] = None,
    json: Annotated[Path | None, option("--json", OUTPUT, "Write figures, settings and predictions.")] = None,
    csv: Annotated[Path | None, option("--csv", OUTPUT, "Write every prediction.")] = None,
    figures: Annotated[
        Path | None, option("--figures", OUTPUT, "Write the figures of the report into this folder.")
    ] = None,
    confusion: Annotated[
        str | None, option("--confusion", OUTPUT, "Space of the confusion matrix. Default: the best.")
    ] = None,
    fresh: Annotated[
        bool, option("--fresh", OUTPUT, "Forget what an interrupted run of this command has finished.")
    ] = False,
    force: Force = False,
    quiet: Annotated[bool, option("--quiet", OUTPUT, "Print the table of accuracies only.")] = False,
) -> None:
    """Print accuracies, confusions and seconds; see `EXAMPLES`."""
    positive("--C", c)
    for name, count, least in (
        ("--train", train, 1),
        ("--test", test, 1),
        ("--partitions", partitions, 1),
        ("--folds", folds, 2),
        ("--seed", seed, 0),
    ):
        at_least(name, count, least)
    method.fits(steps.preparation.rate_hz)
    chosen = chosen_spaces(spaces, confusion)
    outputs = Outputs(report=report, json=json, csv=csv, figures=figures, source=reading.path, force=force)
    with outputs.ready():
        reading.refuse_absent()
        notes = method.unused_in(chosen, block_weights, c)
        data = equal_recordings(reading, steps, quiet=quiet)

        from granular_id.ecoc import ECOCClassifier
        from granular_id.evaluation import in_paper_order

        for note in [] if quiet else notes:
            typer.echo(f"note: {note}")
        known = method.spaces(data.rate_hz, block_weights)
        run = Run(
            spaces={name: known[name] for name in chosen or in_paper_order(known)},
            protocol=protocol.value,
            confusion_of=confusion,
            fresh=fresh,
            arguments={
                "n_partitions": partitions,
                "train_per_class": train,
                "test_per_class": test,
                "n_folds": folds,
                "controls": controls,
                "classifier": ECOCClassifier(C=c),
                "n_jobs": method.n_jobs,
                "random_state": seed,
            },
        )
        evaluate_and_show(data, run, outputs, quiet=quiet)


evaluate.__doc__ = EXAMPLES

# ``granular-id report``: the page of an evaluation that was stored as JSON.

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
        from granular_id.evaluation import EvaluationResult

        written = outputs.write(EvaluationResult.from_json(result), None)
    say_written(Console(highlight=False), written, None)


report.__doc__ = TEXT

"""``granular-id evaluate``: how well materials are told apart, in which space."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from granular_id._core import GranularIdError
from granular_id._text import install
from granular_id.cli.errors import FOUND_ERRORS
from granular_id.cli.method import Method, chosen_spaces
from granular_id.cli.options import FORCE, command, count, option
from granular_id.cli.outputs import (
    JSON_FILE,
    PAGE,
    PREDICTIONS,
    check_outputs,
    print_table,
    repeated_command,
    say_written,
    show,
    show_sentence,
)
from granular_id.cli.recordings import Reading, Steps, equal_recordings

if TYPE_CHECKING:
    from granular_id.evaluation import EvaluationResult
    from granular_id.recording import Dataset
    from granular_id.spaces import FeatureSpace

SPLIT, METHOD, OUTPUT = "Held out", "Method", "Output"

BY = (
    "auto: sessions where half of the materials have several, else halves in time, else random folds. Or session, "
    "time, random; or a condition: day, tool, sensor, any entry of the metadata."
)
"""What ``--hold-out`` takes."""


@dataclass(kw_only=True)
class Outputs:
    """Files of an evaluation to write; None leaves one out."""

    report: Path | None = option(OUTPUT, "Write one HTML file with everything.")
    json: Path | None = option(OUTPUT, "Write figures, settings and predictions.")
    csv: Path | None = option(OUTPUT, "Write every prediction.")
    force: bool = FORCE

    def check(self, source: Path | None = None, name: str | None = None) -> None:
        """Refuse what could not be written, before any time is spent on it.

        `source`: what is read. `name`: the one option for all of them, of commands that have no others.
        """
        for module in ("matplotlib", "jinja2"):
            if self.report is not None and importlib.util.find_spec(module) is None:
                raise ImportError(f"a report needs {module}: {install('app')}")
        outputs = [
            ("--report", self.report, PAGE),
            ("--json", self.json, JSON_FILE),
            ("--csv", self.csv, PREDICTIONS),
        ]
        named = [(name or option, path, kind) for option, path, kind in outputs]
        check_outputs(*named, source=source, force=self.force)

    def write(self, result: EvaluationResult) -> list[Path]:
        """Write everything that was asked for; return the paths."""
        written = []
        for path, write in ((self.json, result.to_json), (self.csv, result.to_csv)):
            if path is not None:
                write(path)
                written.append(path)
        if self.report is not None:
            from granular_id.report import write as write_report

            write_report(result, self.report)
            written.append(self.report)
        return written


def evaluate_and_show(
    data: Dataset,
    spaces: Mapping[str, FeatureSpace],
    outputs: Outputs,
    *,
    confusion: str | None = None,
    details: bool = False,
    quiet: bool = False,
    **arguments: Any,
) -> None:
    """Evaluate, print one screen, write the files, say where they are; when quiet print accuracies only.

    Ends with exit code 3 where something spoils the figures, unless that is among `accept`.
    """
    from granular_id.evaluation import (
        accuracy_table,
        confusion_table,
        evaluate as evaluate_spaces,
        gap_lines,
        headline,
        remarks,
        spoiled_lines,
    )

    result = evaluate_spaces(data, spaces, progress=not quiet, **arguments)
    result = replace(result, command=repeated_command())
    for line in spoiled_lines(result):
        show_sentence(line, "bold red")
    if result.spoiling:
        show(f"where it is known: {' '.join(f'--accept {one.code}' for one in result.spoiling)}", "bold red")
    show_sentence(headline(result), "bold yellow" if result.synthetic else "bold")
    for line in gap_lines(result):
        show_sentence(line)
    print_table(accuracy_table(result), strong=result.synthetic)
    if not quiet:
        for line in remarks(result):
            show(line)
    if confusion is not None:
        print_table(confusion_table(result, confusion), tight=True)
    if details:
        show(result.details())
    written = outputs.write(result)
    if not quiet and not details and outputs.report is None:
        show("more: --details; all tables and figures on one page: --report FILE.html")
    say_written(written, repeat=not quiet)
    if result.spoiling:
        raise typer.Exit(FOUND_ERRORS)


@dataclass(kw_only=True)
class HoldOut:
    """What is held out."""

    hold_out: str = option(SPLIT, BY, default="auto")
    paper: bool = option(
        SPLIT, "The paper's table: its feature spaces, 20 random partitions of 50 and 12.", default=False
    )
    train: int = option(
        SPLIT, "Training recordings of each material, of --paper.", default=50, callback=count(1)
    )
    test: int = option(SPLIT, "Test recordings of each material, of --paper.", default=12, callback=count(1))
    partitions: int = option(SPLIT, "Number of random partitions, of --paper.", default=20, callback=count(1))
    accept: list[str] | None = option(
        SPLIT, "A finding, by its name in data check, that is known: no exit code 3. Repeatable."
    )
    seed: int = option(SPLIT, "Same seed, same numbers.", default=0, callback=count(0))

    def __post_init__(self) -> None:
        if self.paper and self.hold_out != "auto":
            raise GranularIdError(f"--paper is random partitions: leave out --hold-out {self.hold_out}")
        if not self.paper and (self.train, self.test, self.partitions) != (50, 12, 20):
            raise GranularIdError(
                "--train, --test and --partitions are of --paper: add it, or leave them out"
            )


@command
def evaluate(
    reading: Reading,
    steps: Steps,
    method: Method,
    held: HoldOut,
    outputs: Outputs,
    *,
    baselines: bool = option(SPLIT, "What the rest and the clock alone would give.", default=True),
    spaces: str | None = option(
        METHOD,
        "Feature spaces separated by commas, the headline's first; paper: the paper's; all. Default: "
        "best,multiband,raw+hfmh.",
    ),
    confusion: str | None = option(OUTPUT, "Print the confusion matrix of this space."),
    details: bool = option(OUTPUT, "Print folds, mistakes, comparisons, choices and seconds.", default=False),
    quiet: bool = option(OUTPUT, "Print the table of accuracies only.", "--quiet", default=False),
) -> None:
    """Measure how well the materials in a set of recordings are told apart.

    PATH is a file that holds the whole set (NumPy, MATLAB, HDF5, Parquet), or a folder of files of any
    format, CSV and ROS bags among them: one sub-folder per material (`rice/01.csv`), files named after it
    (`rice_01.csv`), or an `index.csv`. Forces are in N, torques in N m; `granular-id data info PATH` says
    what is found. Nothing is resampled, cropped or left out unless an option asks for it; a refusal names the
    option.

    Examples:

    `granular-id evaluate recordings --report report.html`
    `granular-id evaluate recordings --hold-out tool --details`
    `granular-id evaluate recordings --spaces raw+hfmh,multiband --json result.json --csv predictions.csv`
    `granular-id evaluate irregular --rate-hz 100 --max-gap-s 1 --n-samples shortest --bin-range auto`
    `granular-id evaluate recordings --paper --train 40 --test 10`

    The headline is the space that stands first, on what new recordings will not share: whole sessions held out,
    or halves in time order, or a condition. Beside it as many recordings are drawn at random, which flatters a
    method that recognises the session instead of the material: what is lost is tested. Baselines, in brackets,
    say what can be had without touching the material.

    Exit code 3: the checks of `granular-id data check`, or a baseline, found what spoils the figures, such as a
    clock that names the label; `--accept NAME` says that it is known.
    """
    method.refuse_impossible(steps.rate_hz)
    outputs.check(reading.path)
    reading.refuse_absent()  # before imports that take longer than a look
    from granular_id.evaluation import USUAL_SPACES

    wanted = ("paper" if held.paper else ",".join(USUAL_SPACES)) if spaces is None else spaces
    chosen = chosen_spaces(wanted, confusion)
    notes = method.unused_in(chosen)
    data = equal_recordings(reading, steps, quiet=quiet)

    from granular_id.ecoc import ECOCClassifier

    for note in [] if quiet else notes:
        show(f"note: {note}")
    known = method.spaces(data.rate_hz)
    evaluate_and_show(
        data,
        {name: known[name] for name in chosen},
        outputs,
        confusion=confusion,
        details=details,
        quiet=quiet,
        by=held.hold_out,
        paper=(held.partitions, held.train, held.test) if held.paper else False,
        baselines=baselines,
        accept=held.accept or (),
        classifier=None if all(known[name].classifier for name in chosen) else ECOCClassifier(C=method.c),
        n_jobs=method.n_jobs,
        random_state=held.seed,
    )

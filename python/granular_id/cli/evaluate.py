"""``granular-id evaluate``: how well materials are told apart, in which space."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from granular_id._files import made_folder
from granular_id._text import install
from granular_id.cli.errors import FOUND_ERRORS
from granular_id.cli.method import Method, chosen_spaces
from granular_id.cli.options import FORCE, command, count, option
from granular_id.cli.outputs import (
    JSON_FILE,
    PAGE,
    PICTURE,
    PREDICTIONS,
    check_outputs,
    fits,
    print_table,
    repeated_command,
    say_written,
    show,
)
from granular_id.cli.recordings import Reading, Steps, equal_recordings

if TYPE_CHECKING:
    from granular_id.evaluation import EvaluationResult
    from granular_id.recording import Dataset
    from granular_id.spaces import FeatureSpace

SPLIT, METHOD, OUTPUT = "Partitions", "Method", "Output"


@dataclass(kw_only=True)
class Outputs:
    """Files of an evaluation to write, and a folder for figures; None leaves one out."""

    report: Path | None = option(OUTPUT, "Write one HTML file with everything.")
    json: Path | None = option(OUTPUT, "Write figures, settings and predictions.")
    csv: Path | None = option(OUTPUT, "Write every prediction.")
    figures: Path | None = option(OUTPUT, "Write the figures of the report into this folder.")
    force: bool = FORCE

    @contextmanager
    def ready(self, source: Path | None = None, name: str | None = None) -> Iterator[None]:
        """Refuse what could not be written, before any time is spent on it.

        The folder for figures is made, and removed again when the block raises and left it empty. `source`: what is
        read. `name`: the one option for all of them, of commands that have no others.
        """
        for wanted, module, path in (
            ("figures need", "matplotlib", self.figures),
            ("a report needs", "matplotlib", self.report),
            ("a report needs", "jinja2", self.report),
        ):
            if path is not None and importlib.util.find_spec(module) is None:
                raise ImportError(f"{wanted} {module}: {install('app')}")
        with nullcontext() if self.figures is None else made_folder(self.figures):
            outputs = [
                ("--report", self.report, PAGE),
                ("--json", self.json, JSON_FILE),
                ("--csv", self.csv, PREDICTIONS),
                *(("--figures", path, PICTURE) for path in self._figures_there()),
            ]
            named = [(name or option, path, kind) for option, path, kind in outputs]
            check_outputs(*named, source=source, force=self.force)
            yield

    def _figures_there(self) -> list[Path]:
        """Figures that would be replaced; which of all there will be depends on the evaluation."""
        if self.figures is None or not any(self.figures.glob("*.png")):
            return []
        from granular_id.report import FIGURES

        paths = (self.figures / f"{name}.png" for name in FIGURES)
        return [path for path in paths if path.exists()]

    def write(self, result: EvaluationResult, space: str | None) -> list[Path]:
        """Write everything that was asked for; return the paths."""
        written = []
        for path, write in (
            (self.report, result.report),
            (self.json, result.to_json),
            (self.csv, result.to_csv),
        ):
            if path is not None:
                write(path)
                written.append(path)
        if self.figures is not None:
            from granular_id.report import figures

            written += figures(result, self.figures, "png", space=space)
        return written


def evaluate_and_show(
    data: Dataset,
    spaces: Mapping[str, FeatureSpace],
    protocol: str,
    outputs: Outputs,
    *,
    confusion: str | None = None,
    quiet: bool = False,
    **arguments: Any,
) -> None:
    """Evaluate, print the tables, write the files, say where they are; when quiet print accuracies only.

    Ends with exit code 3 where the recordings hold what spoils the figures, unless that is among `accept`.
    """
    from granular_id.evaluation import evaluate as evaluate_spaces

    result = evaluate_spaces(data, spaces, protocol, progress=not quiet, **arguments)
    result = replace(result, command=repeated_command())
    _print_findings(result)
    _print_result(result, confusion, brief=quiet)
    written = outputs.write(result, confusion)
    if not quiet and outputs.report is None:
        show("\nall tables and figures on one page: add --report FILE.html")
    say_written(written, repeat=not quiet)
    if result.spoiling:
        raise typer.Exit(FOUND_ERRORS)


def _print_findings(result: EvaluationResult) -> None:
    """Say above the tables what spoils them, and how to state that it is known."""
    from granular_id.evaluation import finding_lines

    spoiling = result.spoiling
    for number, line in enumerate(finding_lines(result)):
        show(("" if number else "\n") + line, "bold red" if number < len(spoiling) else "")
    if spoiling:
        known = " ".join(f"--accept {finding.code}" for finding in spoiling)
        show(
            f"Do not rely on the figures below before this is settled; where it is known: {known}",
            "bold red",
        )


def _print_result(result: EvaluationResult, space: str | None, *, brief: bool) -> None:
    """Print accuracies with gaps and notes; unless `brief` controls, comparison, choices, confusion and seconds too."""
    from granular_id.evaluation import (
        PAPER_NOTE,
        accuracy_table,
        choice_tables,
        comparison_tables,
        confusion_table,
        controls_table,
        hold_out_tables,
        mistakes_table,
        seconds_table,
    )

    accuracies = accuracy_table(result)
    if brief:
        footnotes = tuple(note for note in accuracies.notes if note == PAPER_NOTE)
        print_table(replace(accuracies, notes=footnotes), strong=result.synthetic)
        return
    print_table(accuracies, strong=result.synthetic)
    for table in hold_out_tables(result):
        print_table(table)
    if result.controls:
        print_table(controls_table(result))
    for table in (*comparison_tables(result)[:1], *choice_tables(result)):
        print_table(table)
    # The matrix of the protocol that flatters least; the report and the figures have all of them.
    protocol = result.headline
    chosen = space or result.best_space(protocol)
    matrix = confusion_table(result, chosen, protocol)
    if fits(matrix):
        print_table(matrix, tight=True)
    else:
        print_table(mistakes_table(result, chosen, protocol))
    print_table(seconds_table(result))


@dataclass(kw_only=True)
class Partitions:
    """What trains and what is tested."""

    protocol: Literal["auto", "paper", "session", "chronological", "kfold"] = option(
        SPLIT, "auto: the strictest that the recordings allow, and as many at random.", default="auto"
    )
    hold_out: str | None = option(
        SPLIT,
        "Hold out each value of this condition in turn: session, day, tool, sensor, or any entry of the metadata.",
    )
    paper: bool = option(
        SPLIT, "The paper's table: its feature spaces, 20 random partitions of 50 and 12.", default=False
    )
    train: int | None = option(
        SPLIT, "Training recordings of each class, of --paper. Default: 50.", callback=count(1)
    )
    test: int | None = option(
        SPLIT, "Test recordings of each class, of --paper. Default: 12.", callback=count(1)
    )
    partitions: int | None = option(
        SPLIT, "Number of random partitions, of --paper. Default: 20.", callback=count(1)
    )
    folds: int | None = option(
        SPLIT,
        "Folds of kfold, the most of auto, and of session with one session per class. Default: 5; of auto 3 for more "
        "than 2000 recordings.",
        callback=count(2),
    )
    accept: list[str] | None = option(
        SPLIT, "A finding, by its name in data check, that is known: no exit code 3. Repeatable."
    )
    seed: int = option(SPLIT, "Same seed, same numbers.", default=0, callback=count(0))

    def __post_init__(self) -> None:
        if self.paper and self.protocol not in ("auto", "paper"):
            raise ValueError(f"--paper is random partitions: leave out --protocol {self.protocol}")
        alone = {
            "--paper": self.paper,
            f"--protocol {self.protocol}": self.protocol != "auto",
            "--folds": self.folds is not None,
        }
        for other, given in alone.items():
            if given and self.hold_out is not None:
                raise ValueError(
                    f"--hold-out takes each value of {self.hold_out!r} in turn: leave out {other}"
                )
        if self.paper:
            self.protocol = "paper"


@command
def evaluate(
    reading: Reading,
    steps: Steps,
    method: Method,
    parts: Partitions,
    outputs: Outputs,
    *,
    controls: bool = option(SPLIT, "What the rest and the clock alone would give.", default=True),
    spaces: str = option(
        METHOD,
        "Feature spaces separated by commas; paper: the paper's; all. Default: raw+hfmh,multiband,best.",
        default="",
    ),
    confusion: str | None = option(OUTPUT, "Space of the confusion matrix. Default: the best."),
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
    `granular-id evaluate recordings --paper --train 40 --test 10 --json result.json --csv predictions.csv`
    `granular-id evaluate irregular --rate-hz 100 --max-gap-s 1 --n-samples shortest --bin-range auto`
    `granular-id evaluate recordings --protocol session --spaces raw,raw+hfmh --figures figures`
    `granular-id evaluate few --protocol kfold --folds 5`
    `granular-id evaluate recordings --hold-out tool`

    The headline is the strictest protocol that the recordings allow: whole sessions held out, or halves in time
    order. Beside it as many recordings are drawn at random, which flatters a method that recognises the session
    instead of the material; the gap between the two is shown. Controls say what can be had without touching the
    material. Each accuracy is printed as soon as it is known.

    Exit code 3: the checks of `granular-id data check` found what spoils the figures, such as a clock that
    names the label; `--accept NAME` says that it is known.
    """
    method.refuse_impossible(steps.rate_hz)
    from granular_id.evaluation import USUAL_SPACES

    chosen = chosen_spaces(spaces or ("paper" if parts.paper else ",".join(USUAL_SPACES)), confusion)
    with outputs.ready(reading.path):
        reading.refuse_absent()
        notes = method.unused_in(chosen)
        data = equal_recordings(reading, steps, quiet=quiet)

        from granular_id.ecoc import ECOCClassifier

        for note in [] if quiet else notes:
            show(f"note: {note}")
        known = method.spaces(data.rate_hz)
        evaluate_and_show(
            data,
            {name: known[name] for name in chosen},
            parts.protocol,
            outputs,
            confusion=confusion,
            quiet=quiet,
            hold_out=parts.hold_out,
            n_partitions=parts.partitions,
            train_per_class=parts.train,
            test_per_class=parts.test,
            n_folds=parts.folds,
            controls=controls,
            accept=parts.accept or (),
            classifier=ECOCClassifier(C=method.c),
            n_jobs=method.n_jobs,
            random_state=parts.seed,
        )

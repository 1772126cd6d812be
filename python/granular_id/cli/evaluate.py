"""``granular-id evaluate``: how well materials are distinguished, in which space."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Option

from granular_id._checks import named
from granular_id._core import GranularIdError
from granular_id._text import install
from granular_id.cli import options as opt
from granular_id.cli.outputs import (
    PAGE,
    PREDICTIONS,
    ROOM,
    check_outputs,
    json_of,
    print_table,
    repeated_command,
    show,
    write_files,
)
from granular_id.cli.recordings import read

if TYPE_CHECKING:
    from granular_id.evaluation import EvaluationResult
    from granular_id.spaces import FeatureSpace

_MOST_LINES = 5
"""Of what spoils the figures, and of what deserves mention."""


def evaluate(
    path: opt.Recordings,
    *,
    spaces: Annotated[
        str | None,
        Option(help="Feature spaces, the headline's first; paper; all. Default: best,multiband,raw+hfmh."),
    ] = None,
    hold_out: opt.HoldOut = "auto",
    paper: Annotated[
        str | None,
        Option(
            metavar="20,50,12", help="The paper's table: partitions, training and test recordings of each."
        ),
    ] = None,
    accept: Annotated[list[str] | None, Option(help="A finding that is known. Repeatable.")] = None,
    cutoff_hz: opt.CutoffHz = None,
    bin_range: opt.BinRange = None,
    jobs: opt.Jobs = None,
    seed: opt.Seed = 0,
    report: Annotated[Path | None, Option(help="Write one HTML file with everything.")] = None,
    json: opt.Json = None,
    csv: Annotated[Path | None, Option(help="Write every prediction.")] = None,
    force: opt.Force = False,
    details: opt.Details = False,
    quiet: opt.Quiet = False,
) -> None:
    """Measure how well the materials in a set of recordings are distinguished.

    PATH is what `granular-id data convert` wrote, or a folder of files: one sub-folder per material
    (`rice/01.csv`), files named after it (`rice_01.csv`), or an `index.csv`. Forces are in N, torques in N m.

    The headline is the space that stands first, on what new recordings will not share: whole sessions held out,
    or halves in the order of time or files, or a condition. Beside it as many recordings are drawn at random, which
    flatters a method that recognises the session. Baselines, in brackets, are had without touching the material.

    Exit code 3: something spoils the figures, such as a clock that names the label; `--accept NAME` says that it is
    known.

    Examples:

    - `granular-id evaluate recordings --report report.html`
    - `granular-id evaluate recordings --hold-out tool --details`
    - `granular-id evaluate recordings --spaces raw+hfmh,multiband --json result.json --csv predictions.csv`
    - `granular-id evaluate slow.npz --cutoff-hz 5 --bin-range auto`
    - `granular-id evaluate recordings --paper 20,40,10`
    """
    counts = None if paper is None else _counts(paper)
    if counts is not None and hold_out != "auto":
        raise GranularIdError(
            f"--hold-out {hold_out} has no use with --paper, which draws at random: leave one out"
        )
    settings = opt.histogram_settings(cutoff_hz, bin_range)
    check_outputs(
        ("--report", report, PAGE),
        ("--json", json, json_of("evaluation")),
        ("--csv", csv, PREDICTIONS),
        source=path,
        force=force,
    )
    if report is not None:
        for module in ("matplotlib", "jinja2"):
            if importlib.util.find_spec(module) is None:
                raise ImportError(f"a report needs {module}: {install('app')}")
    names = _names_in(spaces)
    if settings and isinstance(names, list) and not any("hfmh" in name for name in names):
        raise GranularIdError(
            f"--cutoff-hz and --bin-range are about the histogram (hfmh), none of {spaces} has one"
        )
    from granular_id._progress import showing
    from granular_id.evaluation import evaluate as evaluate_spaces

    data = read(path, prepared=True, quiet=quiet)
    with showing(not quiet) as step:
        result = evaluate_spaces(
            data,
            _with_settings(names, data.rate_hz, settings) if settings else names,
            by=hold_out,
            paper=counts or False,
            accept=accept or (),
            n_jobs=-1 if jobs is None else jobs,
            random_state=seed,
            progress=step or False,
        )
    result = replace(result, command=repeated_command())
    room = ROOM - sum(file is not None for file in (report, json, csv))
    print_result(result, details=details, quiet=quiet, room=room)
    write_files(
        (json, result.to_json), (csv, result.to_csv), (report, lambda file: write_report(result, file))
    )
    if result.spoiling:
        raise typer.Exit(opt.FOUND_ERRORS)


def print_result(result: EvaluationResult, *, details: bool, quiet: bool, room: int) -> None:
    """Print on so many lines what spoils the figures, the headline, the gap, the table, and as many remarks as fit."""
    from granular_id.evaluation import accuracy_table, gap_lines, headline, remarks, spoiled_lines

    spoiled = spoiled_lines(result)
    if spoiled:
        room -= show("\n".join(spoiled), "bold red", most=None if details else _MOST_LINES)
        accept = " ".join(f"--accept {one.code}" for one in result.spoiling)
        room -= show(f"where it is known: {accept}", "bold red")
    room -= show(headline(result), "bold yellow" if result.synthetic else "bold")
    room -= sum(show(line) for line in gap_lines(result))
    table, notes = accuracy_table(result), remarks(result)
    room -= print_table(table, strong=result.synthetic, details=details, room=room)
    if details:
        show(result.details())
    elif notes and not quiet and room > 0:
        show("\n".join(notes), most=min(room, _MOST_LINES))


def _names_in(spaces: str | None) -> str | list[str] | None:
    """Read ``--spaces``."""
    if spaces is None or spaces in ("paper", "all"):
        return spaces
    from granular_id.spaces import feature_spaces

    names, known = opt.names_in(spaces), feature_spaces()
    for name in names:
        # alone these stand for several
        named(known if len(names) > 1 or name in known else {**known, "paper": (), "all": ()}, "spaces", name)
    if not names or len(set(names)) < len(names):
        raise GranularIdError(f"--spaces must name at least one feature space, each once, got {spaces!r}")
    return names


def _with_settings(
    names: str | list[str] | None, rate_hz: float, settings: dict[str, Any]
) -> dict[str, FeatureSpace]:
    """Return feature spaces with a histogram of one's own."""
    from granular_id.evaluation import USUAL_SPACES
    from granular_id.spaces import all_spaces, feature_spaces, paper_spaces

    known = feature_spaces(rate_hz=rate_hz, **settings)
    every = {None: USUAL_SPACES, "paper": paper_spaces(known), "all": all_spaces(known)}
    return {name: known[name] for name in (names if isinstance(names, list) else every[names])}


def write_report(result: EvaluationResult, path: Path) -> None:
    """Write the HTML page."""
    from granular_id.report import write

    write(result, path)


def _counts(text: str) -> tuple[int, int, int]:
    """Read ``--paper``."""
    try:
        partitions, train, test = (int(part) for part in text.split(","))
    except ValueError:
        partitions, train, test = 0, 0, 0
    if min(partitions, train, test) < 1:
        raise GranularIdError(f"--paper must be PARTITIONS,TRAIN,TEST such as 20,50,12, got {text!r}")
    return partitions, train, test

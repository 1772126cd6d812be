"""``granular-id demo``: what the package does, on simulated pushes, without any recordings at hand."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from granular_id._files import made_folder
from granular_id._progress import showing
from granular_id.cli.evaluate import print_result, write_report
from granular_id.cli.options import Force, Seed
from granular_id.cli.outputs import PAGE, PREDICTIONS, ROOM, check_outputs, json_of, show, write_files

if TYPE_CHECKING:
    from granular_id.recording import Dataset

PER_CLASS = 20
"""Pushes of each material: with them everything takes well under a minute."""

LIVE_PUSHES, LIVE_SPEED = 3, 5

_BELOW = 5 + LIVE_PUSHES
"""Lines that name files, and what is answered live."""


def demo(
    *,
    output: Annotated[Path, Option("--output", "-o", help="Folder for the files.")] = Path("demo"),
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Evaluate SYNTHETIC recordings, 11 simulated materials in 4 sessions, then name simulated pushes live.

    The recordings come from a physical model: the accuracies say nothing about real materials. Writes report.html
    (open it in a browser), result.json and predictions.csv.

    Examples:

    - `granular-id demo -o somewhere --seed 1`
    """
    page, numbers, table = (output / name for name in ("report.html", "result.json", "predictions.csv"))
    with made_folder(output):
        check_outputs(
            ("--output", page, PAGE),
            ("--output", numbers, json_of("evaluation")),
            ("--output", table, PREDICTIONS),
            force=force,
        )
        from granular_id.evaluation import evaluate
        from granular_id.synthetic import PAPER_MATERIALS, synthesize

        n = PER_CLASS * len(PAPER_MATERIALS)
        show(f"simulating {n} pushes: SYNTHETIC, to show that the program works", "bold yellow", err=True)
        data = synthesize(n_per_class=PER_CLASS, seed=seed)
        with showing(True) as step:
            result = evaluate(data, n_jobs=-1, random_state=seed, progress=step or False)
        print_result(result, details=False, quiet=False, room=ROOM - _BELOW)
        write_files(
            (numbers, result.to_json), (table, result.to_csv), (page, lambda file: write_report(result, file))
        )
        _name_live(data, seed)
    show(f"open {page} in a browser")


def _name_live(data: Dataset, seed: int) -> None:
    """Train on all recordings, and name pushes of a simulated sensor as they come."""
    from granular_id.identifier import Identifier
    from granular_id.live import SimSource, identify

    show("Live, a simulated sensor in a session of its own (SYNTHETIC):", "bold")
    model = Identifier.fit(data, estimate=False)
    source = SimSource("unknown", seed=seed, speed=LIVE_SPEED)
    for number, decision in enumerate(identify(source, model, n=LIVE_PUSHES, pre_s=0.15), start=1):
        result = "right" if decision.label == source.truth else f"wrong: it was {source.truth}"
        show(f"push {number}: {decision.label}, by a margin of {decision.margin:.2f} ({result})")

"""``granular-id demo``: an evaluation of simulated pushes, without any recordings at hand."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

from granular_id.cli.evaluate import CHECKPOINT, Outputs, evaluate_and_show, saying_how_to_go_on
from granular_id.cli.options import FORCE, command, count
from granular_id.cli.outputs import show

if TYPE_CHECKING:
    from granular_id._progress import ProgressCallback

FULL = {"n_partitions": 20, "train_per_class": 50, "test_per_class": 12}
QUICK = {"n_partitions": 5, "train_per_class": 8, "test_per_class": 4}


@command
def demo(
    *,
    output: Path = typer.Option(Path("demo"), "--output", "-o", help="Folder for the files."),
    quick: bool = typer.Option(False, "--quick", help="12 recordings of each material, 5 partitions."),
    seed: int = typer.Option(0, callback=count(0), help="Same seed, same recordings and numbers."),
    threads: int | None = typer.Option(
        None, callback=count(1), help="The numbers do not depend on it. Default: all cores."
    ),
    checkpoint: Path | None = typer.Option(None, help=CHECKPOINT),
    force: bool = FORCE,
) -> None:
    """Evaluate the built-in SYNTHETIC recordings: 11 simulated materials, 62 pushes of each.

    The recordings come from a physical model, not from a sensor. The accuracies show that the program works;
    they say nothing about real materials. Writes report.html (open it in a browser), its figures as PNG,
    result.json and predictions.csv.

    Examples:

    `granular-id demo`
    `granular-id demo -o somewhere --quick`
    """
    outputs = Outputs(
        report=output / "report.html",
        json=output / "result.json",
        csv=output / "predictions.csv",
        figures=output,
        checkpoint=checkpoint,
        force=force,
    )
    named = dict.fromkeys(("--report", "--json", "--csv", "--figures"), "--output")
    counts: dict[str, Any] = QUICK if quick else FULL
    with outputs.ready(named=named), saying_how_to_go_on(checkpoint):
        from granular_id.evaluation import in_paper_order
        from granular_id.spaces import feature_spaces
        from granular_id.synthetic import PAPER_MATERIALS, synthesize

        n_per_class = counts["train_per_class"] + counts["test_per_class"]
        n = n_per_class * len(PAPER_MATERIALS)
        Console(highlight=False).print(
            f"[bold yellow]SYNTHETIC data[/]: {n} simulated pushes through {len(PAPER_MATERIALS)} materials. The "
            "figures below show that the program works, not how well it knows real materials."
        )
        show(f"simulating {n} pushes", err=True)
        data = synthesize(n_per_class=n_per_class, seed=seed)
        known = feature_spaces(rate_hz=data.rate_hz, threads=threads)
        evaluate_and_show(
            data,
            {name: known[name] for name in in_paper_order(known)},
            "auto",
            outputs,
            progress=True if sys.stderr.isatty() else _in_lines(),
            **counts,
            random_state=seed,
            n_jobs=-1 if threads is None else threads,
        )


def _in_lines() -> ProgressCallback:
    """Tell progress where there is no terminal for a bar: a line when a space or protocol is first met."""
    told = set[str]()

    def tell(done: int, total: int, what: str) -> None:
        step = what.partition(", ")[0]
        if step not in told:
            told.add(step)
            show(f"{done} of {total}: {step}", err=True)

    return tell

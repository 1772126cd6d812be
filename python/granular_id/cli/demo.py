"""``granular-id demo``: what the package does, on simulated pushes, without any recordings at hand."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from granular_id._files import made_folder
from granular_id.cli.evaluate import Outputs, evaluate_and_show
from granular_id.cli.options import FORCE, command, count
from granular_id.cli.outputs import show

if TYPE_CHECKING:
    from granular_id.recording import Dataset

PER_CLASS = 20
"""Pushes of each material: with them everything takes well under a minute."""

LIVE_PUSHES, LIVE_SPEED = 3, 5


@command
def demo(
    *,
    output: Path = typer.Option(Path("demo"), "--output", "-o", help="Folder for the files."),
    seed: int = typer.Option(0, callback=count(0), help="Same seed, same recordings and numbers."),
    threads: int | None = typer.Option(
        None, callback=count(1), help="The numbers do not depend on it. Default: all cores."
    ),
    force: bool = FORCE,
) -> None:
    """Evaluate SYNTHETIC recordings, 11 simulated materials in 4 sessions, then name simulated pushes live.

    The recordings come from a physical model, not from a sensor. The accuracies show that the program works;
    they say nothing about real materials. Writes report.html (open it in a browser), result.json and
    predictions.csv. It takes less than a minute of processor time.

    Examples:

    `granular-id demo`
    `granular-id demo -o somewhere --seed 1`
    """
    page = output / "report.html"
    outputs = Outputs(
        report=page,
        json=output / "result.json",
        csv=output / "predictions.csv",
        force=force,
    )
    with made_folder(output):
        outputs.check(name="--output")
        from granular_id.evaluation import USUAL_SPACES
        from granular_id.spaces import feature_spaces
        from granular_id.synthetic import PAPER_MATERIALS, synthesize

        n = PER_CLASS * len(PAPER_MATERIALS)
        Console(highlight=False).print(
            f"[bold yellow]SYNTHETIC data[/]: {n} simulated pushes through {len(PAPER_MATERIALS)} materials. The "
            "figures below show that the program works, not how well it knows real materials."
        )
        show(f"simulating {n} pushes", err=True)
        data = synthesize(n_per_class=PER_CLASS, seed=seed)
        known = feature_spaces(rate_hz=data.rate_hz, threads=threads)
        evaluate_and_show(
            data,
            {name: known[name] for name in USUAL_SPACES},
            outputs,
            random_state=seed,
            n_jobs=-1 if threads is None else threads,
        )
        _name_live(data, seed)
    show(f"\nopen {page} in a browser")


def _name_live(data: Dataset, seed: int) -> None:
    """Train on all recordings, and name pushes of a simulated sensor as they come."""
    from granular_id.identifier import Identifier
    from granular_id.live import SimSource, identify

    show("\nLive, a simulated sensor in a session of its own (SYNTHETIC):", "bold")
    model = Identifier.fit(data, estimate=False)
    source = SimSource("unknown", seed=seed, speed=LIVE_SPEED)
    for number, decision in enumerate(identify(source, model, n=LIVE_PUSHES, pre_s=0.15), start=1):
        verdict = "right" if decision.label == source.truth else f"wrong: it was {source.truth}"
        show(f"push {number}: {decision.label}, by a margin of {decision.margin:.2f} ({verdict})")

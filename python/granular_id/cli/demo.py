"""``granular-id demo``: the whole way on simulated recordings, so that everything can be seen to work."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from granular_id.cli.errors import guarded
from granular_id.cli.method import at_least
from granular_id.cli.session import Force, Outputs, Run, evaluate_and_show

if TYPE_CHECKING:
    from granular_id._progress import ProgressCallback

__all__ = ["demo"]

TEXT = """
Evaluate the built-in SYNTHETIC recordings: 11 simulated materials, 62 pushes of each.

The recordings come from a physical model, not from a sensor. The accuracies show that the program works; they
say nothing about real materials. Writes report.html (open it in a browser), its figures as PNG, result.json and
predictions.csv.

Examples:

`granular-id demo`

`granular-id demo -o somewhere --quick`
"""

FULL = {"n_partitions": 20, "train_per_class": 50, "test_per_class": 12}
QUICK = {"n_partitions": 5, "train_per_class": 8, "test_per_class": 4}


@guarded
def demo(
    *,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the files.")] = Path("demo"),
    quick: Annotated[
        bool, typer.Option("--quick", help="12 recordings of each material, 5 partitions.")
    ] = False,
    seed: Annotated[int, typer.Option("--seed", help="Same seed, same recordings and numbers.")] = 0,
    threads: Annotated[
        int | None, typer.Option("--threads", help="The numbers do not depend on it. Default: all cores.")
    ] = None,
    force: Force = False,
) -> None:
    """Evaluate simulated recordings; see `TEXT`."""
    at_least("--seed", seed, 0)
    at_least("--threads", threads, 1)
    outputs = Outputs(
        report=output / "report.html",
        json=output / "result.json",
        csv=output / "predictions.csv",
        figures=output,
        force=force,
        named=dict.fromkeys(("--report", "--json", "--csv", "--figures"), "--output"),
    )
    with outputs.ready():
        _run(outputs, QUICK if quick else FULL, seed, threads)


demo.__doc__ = TEXT


def _run(outputs: Outputs, counts: dict[str, int], seed: int, threads: int | None) -> None:
    from granular_id.evaluation import in_paper_order
    from granular_id.spaces import feature_spaces
    from granular_id.synthetic import PAPER_MATERIALS, synthesize

    n_per_class = counts["train_per_class"] + counts["test_per_class"]
    n = n_per_class * len(PAPER_MATERIALS)
    Console(highlight=False).print(
        f"[bold yellow]SYNTHETIC data[/]: {n} simulated pushes through {len(PAPER_MATERIALS)} materials. The "
        "figures below show that the program works, not how well it knows real materials."
    )
    told = Console(stderr=True, highlight=False)
    step = f"simulating {n} pushes"
    if not told.is_terminal:
        told.print(step)
    with told.status(step):
        data = synthesize(n_per_class=n_per_class, seed=seed)
    known = feature_spaces(rate_hz=data.rate_hz, threads=threads)
    run = Run(
        spaces={name: known[name] for name in in_paper_order(known)},
        arguments={**counts, "random_state": seed, "n_jobs": threads if threads is not None else -1},
        progress=True if told.is_terminal else _in_lines(told),
    )
    evaluate_and_show(data, run, outputs, quiet=False)


def _in_lines(console: Console) -> ProgressCallback:
    """Tell progress where there is no terminal for a bar: a line when a space or protocol is first met."""
    told = set[str]()

    def tell(done: int, total: int, what: str) -> None:
        step = what.partition(", ")[0]
        if step not in told:
            told.add(step)
            console.print(f"{done} of {total}: {step}", markup=False, soft_wrap=True)

    return tell

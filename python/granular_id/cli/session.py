"""What ``evaluate`` and ``demo`` share: run, print, write."""

from __future__ import annotations

import importlib.util
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

if TYPE_CHECKING:
    from granular_id.evaluation import EvaluationResult
    from granular_id.recording import Dataset
    from granular_id.spaces import FeatureSpace

__all__ = ["Outputs", "Run", "evaluate_and_show"]


@dataclass(frozen=True)
class Outputs:
    """Files to write; None leaves one out."""

    json: Path | None = None
    csv: Path | None = None
    mean_forces: Path | None = None
    confusion: Path | None = None

    def check(self) -> None:
        """Refuse what could not be written, before any time is spent on it."""
        from granular_id._files import check_target  # noqa: PLC0415 (slow to import)

        for path in (self.json, self.csv, self.mean_forces, self.confusion):
            if path is not None:
                check_target(path)
        figures = self.mean_forces is not None or self.confusion is not None
        if figures and importlib.util.find_spec("matplotlib") is None:
            raise ImportError("figures need matplotlib: pip install 'granular-id[app]'")


@dataclass(frozen=True)
class Run:
    """An evaluation to make: see `granular_id.evaluate`.

    ``protocols`` are required; ``tried``, if given, runs as well where the data allow it, and a line says why
    not where they do not.
    """

    spaces: Mapping[str, FeatureSpace]
    protocols: tuple[str, ...]
    tried: str | None = None
    confusion_of: str | None = None
    arguments: Mapping[str, Any] = field(default_factory=dict)


def evaluate_and_show(data: Dataset, run: Run, outputs: Outputs, words: list[str], *, quiet: bool) -> None:
    """Evaluate, print the tables, write the files, say where they are.

    Parameters
    ----------
    data : Dataset
        Of one rate and length.
    run : Run
    outputs : Outputs
        Already checked.
    words : list of str
        The command that repeats this, word by word.
    quiet : bool
        Accuracies only, no progress.
    """
    from granular_id.cli.render import print_result  # noqa: PLC0415 (slow to import: --help must not wait)
    from granular_id.evaluation import evaluate  # noqa: PLC0415
    from granular_id.evaluation.plan import plan_partitions  # noqa: PLC0415

    protocols, notes = list(run.protocols), []
    if run.tried is not None:
        try:
            plan_partitions(data, run.tried)
            protocols.append(run.tried)
        except ValueError as why:
            notes.append(f"{run.tried} protocol left out: {why}")
    result = evaluate(data, run.spaces, protocols, progress=not quiet, **run.arguments)
    result = replace(result, notes=(*result.notes, *notes), command=shlex.join(words))
    console = Console(highlight=False)
    print_result(console, result, run.confusion_of, brief=quiet)
    written = _write(data, result, run.confusion_of, outputs)
    if not quiet:
        console.print()
        for path in written:
            console.print(f"wrote {path}", soft_wrap=True, markup=False)
        console.print(f"repeat with: {result.command}", soft_wrap=True, markup=False)


def _write(data: Dataset, result: EvaluationResult, space: str | None, outputs: Outputs) -> list[Path]:
    jobs: list[tuple[Path | None, Callable[[Path], object]]] = [
        (outputs.json, result.to_json),
        (outputs.csv, result.to_csv),
    ]
    if outputs.mean_forces is not None or outputs.confusion is not None:
        from granular_id.plotting import plot_confusion, plot_mean_forces  # noqa: PLC0415 (matplotlib is an extra)

        protocol = result.protocols[0]
        chosen = space or result.best_space(protocol)
        mark = ", SYNTHETIC recordings" if result.synthetic else ""
        title = f"{chosen}, {protocol} protocol{mark}"
        jobs += [
            (outputs.mean_forces, lambda path: plot_mean_forces(data, path=path)),
            (
                outputs.confusion,
                lambda path: plot_confusion(result.confusion(chosen), result.labels, title=title, path=path),
            ),
        ]
    written = []
    for path, write in jobs:
        if path is not None:
            write(path)
            written.append(path)
    return written

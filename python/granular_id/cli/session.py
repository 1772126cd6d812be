"""What ``evaluate`` and ``demo`` share: run, print, write."""

from __future__ import annotations

import importlib.util
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

if TYPE_CHECKING:
    from granular_id.evaluation import EvaluationResult
    from granular_id.recording import Dataset
    from granular_id.spaces import FeatureSpace

__all__ = ["Outputs", "Run", "evaluate_and_show"]

MEAN_FORCES, CONFUSION = "mean_forces.png", "confusion_{protocol}.png"


@dataclass(frozen=True)
class Outputs:
    """Files to write, and a folder for figures; None leaves one out."""

    json: Path | None = None
    csv: Path | None = None
    figures: Path | None = None

    @contextmanager
    def ready(self) -> Iterator[None]:
        """Refuse what could not be written, before any time is spent on it.

        The folder for figures is made, and is removed again when the block raises and left it empty.
        """
        from granular_id._files import check_target, made_folder  # noqa: PLC0415 (slow to import)

        if self.figures is not None and importlib.util.find_spec("matplotlib") is None:
            raise ImportError("figures need matplotlib: pip install 'granular-id[app]'")
        with nullcontext() if self.figures is None else made_folder(self.figures):
            drawn = [] if self.figures is None else [self.figures / MEAN_FORCES]
            for path in (self.json, self.csv, *drawn):
                if path is not None:
                    check_target(path)
            yield


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


def evaluate_and_show(data: Dataset, run: Run, outputs: Outputs, *, quiet: bool) -> None:
    """Evaluate, print the tables, write the files, say where they are.

    Parameters
    ----------
    data : Dataset
        Of one rate and length.
    run : Run
    outputs : Outputs
        Found ready.
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
    result = replace(result, notes=(*result.notes, *notes), command=_command())
    console = Console(highlight=False)
    print_result(console, result, run.confusion_of, brief=quiet)
    written = _write(data, result, run.confusion_of, outputs)
    if written or not quiet:
        console.print()
    for path in written:
        console.print(f"wrote {path}", soft_wrap=True, markup=False)
    if not quiet:
        console.print(f"repeat with: {result.command}", soft_wrap=True, markup=False)


def _write(data: Dataset, result: EvaluationResult, space: str | None, outputs: Outputs) -> list[Path]:
    jobs: list[tuple[Path | None, Callable[[Path], object]]] = [
        (outputs.json, result.to_json),
        (outputs.csv, result.to_csv),
    ]
    if outputs.figures is not None:
        from granular_id.plotting import plot_mean_forces  # noqa: PLC0415 (matplotlib is an extra)

        jobs.append((outputs.figures / MEAN_FORCES, lambda path: plot_mean_forces(data, path=path)))
        for protocol in result.protocols:
            target = outputs.figures / CONFUSION.format(protocol=protocol)
            jobs.append((target, partial(_plot_confusion, result, space, protocol)))
    written = []
    for path, write in jobs:
        if path is not None:
            write(path)
            written.append(path)
    return written


def _plot_confusion(result: EvaluationResult, space: str | None, protocol: str, path: Path) -> None:
    from granular_id.plotting import plot_confusion  # noqa: PLC0415 (matplotlib is an extra)

    chosen = space or result.best_space(protocol)
    mark = ", SYNTHETIC recordings" if result.synthetic else ""
    title = f"{chosen}, {protocol} protocol{mark}"
    plot_confusion(result.confusion(chosen, protocol), result.labels, title=title, path=path)


def _command() -> str:
    """Return what to type to repeat this run, by the name under which the program was started."""
    started = Path(sys.argv[0])
    if started.name in {"granular-id", "granular-id.exe"}:
        found = shutil.which(started.name)
        elsewhere = started.exists() and not (found and Path(found).samefile(started))
        program = [str(started) if elsewhere else started.name]
    else:
        by_package = started.name == "__main__.py" and started.parent.name == "granular_id"
        program = ["python", "-m", "granular_id" if by_package else "granular_id.cli"]
    return shlex.join([*program, *sys.argv[1:]])

"""What commands share: run an evaluation, print it, write files, say how to repeat it."""

from __future__ import annotations

import importlib.util
import shlex
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

if TYPE_CHECKING:
    from granular_id._progress import ProgressCallback
    from granular_id.evaluation import EvaluationResult
    from granular_id.recording import Dataset
    from granular_id.spaces import FeatureSpace

__all__ = ["Outputs", "Run", "check_targets", "evaluate_and_show", "repeated_command", "say_written"]


@dataclass(frozen=True)
class Outputs:
    """Files to write, and a folder for figures; None leaves one out. `source` is what is read, to be kept."""

    report: Path | None = None
    json: Path | None = None
    csv: Path | None = None
    figures: Path | None = None
    source: Path | None = None

    @contextmanager
    def ready(self) -> Iterator[None]:
        """Refuse what could not be written, before any time is spent on it.

        The folder for figures is made, and is removed again when the block raises and left it empty.
        """
        from granular_id._files import made_folder  # noqa: PLC0415 (slow to import)

        for wanted, module, path in (
            ("figures need", "matplotlib", self.figures),
            ("a report needs", "matplotlib", self.report),
            ("a report needs", "jinja2", self.report),
        ):
            if path is not None and importlib.util.find_spec(module) is None:
                raise ImportError(f"{wanted} {module}: pip install 'granular-id[app]'")
        with nullcontext() if self.figures is None else made_folder(self.figures):
            check_targets(self.report, self.json, self.csv, source=self.source)
            yield

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
            from granular_id.evaluation.report import figures  # noqa: PLC0415 (matplotlib is an extra)

            written += figures(result, self.figures, "png", space=space)
        return written


def check_targets(*paths: Path | None, source: Path | None = None) -> None:
    """Refuse files that cannot be written, those of `source`, and one that would be written twice; None is no file."""
    from granular_id._files import check_target  # noqa: PLC0415 (slow to import)

    targets = [check_target(path) for path in paths if path is not None]
    places = [target.resolve() for target in targets]
    for k, place in enumerate(places):
        if place in places[:k]:
            raise ValueError(f"{targets[k]} would be written twice: give each output a file of its own")
        if source is not None and place.exists() and source.resolve() in (place, *place.parents):
            raise ValueError(f"{targets[k]} belongs to {source}, which is read: give the output another name")


@dataclass(frozen=True)
class Run:
    """An evaluation to make: see `granular_id.evaluate`.

    `fresh` forgets what an interrupted run had finished; `progress` is heeded unless the command is quiet.
    """

    spaces: Mapping[str, FeatureSpace]
    protocol: str | tuple[str, ...] = "auto"
    confusion_of: str | None = None
    fresh: bool = False
    arguments: Mapping[str, Any] = field(default_factory=dict)
    progress: bool | ProgressCallback = True


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
    from granular_id.cli.kept import kept_for  # noqa: PLC0415 (slow to import: --help must not wait)
    from granular_id.cli.render import print_result  # noqa: PLC0415
    from granular_id.evaluation import evaluate  # noqa: PLC0415

    command = repeated_command()
    with kept_for(command, fresh=run.fresh) as kept:
        result = kept.going_on(
            lambda folder: evaluate(
                data,
                run.spaces,
                run.protocol,
                checkpoint=folder,
                progress=not quiet and run.progress,
                **run.arguments,
            )
        )
        result = replace(result, command=command)
        console = Console(highlight=False)
        print_result(console, result, run.confusion_of, brief=quiet)
        written = outputs.write(result, run.confusion_of)
        if not quiet and outputs.report is None:
            console.print("\nall tables and figures on one page: add --report FILE.html", soft_wrap=True)
        say_written(console, written, None if quiet else command)


def say_written(console: Console, written: Sequence[Path], command: str | None) -> None:
    """Name the files that were written, and what to type to repeat it all."""
    if written or command:
        console.print()
    for path in written:
        console.print(f"wrote {path}", soft_wrap=True, markup=False)
    if command:
        console.print(f"repeat with: {command}", soft_wrap=True, markup=False)


def repeated_command() -> str:
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

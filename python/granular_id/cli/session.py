"""What commands share: run an evaluation, print it, write files, say how to repeat it."""

from __future__ import annotations

import importlib.util
import re
import shlex
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from rich.console import Console

from granular_id._files import JSON, MODELS, PAGES, PICTURES, TABLES, check_target, made_folder
from granular_id.cli.groups import option

if TYPE_CHECKING:
    from granular_id._progress import ProgressCallback
    from granular_id.evaluation import EvaluationResult
    from granular_id.recording import Dataset
    from granular_id.spaces import FeatureSpace

__all__ = [
    "ANSWERS",
    "JSON_FILE",
    "LIVE_ANSWERS",
    "MODEL",
    "PAGE",
    "PICTURE",
    "PREDICTIONS",
    "RERUN_LOG",
    "Force",
    "Kind",
    "Output",
    "Outputs",
    "Run",
    "check_outputs",
    "evaluate_and_show",
    "repeated_command",
    "say_written",
]


Force = Annotated[
    bool, option("--force", "Output", "Replace files that are there, where they are of the same kind.")
]


class Kind(NamedTuple):
    """A kind of output: what it is called, the endings it may have, and how its files begin (a pattern of bytes)."""

    name: str
    endings: tuple[str, ...]
    begins: bytes


JSON_FILE = Kind("a JSON file", JSON, rb"\s*[{\[]")
PAGE = Kind("an HTML page", PAGES, rb"\s*<(!doctype\s+)?html")
MODEL = Kind("a model", MODELS, rb".{8}\{")
PREDICTIONS = Kind("a table of predictions", TABLES, rb"protocol,partition,")
ANSWERS = Kind("a table of answers", TABLES, rb"recording,label,margin,")
LIVE_ANSWERS = Kind("a file of live answers", (".jsonl", ".ndjson", *JSON), rb"\s*\{")
RERUN_LOG = Kind("a Rerun log", (".rrd",), rb"RRF")
PICTURE = Kind("a picture", (), rb"\x89PNG|%PDF|\s*<(\?xml|svg)")
"""Its ending chooses the format, and so is asked for; matplotlib knows more of them than begin like this."""

Output = tuple[str, Path | None, Kind]
"""An option, the file that it names, and what will be written there; None is no file."""


@dataclass(frozen=True)
class Outputs:
    """Files to write, and a folder for figures; None leaves one out.

    `source` is what is read, to be kept; `force` replaces what is there. `named` holds the options of commands that
    name them otherwise than `granular-id evaluate`, by its options.
    """

    report: Path | None = None
    json: Path | None = None
    csv: Path | None = None
    figures: Path | None = None
    source: Path | None = None
    force: bool = False
    named: Mapping[str, str] = field(default_factory=dict)

    @contextmanager
    def ready(self) -> Iterator[None]:
        """Refuse what could not be written, before any time is spent on it.

        The folder for figures is made, and is removed again when the block raises and left it empty.
        """
        for wanted, module, path in (
            ("figures need", "matplotlib", self.figures),
            ("a report needs", "matplotlib", self.report),
            ("a report needs", "jinja2", self.report),
        ):
            if path is not None and importlib.util.find_spec(module) is None:
                raise ImportError(f"{wanted} {module}: pip install 'granular-id[app]'")
        with nullcontext() if self.figures is None else made_folder(self.figures):
            outputs: list[Output] = [
                ("--report", self.report, PAGE),
                ("--json", self.json, JSON_FILE),
                ("--csv", self.csv, PREDICTIONS),
                *(("--figures", path, PICTURE) for path in self._figures_there()),
            ]
            of_command = [(self.named.get(name, name), path, kind) for name, path, kind in outputs]
            check_outputs(*of_command, source=self.source, force=self.force)
            yield

    def _figures_there(self) -> list[Path]:
        """Figures that would be replaced; which of all there will be depends on the evaluation."""
        if self.figures is None or not any(self.figures.glob("*.png")):
            return []
        from granular_id.evaluation.report.files import FIGURES  # noqa: PLC0415 (matplotlib is an extra)

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
            from granular_id.evaluation.report import figures  # noqa: PLC0415 (matplotlib is an extra)

            written += figures(result, self.figures, "png", space=space)
        return written


def check_outputs(*outputs: Output, source: Path | None = None, force: bool = False) -> None:
    """Refuse, before any work, outputs that would not be what their name says, or would replace what is there.

    What `_check_targets` refuses; a name that ends like no file of its kind; a file of another kind, by how it begins;
    without `force` any file that is not empty.
    """
    _check_targets(*(path for _, path, _ in outputs), source=source)
    for name, path, kind in outputs:
        if path is None:
            continue
        if kind is PICTURE:
            from granular_id.plotting.style import file_format  # noqa: PLC0415 (matplotlib is an extra)

            file_format(path, name)
        elif path.suffix.lower() not in kind.endings and re.search("[a-z]", path.suffix.lower()):
            # rice_0.5 is no kind of file
            wanted = f"must end in {' or '.join(kind.endings)}, or have no ending"
            raise ValueError(f"{name} writes {kind.name}: it {wanted}, got {path.name!r}")
    for name, path, kind in outputs:
        if path is None or not path.exists() or not path.stat().st_size:
            continue
        known = kind is not PICTURE or path.suffix.lower() in PICTURES
        with path.open("rb") as stream:
            if known and not re.match(kind.begins, stream.read(4096), re.IGNORECASE | re.DOTALL):
                raise ValueError(f"{name} {path}: what is there is not {kind.name}; give another name")
        if not force:
            raise FileExistsError(f"{name} {path}: there is such a file already; add --force to replace it")


def _check_targets(*paths: Path | None, source: Path | None = None) -> None:
    """Refuse files that cannot be written, those of `source`, and one that would be written twice; None is no file."""
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
        if written and "--force" not in shlex.split(command):
            command += " --force"
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

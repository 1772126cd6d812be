"""What commands share: run an evaluation, print it, write files, say how to repeat it."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from granular_id._files import JSON, MODELS, PAGES, PICTURES, TABLES, check_target, made_folder
from granular_id._text import Table
from granular_id.cli.method import option

if TYPE_CHECKING:
    from granular_id._progress import ProgressCallback
    from granular_id.evaluation import EvaluationResult
    from granular_id.recording import Dataset
    from granular_id.spaces import FeatureSpace
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
            from granular_id.plotting import file_format

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
    from granular_id.evaluation import evaluate

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


# Results on a terminal: the same figures as the plain-text tables, with colour and wrapping.


def print_result(console: Console, result: EvaluationResult, space: str | None, *, brief: bool) -> None:
    """Print accuracies with gaps and notes; unless `brief` controls, comparison, choices, confusion and seconds too.

    Parameters
    ----------
    console : Console
    result : EvaluationResult
    space : str or None
        Whose confusion matrix; None: the best of the strictest protocol that ran.
    brief : bool
        The table of accuracies only, without gaps and notes.
    """
    from granular_id.evaluation import (
        PAPER_NOTE,
        accuracy_table,
        choice_tables,
        comparison_tables,
        confusion_table,
        controls_table,
        mistakes_table,
        seconds_table,
    )

    accuracies = accuracy_table(result)
    if brief:
        footnotes = tuple(note for note in accuracies.notes if note == PAPER_NOTE)
        print_table(console, replace(accuracies, notes=footnotes), strong=result.synthetic)
        return
    print_table(console, accuracies, strong=result.synthetic)
    if result.controls:
        print_table(console, controls_table(result))
    for table in (*comparison_tables(result)[:1], *choice_tables(result)):
        print_table(console, table)
    # The matrix of the protocol that flatters least; the report and the figures have all of them.
    protocol = result.strictest or result.protocols[0]
    chosen = space or result.best_space(protocol)
    matrix = confusion_table(result, chosen, protocol)
    fits = _width(matrix) <= console.width
    print_table(console, matrix if fits else mistakes_table(result, chosen, protocol), tight=fits)
    print_table(console, seconds_table(result))


def print_table(console: Console, table: Table, *, strong: bool = False, tight: bool = False) -> None:
    """Print one table with its title above and its notes below."""
    console.print()
    console.print(Text(table.title, style="bold yellow" if strong else "bold"))
    if table.rows:
        drawn = RichTable(
            box=box.SIMPLE_HEAD,
            show_edge=False,
            pad_edge=False,
            padding=(0, 0) if tight else (0, 0, 0, 1),
            header_style="bold",
        )
        for i, name in enumerate(table.header):
            drawn.add_column(Text(name), justify="right" if i else "left", no_wrap=tight)
        for row in table.rows:
            drawn.add_row(*(Text(cell) for cell in row))
        console.print(drawn)
    for note in table.notes:
        console.print(Text(note), highlight=False)


def _width(table: Table) -> int:
    rows = (table.header, *table.rows)
    return sum(max(len(row[i]) for row in rows) + 1 for i in range(len(table.header))) - 1


# Where an interrupted command keeps what it has finished, so that the same command goes on from there.

try:
    import fcntl
except ImportError:  # Windows: two processes with the same command at once are not kept apart there
    fcntl = None  # type: ignore[assignment]


CACHE = "GRANULAR_ID_CACHE"
"""Environment variable: the folder for finished work, instead of granular-id in the user's cache."""

T = TypeVar("T")


class Kept(KeyboardInterrupt):
    """Ctrl-C in a command that keeps what it has finished; the text says what to do about it."""


class Work:
    """A folder for finished work, or None where none can be had."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder

    def going_on(self, work: Callable[[Path | None], T]) -> T:
        """Do some work that goes on from the folder; from the start where the recordings have changed since."""
        from granular_id.evaluation import OtherEvaluationError

        try:
            return work(self.folder)
        except OtherEvaluationError:
            self.forget()
            return work(self.folder)

    def finished(self) -> int:
        """Count what is kept."""
        from granular_id.evaluation import RUN

        return 0 if self.folder is None else sum(path.name != RUN for path in self.folder.glob("*.json"))

    def forget(self) -> None:
        """Remove what is kept."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


@contextmanager
def kept_for(command: str, *, fresh: bool) -> Iterator[Work]:
    """Keep finished work while the block runs, and when Ctrl-C or a crash ends it; forget it when it ends well.

    Parameters
    ----------
    command : str
        What was typed: the same words in the same folder mean the same work, with --force or without.
    fresh : bool
        Forget what an earlier run has left.

    Yields
    ------
    Work
        Below ``$GRANULAR_ID_CACHE``, or ``granular-id`` in the user's cache (``~/.cache``); without a folder where
        that cannot be written.

    Raises
    ------
    Kept
        On Ctrl-C, if anything was finished.
    """
    words = [word for word in shlex.split(command) if word not in ("--fresh", "--force")]
    mark = hashlib.blake2b("\n".join((str(Path.cwd()), *words)).encode(), digest_size=8).hexdigest()
    with _held(_cache(), mark) as folder:
        work = Work(folder)
        if fresh:
            work.forget()
        yield from _kept_in(work)


def _kept_in(work: Work) -> Iterator[Work]:
    try:
        yield work
    except BaseException as stop:
        finished = work.finished()
        if not finished:
            work.forget()
        elif isinstance(stop, KeyboardInterrupt):
            raise Kept(
                f"Interrupted: {finished} finished partitions are kept; the same command goes on from there "
                "(--fresh starts over)."
            ) from None
        raise
    work.forget()


@contextmanager
def _held(root: Path, mark: str) -> Iterator[Path | None]:
    """Give a folder that no other process uses meanwhile; None where there is none to be had.

    A home that is read-only, or the same command running twice, must not stop an evaluation: it runs without.
    """
    try:
        root.mkdir(parents=True, exist_ok=True)
        lock = (root / f"{mark}.lock").open("w")
    except OSError:
        yield None
        return
    with lock:
        try:
            if fcntl is not None:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            yield None
            return
        try:
            yield root / mark
        finally:
            if not (root / mark).exists():
                Path(lock.name).unlink(missing_ok=True)


def _cache() -> Path:
    if os.environ.get(CACHE):
        return Path(os.environ[CACHE])
    if os.environ.get("XDG_CACHE_HOME"):
        root = Path(os.environ["XDG_CACHE_HOME"])
    elif sys.platform == "win32" and os.environ.get("LOCALAPPDATA"):
        root = Path(os.environ["LOCALAPPDATA"])
    else:
        root = Path.home() / ".cache"
    return root / "granular-id"

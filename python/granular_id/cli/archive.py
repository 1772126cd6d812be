"""``granular-id archive``: recordings in Parquet by the million; ``granular-id extract``: their features."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from granular_id._core import GranularIdError
from granular_id._files import check_source, made_folder
from granular_id._text import Table, counted, verb
from granular_id.cli.errors import FOUND_ERRORS, words_of
from granular_id.cli.options import at_least, command, option, with_defaults
from granular_id.cli.outputs import print_table, show, typed_command
from granular_id.cli.recordings import Handling, ReadingOptions, UnreadableError

if TYPE_CHECKING:
    from granular_id.archive import Archive, Extraction
    from granular_id.recording import Dataset, StepReport

OUTPUT, WORKERS, FEATURES = "Output", "Workers", "Features"

ARCHIVE = typer.Argument(metavar="ARCHIVE", help="Folder of an archive.", show_default=False)

_SHOWN = 10


# Recordings into an archive, piece by piece.


@command
def add(
    *,
    archive: Path = typer.Argument(
        metavar="ARCHIVE", help="Folder of an archive; a new one is made.", show_default=False
    ),
    paths: list[Path] = typer.Argument(
        metavar="PATH...", help="Folders and files of recordings, archives too.", show_default=False
    ),
    on_error: Handling = option(
        "Recordings",
        "What cannot be read, a row group of an archive too: refuse, or leave it out.",
        default="raise",
    ),
    quiet: bool = option(
        OUTPUT, "No progress; say only what became of the recordings.", "--quiet", "-q", default=False
    ),
) -> None:
    """Add recordings to an archive, piece by piece, so that any number fits.

    It reads folders that follow the convention, what `granular-id data convert` wrote, which prepares recordings, and
    archives. Several may add to one archive at a time. A recording that is there already is not added again: after a
    Ctrl-C or a crash the same command adds the rest.

    Examples:

    `granular-id archive add fleet recordings`
    `granular-id archive add fleet monday.npz tuesday.npz`
    `granular-id archive add rescued fleet --on-error skip`
    """
    for path in paths:
        check_source(path)
        target, source = archive.resolve(), path.resolve()
        if target == source or source in target.parents or target in source.parents:
            raise GranularIdError(
                f"{path} is, holds or lies in the archive {archive}: give the archive another place"
            )
    from granular_id._progress import showing
    from granular_id.io.parquet.writing import Appender

    reading = with_defaults(ReadingOptions)
    reading.on_error = on_error
    tally = _Tally(archive)
    try:
        with made_folder(archive), showing(not quiet) as step:
            appender, rates = Appender(archive), _Rates(archive)
            for path in paths:
                for piece in _pieces(reading, path, tally):
                    rates.check(piece, path)
                    done = appender.append(piece)
                    tally.n_added += done.n_added
                    tally.n_present += done.n_present
                    if step is not None:
                        step(tally.n_added + tally.n_present, 0, f"recordings: {path.name}")
            if not tally.n_added + tally.n_present:
                raise GranularIdError("no recording is left to add")
    finally:
        for line in tally.lines():
            show(line)
    if not quiet:
        show(f"look at it with: {typed_command('archive', 'info', archive)}")


def _pieces(reading: ReadingOptions, path: Path, tally: _Tally) -> Iterator[Dataset]:
    """Read a path piece by piece; with --on-error skip, of one that cannot be read that is told alone."""
    try:
        for piece in reading.load_parts(path, None):
            tally.report(piece.history[-1])
            yield piece
    except UnreadableError as error:
        if reading.on_error == "raise":
            raise
        tally.left_out(str(error))


class _Tally:
    """Counts what became of recordings, and keeps the first reasons why some were left out."""

    def __init__(self, archive: Path) -> None:
        self.archive, self.n_added, self.n_present, self._n_skipped = archive, 0, 0, 0
        self._begun_s = time.monotonic()
        self._reasons: list[str] = []
        self._notes: dict[str, None] = {}

    def report(self, step: StepReport) -> None:
        """Take what reading says of a piece."""
        for row in step.rows:
            if "skipped" in row:
                self.left_out(row["skipped"])
        self._notes.update(dict.fromkeys(f"note: {note}" for note in step.notes))

    def left_out(self, reason: str) -> None:
        """Count a file of which nothing, or nothing more, can be read."""
        self._n_skipped += 1
        self._reasons = [*self._reasons, f"  {reason}"][:_SHOWN]

    def lines(self) -> Iterator[str]:
        """Yield what to say at the end, however it came about."""
        if self.n_added or self.n_present:
            rate = self.n_added / max(time.monotonic() - self._begun_s, 1e-3)
            speed = f", {rate:,.0f} recordings/s" if self.n_added else ""
            yield f"added {counted(self.n_added)} to {self.archive}{speed}"
        if self.n_present:
            yield f"{counted(self.n_present)} {verb(self.n_present, 'was', 'were')} there already"
        if self._n_skipped:
            yield f"{counted(self._n_skipped, 'file')} skipped:"
            yield from self._reasons
            if self._n_skipped > _SHOWN:
                yield f"  ... and {self._n_skipped - _SHOWN} more"
        yield from list(self._notes)[:_SHOWN]


class _Rates:
    """The one rate of an archive, if it has one: features and models take nothing else."""

    def __init__(self, archive: Path) -> None:
        from granular_id.io.parquet.layout import is_parquet_archive

        self._archive, self._known = archive, set[float | None]()
        if is_parquet_archive(archive):
            import numpy as np

            from granular_id.archive import Archive

            rates = np.unique(Archive(archive).index["rate_hz"].to_numpy())
            self._known = {None if np.isnan(rate) else float(rate) for rate in rates}

    def check(self, data: Dataset, path: Path) -> None:
        """Refuse recordings of another rate than those that are there, or than the first to be added."""
        self._known = self._known or {data[0].rate_hz}
        if len(self._known) > 1:
            return
        (known,) = self._known
        other = next((one for one in data if one.rate_hz != known), None)
        if other is not None:
            came, wanted = (
                "no even rate" if rate is None else f"{rate:g} Hz" for rate in (other.rate_hz, known)
            )
            convert = f"granular-id data convert {shlex.quote(str(path))} NEW.npz --rate-hz"
            help_ = "" if known is None else f"make such by {convert} {known:g}, or "
            raise GranularIdError(
                f"{path}: recording {other.name!r} has {came}, those of the archive {self._archive} have "
                f"{wanted}: {help_}name another archive"
            )


# What an archive holds, and whether it is whole.


def check_is_archive(path: Path) -> None:
    """Refuse what is no archive, and say how to make one of it."""
    check_source(path)
    from granular_id.io.parquet.layout import is_parquet_archive

    if not is_parquet_archive(path):
        make = f"granular-id archive add ARCHIVE {shlex.quote(str(path))}"
        raise GranularIdError(f"{path} is no archive; {make} makes one of recordings")


@command
def info(*, archive: Path = ARCHIVE) -> None:
    """Say what an archive holds, by its index alone: at once, also for a million recordings.

    Examples:

    `granular-id archive info fleet`
    """
    check_is_archive(archive)
    from granular_id.archive import Archive

    opened = Archive(archive)
    show("\n".join(_facts(opened)))
    print_table(_of_materials(opened))


def _facts(archive: Archive) -> Iterator[str]:
    import numpy as np
    import pyarrow.compute as pc

    index = archive.index
    materials, sessions = (
        len(pc.unique(index[name].cast("string")).drop_null()) for name in ("label", "session")
    )
    yield f"{counted(archive.n_recordings)}, {counted(materials, 'material')}, {counted(sessions, 'session')}"
    synthetic = archive.n_synthetic
    if synthetic:
        yield f"SYNTHETIC: {synthetic} of {counted(archive.n_recordings)}"
    yield f"axes: {' '.join(archive.axes)}"
    rates = index["rate_hz"].to_numpy()
    known = np.unique(rates[~np.isnan(rates)])
    irregular = int(np.isnan(rates).sum())
    said = [f"{_span(known)} Hz"] * bool(len(known)) + [f"{counted(irregular)} irregular in time"] * bool(
        irregular
    )
    yield f"rate: {', '.join(said)}"
    lengths = index["n_samples"].to_numpy()
    seconds = (lengths / rates)[~np.isnan(rates)]
    yield f"length: {_span(lengths)} samples" + (f", {_span(seconds)} s" if len(seconds) else "")
    begun = pc.min_max(index["start_time"]).as_py()
    if begun["min"] is not None:
        yield f"recorded: {_day(begun['min'])} to {_day(begun['max'])} (UTC)"
    n_bytes = sum(path.stat().st_size for path in archive.folder.rglob("*.parquet"))
    files = {group.file for group in archive.row_groups}
    row_groups = counted(len(archive.row_groups), "row group")
    yield f"files: {len(files)} of samples with {row_groups}, {n_bytes / 1e6:.1f} MB with their index"


def _of_materials(archive: Archive) -> Table:
    import pyarrow

    columns = {name: archive.index[name].cast("string") for name in ("label", "session")}
    counts = (
        pyarrow.table(columns).group_by("label").aggregate([("session", "count_distinct"), ([], "count_all")])
    )
    rows = sorted(counts.to_pylist(), key=lambda row: (row["label"] is None, row["label"]))
    shown = [
        (row["label"] or "no label", str(row["count_all"]), str(row["session_count_distinct"]))
        for row in rows
    ]
    return Table(f"Archive {archive.folder}", ("material", "recordings", "sessions"), tuple(shown))


def _span(values: Any) -> str:
    return " to ".join(dict.fromkeys(f"{value:g}" for value in (values.min(), values.max())))


def _day(utc_s: float) -> str:
    return datetime.fromtimestamp(utc_s, timezone.utc).strftime("%Y-%m-%d")


@command
def check(
    *,
    archive: Path = ARCHIVE,
    quiet: bool = option(OUTPUT, "No progress.", "--quiet", "-q", default=False),
) -> None:
    """Read all of an archive and say what of it is damaged, or not what its index says.

    Exit code 0 when all is whole, 3 when something is not.

    Examples:

    `granular-id archive check fleet`
    """
    check_is_archive(archive)
    from granular_id import archive as archives  # its `check` is also the name of the file it is in

    report = archives.check(archive, n_jobs=-1, progress=not quiet)
    show(str(report))
    if not report.ok:
        raise typer.Exit(FOUND_ERRORS)


archive = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Recordings in Parquet by the million: add, look at, check.",
)
for shown in (add, info, check):
    archive.command()(shown)


# Work on all of an archive.


@dataclass(kw_only=True)
class WorkerOptions:
    """Who does the work on an archive."""

    jobs: int | None = option(WORKERS, "Threads. Default: one a core.", "--jobs", "-j")
    scheduler: str | None = option(
        WORKERS, "Scheduler of a Dask cluster whose workers do the work: tcp://HOST:8786. Default: threads."
    )

    def __post_init__(self) -> None:
        at_least("--jobs", self.jobs, 1)
        if self.jobs is not None and self.scheduler is not None:
            raise GranularIdError("--jobs are threads of this machine, --scheduler has workers: leave it out")

    def given(self) -> dict[str, Any]:
        """Return the workers as `granular_id.archive.extract` takes them."""
        n_jobs = -1 if self.jobs is None and self.scheduler is None else self.jobs
        return {"n_jobs": n_jobs, "scheduler": self.scheduler}


@command
def extract(
    workers: WorkerOptions,
    *,
    archive: Path = ARCHIVE,
    output: Path = option(
        OUTPUT, "Folder to write features into, or to go on with.", "--output", "-o", default=...
    ),
    space: str | None = option(FEATURES, "hfmh, raw+hfmh or raw. Default: hfmh, 600 counts."),
    model: Path | None = option(
        FEATURES, "Take the features of this model, from `granular-id train`.", "--model", "-m"
    ),
    quiet: bool = option(OUTPUT, "No progress; the last lines only.", "--quiet", "-q", default=False),
) -> None:
    """Extract the features of every recording of an archive, each exactly once.

    OUTPUT gets Parquet files of a thousand recordings each. After a Ctrl-C, a crash or a worker that died the same
    command does what is missing, and only that; the files are the same with any number of threads or workers. A part
    of the archive that cannot be read is named at the end; all others are finished, and the exit code is 2.

    Spaces that learn from recordings, as the multi-band ones do, are those of a model: train one on some recordings
    and give --model. Recordings are taken as they are: `granular-id data convert` brings them to one rate and length.

    With `--scheduler` the workers of a Dask cluster do the work, which must see ARCHIVE and OUTPUT under the same
    names. Encryption and all else is that of Dask's own configuration.

    Examples:

    `granular-id extract fleet -o features`
    `granular-id extract fleet -o features --space raw+hfmh --jobs 8`
    `granular-id extract fleet -o features --model kitchen.safetensors --scheduler tcp://10.0.0.7:8786`
    """
    if space is not None and model is not None:
        raise GranularIdError("--space and --model both say which features: give one of them")
    check_is_archive(archive)
    if model is not None:
        check_source(model)
    from granular_id.archive import extract as extract_features

    with working_on(archive, partial(say_features, output)):
        done = extract_features(archive, output, space, model=model, progress=not quiet, **workers.given())
    say_features(output, done)


@contextmanager
def working_on(archive: Path, say: Callable[..., None]) -> Iterator[None]:
    """Say what there is where a part of the work failed, what goes on where it stopped, and ways out for archives."""
    from granular_id.archive import PartitionError

    again = "the same command goes on from there"
    try:
        yield
    except PartitionError as error:
        say(error.extraction, partial=True)
        raise
    except ValueError as error:
        raise GranularIdError(words_of(error, archive=archive)) from error
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"Interrupted: no file was left half-written; {again}.") from None
    except OSError as error:
        if (
            type(error) is not OSError
        ):  # a full disk, a quota, a broken device; others have a type of their own
            raise
        raise OSError(f"{words_of(error)}; once it can be written {again}") from error


def say_features(output: Path, done: Extraction, *, partial: bool = False) -> None:
    """Say what was extracted and how to read it."""
    show(str(done))
    if not partial or done.n_partitions:
        reader = typed_reader("Features", output, partial=partial)
        show(f"read them with: {reader}  # .X .y .sessions .names")


def typed_reader(name: str, output: Path, *, partial: bool = False) -> str:
    """Return the line of Python that reads an output."""
    how = ", partial=True" if partial else ""
    return f"from granular_id.archive import {name}; {name.lower()} = {name}({str(output)!r}{how})"

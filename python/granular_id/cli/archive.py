"""``granular-id archive``: recordings in Parquet by the million; ``granular-id extract``: their features."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from granular_id._files import check_source, made_folder
from granular_id._text import Table, counted, known_label, verb
from granular_id.cli.errors import FOUND_ERRORS
from granular_id.cli.options import at_least, command, names_in, option
from granular_id.cli.outputs import print_table, show, typed_command
from granular_id.cli.recordings import ReadingOptions, Steps

if TYPE_CHECKING:
    from granular_id._progress import ProgressCallback
    from granular_id.archive import Archive
    from granular_id.recording import Dataset, StepReport

OUTPUT, ENGINE, FEATURES = "Output", "Engine", "Features"

ARCHIVE = typer.Argument(metavar="ARCHIVE", help="Folder of an archive.", show_default=False)


# Recordings into an archive, piece by piece.


@dataclass(kw_only=True)
class PieceSteps(Steps):
    """What to do with recordings of which only a piece is known at a time."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.length == "shortest":
            raise ValueError(
                "--n-samples shortest needs all recordings at once, and an archive takes them piece by piece: give a "
                "number, or --duration-s"
            )
        self.refuse_unused_onsets()
        self._unmet = {*names_in(self.exclude), *self.onsets}

    def prepared(self, piece: Dataset) -> tuple[Dataset | None, list[StepReport]]:
        """Take a piece through the steps; None where nothing of it is left. Also return what the steps reported."""
        from granular_id.recording import StepReport

        known = {known_label(name, piece.labels): name for name in names_in(self.exclude)}
        self._unmet -= {name for label, name in known.items() if label in piece.labels}
        kept = [place for place, one in enumerate(piece) if one.label not in known]
        if not kept:
            return None, []
        data = piece if len(kept) == len(piece) else piece.select(indices=kept)
        here = set(data.names) & set(self.onsets)
        self._unmet -= here
        mine = [text for text in self.onset_at or [] if text.rpartition("=")[0] in here]
        reports = []
        try:
            for made in replace(self, onset_at=mine or None).each(data):
                data = made
                reports.append(made.history[-1])
        except ValueError as error:
            if "skip" not in (self.on_short, self.on_gap) or not _NOTHING_LEFT.match(str(error)):
                raise
            rows = [{"name": one.name, "skipped": str(error)} for one in data]
            return None, [*reports, StepReport("skip", rows=rows)]
        return data, reports

    def warn_of_unmet(self) -> None:
        """Warn of names in options that no recording had: known only now."""
        for name in sorted(self._unmet):
            what = "--exclude" if name in names_in(self.exclude) else "--onset-at"
            show(f"warning: {what} names {name!r}, which no recording has", "bold yellow", err=True)


_NOTHING_LEFT = re.compile(r"(none of the|each of) \d+ recordings? ")
"""How a step begins to say that it would leave no recording: of a piece that is no fault."""

_SHOWN = 10


class _Tally:
    """Counts what became of recordings, and keeps the first reasons why some were left out."""

    def __init__(self, archive: Path) -> None:
        self.archive, self.n_added, self.n_present, self.labels = archive, 0, 0, Counter[str | None]()
        self._begun_s = time.monotonic()
        self._skipped: Counter[str] = Counter()
        self._reasons: list[str] = []
        self._notes: dict[str, None] = {}

    def report(self, step: StepReport) -> None:
        reading = step.step == "load"
        for row in step.rows:
            if "skipped" in row:
                self._skipped["file" if reading else "recording"] += 1
                if len(self._reasons) < _SHOWN:
                    self._reasons.append(f"  {'' if reading else row['name'] + ': '}{row['skipped']}")
        self._notes.update(dict.fromkeys(f"note: {note}" for note in step.notes))

    def lines(self) -> Iterator[str]:
        """Yield what to say at the end, however it came about."""
        if self.n_added or self.n_present:
            rate = self.n_added / max(time.monotonic() - self._begun_s, 1e-3)
            speed = f", {rate:,.0f} recordings/s" if self.n_added else ""
            yield f"added {counted(self.n_added)} to {self.archive}{speed}"
        if self.n_present:
            yield f"{counted(self.n_present)} {verb(self.n_present, 'was', 'were')} there already"
        if self._skipped:
            yield f"{', '.join(counted(n, what) for what, n in sorted(self._skipped.items()))} skipped:"
            yield from self._reasons
            if more := self._skipped.total() - len(self._reasons):
                yield f"  ... and {more} more"
        yield from list(self._notes)[:_SHOWN]


@command
def add(
    reading: ReadingOptions,
    steps: PieceSteps,
    *,
    archive: Path = typer.Argument(
        metavar="ARCHIVE", help="Folder of an archive; a new one is made.", show_default=False
    ),
    paths: list[Path] = typer.Argument(
        metavar="PATH...", help="Folders and files of recordings, of any format.", show_default=False
    ),
    quiet: bool = option(OUTPUT, "No progress; the last lines only.", "--quiet", "-q", default=False),
) -> None:
    """Add recordings to an archive, piece by piece, so that any number fits.

    It reads what `granular-id evaluate` reads, archives too, takes each piece through the steps that are asked for
    and appends it. Several may add to one archive at a time. A recording that is there already is not added again:
    after a Ctrl-C or a crash the same command adds the rest.

    Examples:

    `granular-id archive add fleet recordings`
    `granular-id archive add fleet monday.h5 bags --rate-hz 500 --begin-at onset --lead-s 0.1 --duration-s 3.2`
    `granular-id archive add fleet drives --axes wx,wy,wz,ax,ay,az --units rad/s,m/s2 --window-s 1.7 --on-error skip`
    """
    for path in paths:
        check_source(path)
        _refuse_nested(archive, path)
    from granular_id._progress import displaying
    from granular_id.archive import append
    from granular_id.live.recorder import check_archive

    tally = _Tally(archive)
    try:
        with made_folder(archive), displaying(not quiet) as display:
            check_archive(archive)
            told = _Told(display.step, tally)
            for path in paths:
                for piece in reading.load_parts(path, told.file):
                    tally.report(piece.history[-1])
                    data, reports = steps.prepared(piece)
                    for report in reports:
                        tally.report(report)
                    if data is not None:
                        done = append(archive, data)
                        tally.n_added += done.n_added
                        tally.n_present += done.n_present
                        told.show(path.name)
            if not tally.n_added + tally.n_present:
                raise ValueError("no recording is left to add")
    finally:
        for line in tally.lines():
            show(line)
    steps.warn_of_unmet()
    if not quiet:
        show(f"look at it with: {typed_command('archive', 'info', archive)}")


class _Told:
    """Shows how many files are read and how many recordings are added, whichever moves."""

    def __init__(self, step: ProgressCallback | None, tally: _Tally) -> None:
        self._step, self._tally = step, tally
        self._done, self._total = 0, 1

    def file(self, done: int, total: int, what: str) -> None:
        self._done, self._total = done, total
        self.show(what)

    def show(self, what: str) -> None:
        if self._step is not None:
            self._step(self._done, self._total, f"files, {self._tally.n_added} recordings added: {what}")


def _refuse_nested(archive: Path, path: Path) -> None:
    target, source = archive.resolve(), path.resolve()
    if target == source or source in target.parents or target in source.parents:
        raise ValueError(f"{path} is, holds or lies in the archive {archive}: give the archive another place")


# What an archive holds, and whether it is whole.


@command
def info(*, archive: Path = ARCHIVE) -> None:
    """Say what an archive holds, by its index alone: at once, also for a million recordings.

    Examples:

    `granular-id archive info fleet`
    """
    check_source(archive)
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
    n_bytes = _sizes(archive.folder)
    files = {group.file for group in archive.row_groups}
    yield (
        f"files: {len(files)} of samples with {counted(len(archive.row_groups), 'row group')}, "
        f"{_in_bytes(n_bytes['samples'])}; index {_in_bytes(n_bytes['index'])}"
    )


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


def _sizes(folder: Path) -> Counter[str]:
    """Add up the bytes of samples and of the index, hidden files left out."""
    sizes: Counter[str] = Counter()
    for path in folder.rglob("*.parquet"):
        if not path.name.startswith("."):
            sizes["samples" if path.parent.name == "samples" else "index"] += path.stat().st_size
    return sizes


def _span(values: Any) -> str:
    return " to ".join(dict.fromkeys(f"{value:g}" for value in (values.min(), values.max())))


def _day(utc_s: float) -> str:
    return datetime.fromtimestamp(utc_s, timezone.utc).strftime("%Y-%m-%d")


def _in_bytes(n: int) -> str:
    size = float(n)
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} TB"


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
    check_source(archive)
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
class EngineOptions:
    """Who does the work on an archive."""

    engine: Literal["local", "dask"] = option(
        ENGINE,
        "Threads of this process, or workers of Dask; the files written are the same.",
        default="local",
    )
    jobs: int | None = option(
        ENGINE, "Threads, or workers on this machine. Default: one a core.", "--jobs", "-j"
    )
    scheduler: str | None = option(
        ENGINE,
        "Scheduler of a Dask cluster that runs: tcp://HOST:8786 or tls://HOST:8786. Default: workers on this machine.",
    )
    dashboard: str | None = option(ENGINE, "Where Dask shows its page: HOST:PORT. Default: 127.0.0.1:8787.")
    tls_ca: Path | None = option(ENGINE, "Certificate of the authority, for tls://.")
    tls_cert: Path | None = option(ENGINE, "Certificate of this program, for tls://.")
    tls_key: Path | None = option(ENGINE, "Key of this program, for tls://.")

    def __post_init__(self) -> None:
        at_least("--jobs", self.jobs, 1)
        tls = {"--tls-ca": self.tls_ca, "--tls-cert": self.tls_cert, "--tls-key": self.tls_key}
        dask = {"--scheduler": self.scheduler, "--dashboard": self.dashboard, **tls}
        given = [name for name, value in dask.items() if value is not None]
        if given and self.engine != "dask":
            raise ValueError(f"{given[0]} is about Dask: add --engine dask")
        for name, value in (("--jobs", self.jobs), ("--dashboard", self.dashboard)):
            if value is not None and self.scheduler is not None:
                raise ValueError(
                    f"{name} is for workers on this machine, those of --scheduler are there: leave it out"
                )
        missing = [name for name, value in tls.items() if value is None]
        if missing and len(missing) < len(tls):
            raise ValueError(f"TLS needs --tls-ca, --tls-cert and --tls-key: add {missing[0]}")
        for path in tls.values():
            if path is not None:
                check_source(path)

    def given(self) -> dict[str, Any]:
        """Return the engine as `granular_id.archive.extract` takes it."""
        every = -1 if self.scheduler is None else None  # a cluster that runs has its workers
        of_dask = {
            "dashboard_address": self.dashboard,
            "tls_ca_file": self.tls_ca,
            "tls_cert": self.tls_cert,
            "tls_key": self.tls_key,
        }
        return {
            "engine": self.engine,
            "n_jobs": every if self.jobs is None else self.jobs,
            "scheduler": self.scheduler,
            **{name: value for name, value in of_dask.items() if value is not None},
        }


@command
def extract(
    engine: EngineOptions,
    *,
    archive: Path = ARCHIVE,
    output: Path = option(
        OUTPUT, "Folder to write features into, or to go on with.", "--output", "-o", default=...
    ),
    space: str | None = option(
        FEATURES, "hfmh, raw+hfmh, dft ...: any that learns nothing. Default: hfmh, 600 counts."
    ),
    model: Path | None = option(
        FEATURES, "Take the features of this model, from `granular-id train`.", "--model", "-m"
    ),
    dtype: Literal["float64", "float32"] = option(
        FEATURES, "Numbers to store; float32 takes half the room.", default="float64"
    ),
    quiet: bool = option(OUTPUT, "No progress; the last lines only.", "--quiet", "-q", default=False),
) -> None:
    """Extract the features of every recording of an archive, each exactly once.

    OUTPUT gets Parquet files of some thousand recordings each, and a manifest when all are there. After a Ctrl-C, a
    crash or a worker that died the same command does what is missing, and only that; the files are the same with any
    engine and any number of workers. A part of the archive that cannot be read is named at the end; all others are
    finished, and the exit code is 2.

    Spaces that learn from recordings, as the multi-band ones do, are those of a model: train one on some recordings
    and give --model. Recordings are taken as they are: `granular-id archive add` brings them to one rate and length.

    `--engine dask` starts workers on this machine; with `--scheduler` those of a cluster do the work, which must see
    ARCHIVE and OUTPUT under the same names.

    Examples:

    `granular-id extract fleet -o features`
    `granular-id extract fleet -o features --space raw+hfmh --dtype float32 --engine dask --jobs 8`
    `granular-id extract fleet -o features --model kitchen.safetensors --engine dask --scheduler tcp://10.0.0.7:8786`
    """
    if space is not None and model is not None:
        raise ValueError("--space and --model both say which features: give one of them")
    for path in (archive, *([] if model is None else [model])):
        check_source(path)
    from granular_id.archive import extract as extract_features

    done = extract_features(
        archive, output, space, model=model, dtype=dtype, progress=not quiet, **engine.given()
    )
    show(str(done))
    show(f"read them with: {typed_reader('Features', output)}  # .X .y .sessions .names")


def typed_reader(name: str, output: Path) -> str:
    """Return the line of Python that reads an output."""
    return f"from granular_id.archive import {name}; {name.lower()} = {name}({str(output)!r})"

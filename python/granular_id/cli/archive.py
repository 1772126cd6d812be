"""``granular-id archive``: recordings in Parquet by the million; ``granular-id extract``: their features."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from granular_id._checks import WayOutError
from granular_id._core import GranularIdError
from granular_id._files import check_source, made_folder
from granular_id._text import Table, counted, typed, verb
from granular_id.cli import options as opt
from granular_id.cli.outputs import ROOM, print_table, show
from granular_id.cli.recordings import about

if TYPE_CHECKING:
    from granular_id.archive import Archive, Extraction
    from granular_id.recording import Dataset

_SHOWN = 10


# Recordings into an archive, piece by piece.


def add(
    archive: opt.Archive,
    paths: Annotated[list[Path], Argument(metavar="PATH...", help="Recordings, archives too.")],
    *,
    on_error: Annotated[opt.Skip, Option(help="What cannot be read: refuse, or leave it out.")] = "raise",
    quiet: opt.Quiet = False,
) -> None:
    """Add recordings to an archive, piece by piece, so that any number fits.

    It reads folders that follow the convention, what `granular-id data convert` wrote, which prepares recordings, and
    archives. Several may add to one archive at a time. A recording that is there already is not added again: after a
    Ctrl-C or a crash the same command adds the rest.

    Examples:

    - `granular-id archive add fleet recordings`
    - `granular-id archive add fleet monday.npz tuesday.npz`
    - `granular-id archive add rescued fleet --on-error skip`
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

    n_added = n_present = 0
    skipped: list[str] = []
    notes: dict[str, None] = {}
    sources: dict[str, set[Path]] = {}
    begun_s = time.monotonic()
    try:
        with made_folder(archive), showing(not quiet) as step:
            appender, rates = Appender(archive), _rates(archive)
            for path in paths:
                for piece in _pieces(path, on_error, skipped):
                    appender.update(piece.axes, str(path))
                    rates = rates or {piece[0].rate_hz}
                    _refuse_other_rate(piece, rates, path, archive)
                    notes |= dict.fromkeys(f"note: {note}" for note in piece.history[-1].notes)
                    for session in {one.session for one in piece if one.session}:
                        sources.setdefault(session, set()).add(path)
                    done = appender.append(piece)
                    n_added, n_present = n_added + done.n_added, n_present + done.n_present
                    if step is not None:
                        step(n_added + n_present, 0, f"recordings: {path.name}")
            if not n_added + n_present:
                raise GranularIdError("no recording is left to add")
    finally:
        speed = n_added / max(time.monotonic() - begun_s, 1e-3)
        lines = [f"added {counted(n_added)} to {archive}, {speed:,.0f} recordings/s"] * bool(n_added)
        lines += [f"{counted(n_present)} {verb(n_present, 'was', 'were')} there already"] * bool(n_present)
        if skipped:
            lines += [f"{counted(len(skipped), 'file')} skipped:", *(f"  {reason}" for reason in skipped)]
        if lines:
            show("\n".join([*lines, *([] if quiet else notes)]), most=_SHOWN + 4, rest="")
        if shared := sorted(session for session, paths_ in sources.items() if len(paths_) > 1):
            names = f"{', '.join(shared[:3])}{', ...' * (len(shared) > 3)}"
            one = f"{verb(len(shared), 'is one session', 'are one session each')} from now on"
            show(f"warning: {names} of several sources {one}", "bold yellow", err=True)


def _pieces(path: Path, on_error: opt.Skip, skipped: list[str]) -> Iterator[Dataset]:
    """Read a path piece by piece; with --on-error skip, why something cannot be read joins a list."""
    from granular_id.io import RecordingFileError, load_parts

    try:
        with about(path):
            for piece in load_parts(path, on_error=on_error):
                skipped += [row["skipped"] for row in piece.history[-1].rows if "skipped" in row]
                yield piece
    except RecordingFileError as error:
        if on_error == "raise":
            raise
        skipped.append(str(error))


def _rates(archive: Path) -> set[float | None]:
    """Return the rates in an archive, None for uneven stamps; of one that is not there yet none."""
    from granular_id.io.parquet.layout import is_parquet_archive

    if not is_parquet_archive(archive):
        return set()
    from granular_id.archive import Archive

    return set(Archive(archive).index["rate_hz"].to_pylist())


def _refuse_other_rate(data: Dataset, rates: set[float | None], path: Path, archive: Path) -> None:
    """Refuse recordings of another rate than the one of an archive: features and models take nothing else."""
    if len(rates) > 1:
        return
    (known,) = rates
    other = next((one for one in data if one.rate_hz != known), None)
    if other is not None:
        came, wanted = ("no even rate" if rate is None else f"{rate:g} Hz" for rate in (other.rate_hz, known))
        way_out = () if known is None else (" ", typed(resample_hz=known))
        with about(path):
            raise WayOutError(
                f"{path}: recording {other.name!r} has {came}, those of the archive {archive} have {wanted}: name "
                "another archive, or bring them to one rate",
                *way_out,
            )


# What an archive holds, and whether it is whole.


def check_is_archive(path: Path) -> None:
    """Refuse what is no archive, and say how to make one of it."""
    check_source(path)
    from granular_id.io.parquet.layout import is_parquet_archive

    if not is_parquet_archive(path):
        make = f"granular-id archive add ARCHIVE {shlex.quote(str(path))}"
        raise GranularIdError(f"{path} is no archive; {make} makes one of recordings")


def info(archive: opt.Archive, *, details: opt.Details = False) -> None:
    """Say what an archive holds, by its index alone: at once, also for a million recordings.

    Examples:

    - `granular-id archive info fleet`
    """
    check_is_archive(archive)
    from granular_id.archive import Archive

    opened = Archive(archive)
    n_facts = show("\n".join(_facts(opened)))
    print_table(_of_materials(opened), details=details, room=ROOM + 4 - n_facts)


def _facts(archive: Archive) -> Iterator[str]:
    import numpy as np
    import pyarrow.compute as pc

    index = archive.index
    n = {name: len(pc.unique(index[name].cast("string")).drop_null()) for name in ("label", "session")}
    yield f"{counted(archive.n_recordings)}, {counted(n['label'], 'material')}, {counted(n['session'], 'session')}"
    if archive.n_synthetic:
        yield f"SYNTHETIC: {archive.n_synthetic} of {counted(archive.n_recordings)}"
    yield f"axes: {' '.join(archive.axes)}"
    rates, lengths = index["rate_hz"].to_numpy(), index["n_samples"].to_numpy()
    uneven = np.isnan(rates)
    parts = [f"{_span(rates[~uneven])} Hz"] * (not uneven.all())
    parts += [f"{counted(int(uneven.sum()))} irregular in time"] * bool(uneven.any())
    yield f"rate: {', '.join(parts)}"
    seconds = "" if uneven.all() else f", {_span((lengths / rates)[~uneven])} s"
    yield f"length: {_span(lengths)} samples{seconds}"
    begun = pc.min_max(index["start_time"]).as_py()
    if begun["min"] is not None:
        days = (f"{datetime.fromtimestamp(begun[name], timezone.utc):%Y-%m-%d}" for name in ("min", "max"))
        yield f"recorded: {' to '.join(days)} (UTC)"
    n_bytes = sum(path.stat().st_size for path in archive.folder.rglob("*.parquet"))
    files, row_groups = {group.file for group in archive.row_groups}, len(archive.row_groups)
    with_ = f"{counted(row_groups, 'row group')}, {n_bytes / 1e6:.1f} MB with their index"
    yield f"files: {len(files)} of samples with {with_}"


def _of_materials(archive: Archive) -> Table:
    import pyarrow

    columns = {name: archive.index[name].cast("string") for name in ("label", "session")}
    counts = (
        pyarrow.table(columns).group_by("label").aggregate([("session", "count_distinct"), ([], "count_all")])
    )
    rows = sorted(counts.to_pylist(), key=lambda row: (row["label"] is None, row["label"]))
    names = ("count_all", "session_count_distinct")
    shown = tuple((row["label"] or "no label", *(str(row[name]) for name in names)) for row in rows)
    return Table(f"Archive {archive.folder}", ("material", "recordings", "sessions"), shown)


def _span(values: Any) -> str:
    return " to ".join(dict.fromkeys(f"{value:g}" for value in (values.min(), values.max())))


def check(archive: opt.Archive, *, details: opt.Details = False, quiet: opt.Quiet = False) -> None:
    """Read all of an archive and say what of it is damaged, or not what its index says.

    Exit code 0 when all is whole, 3 when something is not.

    Examples:

    - `granular-id archive check fleet`
    """
    check_is_archive(archive)
    from granular_id import archive as archives  # its `check` is also the name of the file it is in

    report = archives.check(archive, n_jobs=-1, progress=not quiet)
    show(str(report), most=None if details else 2 * _SHOWN)
    if not report.ok:
        show("to save what is whole:")
        show(f"granular-id archive add rescued {shlex.quote(str(archive))} --on-error skip")
        raise typer.Exit(opt.FOUND_ERRORS)


# Work on all of an archive.


def extract(
    archive: opt.Archive,
    *,
    output: Annotated[Path, Option("--output", "-o", help="Folder to write into, or to go on with.")],
    space: Annotated[str | None, Option(help="hfmh, raw+hfmh or raw. Default: hfmh.")] = None,
    model: Annotated[Path | None, Option("--model", "-m", help="Take the features of this model.")] = None,
    jobs: opt.Jobs = None,
    scheduler: opt.Scheduler = None,
    quiet: opt.Quiet = False,
) -> None:
    """Extract the features of every recording of an archive, each exactly once.

    After a Ctrl-C, a crash or a worker that died the same command does what is missing; the files are the same with any
    number of threads or workers. What cannot be read is named at the end; all else is finished, and the exit code is 2.

    Spaces that learn from recordings, as the multi-band ones do, are those of a model: give --model. With `--scheduler`
    the workers of a Dask cluster do the work, which must see ARCHIVE and OUTPUT under the same names.

    Examples:

    - `granular-id extract fleet -o features`
    - `granular-id extract fleet -o features --space raw+hfmh --jobs 8`
    - `granular-id extract fleet -o features --model kitchen.safetensors --scheduler tcp://10.0.0.7:8786`
    """
    if space is not None and model is not None:
        raise GranularIdError("--space and --model both say which features: give one of them")
    check_is_archive(archive)
    if model is not None:
        check_source(model)
    from granular_id.archive import extract as extract_features

    with working_on(archive, partial(say_made, "Features", output)):
        done = extract_features(
            archive,
            output,
            space,
            model=model,
            progress=not quiet,
            n_jobs=opt.jobs_of(jobs, scheduler),
            scheduler=scheduler,
        )
    say_made("Features", output, done)


@contextmanager
def working_on(archive: Path, say: Callable[..., None]) -> Iterator[None]:
    """Say what there is where a part of the work failed, what goes on where it stopped, and ways out for archives."""
    from granular_id.archive import PartitionError

    again = "the same command goes on from there"
    try:
        with about(archive):
            yield
    except PartitionError as error:
        say(error.extraction, partial=True)
        raise
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"Interrupted: no file was left half-written; {again}.") from None
    except OSError as error:
        if (
            type(error) is not OSError
        ):  # a full disk, a quota, a broken device; others have a type of their own
            raise
        raise OSError(f"{error}; once it can be written {again}") from error


def say_made(name: str, output: Path, done: Extraction, *, partial: bool = False) -> None:
    """Say what was made of an archive, and the line of Python that reads it."""
    show(str(done))
    if not partial or done.n_partitions:
        how = ", partial=True" if partial else ""
        show(f"read: from granular_id.archive import {name}; {name.lower()} = {name}({str(output)!r}{how})")

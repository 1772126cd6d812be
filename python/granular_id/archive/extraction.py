"""Work on whole archives: planned, done by threads or a cluster, each partition exactly once, and written down."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, time
from typing import Any

from granular_id._checks import argument_error, checked_n_jobs
from granular_id._files import absolute, made_folder, sha256_of
from granular_id._progress import ProgressCallback, check_progress, displaying
from granular_id._text import counted, whole_percent
from granular_id.archive.engines import run_tasks
from granular_id.archive.manifest import MANIFEST, PARTITION, read_manifest, write_manifest
from granular_id.archive.work import (
    MARK,
    Outcome,
    Task,
    Work,
    finished,
    forget,
    partition_name,
    remember,
    spec_json,
)
from granular_id.io.errors import need
from granular_id.io.parquet.archive import Archive, RowGroup

_MOST_RECORDINGS = 2048
"""Recordings of a partition: 0.1 to 1 s of work, from counts to multi-band features."""

_ATTEMPTS = 3

_NAMED = 3
"""Failures that an error names."""

_MOST_SAMPLES = 1 << 22
"""Samples of a partition of long recordings."""

_DRAFT = re.compile(
    r"\.([0-9a-f]{32}\.parquet\.)?[0-9a-f]{16}\.tmp|\._(manifest|model)-[0-9a-f]{16}\.(json|safetensors)"
)
"""Temporary files: of partitions, of what stands beside them, and those that show whether workers see the folder."""

_LONGEST_DRAFT_S = 86_400.0
"""Nothing is written to a temporary file for so long: its writer is dead, and no other driver still needs it."""


@dataclass(frozen=True)
class Extraction:
    """What was done for an archive; printed, it is one line.

    Attributes
    ----------
    out : Path
        Folder of the partitions and ``_manifest.json``.
    n_recordings, n_partitions : int
        What the folder holds now.
    n_resumed : int
        Partitions that were there before, and were not computed again.
    seconds : float
        From the first task to the manifest.
    stage_seconds : dict of str to float
        Seconds of ``reading``, ``computing`` and ``writing``, of all threads together.
    recordings_per_s : float
        Recordings of this run, not of what was there before; 0 where there were none.
    sha256 : str
        Over all partitions: the same recordings, work and versions give the same, whoever did it.
    synthetic : bool
        Whether any recording was simulated: what comes of them says nothing about real materials.
    failures : tuple of Outcome
        Partitions that could not be made, each with ``problem``.
    """

    out: Path
    n_recordings: int
    n_partitions: int
    n_resumed: int
    seconds: float
    stage_seconds: dict[str, float]
    recordings_per_s: float
    sha256: str
    synthetic: bool = False
    failures: tuple[Outcome, ...] = ()

    def __str__(self) -> str:
        marked = "SYNTHETIC recordings" if self.synthetic else "recordings"
        said = [f"{self.n_recordings} {marked} in {counted(self.n_partitions, 'partition')}"]
        if self.n_resumed:
            said.append(f"{self.n_resumed} of them there before")
        if self.recordings_per_s:
            said.append(f"{self.seconds:.1f} s, {self.recordings_per_s:.0f} recordings/s")
        whole = sum(self.stage_seconds.values())
        if whole:
            shares = (f"{name} {whole_percent(100 * s / whole)} %" for name, s in self.stage_seconds.items())
            said.append(", ".join(shares))
        if self.failures:
            said.append(f"{counted(len(self.failures), 'partition')} FAILED")
        return f"{self.out}: {'; '.join(said)}; sha256 {self.sha256[:16]}"


class PartitionError(ValueError):
    """Some partitions could not be made; all others are finished, and the manifest names both.

    Attributes
    ----------
    extraction : Extraction
        What was done; its ``failures`` are the partitions that were not.
    """

    def __init__(self, message: str, extraction: Extraction) -> None:
        super().__init__(message)
        self.extraction = extraction


def run(
    archive: Archive,
    work: Work,
    out: str | os.PathLike[str],
    *,
    n_jobs: int | None = None,
    scheduler: Any = None,
    progress: bool | ProgressCallback = True,
    prepare: Callable[[Path], None] | None = None,
) -> Extraction:
    """Do some work for all recordings of an archive, each exactly once; parameters and errors as of `extract`.

    `prepare` is given the folder before anything else is written to it.
    """
    _check_call(archive, out, n_jobs, scheduler, progress)
    work.check(archive)
    folder = Path(absolute(out))
    tasks = tasks_of(archive, work, out)
    spec, source = spec_json(work, archive), absolute(archive.folder)
    with made_folder(folder):
        if prepare is not None:
            prepare(folder)
        stale = _refuse_others(folder, archive, spec, {task.name for task in tasks})
        begun = perf_counter()
        there = _there(folder, tasks)
        done = dict(there)
        missing = [task for task in tasks if task.name not in there]
        n_missing = sum(task.n_recordings for task in missing)
        n_made = 0

        def left() -> float | None:
            return (perf_counter() - begun) / n_made * (n_missing - n_made) if n_made else None

        try:
            remember(archive, source)
            with displaying(progress, left) as display:

                def take(outcome: Outcome) -> None:
                    nonlocal n_made
                    done[outcome.name] = outcome
                    n_made = min(n_made + outcome.n_recordings, n_missing)
                    if display.step is not None:
                        rate = n_made / max(perf_counter() - begun, 1e-9)
                        n_before = archive.n_recordings - n_missing
                        display.step(n_before + n_made, archive.n_recordings, f"{rate:.0f} recordings/s")

                todo = missing
                for _ in range(_ATTEMPTS):
                    run_tasks(todo, n_jobs, scheduler, take)
                    # Another driver, for which the archive had grown, may have removed some.
                    todo = [task for task in tasks if not (done[task.name].problem or _is_there(task))]
                    if not todo:
                        break
                else:
                    problem = "is gone each time that it was made: does another process work in this folder?"
                    raise OSError(f"{folder / todo[0].name} {problem}")
        finally:
            forget(source)
            _remove_drafts(folder)
        outcomes = [done[task.name] for task in tasks]
        failures = tuple(outcome for outcome in outcomes if outcome.problem)
        synthetic = archive.is_synthetic
        sha256 = write_manifest(folder, archive, spec, outcomes, synthetic)
        for path in [] if failures else stale:
            path.unlink(missing_ok=True)
        seconds = perf_counter() - begun
    made = [done[task.name] for task in missing if not done[task.name].problem]
    n_computed = sum(outcome.n_recordings for outcome in made)
    extraction = Extraction(
        out=Path(out),
        n_recordings=sum(outcome.n_recordings for outcome in outcomes if not outcome.problem),
        n_partitions=len(outcomes) - len(failures),
        n_resumed=len(there),
        seconds=seconds,
        stage_seconds={
            stage: sum(outcome.seconds.get(stage, 0.0) for outcome in made)
            for stage in ("reading", "computing", "writing")
        },
        recordings_per_s=n_computed / seconds,
        sha256=sha256,
        synthetic=synthetic,
        failures=failures,
    )
    if failures:
        raise PartitionError(_failed(folder, failures, len(outcomes)), extraction)
    return extraction


def _check_call(
    archive: Archive,
    out: str | os.PathLike[str],
    n_jobs: int | None,
    scheduler: Any,
    progress: bool | ProgressCallback,
) -> None:
    """Refuse what `run` cannot be given, before anything is read or written."""
    checked_n_jobs(n_jobs)
    check_progress(progress)
    if scheduler is not None and n_jobs is not None:
        wanted = "must be None with a scheduler, whose workers are as they are"
        raise argument_error(ValueError, "n_jobs", f"{wanted}; got {n_jobs!r}")
    home, target = archive.folder.resolve(), Path(out).resolve()
    if home in (target, *target.parents):
        problem = f"={os.fspath(out)!r} is or lies in the archive: name another folder"
        raise argument_error(ValueError, "out", problem)


def tasks_of(archive: Archive, work: Work, out: str | os.PathLike[str]) -> list[Task]:
    """Return the partitions of an archive as tasks, in its order."""
    spec = spec_json(work, archive)
    return [
        Task(
            archive=absolute(archive.folder),
            out=absolute(out),
            name=partition_name(spec, groups),
            row_groups=tuple((group.file, group.row_group) for group in groups),
            n_recordings=groups[-1].stop - groups[0].start,
            work=work,
        )
        for groups in planned(archive.row_groups)
    ]


def planned(row_groups: Sequence[RowGroup]) -> Iterator[list[RowGroup]]:
    """Join neighbouring row groups to partitions; what is appended to an archive changes at most those at its place."""
    some: list[RowGroup] = []
    n_recordings = n_samples = 0
    for group in row_groups:
        n_recordings += group.stop - group.start
        n_samples += group.n_samples
        if some and (n_recordings > _MOST_RECORDINGS or n_samples > _MOST_SAMPLES):
            yield some
            some, n_recordings, n_samples = [], group.stop - group.start, group.n_samples
        some.append(group)
    if some:
        yield some


# What is in the folder already.


def _refuse_others(folder: Path, archive: Archive, spec: str, wanted: set[str]) -> list[Path]:
    """Refuse a folder with other work or other recordings in it; return partitions of an older state of the archive."""
    library = need("pyarrow.parquet", extra="app", why="to work on archives")
    compute = need("pyarrow.compute", extra="app", why="to work on archives")
    other, help_ = f"{folder} holds other work already", "name another folder"
    if (folder / MANIFEST).exists() and not any(PARTITION.fullmatch(path.name) for path in folder.iterdir()):
        with suppress(FileNotFoundError):
            read_manifest(folder)  # of something else
    stale = []
    for path in sorted(folder.iterdir()):
        if path.name in wanted or not PARTITION.fullmatch(path.name):
            continue
        try:
            with library.ParquetFile(path) as opened:
                said = json.loads((opened.metadata.metadata or {})[MARK.encode()])["spec"]
                digests = opened.read(["digest"])["digest"]
        except FileNotFoundError:  # another driver has just removed it
            continue
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{other}: {path.name} is no partition ({error}); {help_}"[:400]) from error
        if said != json.loads(spec):
            raise ValueError(f"{other}: {_difference(said, json.loads(spec))}; {help_}")
        known = archive.index["digest"].cast(digests.type)
        if not compute.all(compute.is_in(digests, value_set=known)).as_py():
            problem = f"recordings that {archive.folder} does not have (in {path.name})"
            raise ValueError(f"{folder} holds {problem}; {help_}")
        stale.append(path)
    return stale


def _difference(there: Any, wanted: Any, what: str = "") -> str:
    """Name the first entry in which two descriptions differ."""
    if isinstance(there, dict) and isinstance(wanted, dict):
        first = [key for key in ("class", *wanted) if key in wanted and key in there]
        for key in first:
            if there[key] != wanted[key]:
                return _difference(there[key], wanted[key], key)
        there, wanted = (", ".join(one) for one in (there, wanted))
        return f"{what} of {there} there, of {wanted} wanted"
    return f"{what} {there!r:.120} there, {wanted!r:.120} wanted"


def _there(folder: Path, tasks: Sequence[Task]) -> dict[str, Outcome]:
    """Return what was finished before, and is still whole: as the last manifest says, or by the sums of its pages."""
    try:
        listed = {known["name"]: known for known in read_manifest(folder)["partitions"]}
    except (OSError, ValueError):
        listed = {}
    there: dict[str, Outcome] = {}
    for task in tasks:
        if not _is_there(task):
            continue
        path = folder / task.name
        known = listed.get(task.name)
        outcome = finished(task) if known is None else _as_listed(task, path, known)
        if outcome is not None:
            there[task.name] = outcome
    return there


def _is_there(task: Task) -> bool:
    return Path(task.out, task.name).is_file()


def _as_listed(task: Task, path: Path, known: Mapping[str, Any]) -> Outcome | None:
    """Return the outcome of a task whose file is what a manifest says; remove the file where it is not."""
    try:
        with path.open("rb") as file:
            sha256 = sha256_of(file)
    except FileNotFoundError:  # another driver has just removed it
        return None
    if sha256 == known["sha256"]:
        return Outcome(task.name, task.n_recordings, sha256, known["n_bytes"])
    path.unlink(missing_ok=True)
    return None


def _remove_drafts(folder: Path) -> None:
    """Remove temporary files of dead writers; those that another driver is writing are left alone."""
    for path in folder.iterdir():
        with suppress(FileNotFoundError):
            if _DRAFT.fullmatch(path.name) and time() - path.stat().st_mtime > _LONGEST_DRAFT_S:
                path.unlink()


# What is told.


def _failed(folder: Path, failures: Sequence[Outcome], n_partitions: int) -> str:
    named = "; ".join(f"{outcome.name}: {outcome.problem}" for outcome in failures[:_NAMED])
    more = f"; {len(failures) - _NAMED} more in {MANIFEST}" if len(failures) > _NAMED else ""
    n_recordings = counted(sum(outcome.n_recordings for outcome in failures))
    how_many = f"{len(failures)} of {counted(n_partitions, 'partition')} failed ({n_recordings})"
    return f"{folder}: {how_many}, all others are finished: {named}{more}"

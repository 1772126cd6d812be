"""Work on whole archives, partition by partition: each makes one file, under a name made of what it is made of.

What is done is what is there. A file appears by a rename when it is whole and on the disk, so that any number of
drivers and workers may make the same one, be killed, and begin again.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from time import perf_counter, time
from typing import Any, Protocol

import numpy as np

from granular_id import _core
from granular_id._checks import argument_error, checked_n_jobs
from granular_id._core import GranularIdError
from granular_id._files import absolute, durable_file, made_folder
from granular_id._progress import ProgressCallback, check_progress, showing
from granular_id._text import counted
from granular_id.archive.workers import check_scheduler, work_through
from granular_id.io.files import RecordingFileError, naming, need, printable
from granular_id.io.parquet.archive import Archive, RowGroup, coded_texts
from granular_id.io.parquet.layout import MARK, key_of
from granular_id.recording import Dataset, Recording, Setup

pa = need("pyarrow", extra="app", why="to work on archives")
pq = need("pyarrow.parquet", extra="app", why="to work on archives")

ABOUT = pa.schema(
    {name: pa.string() for name in ("name", "label", "session")}
    | {"start_time": pa.float64(), "digest": pa.string()}
)
"""Columns of the index that stand in front of what is computed."""

UNFINISHED = "_unfinished"
"""Beside the partitions until all of them are there; pandas and pyarrow pass over names with a line in front."""

_MOST_RECORDINGS, _MOST_SAMPLES = 1024, 1 << 22
"""Of a partition: 0.1 to 1 s of work on pushes, from counts to multi-band features."""

_PARTITION = re.compile(r"[0-9a-f]{32}\.parquet")
_LONGEST_DRAFT_S = 86_400.0
"""Nothing is written to a temporary file for so long: its writer is dead."""

_NAMED = 3
"""Failures that an error names."""


class Spec(Protocol):
    """What is made of recordings. Picklable: it travels to workers, and holds no data.

    `describe` returns everything that decides the output, as JSON: it is part of the name of every file. `table` makes
    a pyarrow.Table of neighbouring row groups.
    """

    def describe(self) -> dict[str, Any]: ...  # noqa: D102
    def table(self, archive: Archive, groups: Sequence[RowGroup]) -> Any: ...  # noqa: D102


@dataclass(frozen=True)
class Partition:
    """Neighbouring row groups of one file of samples. A few hundred bytes; no data goes through a scheduler."""

    archive: str
    file: str
    row_groups: tuple[int, ...]
    n_recordings: int

    def __str__(self) -> str:
        last = f" to {self.row_groups[-1]}" if len(self.row_groups) > 1 else ""
        return f"{self.file}, row group {self.row_groups[0]}{last}"

    def name(self, spec: Spec) -> str:
        """Name the output by all that decides about it."""
        text = json.dumps([_described(spec), self.file, self.row_groups], sort_keys=True)
        return f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.parquet"


def partitions_of(archive: Archive) -> list[Partition]:
    """Cut an archive into partitions, in its order. What is appended adds partitions, and changes none."""
    found: list[Partition] = []
    n_samples = 0
    for group in archive.row_groups:
        n, last = group.stop - group.start, found[-1] if found else None
        n_samples += group.n_samples
        fits = last is not None and last.n_recordings + n <= _MOST_RECORDINGS and n_samples <= _MOST_SAMPLES
        if last is not None and fits and last.file == group.file:
            joined = (*last.row_groups, group.row_group)
            found[-1] = replace(last, row_groups=joined, n_recordings=last.n_recordings + n)
        else:
            found.append(Partition(absolute(archive.folder), group.file, (group.row_group,), n))
            n_samples = group.n_samples
    return found


def process_partition(partition: Partition, spec: Spec) -> Any:
    """Return the table of a partition: a row per recording, what the index says of it and what is made of it.

    A pure function: nothing is written, and the same partition and spec give the same table anywhere.
    """
    archive = _opened(partition.archive, key_of(partition.file))
    groups = [archive.row_groups[number] for number in partition.row_groups]
    rows = archive.index.slice(groups[0].start, groups[-1].stop - groups[0].start)
    about = rows.select(ABOUT.names).cast(ABOUT)
    own = spec.table(archive, groups)
    place = [*archive.written, partition.row_groups[0]]
    # As plain texts: the dictionary of the column holds the texts of all recordings in the file.
    n_synthetic = archive.count_synthetic(rows["meta"].cast(pa.large_string()))
    described = {"spec": _described(spec), "place": place, "n_synthetic": n_synthetic}
    schema = pa.schema([*about.schema, *own.schema], metadata={MARK: json.dumps(described, sort_keys=True)})
    return pa.Table.from_arrays([*about.columns, *own.columns], schema=schema)


@lru_cache(maxsize=4)
def _opened(folder: str, key: str) -> Archive:
    """Open the part of an archive that one index file lists: its name says what is in it."""
    return Archive(folder, keys=[key])


def _described(spec: Spec) -> dict[str, Any]:
    """Return everything beside the recordings that decides what is written, as JSON would be read."""
    described = {**spec.describe(), "granular_id": _core.__version__}
    plain: dict[str, Any] = json.loads(json.dumps(described, ensure_ascii=False, allow_nan=False))
    return plain


def make_file(partition: Partition, spec: Spec, out: str) -> str:
    """Make the file of a partition, unless it is there; return why it could not be computed, or nothing.

    An OSError where it cannot be written.
    """
    target = Path(out, partition.name(spec))
    if target.is_file():
        return ""
    try:
        table = process_partition(partition, spec)
    except RecordingFileError as error:  # names the row group itself
        return printable(str(error))
    except Exception as error:
        return f"{partition}: {printable(str(error)) or type(error).__name__}"
    # Lists of numbers are split into bytes, which lz4 packs: 600 counts take 256 bytes of 4,800, at 165,000 recordings
    # a second on a core; zstd takes twice the time for numbers that hardly repeat, and saves a twentieth of their size.
    lists = [field.name for field in table.schema if str(field.type).startswith("fixed_size_list")]
    with durable_file(target) as draft:
        pq.write_table(
            table,
            draft,
            compression="lz4",
            use_dictionary=[field.name for field in table.schema if field.type == "string"],
            use_byte_stream_split=[f"{name}.list.element" for name in lists],
            write_statistics=[name for name in table.column_names if name not in lists],
            write_page_checksum=True,
        )
    return ""


# All partitions.


@dataclass(frozen=True)
class Extraction:
    """What was done for an archive; printed, it is one line.

    Attributes
    ----------
    out : Path
        Folder of the partitions.
    n_recordings, n_partitions : int
        What the folder holds now.
    n_resumed : int
        Partitions that were there before, and were not computed again.
    recordings_per_s : float
        Recordings of this run, not of what was there before; 0 where there were none.
    synthetic : bool
        Whether any recording was simulated: what comes of them says nothing about real materials.
    failures : dict of str to str
        Partitions that could not be made, by the name of the file, and why.
    """

    out: Path
    n_recordings: int
    n_partitions: int
    n_resumed: int
    recordings_per_s: float
    synthetic: bool
    failures: Mapping[str, str]

    def __str__(self) -> str:
        marked = "SYNTHETIC recordings" if self.synthetic else "recordings"
        parts = [f"{self.n_recordings} {marked} in {counted(self.n_partitions, 'partition')}"]
        parts += [f"{self.n_resumed} of them there before"] if self.n_resumed else []
        parts += [f"{self.recordings_per_s:.0f} recordings/s"] if self.recordings_per_s else []
        parts += [f"{counted(len(self.failures), 'partition')} FAILED"] if self.failures else []
        return f"{self.out}: {'; '.join(parts)}"


class PartitionError(GranularIdError):
    """Some partitions could not be made, as ``extraction.failures`` says; all others are finished."""

    def __init__(self, extraction: Extraction) -> None:
        problems = [f"{name}: {problem}" for name, problem in extraction.failures.items()]
        failed = f"{counted(len(problems), 'partition')} failed, all others are finished"
        more = f"; and {len(problems) - _NAMED} more" if len(problems) > _NAMED else ""
        super().__init__(f"{extraction.out}: {failed}: {'; '.join(problems[:_NAMED])}{more}")
        self.extraction = extraction


def run(
    archive: Archive,
    spec: Spec,
    out: str | os.PathLike[str],
    *,
    n_jobs: int | None = None,
    scheduler: Any = None,
    progress: bool | ProgressCallback = True,
    beside: Mapping[str, bytes] | None = None,
) -> Extraction:
    """Make the files of all partitions of an archive; parameters and errors as of `extract`.

    `beside`: other files that belong to them, by name.
    """
    checked_n_jobs(n_jobs)
    check_progress(progress)
    check_scheduler(scheduler)
    if scheduler is not None and n_jobs is not None:
        problem = f"must be None with a scheduler, whose workers are as they are; got {n_jobs!r}"
        raise argument_error(GranularIdError, "n_jobs", problem)
    if archive.folder.resolve() in (Path(out).resolve(), *Path(out).resolve().parents):
        problem = f"={os.fspath(out)!r} is or lies in the archive: name another folder"
        raise argument_error(GranularIdError, "out", problem)
    begun, n_made, failures = perf_counter(), 0, dict[str, str]()
    partitions = {partition.name(spec): partition for partition in partitions_of(archive)}
    with made_folder(absolute(out)) as folder, showing(progress) as step:
        there = _footers_in(folder)
        ours = _described(spec)
        for name, footer in there.items():
            if footer["spec"] != ours:
                other = f"other work already: {_difference(footer['spec'], ours)}"
                raise GranularIdError(f"{folder} holds {other}; name another folder")
            if name not in partitions:
                others = f"recordings that {archive.folder} does not have (in {name})"
                raise GranularIdError(f"{folder} holds {others}; name another folder")
        missing = {name: one for name, one in partitions.items() if name not in there}
        n_missing = sum(one.n_recordings for one in missing.values())

        def done(name: str, problem: str) -> None:
            nonlocal n_made
            n_made += partitions[name].n_recordings
            if problem:
                failures[name] = problem
            if step is not None:
                step(n_made, n_missing, f"{n_made / max(perf_counter() - begun, 1e-9):.0f} recordings/s")

        for name, content in (beside or {}).items():
            with durable_file(folder / name) as draft:
                draft.write_bytes(content)
        if missing:
            (folder / UNFINISHED).touch()
        make = partial(make_file, spec=spec, out=os.fspath(folder))
        work_through(make, missing, done, n_jobs=n_jobs, scheduler=scheduler)
        for path in folder.glob(".*-" + "[0-9a-f]" * 16 + ".*"):
            with suppress(FileNotFoundError):
                if time() - path.stat().st_mtime > _LONGEST_DRAFT_S:
                    path.unlink()
        if not failures:
            (folder / UNFINISHED).unlink(missing_ok=True)
    n_failed = sum(partitions[name].n_recordings for name in failures)
    extraction = Extraction(
        out=Path(out),
        n_recordings=archive.n_recordings - n_failed,
        n_partitions=len(partitions) - len(failures),
        n_resumed=len(there),
        recordings_per_s=(n_missing - n_failed) / (perf_counter() - begun),
        synthetic=bool(archive.n_synthetic),
        failures=failures,
    )
    if failures:
        raise PartitionError(extraction)
    return extraction


def _difference(there: Any, wanted: Any, what: str = "") -> str:
    """Name the first entry in which two descriptions differ."""
    if isinstance(there, dict) and isinstance(wanted, dict) and there.keys() == wanted.keys():
        first = next(key for key in wanted if there[key] != wanted[key])
        return _difference(there[first], wanted[first], f"{first} ")
    return f"{what}{there!r:.120} there, {wanted!r:.120} wanted"


def one_of_each(archive: Archive, rate_hz: float) -> Dataset:
    """Return blank recordings of all set-ups, units and rates that occur, for what looks at nothing else."""
    index = archive.index
    codes, _ = coded_texts(index["meta"])
    other_rate = np.flatnonzero(index["rate_hz"].to_numpy() != rate_hz)[:1]
    first = {*np.unique(codes, return_index=True)[1].tolist(), *other_rate.tolist()}
    found: dict[Hashable, Recording] = {}
    for row in index.select(["name", "meta", "rate_hz"]).take(sorted(first)).to_pylist():
        meta, rate = archive.meta_of(row["meta"]), row["rate_hz"]
        key = Setup.of(meta), repr(meta.get("units")), rate
        if key not in found:
            times = np.zeros(1) if rate is None else None
            about: dict[str, Any] = {"meta": meta, "name": row["name"] or "", "axes": archive.axes}
            found[key] = Recording(np.zeros((1, len(archive.axes))), rate_hz=rate, time_s=times, **about)
    return Dataset(list(found.values()), archive.history)


# What was made, read.


def _footers_in(folder: Path) -> dict[str, dict[str, Any]]:
    """Return what the footers of all partitions say, by name of the file; rows as ``"n_rows"``."""
    footers = {}
    for path in sorted(folder.glob("*.parquet")):
        if _PARTITION.fullmatch(path.name):
            with naming(path, "reading it as a partition (remove it, or name another folder)"):
                about = pq.read_metadata(path)
                footers[path.name] = {**json.loads(about.metadata[MARK.encode()]), "n_rows": about.num_rows}
    return footers


class Outputs:
    """What partitions in a folder hold, one after the other, in the order of the archive."""

    holds: str
    """What the partitions hold, as their footers name it."""

    def __init__(self, folder: str | os.PathLike[str], *, partial: bool = False) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise FileNotFoundError(f"{self.folder}: no such folder")
        footers = _footers_in(self.folder)
        self.unfinished = (self.folder / UNFINISHED).exists()
        if not footers or (self.unfinished and not partial):
            again = "do the same again, which makes what is missing"
            hint = ", or take what there is by partial=True" if footers else ""
            raise FileNotFoundError(f"{self.folder}: the {self.holds} are not finished: {again}{hint}")
        self.spec: Mapping[str, Any] = next(iter(footers.values()))["spec"]
        if self.holds not in self.spec:
            raise GranularIdError(f"{self.folder} holds no {self.holds}, but {', '.join(self.spec)}")
        for name, footer in footers.items():
            if footer["spec"] != self.spec:
                how = f"{_difference(footer['spec'], self.spec)} (in {name})"
                raise GranularIdError(f"{self.folder} holds two kinds of {self.holds}: {how}")
        self._files = sorted(footers, key=lambda name: (footers[name]["place"], name))
        self.n_recordings = int(sum(footer["n_rows"] for footer in footers.values()))
        self.n_synthetic = int(sum(footer["n_synthetic"] for footer in footers.values()))

    def __len__(self) -> int:
        return self.n_recordings

    def __repr__(self) -> str:
        return f"{type(self).__name__}({os.fspath(self.folder)!r}: {counted(len(self))})"

    def tables(self, *columns: str) -> Iterator[Any]:
        """Yield some columns of one partition after the other, as pyarrow.Table; checksums are verified."""
        for file in self._files:
            path = self.folder / file
            with naming(path, f"reading {self.holds} (remove it, and make it again)"):
                table = pq.read_table(path, columns=[*columns], page_checksum_verification=True)
            yield table

    def joined(self, *columns: str) -> Any:
        """Return the same in one pyarrow.Table."""
        return pa.concat_tables(self.tables(*columns))

"""``check``: decode an archive as a whole and say what is wrong with it, row group by row group."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

from granular_id._checks import checked_n_jobs
from granular_id._files import check_source
from granular_id._parallel import spread
from granular_id._progress import ProgressCallback, Ticker, check_progress, showing
from granular_id._text import counted, fixed, verb
from granular_id.io import RecordingFileError
from granular_id.io.files import bytes_of
from granular_id.io.parquet.archive import Archive, RowGroup
from granular_id.io.parquet.layout import INDEX_FILE, INDEX_FOLDER, SAMPLES_FOLDER, index_names, index_of
from granular_id.io.parquet.writing import digest_of

_SHOWN = 20
"""Problems that are printed; all are in `CheckReport.problems`."""


@dataclass(frozen=True)
class Problem:
    """What is wrong in an archive.

    Attributes
    ----------
    file : str
        The damaged file, in the folder of the archive.
    row_group : int or None
        Its row group; None: the whole file.
    reason : str
    """

    file: str
    row_group: int | None
    reason: str

    def __str__(self) -> str:
        place = "" if self.row_group is None else f", row group {self.row_group}"
        return f"{self.file}{place}: {self.reason}"


@dataclass(frozen=True)
class CheckReport:
    """What `check` found; ``print`` it.

    Attributes
    ----------
    folder : path
    n_recordings, n_samples : int
        What the index files list.
    n_files, n_bytes : int
        Files of samples that they list, and the size of everything in the folder.
    problems : tuple of Problem
        File, row group and reason.
    leftovers : tuple of str
        Files that are no part of the archive: left by an append that was interrupted, or of one that is under way.
    seconds : float
        How long it took.
    ok : bool
        Whether there are no problems; leftovers harm nobody.
    """

    folder: Path
    n_recordings: int
    n_samples: int
    n_files: int
    n_bytes: int
    problems: tuple[Problem, ...]
    leftovers: tuple[str, ...]
    seconds: float = field(compare=False)

    @property
    def ok(self) -> bool:
        """Whether there are no problems."""
        return not self.problems

    def __str__(self) -> str:
        rate = self.n_recordings / self.seconds if self.seconds > 0 else 0.0
        size = f"{self.n_samples:,} samples in {counted(self.n_files, 'file')}, {fixed(self.n_bytes / 1e6, 1)} MB"
        lines = [f"{self.folder}: {counted(self.n_recordings)}, {size}; {fixed(rate)} recordings/s"]
        if self.leftovers:
            what = (
                "left by an append that was interrupted, or of one that is under way; no part of the archive"
            )
            lines += [f"{counted(len(self.leftovers), 'file')} {what}:", *_first(self.leftovers)]
        if self.problems:
            lines += [f"{counted(len(self.problems), 'problem')}:", *_first(list(map(str, self.problems)))]
        else:
            lines.append("no problems")
        return "\n".join(lines)


def _first(lines: Sequence[str]) -> list[str]:
    more = len(lines) - _SHOWN
    return [f"  {line}" for line in lines[:_SHOWN]] + ([f"  and {more} more"] if more > 0 else [])


def check(
    archive: Archive | str | os.PathLike[str],
    *,
    n_jobs: int | None = None,
    progress: bool | ProgressCallback = True,
) -> CheckReport:
    """Decode everything in an archive and compare it with what was written.

    Every row group is read as `Archive.read` does, with checksums of pages, counts and checks of recordings; digests
    of recordings are computed anew. Recordings that are there twice are found, and files that no index lists. What is
    damaged does not hide what comes after it. Nothing is changed.

    Parameters
    ----------
    archive : Archive, str or path
        An archive or its folder, whose index files are read anew.
    n_jobs : int, optional
        Threads over row groups, as in joblib: None is 1, -1 all cores. Each holds one row group.
    progress : bool or callable, default True
        True shows how far it is, as the largest archives take hours; a callable is called as
        ``progress(row_groups_done, row_groups_in_all, file)``.

    Returns
    -------
    CheckReport
        ``.ok``, ``.problems`` (file, row group, reason), ``.leftovers``.

    Raises
    ------
    FileNotFoundError
        There is no such folder.
    RecordingFileError
        It is no archive.
    ImportError
        pyarrow is missing.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.archive import append, check
    >>> from granular_id import Dataset, Recording
    >>> pushes = [Recording(np.full((3, 6), i), rate_hz=500, label="rice", name=f"push {i}") for i in range(5)]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = append(folder, Dataset(pushes))
    ...     report = check(folder, progress=False)
    >>> report.ok, report.n_recordings, report.problems
    (True, 5, ())
    """
    check_progress(progress)
    n_threads = _threads(checked_n_jobs(n_jobs))
    folder = archive.folder if isinstance(archive, Archive) else check_source(archive)
    begin = perf_counter()
    damaged: list[RecordingFileError] = []
    try:
        opened = Archive(folder, unreadable=damaged)
    except RecordingFileError:
        if not index_names(folder):  # it is no archive
            raise
        problems = [*map(_of_index, damaged)]
        return CheckReport(folder, 0, 0, 0, bytes_of(folder), tuple(problems), (), perf_counter() - begin)
    problems = [*map(_of_index, damaged)]
    with showing(progress) as callback:
        ticker = Ticker(len(opened.row_groups), callback)

        def checked(group: RowGroup) -> tuple[Problem | None, list[str]]:
            try:
                return _checked(opened, group)
            finally:
                ticker.tick(group.file)

        found = spread(checked, opened.row_groups, n_threads)
    problems += dict.fromkeys(problem for problem, _ in found if problem is not None)  # of a whole file once
    digests = [digest for _, some in found for digest in some]
    problems += _doubles(opened, digests)
    return CheckReport(
        folder,
        opened.n_recordings,
        sum(group.n_samples for group in opened.row_groups),
        len({group.file for group in opened.row_groups}),
        bytes_of(folder),
        tuple(problems),
        tuple(_leftovers(opened, [problem.file for problem in problems])),
        perf_counter() - begin,
    )


def _checked(archive: Archive, group: RowGroup) -> tuple[Problem | None, list[str]]:
    """Return what is wrong with a row group, and a digest of each of its recordings, stored ones first."""
    rows = archive.index.slice(group.start, group.stop - group.start)
    stored = rows["digest"].to_pylist()
    try:
        recordings = archive.read(group).recordings
    except RecordingFileError as error:
        whole = error.path == os.fspath(archive.folder / group.file) and error.place in (None, "footer")
        problem = Problem(group.file, None if whole else group.row_group, _reason(error))
        return problem, stored
    computed = list(map(digest_of, recordings))
    wrong = [i for i, known in enumerate(stored) if known != computed[i]]
    if not wrong:
        return None, computed  # which are the stored ones
    which = f"{counted(len(wrong))} of {len(stored)} {verb(len(wrong), 'has', 'have')}"
    reason = f"{which} another digest than {index_of(group.file)} says, the first is {recordings[wrong[0]].name!r:.60}"
    return Problem(group.file, group.row_group, reason), stored


def _threads(n_jobs: int | None) -> int:
    if n_jobs is None:
        return 1
    from joblib import effective_n_jobs  # slow to import

    return int(effective_n_jobs(n_jobs))


def _of_index(error: RecordingFileError) -> Problem:
    name = Path(error.path).name
    return Problem(name if name == INDEX_FILE else f"{INDEX_FOLDER}/{name}", None, _reason(error))


def _reason(error: RecordingFileError) -> str:
    where = "" if error.column is None else f"column {error.column}: "
    return where + error.problem


def _doubles(archive: Archive, digests: Sequence[str]) -> Iterator[Problem]:
    """Find recordings that an append would have taken for the same: what several row groups hold."""
    several = {digest for digest, count in Counter(digests).items() if count > 1}
    rows = [i for i, digest in enumerate(digests) if digest in several]
    if not rows:
        return
    about = archive.index.take(rows)
    identities = zip(
        *(about[name].to_pylist() for name in ("name", "label", "session", "start_time")), strict=True
    )
    first: dict[tuple[object, ...], int] = {}
    again: dict[int, int] = {}
    for row, identity in zip(rows, identities, strict=True):
        before = first.setdefault((digests[row], *identity), row)
        if before != row:
            again[row] = before
    if not again:
        return
    for group in archive.row_groups:
        here = [row for row in range(group.start, group.stop) if row in again]
        if here:
            name = archive.index["name"][here[0]].as_py()
            which = f"holds {counted(len(here))} that {verb(len(here), 'is', 'are')} in the archive already"
            reason = f"{which}, the first is {name!r:.60} (recording {here[0]} of all, also {again[here[0]]})"
            yield Problem(group.file, group.row_group, reason)


def _leftovers(archive: Archive, damaged: Sequence[str]) -> Iterator[str]:
    """Name what lies in the folders of the archive and is listed nowhere; not what a damaged index may list."""
    known = {group.file for group in archive.row_groups} | set(archive.index_files) | set(damaged)
    for folder in (SAMPLES_FOLDER, INDEX_FOLDER):
        place = archive.folder / folder
        for path in sorted(place.iterdir()) if place.is_dir() else []:
            name = f"{folder}/{path.name}"
            if name not in known and index_of(name) not in damaged:
                yield name

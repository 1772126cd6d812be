"""``check``: decode an archive as a whole and say what is wrong with it, row group by row group."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from granular_id._checks import checked_n_jobs
from granular_id._files import check_source
from granular_id._parallel import spread
from granular_id._progress import ProgressCallback, Ticker, check_progress, showing
from granular_id._text import counted, verb
from granular_id.io import RecordingFileError
from granular_id.io.parquet.archive import Archive, RowGroup
from granular_id.io.parquet.layout import index_file, index_keys, index_of, samples_file
from granular_id.io.parquet.writing import digest_of


@dataclass(frozen=True)
class CheckReport:
    """What `check` found; ``print`` it.

    Attributes
    ----------
    folder : path
    n_recordings : int
        What the index files list.
    problems : tuple of RecordingFileError
        Each with ``path``, ``place`` (the row group, None: the whole file) and ``problem``.
    leftovers : tuple of str
        Files that are no part of the archive: left by an append that was interrupted, or of one that is under way.
    n_unreadable : int
        Recordings of the row groups that cannot be decoded.
    """

    folder: Path
    n_recordings: int
    problems: tuple[RecordingFileError, ...]
    leftovers: tuple[str, ...]
    n_unreadable: int = 0

    @property
    def ok(self) -> bool:
        """Whether there are no problems; leftovers harm nobody."""
        return not self.problems

    def __str__(self) -> str:
        found = counted(len(self.problems), "problem") if self.problems else "no problems"
        lost = f", {self.n_unreadable} of them unreadable" * bool(self.n_unreadable)
        lines = [f"{self.folder}: {counted(self.n_recordings)}{lost}, {found}"]
        lines += [f"  {problem}" for problem in self.problems]
        if self.leftovers:
            what = f"{counted(len(self.leftovers), 'file')} left by an append that was interrupted"
            lines.append(f"{what}, or of one that is under way; no part of the archive:")
            lines += [f"  {name}" for name in self.leftovers]
        return "\n".join(lines)


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
        ``.ok``, ``.problems``, ``.n_unreadable``, ``.leftovers``.

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
    checked_n_jobs(n_jobs)
    from joblib import effective_n_jobs  # slow to import

    folder = archive.folder if isinstance(archive, Archive) else check_source(archive)
    problems: list[RecordingFileError] = []
    try:
        opened = Archive(folder, unreadable=problems)
    except RecordingFileError:
        if not problems:  # it is no archive
            raise
        return CheckReport(folder, 0, tuple(problems), tuple(_leftovers(folder)))
    with showing(progress) as step:
        ticker = Ticker(len(opened.row_groups), step)

        def checked(group: RowGroup) -> tuple[RecordingFileError | None, int]:
            found = _problem_of(opened, group)
            ticker.tick(group.file)
            return found

        found = spread(checked, opened.row_groups, effective_n_jobs(n_jobs))
    # Of a whole file once.
    problems += {str(problem): problem for problem, _ in found if problem is not None}.values()
    problems += _doubles(opened)
    leftovers, n_unreadable = tuple(_leftovers(folder)), sum(n for _, n in found)
    return CheckReport(folder, opened.n_recordings, tuple(problems), leftovers, n_unreadable)


def _problem_of(archive: Archive, group: RowGroup) -> tuple[RecordingFileError | None, int]:
    """Return what is wrong with a row group, and how many of its recordings cannot be decoded."""
    try:
        recordings = archive.read(group).recordings
    except RecordingFileError as error:
        return error, group.stop - group.start
    stored = archive.index["digest"].slice(group.start, len(recordings)).to_pylist()
    wrong = [one.name for one, known in zip(recordings, stored, strict=True) if digest_of(one) != known]
    if not wrong:
        return None, 0
    which = f"{counted(len(wrong))} of {len(stored)} {verb(len(wrong), 'has', 'have')} another digest"
    return _problem(archive, group, f"{which} than {index_of(group.file)} says, the first is", wrong[0]), 0


def _problem(archive: Archive, group: RowGroup, what: str, name: str) -> RecordingFileError:
    place = f"row group {group.row_group}"
    return RecordingFileError(archive.folder / group.file, f"{what} {name!r:.60}", place=place)


def _doubles(archive: Archive) -> Iterator[RecordingFileError]:
    """Find recordings that an append would have taken for the same."""
    first: dict[str, int] = {}
    ids, names = archive.index["id"].to_pylist(), archive.index["name"]
    for group in archive.row_groups:
        rows = range(group.start, group.stop)
        again = [row for row in rows if first.setdefault(ids[row], row) != row]
        if again:
            which = f"{counted(len(again))} that {verb(len(again), 'is', 'are')} in the archive already"
            what = f"holds {which} (recording {again[0]} of all is also {first[ids[again[0]]]}), the first is"
            yield _problem(archive, group, what, names[again[0]].as_py())


def _leftovers(folder: Path) -> Iterator[str]:
    """Name what lies in the folders of the archive and belongs to no index file."""
    known = {name for key in index_keys(folder) for name in (index_file(key), samples_file(key))}
    for path in sorted([*folder.glob("*.parquet"), *folder.glob("samples/*")]):
        name = path.relative_to(folder).as_posix()
        if name not in known:
            yield name

"""``load``: recognise what a path holds and read it."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Literal

from granular_id._checks import argument_error, checked_flag
from granular_id._files import check_source
from granular_id._progress import ProgressCallback, showing
from granular_id._text import counted
from granular_id.io.errors import RecordingFileError, attempt
from granular_id.io.folder import LAYOUTS, FoundFiles, find_files
from granular_id.io.formats import FORMATS, format_of, read_file
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource, completed
from granular_id.recording import Dataset, Recording, StepReport

_ARRAYS = ("npy", "npz", "mat", "hdf5")
_OF_FORMATS = {
    "topic": ("a bag or MCAP", ("mcap", "ros")),
    "array": ("of named arrays", _ARRAYS),
    "label": ("of named arrays or a table", (*_ARRAYS, "csv", "parquet")),
}
"""Which formats have what an option names."""


def load(
    path: str | os.PathLike[str],
    *,
    rate_hz: float | None = None,
    on_error: Literal["raise", "skip"] = "raise",
    on_time_error: Literal["raise", "repair"] = "raise",
    max_file_bytes: int | None = None,
    topic: str | None = None,
    time_unit: Literal["s", "ms", "us", "ns", "sample"] | None = None,
    array: str | None = None,
    label: str | None = None,
    isolate: bool = False,
    progress: bool | ProgressCallback = False,
) -> Dataset:
    r"""Read recordings from a file or folder.

    Nothing is resampled or cropped here. Recordings whose stamps lie within 1 % of a step of an even grid
    become uniform at the shortest decimal rate that fits; the others keep their stamps (`time_s`) and wait
    for ``.resample``. Stamps above 1e8 are taken as seconds since 1970 and give `start_time`.

    Parameters
    ----------
    path : str or path
        A file of a known format, or a folder of such files: ``label/*``, ``label/session/*``, ``label_*``, or with
        an ``index.csv``; folders ``train``, ``test`` and ``key=value`` are no labels. Formats: CSV, NumPy (.npy,
        .npz), MATLAB (.mat), HDF5 (.h5), Parquet (a native folder, or a table), ROS 1 and ROS 2 bags, MCAP, and the
        rows of GM10-ts.
    rate_hz : float, optional
        Rate at which files that have no clock were recorded, Hz (``--recorded-hz`` on the command line, where
        ``--rate-hz`` is ``.resample(rate_hz)``). Where there are stamps they must fit it (each within
        half a step of its place), and so must a rate that the file states itself, or it is refused. A
        ``rate_hz`` in index.csv comes first.
    on_error : {"raise", "skip"}
        What to do with a file that cannot be read: raise, or read the rest and list it in ``history[-1]``.
    on_time_error : {"raise", "repair"}
        What to do where time runs backwards or a stamp is repeated: raise with the place, or sort the samples
        and average those that share a stamp, count them in ``history[-1]`` and flag them ``TIME_REPAIRED``.
    max_file_bytes : int, optional
        Largest file that is read; by default 8 MiB for text, of which a line counts as at least 40 bytes (three
        minutes at 500 Hz), and 2 GiB for binary files, which may not expand more than 64-fold beyond 64 MiB: a
        file that is no recording is refused within a second and 256 MB.
    topic : str, optional
        Which topic of a bag holds the wrench, where there are several; ``"/topic.field"`` is the wrench in a field of
        its messages. Refused where no file is a bag or MCAP.
    time_unit : {"s", "ms", "us", "ns", "sample"}, optional
        What stamps count, where the file does not state it; "sample": they are an index, and a rate is stated. By
        default stamps are seconds, and refused where samples would lie 1 s or more, or 10 us or less apart.
    array : str, optional
        Which array (variable, data set or group) holds the samples, where there are several that may: its name,
        with the names of the groups around it or without. It counts whatever it is called.
    label : str, optional
        Which array, or column of a table (CSV, Parquet), holds the labels.
    isolate : bool, default False
        Read the files in a child process: for files from strangers. A crash, a hang or a hunger for memory of the
        library that reads a file becomes a RecordingFileError; the child may use 1 GiB and eight times the size of
        the largest file, and for each file 20 s of processor time and 1 s for every 4 MB. Memory is limited on Linux
        only. It starts within a second, once and again after each file that ended it; the recordings are the same.
        See docs/security.md for what it does not prevent. By default files are read in this process, which is faster.
    progress : bool or callable
        True draws a bar on a terminal; a callable is called as ``progress(files_done, files_in_all, file)``.

    Returns
    -------
    Dataset
        ``history[-1]`` says what was read, skipped, repaired and guessed; steps stored in the file come before.

    Raises
    ------
    FileNotFoundError
        `path` does not exist.
    RecordingFileError
        (a ValueError) naming the file and place of the first fault, or a path of no known format.
    ImportError
        The format needs a library that is not installed; names the extra that brings it.
    TypeError, ValueError
        A bad setting, named.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from granular_id.io import load
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "rice_1.csv"
    ...     _ = file.write_text("time,fx,fy,fz,tx,ty,tz\n0,1,2,3,4,5,6\n0.002,1,2,3,4,5,6\n")
    ...     data = load(folder)
    >>> data[0]
    Recording('rice_1.csv', label='rice', 2 samples at 500 Hz)
    """
    options = LoadOptions(
        rate_hz, on_error, on_time_error, max_file_bytes, topic, time_unit=time_unit, array=array, label=label
    )
    isolate = checked_flag("isolate", isolate)
    place = check_source(path)
    known = format_of(place)
    with showing(progress) as callback:
        if known is not None:
            found = FoundFiles(known.what, [FileSource.alone(place)])
            return _read(found, place, options, callback, isolate=isolate, alone=True)
        if place.is_dir():
            return _read(find_files(place, options), place, options, callback, isolate=isolate)
    wanted = "; ".join(known.what for known in FORMATS)
    problem = f"is of no known format; what can be read: {wanted}; or a folder of such files ({LAYOUTS})"
    raise RecordingFileError(place, problem)


def _read(
    found: FoundFiles,
    root: Path,
    options: LoadOptions,
    progress: ProgressCallback | None,
    *,
    isolate: bool,
    alone: bool = False,
) -> Dataset:
    """Read files one after the other; with on_error="skip" a file that cannot be read is listed instead."""
    _refuse_unused(found.sources, options)
    if options.on_error == "raise" and found.problems:
        raise _skippable(found.problems[0]) if found.sources else found.problems[0]
    contents: list[FileContent] = []
    problems = list(found.problems)
    with _reader(found.sources, options, isolate=isolate) as read:
        for done, source in enumerate(found.sources, start=1):
            content = attempt(
                problems, lambda source: completed(read(source), source, options.rate_hz), source
            )
            if content is not None:
                contents.append(content)
            elif alone:
                raise problems[-1]
            elif options.on_error == "raise":
                raise _skippable(problems[-1])
            if progress is not None:
                progress(done, len(found.sources), source.name)
    recordings = [recording for content in contents for recording in content.recordings]
    if not recordings:
        problem = f"none of {counted(len(problems))} could be read; the first problem: {problems[0]}"
        raise RecordingFileError(root, problem) from problems[0]
    history = [*found.history, *(step for content in contents for step in content.history)]
    return Dataset(recordings, [*history, _report(found, options, contents, recordings, problems)])


@contextmanager
def _reader(
    sources: Sequence[FileSource], options: LoadOptions, *, isolate: bool
) -> Iterator[Callable[[FileSource], FileContent]]:
    """Yield what reads a file: in this process, or in a child that is gone at the end."""
    if not isolate:
        yield partial(read_file, options=options)
        return
    # the child runs this module: it must not be there already
    from granular_id.io.isolate import IsolatedReader

    with IsolatedReader(sources, options) as reader:
        yield reader.read


def _refuse_unused(sources: Sequence[FileSource], options: LoadOptions) -> None:
    """Refuse options that would change nothing, as no file is of a format that has what they name."""
    known = {one.name for source in sources if (one := format_of(source.path)) is not None}
    for name, (what, wanted) in _OF_FORMATS.items():
        if sources and getattr(options, name) is not None and known.isdisjoint(wanted):
            came = f"{counted(len(sources), 'file')}, the first is {sources[0].path}"
            raise argument_error(ValueError, name, f"must be left out where no file is {what}: {came}")


def _skippable(problem: RecordingFileError) -> RecordingFileError:
    problem.skippable = True
    return problem


def _report(
    found: FoundFiles,
    options: LoadOptions,
    contents: Sequence[FileContent],
    recordings: Sequence[Recording],
    problems: Sequence[RecordingFileError],
) -> StepReport:
    parameters = {"format": found.layout, **asdict(options)}
    del parameters["max_file_bytes"]
    rows: list[dict[str, Any]] = [row for content in contents for row in content.rows]
    totals = {
        "recordings": len(recordings),
        "skipped": len(problems),
        "uniform": sum(r.is_uniform for r in recordings),
        "irregular": sum(not r.is_uniform for r in recordings),
        "moved_samples": sum(row.get("moved", 0) for row in rows),
        "merged_samples": sum(row.get("merged", 0) for row in rows),
    }
    notes = Counter(note for content in contents for note in content.notes)
    skipped = [{"name": Path(problem.path).name, "skipped": str(problem)} for problem in problems]
    every = [note if count == 1 else f"{note} ({count} files)" for note, count in notes.items()]
    return StepReport("load", parameters, totals, skipped + rows, [*found.notes, *every])

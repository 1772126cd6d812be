"""``load`` and ``load_parts``: find what a path holds, read it, and make recordings of it."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from granular_id._checks import argument_error, whole_number
from granular_id._core import GranularIdError
from granular_id._progress import ProgressCallback, check_progress, showing
from granular_id._text import counted
from granular_id.io.csv_head import last_width
from granular_id.io.files import RecordingFileError, check_place, failed
from granular_id.io.index import INDEX_NAME
from granular_id.io.label_notes import (
    alike_labels,
    labels_of_one,
    other_sessions,
    pauses_in,
    place_note,
    refuse_labels_of_files,
    refuse_labels_of_table,
)
from granular_id.io.source import FileContent, FileSource, LoadOptions, ReadFile
from granular_id.io.sources import find_sources, format_of, listed, placed
from granular_id.io.ways_out import with_all_wanted
from granular_id.recording import (
    Dataset,
    Made,
    StepReport,
    TableError,
    restated,
    to_recordings,
)

_ARRAYS = ("npy", "npz", "mat", "hdf5")
_OF_FORMATS = {
    "topic": ("a bag or MCAP", ("ros",)),
    "array": ("of named arrays", _ARRAYS),
    "time": ("a table", ("csv", "parquet")),
    "id": ("a table", ("csv", "parquet")),
    "csv": ("a text table", ("csv",)),
}
"""Which formats have what an option names."""

_EXAMPLES = 3
_FEW = 3


def load(
    path: str | os.PathLike[str],
    *,
    rate_hz: float | None = None,
    on_error: Literal["raise", "skip"] = "raise",
    on_time_error: Literal["raise", "repair"] = "raise",
    topic: str | None = None,
    array: str | None = None,
    time: str | None = None,
    time_unit: Literal["s", "ms", "us", "ns", "sample"] | None = None,
    axes: str | Sequence[str] | None = None,
    units: str | Sequence[str] | None = None,
    id: str | None = None,  # noqa: A002 (what the column is called)
    label: str | None = None,
    session: str | None = None,
    csv: Mapping[str, Any] | None = None,
    progress: bool | ProgressCallback = False,
) -> Dataset:
    r"""Read recordings from a file or folder.

    Nothing is resampled or cropped. Recordings whose stamps lie within 1 % of a step of an even grid, or within the
    last digit they are written with, become uniform at the shortest decimal rate that fits, or at the round figure
    within 0.1 % of it; the others keep their stamps (`time_s`) and wait for ``.resample``. Stamps above 1e8 are
    taken as seconds since 1970 and give `start_time`. Rows that are empty in all axes are missing samples: they are
    left out and leave a gap.

    What is in memory already comes in by `Dataset.from_arrays` and `Dataset.from_frames`; so does whatever numpy or
    pandas can read and this function refuses.

    Parameters
    ----------
    path : str or path
        A file of a known format, or a folder of such files: ``label/*``, ``label_1.csv``, or with an ``index.csv``.
        Formats: text tables (.csv, .txt, .lvm, .csv.gz ...), NumPy (.npy, .npz), MATLAB (.mat), HDF5 (.h5), Parquet (a
        native folder, or a table), ROS 1 and ROS 2 bags, MCAP.
    rate_hz : float, optional
        Rate at which the recordings were taken, Hz (``--recorded-hz`` on the command line); for files without a clock,
        or whose readings come in packets, with one stamp or within a moment, which it wins over: then the clock is
        ignored. Stamps that say another rate, or have pauses, are refused beside it. A ``rate_hz`` in index.csv comes
        first.
    on_error : {"raise", "skip"}
        What to do with a file that cannot be read: raise, or read the rest and list it in ``history[-1]``; of an
        archive also with a row group or index file.
    on_time_error : {"raise", "repair"}
        What to do where time runs backwards: raise with the place, or sort the samples, count them in ``history[-1]``
        and flag them ``TIME_REPAIRED``. Rows that are there twice are merged; different rows are never averaged.
    topic : str, optional
        Which topic of a bag holds the wrench, where there are several; ``"/topic.field"`` is the wrench in a field of
        its messages.
    array : str, optional
        Which array of an NPZ, MATLAB or HDF5 file holds the samples, where it is not ``X``: its name, with the names of
        the groups around it or without. Of several groups it is one recording each.
    time : str, optional
        Which column of a table is the clock, where it is not called time, t, timestamp ...
    time_unit : {"s", "ms", "us", "ns", "sample"}, optional
        What stamps count, where the file does not state it; "sample": they are an index, and a rate is stated. By
        default stamps are seconds, and refused where samples would lie 0.1 s or more, or 10 us or less apart.
    axes : str or sequence of str, optional
        Columns that are the axes, in this order: ``("wx", "wy", "wz")`` or ``"wx,wy,wz"``. They are named with or
        without a unit behind their name, ``wx [rad/s]``; other columns are left out. Unnamed arrays of that width have
        these axes. By default fx fy fz tx ty tz, or what the file itself says of its axes.
    units : str or sequence of str, optional
        Units of the axes, where the file does not state them: one for all, one per axis, or one for each
        three axes (of six ``"rad/s,m/s2"``). They come into ``meta["units"]``; forces
        and torques (fx to tz) are converted to N and N m. A file that states another unit is refused.
    id : str, optional
        Which column of a table tells recordings apart, where it is not called recording, trial or id.
    label, session : str, optional
        Where label and session stand: ``"folder"`` (of the file), ``"parent"`` (the folder above that), ``"file"`` (its
        name, of the label without the number at its end; its folder's where each holds one file of the same name),
        ``"column:NAME"`` (of a table, or array) or ``"meta:PATH"`` (``meta:source.tool``; also columns of index.csv).
        By default what index.csv or the file says, else for the label the folder, or the name of files in one folder;
        folders within folders are refused, but for one called ``data`` or the like around all.
    csv : mapping, optional
        Options of ``pandas.read_csv`` for text tables, as they are: ``{"skiprows": 7, "decimal": ","}``; but a file
        of UTF-8 among others in another ``encoding`` is read as UTF-8, with a note.
    progress : bool or callable
        True draws a bar on a terminal; a callable is called as ``progress(files_done, files_in_all, file)``.

    Returns
    -------
    Dataset
        ``history[-1]`` says what was read and skipped, and where label and session were taken from. What was chosen by
        `array`, `topic`, `axes`, `time` and `csv` stands in ``meta["read_as"]``, which models compare.

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
    >>> from granular_id import load
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "rice_1.csv"
    ...     _ = file.write_text("time,fx,fy,fz,tx,ty,tz\n0,1,2,3,4,5,6\n0.002,1,2,3,4,5,6\n")
    ...     data = load(folder)
    >>> data[0]
    Recording('rice_1.csv', label='rice', 2 samples at 500 Hz)
    """
    options = LoadOptions(
        rate_hz,
        on_error,
        on_time_error,
        topic,
        array,
        time,
        time_unit,
        axes,  # type: ignore[arg-type]  # which makes tuples of both
        units,  # type: ignore[arg-type]
        id,
        label,
        session,
        csv,
    )
    reading = _Reading(path, options)
    reads = list(reading.files(progress, parts=False))
    if any(read.may_be_labels for read in reads):
        refuse_labels_of_files(path, reads)
    return reading.dataset(reads, notes=alike_labels(reads) + (pauses_in(reads) or labels_of_one(reads)))


def load_parts(
    path: str | os.PathLike[str],
    *,
    n_recordings: int = 2048,
    progress: bool | ProgressCallback = False,
    **options: Any,
) -> Iterator[Dataset]:
    """Read recordings as `load` does, piece by piece: the same ones in the same order, with less in memory.

    Files of a folder are read one after the other, row groups of an archive too. What is in memory is one piece and
    one file (or row group) more; a file of many recordings is read as a whole.

    Parameters
    ----------
    path : str or path
        As in `load`.
    n_recordings : int, default 2048
        Recordings of a piece: 160 MB where each has 1600 samples of six axes. The last piece has fewer.
    progress
        As in `load`.
    **options
        All others of `load`: ``rate_hz``, ``on_error``, ``label`` ...

    Yields
    ------
    Dataset
        Its history is that of `load`, of this piece alone.

    Raises
    ------
    FileNotFoundError, RecordingFileError, ImportError, TypeError, ValueError
        As `load`; what is wrong in a file, once the pieces before it have been read. With ``on_error="skip"`` what
        of an archive is damaged is left out.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.io import load_parts, save
    >>> from granular_id import Dataset, Recording
    >>> data = Dataset([Recording(np.full((3, 6), i), rate_hz=500, name=f"push {i}") for i in range(5)])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [len(part) for part in load_parts(save(data, folder + "/pushes.npz"), n_recordings=2)]
    [2, 2, 1]
    """
    most = whole_number("n_recordings", n_recordings)
    known = [one.name for one in fields(LoadOptions) if one.init]
    unknown = next((name for name in options if name not in known), None)
    if unknown is not None:
        raise argument_error(TypeError, unknown, f"is no option of load; wanted one of {', '.join(known)}")
    check_progress(progress)
    return _parts(_Reading(path, LoadOptions(**options)), most, progress)


def _parts(reading: _Reading, most: int, progress: bool | ProgressCallback) -> Iterator[Dataset]:
    waiting: list[ReadFile] = []
    for read in reading.files(progress, parts=True):
        waiting.append(read)
        while sum(len(each.recordings) for each in waiting) > most:
            now, waiting = _split(waiting, most)
            yield reading.dataset(now)
    if waiting:
        yield reading.dataset(waiting)


def _split(reads: Sequence[ReadFile], n: int) -> tuple[list[ReadFile], list[ReadFile]]:
    """Part the first n recordings from the others; what is remarked on a file goes with the first of it."""
    now, rest = [], []
    for read in reads:
        here = read.recordings[:n]
        n -= len(here)
        if here:
            now.append(replace(read, recordings=here))
        if len(here) < len(read.recordings):
            others = replace(read, recordings=read.recordings[len(here) :])
            rest.append(replace(others, rows=[], notes=[]) if here else others)
    return now, rest


class _Reading:
    """A path that is read: what it holds, and what is wrong with it."""

    def __init__(self, path: str | os.PathLike[str], options: LoadOptions) -> None:
        self._options, self._root = options, Path(path)
        self._found = find_sources(self._root, options)
        formats = [known for source in self._found.files if (known := format_of(source.path)) is not None]
        self._alone = [source.path for source in self._found.files] == [self._root]
        self._named = self._alone or self._found.layout == INDEX_NAME  # each file is meant to be a recording
        self._problems: list[RecordingFileError] = []
        self._n_reported = 0
        self._beside: list[tuple[RecordingFileError, FileSource]] = []  # files that hold none of the axes
        self._places_noted = False
        known_names = {known.name for known in formats}
        for name, (what, wanted) in _OF_FORMATS.items():  # options that would change nothing
            if formats and getattr(options, name) is not None and known_names.isdisjoint(wanted):
                n = counted(len(formats), "file")
                came = f"{n}, the first is {self._found.files[0].path}"
                problem = f"must be left out where no file is {what}: {came}"
                raise argument_error(GranularIdError, name, problem)

    def files(self, progress: bool | ProgressCallback, *, parts: bool) -> Iterator[ReadFile]:
        """Read files one after the other; with on_error="skip" a file that cannot be read is listed instead."""
        found, problems, skips = self._found, self._problems, self._options.on_error == "skip"
        if found.problems and not skips:
            found.problems[0].skippable = bool(found.files)
            raise found.problems[0]
        problems += found.problems
        nothing = True
        with nullcontext() if progress is False else showing(progress) as callback:
            for done, source in enumerate(found.files, start=1):
                # what is to be left out may be a piece of a file
                for read in self._pieces(source, parts=parts or skips):
                    nothing = False
                    yield read
                if callback is not None:
                    callback(done, len(found.files), source.name)
        if not nothing:
            self._refuse_alike()
        else:
            every = [*problems, *(error for error, _ in self._beside)]
            if self._alone or not skips:
                first = every[0]
                its = next((one for one in found.files if str(one.path) == first.path), None)
                raise first if its is None else self._complete(first, its)
            problem = f"none of {counted(len(every))} could be read; the first problem: {every[0]}"
            raise RecordingFileError(self._root, problem) from every[0]

    def _pieces(self, source: FileSource, *, parts: bool) -> Iterator[ReadFile]:
        """Read a file of any format, piece by piece where it has pieces; what cannot be read is raised, or listed."""
        known, whole = format_of(source.path), True
        if known is None:
            raise RecordingFileError(source.path, "is of no known format any more")
        try:
            check_place(source.path, source.root)
            contents = (
                [known.read(source, self._options)]
                if known.parts is None or not parts
                else known.parts(source, self._options)
            )
            for content in contents:
                if isinstance(content, RecordingFileError):
                    self._problems.append(content)
                    continue
                read = _made(content, source)
                whole = False
                yield read
        except ImportError:
            raise
        except Exception as reason:
            error = failed(source.path, f"reading it as {known.name}", reason)
            doubt = error.parts == source.two_meanings
            if error.no_wrench and not self._named:
                self._beside.append((error, source))
            elif self._options.on_error == "skip" and not doubt:
                self._problems.append(error)
            else:
                cause = error.__cause__ if error is reason else reason
                error = error if doubt else self._complete(error, source)
                error.skippable = not doubt and (not whole or self._reads_another(source))
                raise error from cause

    def _refuse_alike(self) -> None:
        """Refuse files that hold none of the axes, where those that were read make recordings of them; or skip them."""
        if not self._beside:
            return
        beside = [source for _, source in self._beside]
        others = [source for source in self._found.files if source not in beside]
        series = {_series(source) for source in others}
        widths = {_row_width(source) for source in others} - {None}
        alike = [
            (error, source)
            for error, source in self._beside
            if _series(source) in series or _row_width(source) in widths
        ]
        if alike and self._options.on_error == "raise":
            error = self._complete(*alike[0])
            error.skippable = True
            raise error
        self._problems += [error for error, _ in alike]
        self._beside = [one for one in self._beside if one not in alike]

    def _complete(self, error: RecordingFileError, source: FileSource) -> RecordingFileError:
        return with_all_wanted(error, source, self._options, partial(_tried, source))

    def _reads_another(self, source: FileSource) -> bool:
        """Whether another file can be read: one of those before, or of the next few."""
        after = self._found.files.index(source) + 1
        for other in self._found.files[after:][:_FEW]:
            with suppress(GranularIdError):
                _tried(other, self._options)
                return True
        return after > 1

    def dataset(self, reads: Sequence[ReadFile], notes: Sequence[str] = ()) -> Dataset:
        """Put together what was read since the last time, with a report."""
        whole = Made(
            [r for read in reads for r in read.recordings], [row for read in reads for row in read.rows]
        )
        problems = self._problems[self._n_reported :]
        self._n_reported = len(self._problems)
        totals = {"recordings": 0, "skipped": len(problems), **whole.totals}
        orders = list(dict.fromkeys(note for read in reads for note in read.orders))
        counts = Counter(note for read in reads for note in read.notes)
        first = list(notes)
        notes = [note if count == 1 else f"{note} ({count} files)" for note, count in counts.items()]
        notes = [*self._found.notes, *notes]
        if not self._places_noted:  # with the first piece, for all
            places = [place_note(what, reads, self._alone) for what in ("label", "session")]
            places.append(other_sessions(reads))
            notes = [*first, *filter(None, places), *notes]
        if self._beside:
            names = [source.path.name for _, source in self._beside]
            orders.insert(0, f"not read, as they hold none of the axes: {listed(names)}")
        notes = [*orders, *notes]
        self._places_noted = True
        given = {one.name: getattr(self._options, one.name) for one in fields(LoadOptions) if one.init}
        if given["csv"] is not None:
            given["csv"] = {key: repr(value) for key, value in given["csv"].items()}
        given = {name: value for name, value in given.items() if value is not None}
        skipped = [{"name": Path(problem.path).name, "skipped": str(problem)} for problem in problems]
        parameters = {"format": self._found.layout, **given}
        report = StepReport("load", parameters, totals, skipped + whole.rows, notes)
        stored = {id(read.history): read.history for read in reads}  # of a file once, not of a piece
        before = [*self._found.history, *(step for steps in stored.values() for step in steps)]
        return Dataset(whole.recordings, [*before, report])


def _series(source: FileSource) -> tuple[str, ...]:
    """Return what numbered files have in common: their names without the numbers."""
    return source.path.suffix.lower(), re.sub(r"\d+", "#", source.path.stem.lower())


def _row_width(source: FileSource) -> int | None:
    """Return the cells of the last row of a text table whose name holds its label; None of all others."""
    known = format_of(source.path)
    if known is None or known.name != "csv" or "file" not in source.label_place:
        return None
    return last_width(source.path)


def _tried(source: FileSource, options: LoadOptions) -> None:
    """Read one file with other options, for what is wanted beside them."""
    known = format_of(source.path)
    stated = replace(source, **{name: value for name, value in options.stated.items() if value is not None})
    stated = placed(stated, options, source.path.resolve())
    if known is not None:
        try:
            _made(known.read(stated, options), stated)
        except Exception as reason:
            raise failed(source.path, f"reading it as {known.name}", reason) from reason


def _made(content: FileContent, source: FileSource) -> ReadFile:
    """Make the recordings of what a reader found."""
    read = ReadFile(
        rows=content.rows, notes=content.notes, source=source, orders=content.orders, history=content.history
    )
    read.may_be_sessions = content.may_be_sessions
    try:
        read.recordings = [restated(recording, source) for recording in content.recordings]
    except TableError as error:
        raise RecordingFileError(source.path, error.parts, column=error.column) from error
    for i, table in enumerate(content.tables):
        try:
            made = to_recordings(table, source)
        except TableError as error:
            place = {"column": error.column, "no_wrench": error.no_wrench, **content.place(i, error.row)}
            lines = content.in_python(error.mend) if error.mend else []
            raise RecordingFileError(source.path, [*error.parts, *lines], **place) from error
        if made.may_be_labels or made.label_mend or made.may_be_several or made.may_be_ids:
            refuse_labels_of_table(made, content, source)
        read.may_be_labels = made.may_be_labels or content.may_be_labels
        for name, texts in made.may_be_sessions.items():
            read.may_be_sessions.setdefault(name, []).extend(texts)
        read.recordings += made.recordings
        read.rows += made.rows
        read.notes += [note for note in made.notes if note not in read.notes]
    n = len(read.recordings)
    if n > 1 and (source.start_time is not None or source.trigger_index is not None):
        problem = f"start_time and trigger_index are stated for a file of {counted(n)}"
        raise RecordingFileError(source.path, f"{problem}; wanted in the file itself")
    if source.two_meanings is not None and any(recording.label is None for recording in read.recordings):
        raise RecordingFileError(source.root, source.two_meanings)
    return read

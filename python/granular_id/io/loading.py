"""``load`` and ``load_parts``: recognise what a path holds and read it."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, Literal

from granular_id._checks import argument_error, checked_index
from granular_id._files import check_source
from granular_id._progress import ProgressCallback, check_progress, showing
from granular_id._text import counted
from granular_id.io.errors import RecordingFileError, attempt
from granular_id.io.folder import LAYOUTS, OTHER_FILES, FoundFiles, find_files
from granular_id.io.folder_save import INDEX_COLUMNS
from granular_id.io.formats import FORMATS, format_of, read_file, read_parts
from granular_id.io.options import LoadOptions
from granular_id.io.source import FileContent, FileSource, completed
from granular_id.recording import Dataset, Recording, StepReport

_ARRAYS = ("npy", "npz", "mat", "hdf5")
_OF_FORMATS = {
    "topic": ("a bag or MCAP", ("ros",)),
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
    axes: str | Sequence[str] | None = None,
    units: str | Sequence[str] | None = None,
    window_s: float | None = None,
    hop_s: float | None = None,
    session: str | None = None,
    progress: bool | ProgressCallback = False,
) -> Dataset:
    r"""Read recordings from a file or folder.

    Nothing is resampled here, or cropped but for windows. Recordings whose stamps lie within 1 % of a step of an even
    grid become uniform at the shortest decimal rate that fits; the others keep their stamps (`time_s`) and wait for
    ``.resample``. Stamps above 1e8 are taken as seconds since 1970 and give `start_time`.

    Parameters
    ----------
    path : str or path
        A file of a known format, or a folder of such files: ``label/*``, ``label/session/*``, ``label_*``, or with
        an ``index.csv``; folders ``train``, ``test`` and ``key=value`` are no labels. Formats: CSV, NumPy (.npy,
        .npz), MATLAB (.mat), HDF5 (.h5), Parquet (a native folder, or a table), ROS 1 and ROS 2 bags, MCAP.
    rate_hz : float, optional
        Rate at which files that have no clock were recorded, Hz (``--recorded-hz`` on the command line, where
        ``--rate-hz`` is ``.resample(rate_hz)``). Where there are stamps they must fit it (each within
        half a step of its place), and so must a rate that the file states itself, or it is refused. A
        ``rate_hz`` in index.csv comes first.
    on_error : {"raise", "skip"}
        What to do with a file that cannot be read: raise, or read the rest and list it in ``history[-1]``; of an
        archive also with a row group or index file.
    on_time_error : {"raise", "repair"}
        What to do where time runs backwards or a stamp is repeated: raise with the place, or sort the samples
        and average those that share a stamp, count them in ``history[-1]`` and flag them ``TIME_REPAIRED``.
    max_file_bytes : int, optional
        Largest file that is read; by default 24 MiB for text, of which a line counts as at least 40 bytes (nine
        minutes of six axes at 500 Hz), and 2 GiB for binary files, which may not expand more than
        64-fold beyond 64 MiB: a file that is no recording is refused within seconds and 256 MB.
    topic : str, optional
        Which topic of a bag holds the wrench, where there are several; ``"/topic.field"`` is the wrench in a field of
        its messages. An IMU that is named so is read too, as axes wx wy wz ax ay az: state its `units`. Refused where
        no file is a bag or MCAP.
    time_unit : {"s", "ms", "us", "ns", "sample"}, optional
        What stamps count, where the file does not state it; "sample": they are an index, and a rate is stated. By
        default stamps are seconds, and refused where samples would lie 1 s or more, or 10 us or less apart.
    array : str, optional
        Which array (variable, data set or group) holds the samples, where there are several that may: its name, with
        the names of the groups around it or without. It counts whatever it is called.
    label : str, optional
        Which array, or column of a table (CSV, Parquet), holds the labels.
    axes : str or sequence of str, optional
        Columns that are the axes, in this order: ``("wx", "wy", "wz")`` or ``"wx,wy,wz"``. They are named with or
        without a unit behind their name, ``wx [rad/s]``; other columns are left out, by name. Unnamed arrays of that
        width have these axes. By default fx fy fz tx ty tz, or what the file itself says of its axes.
    units : str or sequence of str, optional
        Units of the axes, where the file does not state them: one for all, one per axis, or one for each of several
        runs of equal length (six axes and ``"rad/s,m/s2"``: three and three). They come into ``meta["units"]`` as they
        stand; forces and torques (fx to tz) are converted to N and N m. A file that states another unit is refused.
        By default what the file states; nothing is guessed.
    window_s, hop_s : float, optional
        Cut every recording into windows this long, from one to the next by `hop_s` (by default `window_s`: they do not
        overlap), as `Dataset.windows` does. Recordings must be uniform: resample others first, and then cut them.
    session : str, optional
        What was recorded in one go: ``"file"`` (each file is a session), ``"folder"`` (all files of a folder), or the
        name of a column of index.csv, or of the file, where it has one value in a recording. By default what index.csv,
        the file or three levels of folders say; windows without a session have their recording's name.
    progress : bool or callable
        True draws a bar on a terminal; a callable is called as ``progress(files_done, files_in_all, file)``.

    Returns
    -------
    Dataset
        ``history[-1]`` says what was read, skipped, repaired and guessed; steps stored in the file come before, and
        one about windows after it.

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
        max_file_bytes,
        topic,
        time_unit=time_unit,
        array=array,
        label=label,
        axes=axes,  # type: ignore[arg-type]  # which makes tuples of both
        units=units,  # type: ignore[arg-type]
        window_s=window_s,
        hop_s=hop_s,
        session=session,
    )
    with showing(progress) as callback:
        reading = _Reading(path, options)
        return reading.dataset(list(reading.contents(callback, parts=False)))


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
        Recordings of a piece, before they are cut into windows: 160 MB where each has 1600 samples of six axes. The
        last piece has fewer; where nearly all recordings are shorter than a window, a piece has more.
    progress
        As in `load`.
    **options
        All others of `load`: ``rate_hz``, ``on_error``, ``window_s`` ...

    Yields
    ------
    Dataset
        Its history is that of `load`, of this piece alone.

    Raises
    ------
    FileNotFoundError, RecordingFileError, ImportError, TypeError, ValueError
        As `load`; what is wrong in a file, once the pieces before it have been read. With ``on_error="skip"`` what
        of an archive is damaged is left out. Windows of recordings that share a name
        are refused, as the whole is needed to tell them apart.

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
    most = checked_index(n_recordings, "n_recordings")
    if most < 1:
        raise argument_error(ValueError, "n_recordings", f"must be positive, got {most}")
    known = [field.name for field in fields(LoadOptions)]
    unknown = next((name for name in options if name not in known), None)
    if unknown is not None:
        raise argument_error(TypeError, unknown, f"is no option of load; wanted one of {', '.join(known)}")
    check_progress(progress)
    return _parts(_Reading(path, LoadOptions(**options)), most, progress)


def _parts(reading: _Reading, most: int, progress: bool | ProgressCallback) -> Iterator[Dataset]:
    with showing(progress) as callback:
        waiting: list[FileContent] = []
        several = False
        for content in reading.contents(callback, parts=True):
            waiting.append(content)
            while sum(len(each.recordings) for each in waiting) > most:
                now, rest = _split(waiting, most)
                if not (reading.gives_any(now) and reading.gives_any(rest)):
                    break
                several = True
                reading.check_windows(now)
                yield reading.dataset(now)
                waiting = rest
        if several:
            reading.check_windows(waiting)
        yield reading.dataset(waiting)


def _split(contents: Sequence[FileContent], n: int) -> tuple[list[FileContent], list[FileContent]]:
    """Part the first n recordings from the others; what is remarked on a file goes with the first of it."""
    now, rest = [], []
    for content in contents:
        here = content.recordings[:n]
        n -= len(here)
        if here:
            now.append(replace(content, recordings=here))
        if len(here) < len(content.recordings):
            others = replace(content, recordings=content.recordings[len(here) :])
            rest.append(replace(others, rows=[], notes=[]) if here else others)
    return now, rest


class _Reading:
    """A path that is read: what it holds, and what is wrong with it."""

    def __init__(self, path: str | os.PathLike[str], options: LoadOptions) -> None:
        self._options = options
        self._root = place = check_source(path)
        self._problems: list[RecordingFileError] = []
        self._n_problems = 0
        self._names: set[str] = set()
        self._first: list[Recording] = []
        known = format_of(place)
        self._alone = known is not None
        if known is not None:
            self._found = FoundFiles(known.what, [FileSource.alone(place)])
        elif place.is_dir():
            self._found = find_files(place, options)
        else:
            wanted = "; ".join(known.what for known in FORMATS)
            problem = (
                f"is of no known format; what can be read: {wanted}; or a folder of such files ({LAYOUTS})"
            )
            if place.is_file():
                problem += f"; {OTHER_FILES}"
            raise RecordingFileError(place, problem)

    def contents(self, progress: ProgressCallback | None, *, parts: bool) -> Iterator[FileContent]:
        """Read files one after the other; with on_error="skip" a file that cannot be read is listed instead."""
        found, options, problems = self._found, self._options, self._problems
        _refuse_unused(found.sources, options)
        sources = [_with_session(source, found.columns, options.session) for source in found.sources]
        if options.on_error == "raise" and found.problems:
            raise _skippable(found.problems[0]) if found.sources else found.problems[0]
        problems += found.problems
        nothing = True
        # what is to be left out may be a piece of a file
        read = read_parts if parts or options.on_error == "skip" else _whole
        for done, source in enumerate(sources, start=1):
            before, pieces = len(problems), read(source, options)
            whole = True
            while (content := attempt(problems, _next, pieces, source, options)) is not None:
                if isinstance(content, RecordingFileError):
                    problems.append(content)
                    continue
                nothing = whole = False
                yield content
            if len(problems) > before and options.on_error == "raise":
                raise problems[-1] if self._alone and whole else _skippable(problems[-1])
            if len(problems) > before and self._alone and nothing:
                raise problems[before]
            if progress is not None:
                progress(done, len(sources), source.name)
        if nothing:
            problem = f"none of {counted(len(problems))} could be read; the first problem: {problems[0]}"
            raise RecordingFileError(self._root, problem) from problems[0]

    def dataset(self, contents: Sequence[FileContent]) -> Dataset:
        """Put together what was read since the last time."""
        recordings = [recording for content in contents for recording in content.recordings]
        problems = self._problems[self._n_problems :]
        self._n_problems = len(self._problems)
        stored = {
            id(content.history): content.history for content in contents
        }  # of a file once, not of a piece
        history = [*self._found.history, *(step for steps in stored.values() for step in steps)]
        report = _report(self._found, self._options, contents, recordings, problems)
        return _cut(Dataset(recordings, [*history, report]), self._options)

    def gives_any(self, contents: Sequence[FileContent]) -> bool:
        """Tell whether anything is left of some recordings when windows are cut and short ones skipped."""
        window_s = self._options.window_s
        if window_s is None or self._options.on_error == "raise":
            return True
        every = (recording for content in contents for recording in content.recordings)
        return any(r.rate_hz is None or r.n_samples >= round(window_s * r.rate_hz) for r in every)

    def check_windows(self, contents: Sequence[FileContent]) -> None:
        """Refuse windows of a piece that would be others than those of the whole."""
        if self._options.window_s is None:
            return
        recordings = [recording for content in contents for recording in content.recordings]
        for recording in recordings:
            name = recording.name.strip()
            if not name or name in self._names:
                came = f"recordings share the name {name!r:.60}" if name else "a recording has no name"
                way_out = "windows of a piece cannot tell them apart: use load, or give them names"
                raise argument_error(
                    ValueError, "window_s", f"={self._options.window_s:g}: {came}, and {way_out}"
                )
            self._names.add(name)
        self._first = self._first or recordings[:1]
        _check_rate(Dataset([*self._first, *recordings]), self._options.window_s)


def _next(
    pieces: Iterator[FileContent | RecordingFileError], source: FileSource, options: LoadOptions
) -> FileContent | RecordingFileError | None:
    content = next(pieces, None)
    return completed(content, source, options) if isinstance(content, FileContent) else content


def _with_session(source: FileSource, columns: Sequence[str], session: str | None) -> FileSource:
    """Say of a file which session it is, where that stands outside of it: its place, index.csv, names of folders."""
    if session is None:
        return source
    inside = source.path.is_relative_to(source.root)
    place = source.path.relative_to(source.root) if inside else Path(source.path.name)
    own: object
    if session == "file":
        own = place.as_posix()
    elif session == "folder":
        own = place.parent.as_posix() if place.parent.name else source.root.resolve().name
    elif session.lower() in columns:
        column = session.lower()
        own = getattr(source, column) if column in INDEX_COLUMNS else source.meta.get(column)
    elif session in source.meta:
        own = source.meta[session]
    else:
        return source
    return replace(source, session=None if own is None else str(own), session_is_known=True)


def _cut(data: Dataset, options: LoadOptions) -> Dataset:
    if options.window_s is None:
        return data
    _check_rate(data, options.window_s)
    try:
        return data.windows(options.window_s, options.hop_s, on_short=options.on_error)
    except ValueError as error:
        raise ValueError(str(error).replace("on_short=", "on_error=")) from error


def _check_rate(data: Dataset, window_s: float) -> None:
    try:
        _ = data.rate_hz
    except ValueError as error:
        came = str(error).partition(";")[0]
        way_out = f"load without window_s, then call .resample(rate_hz) and .windows({window_s:g})"
        raise argument_error(ValueError, "window_s", f"={window_s:g}: {came}; {way_out}") from error


def _whole(source: FileSource, options: LoadOptions) -> Iterator[FileContent]:
    yield read_file(source, options)


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
    for name in ("max_file_bytes", "window_s", "hop_s"):  # windows are a step of their own
        del parameters[name]
    for name in ("axes", "units", "session"):
        if parameters[name] is None:
            del parameters[name]
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

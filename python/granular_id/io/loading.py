"""``load``: recognise what a path holds and read it."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from granular_id.io.csv_folder import LAYOUTS, is_csv_file, load_csv_file, load_csv_folder
from granular_id.io.errors import RecordingFileError
from granular_id.io.options import MAX_FILE_BYTES, LoadOptions
from granular_id.recording import Dataset


@dataclass(frozen=True)
class Format:
    """A way of keeping recordings: how to recognise it and how to read it."""

    what: str
    recognises: Callable[[Path], bool]
    read: Callable[[Path, LoadOptions], Dataset]


FORMATS = (
    Format("one CSV file (*.csv)", is_csv_file, load_csv_file),
    Format(f"a folder of CSV files ({LAYOUTS})", Path.is_dir, load_csv_folder),
)
"""All formats, asked in this order."""


def load(
    path: str | os.PathLike[str],
    *,
    rate_hz: float | None = None,
    on_error: Literal["raise", "skip"] = "raise",
    on_time_error: Literal["raise", "repair"] = "raise",
    max_file_bytes: int = MAX_FILE_BYTES,
    progress: Callable[[int, int], object] | None = None,
) -> Dataset:
    r"""Read recordings from a file or folder.

    Nothing is resampled or cropped here. Recordings whose stamps lie within 1 % of a step of an even grid
    become uniform at the shortest decimal rate that fits; the others keep their stamps (`time_s`) and wait
    for ``.resample``. Stamps above 1e8 are taken as seconds since 1970 and give `start_time`.

    Parameters
    ----------
    path : str or path
        A CSV file (one recording, no label) or a folder of them: ``label/*.csv``, ``label/session/*.csv``,
        ``label_*.csv``, or with an ``index.csv``.
    rate_hz : float, optional
        Rate of files that have no time column, Hz. Where there are stamps they must fit it (each within
        half a step of its place), or the file is refused. A ``rate_hz`` in index.csv comes first.
    on_error : {"raise", "skip"}
        What to do with a file that cannot be read: raise, or read the rest and list it in ``history[-1]``.
    on_time_error : {"raise", "repair"}
        What to do where time runs backwards or a stamp is repeated: raise with the line, or sort the samples
        and average those that share a stamp, count them in ``history[-1]`` and flag them ``TIME_REPAIRED``.
    max_file_bytes : int
        Largest file that is read, a line counting as at least 40 bytes; 8 MiB by default (three minutes at
        500 Hz), so that a file that is no recording is refused within a second and 256 MB.
    progress : callable, optional
        Called as ``progress(files_done, files_in_all)`` after each file.

    Returns
    -------
    Dataset
        ``history[-1]`` says what was read, skipped and repaired.

    Raises
    ------
    FileNotFoundError
        `path` does not exist.
    RecordingFileError
        (a ValueError) naming the file, line and column of the first fault, or a path of no known format.
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
    options = LoadOptions(rate_hz, on_error, on_time_error, max_file_bytes, progress)
    place = Path(path)
    if not place.exists():
        raise FileNotFoundError(f"{os.fspath(path)}: no such file or folder")
    for known in FORMATS:
        if known.recognises(place):
            return known.read(place, options)
    wanted = "; ".join(known.what for known in FORMATS)
    raise RecordingFileError(place, f"is of no known format; what can be read: {wanted}")

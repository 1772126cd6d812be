"""Write a ``Dataset`` as a folder of CSV files that ``load`` reads back bit for bit."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_id._core import write_number_table
from granular_id._progress import ProgressCallback
from granular_id.io.columns import FLAGS, TIME
from granular_id.io.folder_save import checked_dataset, indexed_folder, refuse_other_axes
from granular_id.recording import AXES, Dataset, Recording

__all__ = ["save_csv"]


def save_csv(
    dataset: Dataset, folder: str | os.PathLike[str], *, progress: ProgressCallback | None = None
) -> Path:
    """Write a folder of CSV files with an ``index.csv``.

    Samples are written with as many digits as float64 needs; ``load(folder) == dataset`` holds. Everything is
    written under a temporary name beside `folder` and renamed when complete: no half-written folder is ever seen
    under the final name.

    Parameters
    ----------
    dataset : Dataset
        Of 6-axis recordings.
    folder : str or path
        New or empty folder.
    progress : callable, optional
        Called as ``progress(files_done, files_in_all, file)``.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileExistsError
        `folder` is a file, a link or a folder with something in it.
    FileNotFoundError
        The folder to put it in does not exist.
    ValueError
        A recording has other axes.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.io import load, save_csv
    >>> from granular_id.recording import Dataset, Recording
    >>> data = Dataset([Recording(np.ones((3, 6)) / 3, rate_hz=500, label="oat flakes")])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     load(save_csv(data, folder + "/oats")) == data
    True
    """
    refuse_other_axes(checked_dataset(dataset), "CSV")
    return indexed_folder(dataset, folder, ".csv", _write, progress)


def _write(recording: Recording, path: Path) -> None:
    header = [TIME, *AXES]
    columns: list[NDArray[np.float64] | NDArray[np.uint8]] = [recording.times(), *recording.wrench.T]
    if recording.flags is not None:
        header.append(FLAGS)
        columns.append(recording.flags)
    with path.open("wb") as file:
        file.write(",".join(header).encode("ascii") + b"\n")
        file.write(write_number_table(columns))

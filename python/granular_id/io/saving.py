"""``save``: write a data set in a format that ``load`` reads back bit for bit."""

from __future__ import annotations

import os
from pathlib import Path

from granular_id._progress import ProgressCallback, showing
from granular_id.io.folder_save import check_room, checked_dataset
from granular_id.io.formats import writer
from granular_id.recording import Dataset


def save(
    dataset: Dataset,
    path: str | os.PathLike[str],
    format: str | None = None,  # noqa: A002 (what pandas, matplotlib and pillow call it)
    *,
    progress: bool | ProgressCallback = False,
) -> Path:
    """Write a data set.

    Samples, stamps, flags, metadata and history are kept to the last bit: ``load(save(data, path)) == data``.
    Everything is written under a temporary name and renamed when complete; nothing is overwritten.

    Parameters
    ----------
    dataset : Dataset
    path : str or path
        File or folder to write; it must not exist (a folder may, if empty).
    format : str, optional
        ``"csv"`` (a folder), ``"npz"`` or ``"parquet"`` (a folder). By default told by the ending of `path`.
    progress : bool or callable
        True draws a bar on a terminal; a callable is called as ``progress(done, total, what)``.

    Returns
    -------
    Path
        What was written.

    Raises
    ------
    FileExistsError
        There is something at `path` already.
    FileNotFoundError
        The folder to put it in does not exist.
    ValueError
        No such format, one that is only read, or an ending that says nothing; recordings that the format cannot hold.
    ImportError
        The format needs a library that is not installed; names the extra that brings it.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id import load, save
    >>> from granular_id import Dataset, Recording
    >>> data = Dataset([Recording(np.ones((3, 6)) / 3, rate_hz=500, label="oat flakes")])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     load(save(data, folder + "/oats", "csv")) == data
    True
    """
    checked_dataset(dataset)
    check_save(path, format)
    with showing(progress) as callback:
        return writer(path, format)(dataset, Path(path), progress=callback)


def check_save(path: str | os.PathLike[str], format: str | None = None) -> None:  # noqa: A002 (as in save)
    """Refuse what `save` would refuse whatever the data set, before hours of work depend on it.

    Raises
    ------
    FileExistsError, FileNotFoundError, ValueError
        As `save`.
    """
    writer(path, format)
    check_room(Path(path))

"""The table of file formats: how each is recognised, read and written; ``save``."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from granular_id._core import GranularIdError
from granular_id._progress import ProgressCallback, showing
from granular_id.io.csv import read_csv
from granular_id.io.csv_saving import save_csv
from granular_id.io.files import RecordingFileError, check_room
from granular_id.io.flat import checked_dataset
from granular_id.io.hdf5 import read_hdf5
from granular_id.io.matlab import read_mat
from granular_id.io.npz import read_npy, read_npz, save_npz
from granular_id.io.parquet.layout import INDEX_FILE
from granular_id.io.parquet.table import parquet_parts, read_parquet
from granular_id.io.parquet.writing import save_parquet
from granular_id.io.ros import read_ros
from granular_id.io.source import FileContent, FileSource, LoadOptions
from granular_id.recording import Dataset


@dataclass(frozen=True)
class FileFormat:
    """A way of keeping recordings."""

    name: str  # what `format=` and `--to` call it
    what: str  # for people, with its endings
    suffixes: tuple[str, ...]  # endings of its files, lower case, with the point
    read: Callable[[FileSource, LoadOptions], FileContent]
    save: Callable[..., Path] | None = None  # save(dataset, path)
    saves_folder: bool = False  # whether what `save` writes is a folder
    sign: re.Pattern[str] | None = None  # name of what lies in a folder that is a file of this format
    parts: Callable[[FileSource, LoadOptions], Iterator[FileContent | RecordingFileError]] | None = (
        None  # the same, piece by piece; errors about what was left out, with on_error="skip"
    )


FORMATS = (
    FileFormat(
        "csv",
        "text tables (*.csv, *.tsv, *.txt, *.dat, *.lvm, *.csv.gz)",
        (".csv", ".tsv", ".txt", ".dat", ".lvm", ".csv.gz", ".tsv.gz", ".txt.gz"),
        read_csv,
        save_csv,
        saves_folder=True,
    ),
    FileFormat("npz", "NumPy archives (*.npz)", (".npz",), read_npz, save_npz),
    FileFormat("npy", "NumPy arrays (*.npy)", (".npy",), read_npy),
    FileFormat("mat", "MATLAB (*.mat)", (".mat",), read_mat),
    FileFormat("hdf5", "HDF5 (*.h5, *.hdf5)", (".h5", ".hdf5"), read_hdf5),
    FileFormat(
        "parquet",
        "Parquet (archives, tables *.parquet)",
        (".parquet",),
        read_parquet,
        save_parquet,
        saves_folder=True,
        sign=INDEX_FILE,
        parts=parquet_parts,
    ),
    FileFormat(
        "ros",
        "ROS bags and MCAP (*.bag, *.db3, *.mcap, folders with metadata.yaml)",
        (".bag", ".db3", ".mcap"),
        read_ros,
        sign=re.compile(r"metadata\.yaml"),
    ),
)
"""All formats, tried in this order."""


def writer(path: str | os.PathLike[str], name: str | None) -> Callable[..., Path]:
    """Return the function that writes a format, named, or known by the ending of the path."""
    ending = Path(path).name.lower()
    by_ending = next((known for known in FORMATS if ending.endswith(known.suffixes)), None)
    chosen = by_ending if name is None else next((known for known in FORMATS if known.name == name), None)
    if chosen is not None and chosen.saves_folder:
        fits = name is not None and by_ending in (None, chosen)
    else:
        fits = by_ending is chosen
    if chosen is None or chosen.save is None or not fits:
        as_format = "" if name is None else f" as format={name!r}"
        wanted = (
            "wanted a name that ends in .npz, or that of a folder: without an ending of CSV files, with .parquet an "
            "archive (in Python format='csv' or 'parquet'); other formats are only read"
        )
        raise GranularIdError(f"{os.fspath(path)} cannot be written{as_format}: {wanted}")
    return chosen.save


def save(
    dataset: Dataset,
    path: str | os.PathLike[str],
    format: str | None = None,  # noqa: A002 (what pandas, matplotlib and pillow call it)
    *,
    progress: bool | ProgressCallback = False,
) -> Path:
    """Write a data set.

    Samples, stamps, flags, metadata and history are written to the last bit: ``load(save(data, path)) == data``.
    Everything is written under a temporary name and renamed when complete; nothing is overwritten.

    Parameters
    ----------
    dataset : Dataset
    path : str or path
        File or folder to write; it must not exist (a folder may, if empty).
    format : str, optional
        ``"csv"`` (a folder), ``"npz"`` or ``"parquet"`` (a folder). By default known by the ending of `path`.
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
    """Refuse what `save` would refuse whatever the data set, before hours of work depend on it."""
    writer(path, format)
    check_room(Path(path))

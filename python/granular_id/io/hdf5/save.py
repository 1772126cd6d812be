"""Write a ``Dataset`` as one HDF5 file that any HDF5 viewer shows."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._files import new_file
from granular_id._progress import ProgressCallback, Ticker
from granular_id.io.errors import need
from granular_id.io.flat import FORMAT, NUMBERS, OPTIONAL, VERSION, FlatRecordings, flatten
from granular_id.recording import Dataset, unit_of

__all__ = ["SAMPLES", "UNITS", "save_hdf5"]

SAMPLES = ("wrench", *OPTIONAL)
"""What lies at the top of a file; what is known of each recording lies in the group ``recordings``."""

UNITS = {"time_s": "s", "recordings/rate_hz": "Hz", "recordings/start_time": "s"}
"""Of the data sets whose attribute ``units`` is no list."""


def save_hdf5(
    dataset: Dataset, path: str | os.PathLike[str], *, progress: ProgressCallback | None = None
) -> Path:
    """Write a data set as one HDF5 file that ``load`` gives back bit for bit.

    ``/wrench`` holds the samples of all recordings one after the other, ``/recordings`` a column per fact about
    them; ``docs/formats/hdf5.md`` describes each. Nothing is compressed: gzip makes reading 14 times slower here;
    where size matters, a Parquet archive is smaller still.

    Parameters
    ----------
    dataset : Dataset
        Recordings of the same axes.
    path : str or path
        File to write, as a rule with the ending ``.h5``; it must not exist.
    progress : callable, optional
        Called after each array, see ``ProgressCallback``.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileExistsError
        There is something at `path` already.
    ImportError
        h5py is missing.
    ValueError
        Recordings differ in their axes, naming the method that helps.
    OSError
        The file cannot be written.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.io.hdf5.file import read_hdf5
    >>> from granular_id.io.hdf5.save import save_hdf5
    >>> from granular_id.recording import Dataset, Recording
    >>> data = Dataset([Recording(np.ones((3, 6)) / 3, rate_hz=500, label="oat flakes")])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_hdf5(data, folder + "/oats.h5").name
    'oats.h5'
    """
    target = Path(path)
    h5py = need("h5py", extra="hdf5", why="to write .h5 files")
    flat = flatten(dataset)
    arrays = _arrays(flat, h5py)
    ticker = Ticker(len(arrays), progress)
    with new_file(target) as draft, h5py.File(draft, "w") as file:
        file.attrs["format"] = _text(FORMAT, h5py)
        file.attrs["version"] = VERSION
        for name, values in arrays.items():
            file[name] = values
            ticker.tick(name)
        file["wrench"].attrs["axes"] = _texts(flat.axes, h5py)
        file["wrench"].attrs["units"] = _texts([unit_of(axis) for axis in flat.axes], h5py)
        for name, unit in UNITS.items():
            if name in file:
                file[name].attrs["units"] = _text(unit, h5py)
    return target


def _arrays(flat: FlatRecordings, h5py: Any) -> dict[str, Any]:
    arrays: dict[str, Any] = {n: getattr(flat, n) for n in SAMPLES if getattr(flat, n) is not None}
    arrays |= {f"recordings/{name}": getattr(flat, name) for name in NUMBERS}
    arrays |= {f"recordings/{name}": _texts(texts, h5py) for name, texts in flat.texts.items()}
    arrays["recordings/meta"] = _text(flat.meta_lines, h5py)
    arrays["history"] = _text(flat.history_json, h5py)
    return arrays


def _texts(texts: Sequence[str], h5py: Any) -> NDArray[Any]:
    """Return texts of fixed width in UTF-8."""
    data = [text.encode("utf-8") for text in texts]
    return np.array(data, dtype=h5py.string_dtype("utf-8", max(1, *map(len, data))))


def _text(text: str, h5py: Any) -> NDArray[Any]:
    data = text.encode("utf-8")
    return np.array(data, dtype=h5py.string_dtype("utf-8", len(data)))

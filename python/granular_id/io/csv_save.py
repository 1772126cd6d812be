"""Write a ``Dataset`` as a folder of CSV files that ``load`` reads back bit for bit."""

from __future__ import annotations

import csv
import json
import os
import re
import secrets
import shutil
from pathlib import Path

from granular_id.io.csv_file import FLAGS_NAME
from granular_id.io.csv_index import INDEX_COLUMNS, INDEX_NAME, IRREGULAR
from granular_id.recording import AXES, Dataset, Recording
from granular_id.recording._values import thaw

_UNSAFE = re.compile(r"[^A-Za-z0-9._-]+")
_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
_LONGEST = 60


def save_csv(dataset: Dataset, folder: str | os.PathLike[str]) -> Path:
    """Write a folder of CSV files with an ``index.csv``.

    Samples are written with as many digits as float64 needs; ``load(folder) == dataset`` holds. File names
    are made from the labels with unsafe characters replaced; the labels themselves stand in the index.
    Everything is written under a temporary name beside `folder` and renamed when complete: no half-written
    folder is ever seen under the final name. The history is not written.

    Parameters
    ----------
    dataset : Dataset
    folder : str or path
        New or empty folder.

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
    if not isinstance(dataset, Dataset):
        raise TypeError(f"dataset must be a Dataset, got {type(dataset).__name__}")
    target = Path(folder)
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise FileExistsError(f"{target}: exists and is not a folder")
    if target.exists() and any(target.iterdir()):
        raise FileExistsError(f"{target}: the folder is not empty; nothing is overwritten")
    if not target.absolute().parent.is_dir():
        raise FileNotFoundError(f"{target.parent}: no such folder")
    partial = target.absolute().parent / f".{target.name}.{secrets.token_hex(4)}.partial"
    partial.mkdir()
    try:
        _write(dataset, partial)
        if target.exists():
            target.rmdir()  # empty, as checked; some systems do not rename over a folder
        partial.rename(target)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return target


def _write(dataset: Dataset, folder: Path) -> None:
    digits = len(str(len(dataset)))
    with (folder / INDEX_NAME).open("w", encoding="utf-8", newline="") as file:
        index = csv.writer(file, lineterminator="\n")
        index.writerow(INDEX_COLUMNS)
        for number, recording in enumerate(dataset, start=1):
            part = _safe_name(recording.label)
            (folder / part).mkdir(exist_ok=True)
            name = f"{part}/{part}_{number:0{digits}d}.csv"
            (folder / name).write_text(_samples(recording), encoding="ascii", newline="\n")
            index.writerow(_index_row(name, recording))


def _index_row(file: str, recording: Recording) -> list[str]:
    return [
        file,
        recording.label or "",
        recording.session or "",
        "" if recording.start_time is None else repr(recording.start_time),
        IRREGULAR if recording.rate_hz is None else repr(recording.rate_hz),
        "" if recording.trigger_index is None else str(recording.trigger_index),
        recording.name,
        json.dumps(thaw(recording.meta), ensure_ascii=False) if recording.meta else "",
    ]


def _samples(recording: Recording) -> str:
    header = ["time", *AXES]
    columns = [recording.times().tolist(), *recording.wrench.T.tolist()]
    if recording.flags is not None:
        header.append(FLAGS_NAME)
        columns.append(recording.flags.tolist())
    rows = (",".join(map(repr, row)) for row in zip(*columns, strict=True))
    return "\n".join([",".join(header), *rows, ""])


def _safe_name(label: str | None) -> str:
    """Make a file name of a label that no system takes for anything else; it need not be unique."""
    if label is None:
        return "unlabelled"
    name = _UNSAFE.sub("_", label)[:_LONGEST].strip("._-") or "label"
    return f"label_{name}" if _RESERVED.fullmatch(name) else name

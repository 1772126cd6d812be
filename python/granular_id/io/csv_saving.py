"""The folder of text tables that is written: a file a recording, and an ``index.csv``."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from granular_id._checks import thaw
from granular_id._core import GranularIdError
from granular_id._progress import ProgressCallback
from granular_id.io.csv import UNNAMED
from granular_id.io.files import new_folder, safe_name
from granular_id.io.flat import checked_dataset
from granular_id.io.index import INDEX_COLUMNS, INDEX_NAME, IRREGULAR, write_history
from granular_id.recording import (
    ABOUT,
    AXES,
    FLAGS,
    Dataset,
    Recording,
    TableError,
    columns_of,
    meaning_of,
)


def save_csv(
    dataset: Dataset, folder: str | os.PathLike[str], *, progress: ProgressCallback | None = None
) -> Path:
    """Write a folder of CSV files with an ``index.csv``, which names the axes where they are no wrench's.

    Samples have as many digits as float64 needs. Units in ``meta["units"]`` stand in line 1, ``wx [rad/s]``.
    `progress` is called after each file.
    """
    usual = all(recording.axes == AXES for recording in checked_dataset(dataset))
    digits = len(str(len(dataset)))
    with new_folder(folder) as partial:
        with (partial / INDEX_NAME).open("w", encoding="utf-8", newline="") as file:
            index = csv.writer(file, lineterminator="\n")
            index.writerow(INDEX_COLUMNS[: -1 if usual else None])
            for number, recording in enumerate(dataset, start=1):
                part = safe_name(recording.label)
                (partial / part).mkdir(exist_ok=True)
                name = f"{part}/{part}_{number:0{digits}d}.csv"
                _write(recording, partial / name)
                row = _index_row(name, recording)
                index.writerow(row if usual else [*row, json.dumps(recording.axes, ensure_ascii=False)])
                if progress is not None:
                    progress(number, len(dataset), name)
        write_history(dataset, partial)
    return Path(folder)


def _index_row(file: str, recording: Recording) -> list[str]:
    return [
        file,
        recording.label or "",
        recording.session or "",
        "" if recording.start_time is None else repr(recording.start_time),
        IRREGULAR if recording.rate_hz is None else repr(recording.rate_hz),
        "" if recording.trigger_index is None else str(recording.trigger_index),
        recording.name,
        json.dumps(thaw(recording.meta)) if recording.meta else "",
    ]


def _heads(recording: Recording) -> Sequence[str]:
    """Name the columns of the axes, with their units where these are stated and are not those of a wrench."""
    axes, units = recording.axes, recording.meta.get("units")
    wrong = next(
        (one for one in axes if set(one) & set(',"\n#') or one in ABOUT or UNNAMED.fullmatch(one)), None
    )
    if wrong is not None:
        problem = (
            f"recording {recording.name!r} has the axis {wrong!r}, which cannot stand in line 1 of a CSV file"
        )
        raise GranularIdError(f"{problem}; name it otherwise, or save npz")
    stated = units if isinstance(units, Mapping) else {}
    own = [None if axis in AXES else stated.get(axis) for axis in axes]
    heads = [
        f"{axis} [{unit}]" if isinstance(unit, str) else axis for axis, unit in zip(axes, own, strict=True)
    ]
    try:
        found = columns_of(tuple(heads), axes)
    except TableError:
        return axes
    back = all(found[axis] == head for axis, head in zip(axes, heads, strict=True))
    units_back = all(
        meaning_of(head).unit == (None if head == axis else unit)
        for head, axis, unit in zip(heads, axes, own, strict=True)
    )
    return heads if back and units_back and "," not in "".join(heads) else axes


def _write(recording: Recording, path: Path) -> None:
    header = ["time", *_heads(recording)]
    columns = [recording.times(), *recording.wrench.T]
    cells = [list(map(repr, column.tolist())) for column in columns]
    if recording.flags is not None:
        header.append(FLAGS)
        cells.append(list(map(str, recording.flags.tolist())))
    lines = map(",".join, zip(*cells, strict=True))
    path.write_text("\n".join([",".join(header), *lines, ""]), encoding="utf-8", newline="\n")

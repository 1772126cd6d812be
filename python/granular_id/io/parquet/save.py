"""Write a ``Dataset`` as a native archive: a folder of Parquet files that any Parquet reader opens."""

from __future__ import annotations

import inspect
import json
import os
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from granular_id._checks import FloatArray, checked_index, thaw
from granular_id._progress import ProgressCallback
from granular_id.io.errors import need
from granular_id.io.flat import flatten
from granular_id.io.folder_save import checked_dataset, new_folder, write_history
from granular_id.io.parquet.layout import (
    FLAGS,
    INDEX_FILE,
    MARK,
    SAMPLES_FOLDER,
    TIME,
    Mark,
    part_name,
)
from granular_id.recording import Dataset, Recording

RECORDINGS_PER_GROUP = 128
"""A row group of 1600 samples each has 10 MB of samples: what a worker holds of them at least."""

_COMMON = {"compression": "zstd", "write_page_checksum": True, "store_schema": False}
_GROUPS_PER_PART = 64
_MAX_GROUP_SAMPLES = 1 << 22
_PAGE_BYTES = 8 << 20
_PROBED_SAMPLES = 1 << 16
_DISTINCT_SHARE = 0.3


def save_parquet(
    dataset: Dataset,
    folder: str | os.PathLike[str],
    *,
    recordings_per_group: int = RECORDINGS_PER_GROUP,
    progress: ProgressCallback | None = None,
) -> Path:
    """Write a data set as a Parquet archive.

    ``recordings.parquet`` has a row per recording; ``samples/part-*.parquet`` hold the samples as float64, a column
    per axis (N and N m), with ``time_s`` and ``flags`` where recordings have any. Every bit is kept: the encodings
    are lossless. Columns whose values repeat, as counts of a sensor do, are stored as a dictionary, all others with
    their bytes split into streams (half the size and a third of the time of a dictionary there); both are
    compressed by zstd, with a checksum per page.

    Parameters
    ----------
    dataset : Dataset
    folder : str or path
        New or empty folder. It is written under a temporary name and renamed at the end.
    recordings_per_group : int
        Recordings that share a row group, the unit in which archives are read: 128 by default, 10 MB of samples
        of 3.2 s at 500 Hz. Long recordings share with fewer.
    progress : callable, optional
        Called as ``progress(recordings_done, recordings_in_all, file)`` after each row group.

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
    ImportError
        pyarrow is missing.
    TypeError, ValueError
        `dataset` is no Dataset, its recordings differ in their axes, or `recordings_per_group` is not positive.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from granular_id.io import load
    >>> from granular_id.io.parquet.save import save_parquet
    >>> from granular_id.recording import Dataset, Recording
    >>> data = Dataset([Recording(np.ones((3, 6)) / 3, rate_hz=500, label="oat flakes")])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     load(save_parquet(data, folder + "/oats")) == data
    True
    """
    recordings = checked_dataset(dataset).recordings
    most = checked_index(recordings_per_group, "recordings_per_group")
    if most < 1:
        raise ValueError(f"recordings_per_group must be positive, got {most}")
    library = need("pyarrow.parquet", extra="app", why="to write Parquet files")
    mark = Mark.of_axes(dataset.axes)
    groups = _groups(recordings, most)
    files = [part_name(i // _GROUPS_PER_PART) for i in range(len(groups))]
    with new_folder(folder) as partial:
        (partial / SAMPLES_FOLDER).mkdir()
        for start in range(0, len(groups), _GROUPS_PER_PART):
            spans = groups[start : start + _GROUPS_PER_PART]
            for done in _write_part(library, partial / files[start], dataset, spans, mark):
                if progress is not None:
                    progress(done, len(recordings), files[start])
        _write_index(library, partial / INDEX_FILE, _index_table(recordings, groups, files), mark)
        write_history(dataset, partial)
    return Path(folder)


def _groups(recordings: Sequence[Recording], most: int) -> list[tuple[int, int]]:
    """Cut the recordings into runs of at most `most`, and not more samples than fit into a row group."""
    spans = []
    start = samples = 0
    for i, recording in enumerate(recordings):
        samples += recording.n_samples
        if i > start and (i - start == most or samples > _MAX_GROUP_SAMPLES):
            spans.append((start, i))
            start, samples = i, recording.n_samples
    return [*spans, (start, len(recordings))]


def _write_part(
    library: Any, path: Path, dataset: Dataset, spans: Sequence[tuple[int, int]], mark: Mark
) -> Iterator[int]:
    """Write one file of samples; yield after each row group how many recordings are written."""
    arrow = need("pyarrow", extra="app", why="to write Parquet files")
    fields = [arrow.field(column, arrow.float64(), nullable=False) for column in mark.columns]
    timed = any(r.time_s is not None for r in dataset)
    flagged = any(r.flags is not None for r in dataset)
    fields += [arrow.field(TIME, arrow.float64(), nullable=False)] if timed else []
    fields += [arrow.field(FLAGS, arrow.uint8(), nullable=False)] if flagged else []
    schema = arrow.schema(fields)
    probe = _probe(dataset.recordings[spans[0][0] : spans[-1][1]])
    repeating = [column for j, column in enumerate(mark.columns) if _repeats(probe[:, j])]
    split = [field.name for field in fields if field.name not in (*repeating, FLAGS)]
    with library.ParquetWriter(
        path,
        schema,
        use_dictionary=repeating + [FLAGS] * flagged,
        use_byte_stream_split=split,
        write_statistics=False,  # of samples nobody asks for the least and the largest
        data_page_size=_PAGE_BYTES,
        **_whole_pages(library),
        **_COMMON,
    ) as writer:
        writer.add_key_value_metadata({MARK: mark.to_json("samples")})
        for start, end in spans:
            flat = flatten(Dataset(dataset.recordings[start:end]))
            n = len(flat.wrench)
            columns = [np.ascontiguousarray(column) for column in flat.wrench.T]
            columns += [_or_full(flat.time_s, n, np.nan)] if timed else []
            columns += [_or_full(flat.flags, n, np.uint8(0))] if flagged else []
            writer.write_table(arrow.Table.from_arrays(columns, schema=schema), row_group_size=n)
            yield end


def _whole_pages(library: Any) -> dict[str, int]:
    """Return what keeps pyarrow from cutting columns into pages of 20,000 rows, which take half as long again to read.

    Versions that do not cut do not know the setting.
    """
    known = inspect.signature(library.ParquetWriter).parameters
    return {"max_rows_per_page": _MAX_GROUP_SAMPLES} if "max_rows_per_page" in known else {}


def _or_full(values: Any, n: int, nothing: Any) -> Any:
    return np.full(n, nothing) if values is None else values


def _probe(recordings: Sequence[Recording]) -> FloatArray:
    """Take samples from all over the recordings, about as many as decide whether values repeat."""
    total = sum(r.n_samples for r in recordings)
    step = max(1, total // _PROBED_SAMPLES)
    kept = islice(recordings, 0, None, step)
    return np.concatenate([r.wrench[:_PROBED_SAMPLES] for r in kept])


def _repeats(values: FloatArray) -> bool:
    return len(np.unique(values)) < _DISTINCT_SHARE * len(values)


def _write_index(library: Any, path: Path, index: Any, mark: Mark) -> None:
    with library.ParquetWriter(path, index.schema, **_COMMON) as writer:
        writer.add_key_value_metadata({MARK: mark.to_json("recordings")})
        writer.write_table(index)


def _index_table(
    recordings: Sequence[Recording], groups: Sequence[tuple[int, int]], files: Sequence[str]
) -> Any:
    arrow = need("pyarrow", extra="app", why="to write Parquet files")
    text, number, whole = arrow.string(), arrow.float64(), arrow.int64()
    counts = [end - start for start, end in groups]
    row_groups = [i % _GROUPS_PER_PART for i in range(len(groups))]
    columns = {
        "id": (range(len(recordings)), whole),
        "name": ([r.name for r in recordings], text),
        "label": ([r.label for r in recordings], text),
        "session": ([r.session for r in recordings], text),
        "start_time": ([r.start_time for r in recordings], number),
        "rate_hz": ([r.rate_hz for r in recordings], number),
        "n_samples": ([r.n_samples for r in recordings], whole),
        "trigger_index": ([r.trigger_index for r in recordings], whole),
        "file": (np.repeat(files, counts).tolist(), text),
        "row_group": (np.repeat(row_groups, counts), whole),
        "meta": ([json.dumps(thaw(r.meta)) if r.meta else None for r in recordings], text),
    }
    return arrow.table({name: arrow.array(values, kind) for name, (values, kind) in columns.items()})

"""Small archives, and what is in the folders that are made of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from granular_id.io.formats import save_parquet
from granular_id.recording import Dataset, Recording

LABELS = ("rice", "fine sugar", "oat flakes")


def some_recordings(
    n: int = 24, n_samples: int | Sequence[int] = 60, *, rate_hz: float = 500.0, seed: int = 0
) -> Dataset:
    """Noise of six axes that a sensor might have counted; a label, a session and a start time each."""
    lengths = [n_samples] * n if isinstance(n_samples, int) else list(n_samples)
    rng = np.random.default_rng(seed)
    every = []
    for i, length in enumerate(lengths):
        wrench = np.round(rng.normal(size=(length, 6)) * 64) / 128
        about = {
            "label": LABELS[i % 3],
            "session": f"day {i % 2}",
            "start_time": 1.7e9 + i,
            "name": f"push {i}",
        }
        every.append(Recording(wrench, rate_hz=rate_hz, **about))
    return Dataset(every)


def some_archive(folder: Path, dataset: Dataset | None = None, *, per_group: int = 2) -> Path:
    """Write an archive of small row groups."""
    return save_parquet(
        some_recordings() if dataset is None else dataset, folder, recordings_per_group=per_group
    )


def small_partitions(monkeypatch, n_recordings: int = 4) -> None:
    """Let partitions hold fewer recordings."""
    monkeypatch.setattr("granular_id.archive.extraction._MOST_RECORDINGS", n_recordings)


def files_in(folder: Path) -> dict[str, bytes]:
    """Name every file of a folder, temporary ones too, with its bytes."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def partitions_in(folder: Path) -> list[str]:
    """Name the partitions of a folder."""
    return sorted(path.name for path in folder.glob("*.parquet"))


def poison(archive: Path, row_group: int, file: str = "samples/part-00000.parquet") -> bytes:
    """Damage the samples of one row group; return the bytes of the file as it was."""
    import pyarrow.parquet as pq

    path = archive / file
    whole = path.read_bytes()
    column = pq.read_metadata(path).row_group(row_group).column(0)
    start = column.dictionary_page_offset or column.data_page_offset
    damaged = bytearray(whole)
    at = start + column.total_compressed_size - 8
    damaged[at] ^= 0xFF
    path.write_bytes(damaged)
    return whole

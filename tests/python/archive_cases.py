"""Small archives, and what is in the folders that are made of them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from granular_id.io.parquet.writing import save_parquet
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
        about = {"label": LABELS[i % 3], "session": f"day {i % 2}", "start_time": 1.7e9 + i}
        every.append(Recording(wrench, rate_hz=rate_hz, name=f"push {i}", **about))
    return Dataset(every)


def some_archive(folder: Path, dataset: Dataset | None = None, *, per_group: int = 2) -> Path:
    """Write an archive of small row groups."""
    data = some_recordings() if dataset is None else dataset
    return save_parquet(data, folder, recordings_per_group=per_group)


def small_partitions(monkeypatch, n_recordings: int = 4) -> None:
    """Let partitions hold fewer recordings."""
    monkeypatch.setattr("granular_id.archive.partitions._MOST_RECORDINGS", n_recordings)


def files_in(folder: Path) -> dict[str, bytes]:
    """Name every file of a folder, temporary ones too, with its bytes."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def partitions_in(folder: Path) -> list[str]:
    """Name the partitions of a folder."""
    return sorted(path.name for path in folder.glob("[!.]*.parquet"))


def index_in(archive: Path) -> Path:
    """Return the index file of an archive that was written at once."""
    (path,) = archive.glob("recordings-*.parquet")
    return path


def samples_in(archive: Path) -> Path:
    """Return the file of samples of an archive that was written at once."""
    (path,) = archive.glob("samples/part-*.parquet")
    return path


def poison(path: Path, row_group: int) -> bytes:
    """Flip bits in the first column of a row group; return the bytes of the file as it was."""
    import pyarrow.parquet as pq

    whole = path.read_bytes()
    column = pq.read_metadata(path).row_group(row_group).column(0)
    start = column.dictionary_page_offset or column.data_page_offset
    damaged = bytearray(whole)
    damaged[start + column.total_compressed_size - 8] ^= 0xFF
    path.write_bytes(damaged)
    return whole


def rewrite(path: Path, change: Callable[[Any], Any] = lambda table: table, labels=None, **options) -> None:
    """Write a Parquet file anew by plain pyarrow, its table or its labels changed."""
    import pyarrow.parquet as pq

    found = pq.read_metadata(path).metadata
    own = {key: value for key, value in found.items() if key in (b"granular_id", b"history")}
    table = change(pq.ParquetFile(path).read())
    pq.write_table(table.replace_schema_metadata(own if labels is None else labels), path, **options)


def with_column(name: str, values: Any) -> Callable[[Any], Any]:
    """Put other values into a column of a table."""
    return lambda table: table.set_column(table.column_names.index(name), name, values)


@dataclass(frozen=True)
class Sums:
    """A spec: the sum of the samples of each recording; `before` is called with each row group."""

    about: str = "sums"
    before: Callable[[Any], object] | None = None

    def describe(self):
        return {"sums": self.about}

    def table(self, archive, groups):
        import pyarrow as pa

        sums = []
        for group in groups:
            if self.before is not None:
                self.before(group)
            sums += [one.wrench.ravel().sum() for one in archive.read(group)]
        return pa.table({"sum": sums})


@dataclass(frozen=True)
class Dies:
    """Kills its process: once at one row group, always at another; `words` is a folder where it leaves word of it."""

    words: str
    once: int = 5
    always: int = 9

    def __call__(self, group):
        word = Path(self.words, f"died at {group.row_group}")
        if group.row_group == self.always or (group.row_group == self.once and not word.exists()):
            word.touch()
            os.kill(os.getpid(), 9)

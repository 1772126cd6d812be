"""Features of an archive as users of dask, pyarrow, pandas and scipy write them, and the bare decoding of its files.

    python benches/archive_peer.py ARCHIVE OUT

A task is a file of samples, as most scripts have it; a row group is read at a time, so that the memory of the machine
does not limit how large a file may be. Three ways to write the same features: a recording at a time, a row group at a
time, and (tuned) one count of all cells instead of calls of `numpy.histogram`. Nothing is checked, nothing is resumed.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import dask
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from distributed import Client
from scipy.signal import butter, sosfilt

AXES = ["fx", "fy", "fz", "tx", "ty", "tz"]
N_SAMPLES = 1600
N_BINS, LOW, HIGH = 100, -1.5, 1.5
COLUMNS = [f"{axis}_{i}" for axis in AXES for i in range(N_BINS)]
Features = Callable[[np.ndarray], np.ndarray]
SOS = butter(8, 23.0, "highpass", fs=500.0, output="sos")


def one_by_one(X: np.ndarray) -> np.ndarray:
    """A recording at a time: six axes by one call of the filter, a histogram for each."""
    rows = []
    for x in X:
        filtered = sosfilt(SOS, x, axis=0)
        rows.append([np.histogram(filtered[:, j], N_BINS, (LOW, HIGH))[0] for j in range(6)])
    return np.reshape(rows, (len(X), -1))


def by_row_group(X: np.ndarray) -> np.ndarray:
    """A row group at a time: one call of the filter, a histogram for each recording and axis."""
    filtered = sosfilt(SOS, X, axis=1)
    rows = [[np.histogram(x[:, j], N_BINS, (LOW, HIGH))[0] for j in range(6)] for x in filtered]
    return np.reshape(rows, (len(X), -1))


def counted_at_once(X: np.ndarray) -> np.ndarray:
    """Tuned: axes in front, one call of the filter, one count of all cells (by arithmetic: edges are not exact)."""
    n = len(X)
    filtered = sosfilt(SOS, np.ascontiguousarray(X.transpose(0, 2, 1)), axis=-1)
    cells = ((filtered - LOW) * (N_BINS / (HIGH - LOW))).astype(np.int32)
    inside = (filtered >= LOW) & (filtered < HIGH)
    cells += N_BINS * np.arange(6 * n, dtype=np.int32).reshape(n, 6, 1)
    return np.bincount(cells[inside], minlength=6 * N_BINS * n).reshape(n, 6 * N_BINS)


PEERS: dict[str, Features] = {
    "scipy + numpy, a recording at a time": one_by_one,
    "scipy + numpy, a row group at a time": by_row_group,
    "scipy + numpy, tuned: one count of all": counted_at_once,
}


def tables(path: Path) -> Iterator[pa.Table]:
    """The row groups of a file, one after the other."""
    with pq.ParquetFile(path) as file:
        for i in range(file.num_row_groups):
            yield file.read_row_group(i, columns=AXES, use_threads=False)


def array_of(table: pa.Table) -> np.ndarray:
    """Samples as (recordings, samples, 6)."""
    return np.stack([table[axis].to_numpy() for axis in AXES], axis=-1).reshape(-1, N_SAMPLES, len(AXES))


def extract_file(path: Path, out: Path, features: Features) -> None:
    """What a task does: samples of a file in, a file of features out."""
    rows = np.concatenate([features(array_of(table)) for table in tables(path)])
    pd.DataFrame(rows, columns=COLUMNS).to_parquet(out / path.name)


def extract(archive: Path, out: Path, features: Features, client: Client) -> None:
    """A delayed call for each file, all at once."""
    out.mkdir(parents=True)
    tasks = [
        dask.delayed(extract_file)(path, out, features) for path in sorted(archive.glob("samples/*.parquet"))
    ]
    client.gather(client.compute(tasks))


def decode_arrow(path: Path) -> None:
    """Bare decoding: each row group as an Arrow table, and away with it."""
    for _ in tables(path):
        pass


def decode_arrays(path: Path) -> None:
    """Bare decoding to what a feature is made of: an array (recordings, samples, 6) of each row group."""
    for table in tables(path):
        array_of(table)


def main() -> None:
    archive, out = Path(sys.argv[1]), Path(sys.argv[2])
    for name, features in PEERS.items():
        with Client(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as client:
            start = time.perf_counter()
            extract(archive, out / features.__name__, features, client)
            print(f"{name}: {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()

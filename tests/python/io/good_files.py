"""A good file of every format that is read, made by the library that the format's users have."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow
import pyarrow.parquet
import scipy.io

from dataset_strategies import small
from granular_id.io import save
from granular_id.recording import AXES
from layouts_written import to_h5, to_mat73, to_npz
from ros_cases import even_stamps, write_kind

N_SAMPLES = 40
RATE_HZ = 500.0
WRENCH = np.round(np.random.default_rng(3).normal(size=(N_SAMPLES, 6)), 3)
TIMES = np.arange(N_SAMPLES) / RATE_HZ
TREE = {"wrench": WRENCH, "time": TIMES}
TABLE = {"time": TIMES, **dict(zip(AXES, WRENCH.T, strict=True))}

BAGS = {
    "ros1": "bag1 None",
    "ros2": "bag2 sqlite None v9",
    "ros2 mcap": "bag2 mcap STORAGE v9",
    "mcap": "mcap LZ4",
}
PATHS = {
    "csv": "good.csv",
    "npy": "good.npy",
    "npz": "good.npz",
    "npz of others": "good.npz",
    "mat v4": "good.mat",
    "mat v5": "good.mat",
    "mat v7": "good.mat",
    "mat v7.3": "good.mat",
    "hdf5": "good.h5",
    "parquet": "good.parquet",
    "archive": "good",
    "mcap": "x.mcap",
    "ros1": "x.bag",
    "db3": "x.db3",
    "ros2": "x",
    "ros2 mcap": "x",
}
"""What `write_good` makes of each kind; those without an ending are folders."""


def write_good(kind: str, folder: Path) -> Path:
    """Write a good file of one of the kinds in `PATHS` into a folder; it is made once and copied."""
    for name, data in _good(kind).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder / PATHS[kind]


@cache
def _good(kind: str) -> dict[str, bytes]:
    with TemporaryDirectory() as folder:
        _make(kind, Path(folder))
        paths = [path for path in Path(folder).rglob("*") if path.is_file()]
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def _make(kind: str, folder: Path) -> Path:
    path = folder / PATHS[kind]
    if kind in BAGS:
        return write_kind(BAGS[kind], folder, WRENCH, even_stamps(N_SAMPLES))
    if kind == "db3":
        bag = write_kind(BAGS["ros2"], folder, WRENCH, even_stamps(N_SAMPLES))
        (bag / "x.db3").rename(path)
        (bag / "metadata.yaml").unlink()
        bag.rmdir()
        return path
    if kind in ("npz", "archive"):
        return save(small(), path, format="parquet" if kind == "archive" else None)
    _OTHERS[kind](path)
    return path


def _write_csv(path: Path) -> None:
    with path.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(TABLE)
        rows.writerows(np.column_stack(list(TABLE.values())).tolist())


_OTHERS = {
    "csv": _write_csv,
    "npy": lambda path: np.save(path, WRENCH),
    "npz of others": lambda path: to_npz(TREE, path),
    "hdf5": lambda path: to_h5(TREE, path),
    "parquet": lambda path: pyarrow.parquet.write_table(pyarrow.table(TABLE), path),
    "mat v4": lambda path: scipy.io.savemat(path, TREE, format="4"),
    "mat v5": lambda path: scipy.io.savemat(path, TREE),
    "mat v7": lambda path: scipy.io.savemat(path, TREE, do_compression=True),
    "mat v7.3": lambda path: to_mat73(TREE, path),
}

"""How fast each format is read, beside the plain call of the library that reads its bytes.

    python benches/formats.py [--recordings 682]

Synthetic pushes of 1600 x 6, quantised as a sensor does; both sides in the same process, taking turns, after one
untimed call each. Metadata are two entries per recording: kilobytes of it, as simulated recordings have, are parsed by
``load`` only, and take about 0.1 ms per recording more. The plain call gives bare arrays or tables; ``load`` gives
checked recordings with labels, sessions, triggers and history. "folder" formats hold a file per recording.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import scipy.io
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import granular_id as gid
from granular_id._files import write_json
from granular_id.io import save

REPEATS = 7
Call = Callable[[], Any]


def npz(path: Path) -> None:
    with np.load(path) as file:
        for name in file.files:
            file[name]


def hdf5(path: Path) -> None:
    found: list[h5py.Dataset] = []
    with h5py.File(path) as file:
        file.visititems(lambda _, item: found.append(item) if isinstance(item, h5py.Dataset) else None)
        for dataset in found:
            dataset[()]


def save_h5(path: Path, data: gid.Dataset) -> None:
    with h5py.File(path, "w") as file:
        file["X"], file["y"], file["rate_hz"] = data.X, data.y.tolist(), 500.0


def save_bags(folder: Path, data: gid.Dataset) -> None:
    """Write a ROS 2 bag of MCAP for each recording."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types, stamped = store.types, "geometry_msgs/msg/WrenchStamped"
    folder.mkdir()
    for i, push in enumerate(data):
        bag = Writer(folder / f"{push.label}_{i}", version=9, storage_plugin=StoragePlugin.MCAP)
        bag.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with bag:
            connection = bag.add_connection("/wrench", stamped, typestore=store)
            for stamp_ns, row in zip(
                1_700_000_000_000_000_000 + np.arange(len(push.wrench)) * 2_000_000, push.wrench, strict=True
            ):
                vectors = [types["geometry_msgs/msg/Vector3"](*part) for part in (row[:3], row[3:])]
                stamp = types["builtin_interfaces/msg/Time"](*map(int, divmod(stamp_ns, 10**9)))
                message = types[stamped](
                    types["std_msgs/msg/Header"](stamp, "ft"), types["geometry_msgs/msg/Wrench"](*vectors)
                )
                bag.write(connection, int(stamp_ns), store.serialize_cdr(message, stamped))


def save_mat_v73(path: Path, data: gid.Dataset) -> None:
    """Write what MATLAB's ``save -v7.3`` does: sizes in reverse, chunks packed by gzip."""
    labels = [np.array([[ord(c)] for c in label], np.uint16) for label in data.y]
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("X", data=data.X.T, compression=3, shuffle=False)
        file["rate_hz"] = [[500.0]]
        for name in ("X", "rate_hz"):
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        references = np.empty((1, len(labels)), h5py.ref_dtype)
        for i, label in enumerate(labels):
            file[f"#refs#/{i}"] = label
            file[f"#refs#/{i}"].attrs["MATLAB_class"] = np.bytes_("char")
            references[0, i] = file[f"#refs#/{i}"].ref
        file["y"] = references
        file["y"].attrs["MATLAB_class"] = np.bytes_("cell")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


SAVERS = {"hdf5": save_h5, "mat v7.3": save_mat_v73, "mcap folder": save_bags}
"""How formats that are only read are written."""


def mat_v73(path: Path) -> None:
    with h5py.File(path) as file:
        file["X"][()]
        for reference in file["y"][()].ravel():
            bytes(file[reference][()].astype(np.uint8)).decode()


def parquet(folder: Path) -> None:
    pq.read_table(folder / "recordings.parquet").to_pydict()
    for part in sorted((folder / "samples").glob("*.parquet")):
        for column in pq.read_table(part).columns:
            column.to_numpy()


def loadtxt(folder: Path) -> None:
    for path in sorted(folder.glob("*/*.csv")):
        np.loadtxt(path, delimiter=",", skiprows=1)


def read_csv(folder: Path) -> None:
    for path in sorted(folder.glob("*/*.csv")):
        pd.read_csv(path).to_numpy()


def rosbags(folder: Path) -> None:
    for path in sorted(folder.glob("*/*.mcap")):
        with AnyReader([path]) as reader:
            for connection, _, raw in reader.messages():
                reader.deserialize(raw, connection.msgtype)


def mcap(folder: Path) -> None:
    for path in sorted(folder.glob("*/*.mcap")):
        with path.open("rb") as file:
            for _ in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
                pass


def seconds(calls: list[Call]) -> list[float]:
    """Return the median time of each call; they take turns, so that a busy machine slows all alike."""
    for call in calls:
        call()
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(REPEATS):
        for call, own in zip(calls, times, strict=True):
            start = time.perf_counter()
            call()
            own.append(time.perf_counter() - start)
    return [statistics.median(own) for own in times]


def size_mb(path: Path) -> float:
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    return sum(file.stat().st_size for file in files) / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recordings", type=int, default=682, help="default 682")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the figures as JSON, too")
    options = parser.parse_args()
    n = options.recordings
    figures: dict[str, dict[str, float]] = {}
    made = gid.synthesize(n_per_class=-(-n // 11))[:n]
    data = gid.Dataset([replace(push, meta={"synthetic": True, "tool": "cylinder"}) for push in made])
    few = data[: max(1, n // 10)]
    print(f"{n} recordings of 1600 x 6 ({len(few)} where a file holds one), {REPEATS} repeats, medians")
    print(
        f"{'format':22} {'MB':>7} {'save s':>7} {'load s':>8} {'rec/s':>8}   beside: seconds (load / plain)"
    )
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        rows: list[tuple[str, Path, gid.Dataset, str | None, dict[str, Callable[[Path], None]]]] = [
            ("npz", root / "x.npz", data, None, {"numpy.load": npz}),
            ("npy", root / "x.npy", data, None, {"numpy.load": np.load}),
            ("hdf5", root / "x.h5", data, None, {"h5py": hdf5}),
            ("parquet", root / "parquet", data, "parquet", {"pyarrow": parquet}),
            ("mat v7", root / "v7.mat", data, None, {"scipy.io.loadmat": scipy.io.loadmat}),
            ("mat v6", root / "v6.mat", data, None, {"scipy.io.loadmat": scipy.io.loadmat}),
            ("mat v7.3", root / "v73.mat", data, None, {"h5py": mat_v73}),
            ("csv folder", root / "csv", few, "csv", {"numpy.loadtxt": loadtxt, "pandas.read_csv": read_csv}),
            ("mcap folder", root / "mcap", few, None, {"rosbags": rosbags, "mcap": mcap}),
        ]
        for name, path, chosen, form, peers in rows:
            start = time.perf_counter()
            if path.suffix == ".npy":
                np.save(path, chosen.X)
            elif name in SAVERS:
                SAVERS[name](path, chosen)
            elif path.suffix == ".mat":
                fields = {"X": chosen.X, "y": chosen.y.tolist(), "rate_hz": 500.0}
                scipy.io.savemat(path, fields, do_compression=name == "mat v7")
            else:
                save(chosen, path, form)
            saved = time.perf_counter() - start
            rate = {"rate_hz": 500.0} if path.suffix == ".npy" else {}
            calls: list[Call] = [lambda path=path, rate=rate: gid.load(path, **rate)]
            calls += [lambda peer=peer, path=path: peer(path) for peer in peers.values()]
            ours, *theirs = seconds(calls)
            figures[name] = {"load": ours} | dict(zip(peers, theirs, strict=True))
            beside = ", ".join(
                f"{peer} {other:.4f} ({ours / other:.2f}x)" for peer, other in zip(peers, theirs, strict=True)
            )
            print(
                f"{name:22} {size_mb(path):7.1f} {saved:7.2f} {ours:8.4f} {len(chosen) / ours:8.0f}   {beside}",
                flush=True,
            )
    if options.out:
        write_json(options.out, {"recordings": [n, len(few)], "seconds": figures})


if __name__ == "__main__":
    main()

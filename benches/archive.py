"""Archives: recordings a second and memory, beside a user's Dask script.

Recordings are synthetic (1600 x 6 at 500 Hz); making 100,000 takes ten minutes on one core, so they stay in `--folder`
(1.4 GB), each time written anew to an archive by two processes at once. Every measurement is a process of its own; its
memory, and that of its workers, is polled. Rows take turns within a round, all files are in the page cache, figures are
medians over rounds. Imports and the start of clusters are not timed.
"""

from __future__ import annotations

import argparse
import importlib
import multiprocessing
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import dask
import numpy as np
import pandas as pd
import psutil
import pyarrow.parquet as pq
from distributed import Client, LocalCluster
from scipy.signal import butter, sosfilt

import granular_id as gid
from granular_id import archive as archives
from granular_id.recording import AXES
from granular_id.synthetic import PAPER_MATERIALS
from page import origin
from results import about

PIECE = 2048
CORES = 2
N_SAMPLES, N_BINS, RANGE = 1600, 100, (-1.5, 1.5)
Call = Callable[..., Any]
SPAWN = multiprocessing.get_context("spawn")


# Recordings, and archives of them.


def piece(folder: Path, number: int) -> Path:
    """Some recordings, made if they are not there: all materials mixed, four sessions of one of eight robots."""
    path = folder / f"piece-{number:04d}"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        made = gid.synthesize(n_per_class=-(-PIECE // len(PAPER_MATERIALS)), sessions=4, seed=number)
        chosen = [made[i] for i in np.random.default_rng(number).permutation(len(made))[:PIECE].tolist()]
        session = f"robot {number % 8}, {{}} of piece {number}"
        about = {"synthetic": True, "tool": "cylinder"}
        gid.save(
            gid.Dataset([replace(r, session=session.format(r.session), meta=about) for r in chosen]),
            path,
            "parquet",
        )
    return path


def append_pieces(folder: Path, cache: Path, numbers: Sequence[int], n: int) -> float:
    """What one of the writers does; seconds of `append` alone."""
    seconds = 0.0
    for number in numbers:
        data = gid.load(piece(cache, number))[: n - number * PIECE]
        start = time.perf_counter()
        archives.append(folder, data)
        seconds += time.perf_counter() - start
    return seconds


def write(folder: Path, cache: Path, n: int) -> None:
    """An archive of `n` recordings, by two processes at once."""
    numbers = range(-(-n // PIECE))
    with ProcessPoolExecutor(CORES, mp_context=SPAWN) as pool:
        list(pool.map(partial(piece, cache), numbers))
        shares = [numbers[i::CORES] for i in range(CORES)]
        seconds = list(pool.map(partial(append_pieces, folder, cache, n=n), shares))
    size = sum(path.stat().st_size for path in folder.rglob("*.parquet"))
    print(
        f"{n:,} recordings written as {size / 1e9:.2f} GB ({size / n / 1e3:.1f} KB each): "
        f"{n / max(seconds):,.0f} recordings/s by {CORES} processes at once\n"
    )


def model(folder: Path) -> Path:
    """A model of 132 other recordings."""
    path = folder / "best.safetensors"
    if not path.exists():
        gid.Identifier.fit(gid.synthesize(n_per_class=12, seed=100_000), "best").save(path)
    return path


# What is measured. Each runs in a process of its own, makes its own output, and returns its seconds.


@contextmanager
def cluster() -> Iterator[Client]:
    """Two workers of one thread, which have imported what they need."""
    with (
        LocalCluster(
            n_workers=CORES, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
        ) as local,
        Client(local) as client,
    ):
        for name in ("granular_id.archive", "sklearn", "scipy.signal", "pandas"):
            client.run(importlib.import_module, name)
        yield client


def timed(call: Call) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def ours(folder: Path, out: Path, call: Call, where: str) -> float:
    """Features or answers of a whole archive: on threads, or on a cluster that runs."""
    if where == "cluster":
        with cluster() as client:
            address = client.scheduler.address
            return timed(lambda: call(folder, out=out, scheduler=address, progress=False))
    n_jobs = 1 if where == "1 thread" else CORES
    return timed(lambda: call(folder, out=out, n_jobs=n_jobs, progress=False))


def arrays(path: Path) -> Iterator[np.ndarray]:
    """Decode the row groups of a file, each as (recordings, samples, 6)."""
    with pq.ParquetFile(path) as file:
        for i in range(file.num_row_groups):
            rows = file.read_row_group(i, columns=list(AXES), use_threads=False)
            columns = [rows[axis].to_numpy() for axis in AXES]
            yield np.stack(columns, axis=-1).reshape(-1, N_SAMPLES, len(AXES))


def extract_file(path: Path, out: Path) -> None:
    """What a user's task does: a file of samples in, a file of features out, a row group at a time."""
    sos, rows = butter(8, 23.0, "highpass", fs=500.0, output="sos"), []
    for X in arrays(path):
        filtered = sosfilt(sos, X, axis=1)
        rows += [[np.histogram(column, N_BINS, RANGE)[0] for column in x.T] for x in filtered]
    names = [f"{axis}_{i}" for axis in AXES for i in range(N_BINS)]
    pd.DataFrame(np.reshape(rows, (len(rows), -1)), columns=names).to_parquet(out / path.name)


def theirs(folder: Path, out: Path) -> float:
    """A user's script on a cluster of two that runs: a delayed call for each file; nothing is checked or resumed."""
    out.mkdir(parents=True)
    files = sorted(folder.glob("samples/*.parquet"))
    with cluster() as client:
        tasks = [dask.delayed(extract_file)(path, out) for path in files]
        return timed(lambda: client.gather(client.compute(tasks)))


def answer(sending: Any, call: Call) -> None:
    sending.send(call())
    sending.close()


def measured(call: Call) -> tuple[float, float]:
    """Seconds of a call in a process of its own, and the largest resident MB of it or one of its workers."""
    receiving, sending = SPAWN.Pipe(duplex=False)
    child = SPAWN.Process(target=answer, args=(sending, call))
    child.start()
    sending.close()
    peak, own = 0, psutil.Process(child.pid)
    while not receiving.poll(0.02):
        try:
            sizes = [process.memory_info().rss for process in (own, *own.children(recursive=True))]
        except psutil.NoSuchProcess:
            continue
        peak = max(peak, *sizes)
    seconds = receiving.recv()
    child.join()
    return seconds, peak / 1e6


@dataclass
class Row:
    """A line of the table: what is measured, on how many cores, and what came out, round by round."""

    name: str
    where: str
    call: Call
    found: list[tuple[float, float]] = field(default_factory=list)

    def cells(self, n: int) -> tuple[str, ...]:
        rate = n / statistics.median(seconds for seconds, _ in self.found)
        memory = max(megabytes for _, megabytes in self.found)
        return self.name, self.where, f"{rate:,.0f}", f"{memory:.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--recordings", type=int, default=100_000, help="default 100,000")
    parser.add_argument("--folder", type=Path, help="keeps the synthetic recordings from run to run")
    parser.add_argument("--rounds", type=int, default=3, help="default 3")
    options = parser.parse_args()
    print("\n".join(origin(about(("numpy", "pyarrow", "distributed")))), "\n")
    if options.folder:
        options.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=options.folder) as scratch:
        cache, folder, out = options.folder or Path(scratch), Path(scratch, "archive"), Path(scratch, "out")
        calls = {"hfmh": partial(archives.extract, space="hfmh")}
        calls["identified, best"] = partial(archives.identify, model=model(cache))
        write(folder, cache, options.recordings)
        rows = [
            Row(name, where, partial(ours, folder, call=call, where=where))
            for name, call in calls.items()
            for where in ("1 thread", "2 threads", "cluster")
        ]
        rows.append(Row("hfmh by scipy + numpy", "cluster", partial(theirs, folder)))
        for _ in range(options.rounds):
            for row in rows:
                row.found.append(measured(partial(row.call, out=out)))
                shutil.rmtree(out, ignore_errors=True)
        head = ("what", "where", "recordings/s", "largest process, MB")
        found = (row.cells(options.recordings) for row in rows)
        for cells in (head, ("---", "---", "---:", "---:"), *found):
            print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()

"""Archives: recordings a second, memory and sockets, beside a user's Dask script and the bare decoding of the files.

    python benches/archive.py [--recordings 100000] [--folder F] [--rounds 3]    written, extracted, identified
    python benches/archive.py --scaling 1000 10000 100000                       seconds against recordings
    python benches/archive.py --ports                                           what listens while a cluster runs

Recordings are synthetic (1600 x 6 at 500 Hz); making 100,000 takes ten minutes on one core, so they stay in `--folder`
(1.4 GB), each time written anew to an archive by two processes at once. Every measurement is a process of its own; its
memory, and that of its workers, is polled. Rows take turns within a round, all files are in the page cache, figures are
medians over rounds. Imports and the start of clusters are not timed, but for the row that says so.
"""

from __future__ import annotations

import argparse
import importlib
import multiprocessing
import os
import platform
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import distributed
import numpy as np
import psutil
import pyarrow as pa
from distributed import Client, LocalCluster, get_task_stream

import archive_peer as peer
import granular_id as gid
from granular_id import archive as archives
from granular_id.synthetic import PAPER_MATERIALS

PIECE = 2048
CORES = 2
OTHERS = 10_240  # recordings for rows that are slow, or that write much
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


def without_mean(recording: gid.Recording) -> gid.Recording:
    """Counts no longer repeat from recording to recording, as after any arithmetic on them."""
    return replace(recording, wrench=recording.wrench - recording.wrench.mean(axis=0))


def append_pieces(
    folder: Path, cache: Path, numbers: Sequence[int], n: int, quantised: bool
) -> tuple[int, float]:
    """What one of the writers does; recordings, and seconds of `append` alone."""
    written, seconds = 0, 0.0
    for number in numbers:
        data = gid.load(piece(cache, number))[: n - number * PIECE]
        if not quantised:
            data = gid.Dataset([without_mean(recording) for recording in data])
        start = time.perf_counter()
        archives.append(folder, data)
        seconds += time.perf_counter() - start
        written += len(data)
    return written, seconds


@dataclass(frozen=True)
class Written:
    """An archive of this run, and how it was written."""

    folder: Path
    n: int
    seconds: tuple[float, ...]

    def __str__(self) -> str:
        size = sum(path.stat().st_size for path in self.folder.rglob("*.parquet"))
        rate = self.n / sum(self.seconds)
        return (
            f"{self.n:,} recordings, {self.n * 76_800 / 1e9:.2f} GB of samples, written as {size / 1e9:.2f} GB"
            f" ({size / self.n / 1e3:.1f} KB each): {self.n / max(self.seconds):,.0f} recordings/s by {CORES} processes"
            f" at once, {rate:,.0f} a core"
        )


def write(folder: Path, cache: Path, n: int, quantised: bool = True) -> Written:
    """An archive of `n` recordings, by two processes at once."""
    numbers = range(-(-n // PIECE))
    with ProcessPoolExecutor(CORES, mp_context=SPAWN) as pool:
        for number, path in enumerate(pool.map(partial(piece, cache), numbers)):
            if sys.stderr.isatty():
                print(f"\r{path.name}: {number + 1} of {len(numbers)} pieces", end="", file=sys.stderr)
        shares = [numbers[i::CORES] for i in range(CORES)]
        done = list(pool.map(partial(append_pieces, folder, cache, n=n, quantised=quantised), shares))
    if sum(written for written, _ in done) != n:
        sys.exit(f"{folder}: {done} were written; wanted {n} in all")
    return Written(folder, n, tuple(seconds for _, seconds in done))


def model(folder: Path, space: str) -> Path:
    """A model of 132 other recordings."""
    path = folder / f"{space}.safetensors"
    if not path.exists():
        gid.Identifier.fit(gid.synthesize(n_per_class=12, seed=100_000), space).save(path)
    return path


# What is measured. Each runs in a process of its own, makes its own output, and returns its seconds.


@contextmanager
def cluster(*modules: str) -> Iterator[Client]:
    """Two workers of one thread, which have imported what they need."""
    with (
        LocalCluster(
            n_workers=CORES, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
        ) as local,
        Client(local) as client,
    ):
        client.run(lambda names: [importlib.import_module(name) for name in names] and None, modules)
        yield client


def ours(folder: Path, out: Path, call: Call, where: str) -> dict[str, Any]:
    """Features or answers of a whole archive: on threads, a cluster that runs, or one of its own."""
    if where == "cluster":
        with cluster("granular_id.archive", "sklearn") as client, get_task_stream(client) as stream:
            address = client.scheduler.address
            found = timed(lambda: call(folder, out=out, engine="dask", scheduler=address, progress=False))
        spans = [span for task in stream.data for span in task["startstops"] if span["action"] == "compute"]
        return found | {"tasks": [span["stop"] - span["start"] for span in spans]}
    engine = {"engine": "dask"} if where == "own cluster" else {"engine": "local"}
    n_jobs = 1 if where == "1 thread" else CORES
    return timed(lambda: call(folder, out=out, n_jobs=n_jobs, progress=False, **engine))


def timed(call: Call) -> dict[str, Any]:
    """Seconds in all, and those of the tasks by stage where the call returns them."""
    start = time.perf_counter()
    result = call()
    found = {"seconds": time.perf_counter() - start}
    result = getattr(result, "extraction", result)  # of answers
    return found | {"stages": result.stage_seconds} if hasattr(result, "stage_seconds") else found


def theirs(folder: Path, out: Path, name: str) -> dict[str, Any]:
    """A user's script on a cluster of two that runs."""
    with cluster("archive_peer") as client:
        return timed(lambda: peer.extract(folder, out, peer.PEERS[name], client))


def decoded(folder: Path, name: str, processes: int, **_: Path) -> dict[str, Any]:
    """Bare decoding of all samples; nothing is written."""
    decode, files = getattr(peer, name), sorted(folder.glob("samples/*.parquet"))
    if processes == 1:
        decode(files[0])
        return timed(lambda: [decode(file) for file in files])
    with ProcessPoolExecutor(processes, mp_context=SPAWN) as pool:
        list(pool.map(decode, files[:processes]))
        return timed(lambda: list(pool.map(decode, files)))


@dataclass
class Row:
    """A line of a table: what is measured, on how many cores, and what came out, round by round."""

    name: str
    where: str
    cores: int
    n: int
    call: Call
    found: list[dict[str, Any]]

    @property
    def seconds(self) -> float:
        return statistics.median(found["seconds"] for found in self.found)

    @property
    def rate(self) -> float:
        return self.n / self.seconds


def answer(sending: Any, call: Call) -> None:
    sending.send(call())
    sending.close()


def measured(call: Call) -> dict[str, Any]:
    """What a call returns in a process of its own, with the peaks of its memory and of each of its workers."""
    receiving, sending = SPAWN.Pipe(duplex=False)
    child = SPAWN.Process(target=answer, args=(sending, call))
    child.start()
    sending.close()
    peak = {"rss": 0, "anonymous": 0}
    own = psutil.Process(child.pid)
    while not receiving.poll(0.02):
        try:
            sizes = [process.memory_info() for process in (own, *own.children(recursive=True))]
        except psutil.NoSuchProcess:
            continue
        peak["rss"] = max(peak["rss"], *(size.rss for size in sizes))
        peak["anonymous"] = max(peak["anonymous"], *(size.rss - size.shared for size in sizes))
    found = receiving.recv()
    child.join()
    return found | peak


def in_turns(rows: Sequence[Row], scratch: Path, rounds: int) -> None:
    """Measure all rows, one after the other, round by round; outputs are deleted at once."""
    for number in range(rounds):
        for row in rows:
            out = scratch / "out"
            found = measured(partial(row.call, out=out))
            row.found.append(found | {"bytes": sum(path.stat().st_size for path in out.glob("*"))})
            shutil.rmtree(out, ignore_errors=True)
            if sys.stderr.isatty():
                print(
                    f"round {number + 1}: {row.name}, {row.where}: {row.found[-1]['seconds']:.1f} s",
                    file=sys.stderr,
                )


# Tables.


def machine() -> str:
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        cpu = next(
            (line.split(":")[1].strip() for line in info.read_text().splitlines() if "model name" in line),
            cpu,
        )
    flags = "AVX-512" if info.exists() and "avx512f" in info.read_text() else ""
    memory = psutil.virtual_memory().total / 2**30
    versions = f"numpy {np.__version__}, pyarrow {pa.__version__}, distributed {distributed.__version__}"
    return f"{cpu} {flags}, {os.cpu_count()} cores, {memory:.0f} GB; Python {platform.python_version()}, {versions}"


def markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    dashes = ["---" if i < 2 else "---:" for i in range(len(head))]
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, dashes, *lines))


def shares(row: Row) -> list[str]:
    found = [found["stages"] for found in row.found if "stages" in found]
    return [
        f"{100 * statistics.median(stages[name] / sum(stages.values()) for stages in found):.0f} %"
        if found
        else ""
        for name in ("reading", "computing", "writing")
    ]


def table(rows: Sequence[Row], peers: Sequence[Row]) -> str:
    """Rates, shares of time, memory; beside the first script, and beside bare decoding on as many cores."""
    script = next(row for row in peers if row.name in peer.PEERS)
    lines = []
    for row in [*rows, *peers]:
        bare = [other for other in peers if other.cores == row.cores and other.name.startswith("bare")]
        memory = [max(found[kind] for found in row.found) for kind in ("rss", "anonymous")]
        lines.append(
            [
                row.name,
                row.where,
                f"{row.n:,}",
                f"{row.seconds:.2f}",
                f"{row.rate:,.0f}",
                f"{row.rate / row.cores:,.0f}",
                *shares(row),
                *(f"{size / 1e6:.0f}" for size in memory),
                f"{row.found[-1]['bytes'] / row.n / 1e3:.2f}",
                f"{row.rate / row.cores / (script.rate / script.cores):.1f}",
                *(f"{100 * row.rate / other.rate:.0f} %" for other in bare),
            ]
        )
    head = (
        "what,where,recordings,s,recordings/s,per core,reading,computing,writing,RSS MB,anonymous MB,KB out"
    )
    return markdown([*head.split(","), "x script, per core", "of Arrow", "of arrays"], lines)


def extraction(space: str, dtype: str = "float64") -> Call:
    return partial(archives.extract, space=space, dtype=dtype)


def modelled(function: Call, path: Path) -> Call:
    return partial(function, model=path)


def our_rows(name: str, call: Call, written: Written, places: Sequence[str]) -> list[Row]:
    return [
        Row(
            name,
            where,
            1 if where == "1 thread" else CORES,
            written.n,
            partial(ours, written.folder, call=call, where=where),
            [],
        )
        for where in places
    ]


def peer_rows(written: Written, names: Sequence[str]) -> list[Row]:
    bare = [
        Row(
            f"bare decoding to {what}",
            f"{processes} process{'es' * (processes > 1)}",
            processes,
            written.n,
            partial(decoded, written.folder, name=f"decode_{what.lower()}", processes=processes),
            [],
        )
        for processes in (1, CORES)
        for what in ("Arrow", "arrays")
    ]
    scripts = [
        Row(name, "cluster", CORES, written.n, partial(theirs, written.folder, name=name), [])
        for name in names
    ]
    return bare + scripts


def speed(scratch: Path, cache: Path, n: int, rounds: int) -> None:
    """The tables of everything: all recordings, slow rows on fewer, unquantised ones."""
    everywhere = ("1 thread", "2 threads", "cluster", "own cluster")
    few = min(n, OTHERS)
    paper, best = model(cache, "raw+hfmh"), model(cache, "best")
    written = write(scratch / "all", cache, n)
    print(f"Written: {written}\n")
    rows = our_rows("hfmh", extraction("hfmh"), written, everywhere)
    rows += our_rows("identified, raw+hfmh", modelled(archives.identify, paper), written, everywhere[:3])
    peers = peer_rows(written, list(peer.PEERS))
    in_turns([*rows, *peers], scratch, rounds)
    print(table(rows, peers), end="\n\n", flush=True)

    some = write(scratch / "some", cache, few)
    rows = our_rows("hfmh", extraction("hfmh"), some, everywhere[:2])
    rows += our_rows("hfmh, float32", extraction("hfmh", "float32"), some, everywhere[:2])
    rows += our_rows("raw+hfmh", extraction("raw+hfmh"), some, everywhere[:2])
    rows += our_rows("raw+hfmh, float32", extraction("raw+hfmh", "float32"), some, everywhere[:2])
    rows += our_rows(
        "features of a model, multi-band", modelled(archives.extract, best), some, everywhere[:3]
    )
    rows += our_rows("identified, best", modelled(archives.identify, best), some, everywhere[:3])
    peers = peer_rows(some, list(peer.PEERS)[:1])
    in_turns([*rows, *peers], scratch, rounds)
    print(table(rows, peers), end="\n\n", flush=True)

    real = write(scratch / "real", cache, few, quantised=False)
    print(f"Not quantised (a mean subtracted from each): {real}\n")
    rows = our_rows("hfmh, not quantised", extraction("hfmh"), real, everywhere[:3])
    peers = peer_rows(real, list(peer.PEERS)[:1])
    in_turns([*rows, *peers], scratch, rounds)
    print(table(rows, peers))


def scaling(scratch: Path, cache: Path, sizes: Sequence[int], rounds: int) -> None:
    """Seconds against recordings on a cluster, length of its tasks, and what is left beside them."""
    rows = []
    for n in sizes:
        rows += our_rows("hfmh", extraction("hfmh"), write(scratch / f"of-{n}", cache, n), ["cluster"])
    in_turns(rows, scratch, rounds)
    slope, start = np.polyfit([row.n for row in rows], [row.seconds for row in rows], 1)
    print(f"Line: {start:.2f} s, and {1e6 * slope:.1f} s for a million recordings\n")
    lines = []
    for row in rows:
        tasks = [seconds for found in row.found for seconds in found["tasks"]]
        workers = min(CORES, len(row.found[0]["tasks"]))
        idle = [1 - sum(found["tasks"]) / (workers * found["seconds"]) for found in row.found]
        lines.append(
            [
                f"{row.n:,}",
                f"{row.seconds:.2f}",
                f"{start + slope * row.n:.2f}",
                f"{row.rate:,.0f}",
                f"{len(row.found[0]['tasks'])}",
                f"{min(tasks):.2f}, {statistics.median(tasks):.2f}, {max(tasks):.2f}",
                f"{100 * statistics.median(idle):.0f} %",
            ]
        )
    head = (
        "recordings",
        "s",
        "on the line",
        "recordings/s",
        "tasks",
        "s a task: least, median, most",
        "not in tasks",
    )
    print(markdown(head, lines))


def listening(process: psutil.Process) -> set[str]:
    """Local addresses and ports that `ss -ltn` shows of a process and its children."""
    own = {process.pid, *(child.pid for child in process.children(recursive=True))}
    shown = subprocess.run(["ss", "-ltnp"], check=True, capture_output=True, text=True).stdout
    lines = [(line.split()[3], set(map(int, re.findall(r"pid=(\d+)", line)))) for line in shown.splitlines()]
    return {address for address, pids in lines if pids & own}


def ports(scratch: Path, cache: Path, n: int) -> None:
    """What listens while a cluster that the engine started is at work."""
    written = write(scratch / "ports", cache, n)
    call = partial(ours, written.folder, scratch / "out", extraction("hfmh"), "own cluster")
    child = SPAWN.Process(target=call)
    child.start()
    seen: set[str] = set()
    while child.is_alive():
        with suppress(psutil.NoSuchProcess):
            seen |= listening(psutil.Process(child.pid))
        time.sleep(0.05)
    print("\n".join(sorted(seen)))
    local = ("127.0.0.1:", "[::1]:")
    open_to_others = [address for address in seen if not address.startswith(local)]
    print(f"{len(seen)} sockets listened; to other machines: {', '.join(open_to_others) or 'none'}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recordings", type=int, default=100_000, help="default 100,000")
    parser.add_argument("--folder", type=Path, help="keeps the synthetic recordings from run to run")
    parser.add_argument("--rounds", type=int, default=3, help="default 3")
    parser.add_argument("--scaling", type=int, nargs="+", metavar="N", help="numbers of recordings")
    parser.add_argument("--ports", action="store_true")
    options = parser.parse_args()
    print(f"{time.strftime('%Y-%m-%d')}, {machine()}\n")
    if options.folder:
        options.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        scratch = Path(folder)
        cache = options.folder or scratch
        if options.ports:
            ports(scratch, cache, min(options.recordings, OTHERS))
        elif options.scaling:
            scaling(scratch, cache, options.scaling, options.rounds)
        else:
            speed(scratch, cache, options.recordings, options.rounds)


if __name__ == "__main__":
    main()

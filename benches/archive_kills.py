"""Each recording exactly once, whatever is killed: one archive extracted in nine ways, one digest over all outputs.

Run: python benches/archive_kills.py [recordings] [folder]. The archive is made once and kept in the folder (by default
a temporary one that is removed). Drivers are processes that are killed by signal 9: at a random moment, or just before
the system call that renames. Exits 1 where the outputs of any way differ from those of one thread.
"""

from __future__ import annotations

import hashlib
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pyarrow.parquet as pq

import granular_id as gid
from granular_id import archive as archives
from granular_id._text import Table
from granular_id.recording import Dataset, Recording

JOBS = 2
PER_APPEND = 4096
PARTITION = re.compile(r"[0-9a-f]{32}\.parquet")
LONGEST_S = 3600.0


# The archive, and what is in a folder of outputs.


def synthetic_archive(folder: Path, n: int) -> None:
    """Append `n` SYNTHETIC recordings of 1600 x 6, no two alike, 77 KB each before they are packed."""
    pushes = gid.synthesize(n_per_class=6, seed=0).recordings
    shift = np.full(len(pushes[0].wrench), 1 / 512)
    for start in range(0, n, PER_APPEND):
        some = []
        for i in range(start, min(n, start + PER_APPEND)):
            push = pushes[i % len(pushes)]
            wrench = push.wrench + np.outer(shift, [i // len(pushes)] * 6)
            about = {
                "label": push.label,
                "session": f"day {i % 5}",
                "start_time": 1.7e9 + i,
                "name": f"push {i}",
            }
            some.append(Recording(wrench, rate_hz=push.rate_hz, meta={"synthetic": True}, **about))
        archives.append(folder, Dataset(some))


@dataclass(frozen=True)
class Found:
    """What is in a folder: a digest over all partitions, and what should not be there."""

    sha256: str
    missing: int
    double: int
    temporary: int
    inodes: dict[str, int]


def found(out: Path, n: int) -> Found:
    """Look through a folder of outputs for `n` recordings."""
    mark, inodes, names = hashlib.sha256(), {}, []
    for path in sorted(out.glob("*.parquet")):
        mark.update(f"{path.name} ".encode() + hashlib.sha256(path.read_bytes()).digest())
        names += pq.read_table(path, columns=["name"])["name"].to_pylist()
        inodes[path.name] = path.stat().st_ino
    temporary = [p for p in out.iterdir() if not PARTITION.fullmatch(p.name) and p.name != "_manifest.json"]
    different = len(set(names))
    return Found(mark.hexdigest(), n - different, len(names) - different, len(temporary), inodes)


# Drivers: this file as a program of its own.


def drive(archive: str, out: str, engine: str, n_jobs: str, dies_at: str) -> None:
    """Extract; `dies_at` is empty, or a part of the name before whose renaming this process kills itself."""
    if dies_at:
        _die_before_renaming(re.compile(dies_at))
    archives.extract(archive, out, engine=engine, n_jobs=int(n_jobs), progress=False)


def _die_before_renaming(target: re.Pattern[str]) -> None:
    targets = set()  # Path.replace may call os.replace

    def dying(call: Callable[..., Any]) -> Callable[..., Any]:
        def renaming(source: Any, *others: Any, **options: Any) -> Any:
            if target.search(os.fspath(others[0])):
                targets.add(os.fspath(others[0]))
            if len(targets) == (
                1 if "manifest" in target.pattern else 3
            ):  # two partitions are finished by then
                os.kill(os.getpid(), signal.SIGKILL)
            return call(source, *others, **options)

        return renaming

    for owner, name in ((os, "replace"), (os, "rename"), (Path, "replace"), (Path, "rename")):
        setattr(owner, name, dying(getattr(owner, name)))


def driver(archive: Path, out: Path, engine: str, n_jobs: int, dies_at: str = "") -> subprocess.Popen[bytes]:
    """Start a driver."""
    words = [sys.executable, __file__, "--drive", archive, out, engine, n_jobs, dies_at]
    return subprocess.Popen([str(word) for word in words])


def ended(process: subprocess.Popen[bytes], *, killed: bool = False) -> None:
    """Wait until a driver and the workers that it started have ended, as they should."""
    children = _workers(process)
    code = process.wait(timeout=LONGEST_S)
    if (code == -signal.SIGKILL) != killed or (code and not killed):
        raise SystemExit(f"a driver ended with {code}")
    psutil.wait_procs(children, timeout=30)


def _workers(process: subprocess.Popen[bytes]) -> list[psutil.Process]:
    """Return the processes of Dask below a driver."""
    try:
        children = psutil.Process(process.pid).children()
        return [child for child in children if "spawn_main" in " ".join(child.cmdline())]
    except psutil.Error:
        return []


# What is done to them. Each returns how many partitions were finished when the last driver began.


def undisturbed(archive: Path, out: Path, engine: str, n_jobs: int) -> dict[str, int]:
    """Let a driver come to its end."""
    ended(driver(archive, out, engine, n_jobs))
    return {}


def workers_killed(archive: Path, out: Path) -> dict[str, int]:
    """Kill three workers of a cluster while they work."""
    process = driver(archive, out, "dask", JOBS)
    for _ in range(3):
        n_before = _wait_for_partitions(process, out, 1)
        time.sleep(random.uniform(0.0, 0.5))
        while not (workers := _workers(process)):
            time.sleep(0.05)
        random.choice(workers).kill()
        _wait_for_partitions(process, out, n_before + 1)
    ended(process)
    return {}


def driver_killed(archive: Path, out: Path, engine: str) -> dict[str, int]:
    """Kill a driver at a random moment, and begin again."""
    process = driver(archive, out, engine, JOBS)
    _wait_for_partitions(process, out, 2)
    time.sleep(random.uniform(0.0, 0.5))
    process.kill()
    ended(process, killed=True)
    return _again(archive, out, engine)


def driver_dies(archive: Path, out: Path, dies_at: str) -> dict[str, int]:
    """Let a driver die before it renames, and begin again."""
    ended(driver(archive, out, "local", JOBS, dies_at), killed=True)
    return _again(archive, out, "local")


def two_drivers(archive: Path, out: Path) -> dict[str, int]:
    """Let two drivers work at the same time."""
    both = [driver(archive, out, "local", 1) for _ in range(2)]
    for process in both:
        ended(process)
    return {}


def _again(archive: Path, out: Path, engine: str) -> dict[str, int]:
    finished = {path.name: path.stat().st_ino for path in out.glob("*.parquet")}
    ended(driver(archive, out, engine, JOBS))
    return finished


def _wait_for_partitions(process: subprocess.Popen[bytes], out: Path, n: int) -> int:
    """Wait until so many partitions are finished; return how many are."""
    while (there := len(list(out.glob("*.parquet")))) < n:
        if process.poll() is not None:
            raise SystemExit("a driver ended before anything was killed: take more recordings")
        time.sleep(0.02)
    return there


def main(n: int, folder: Path, seed: int) -> int:
    random.seed(seed)
    print(f"moments by the random seed {seed}", flush=True)
    archive = folder / f"archive-{n}"
    if not archive.is_dir():
        print(f"{n} SYNTHETIC recordings are written to {archive}", flush=True)
        synthetic_archive(archive, n)
    ways: dict[str, Callable[[Path], dict[str, int]]] = {
        "1 thread": lambda out: undisturbed(archive, out, "local", 1),
        f"{JOBS} threads": lambda out: undisturbed(archive, out, "local", JOBS),
        f"cluster of {JOBS} processes": lambda out: undisturbed(archive, out, "dask", JOBS),
        "cluster, 3 workers killed": lambda out: workers_killed(archive, out),
        "driver of threads killed, resumed": lambda out: driver_killed(archive, out, "local"),
        "driver of a cluster killed, resumed": lambda out: driver_killed(archive, out, "dask"),
        "killed between write and rename": lambda out: driver_dies(archive, out, r"[0-9a-f]{32}\.parquet$"),
        "killed between rename and manifest": lambda out: driver_dies(archive, out, r"manifest\.json$"),
        "two drivers at once": lambda out: two_drivers(archive, out),
    }
    rows, first, sound = [], None, True
    for what, way in ways.items():
        out = folder / "out"
        shutil.rmtree(out, ignore_errors=True)
        begun = time.perf_counter()
        before = way(out)
        seconds = time.perf_counter() - begun
        there = found(out, n)
        first = first or there
        redone = sum(there.inodes.get(name) != inode for name, inode in before.items())
        wrong = [there.missing, there.double, there.temporary, redone]
        sound &= there.sha256 == first.sha256 and not any(wrong)
        kept = f"{redone} of {len(before)}" if before else "-"
        counts = (str(count) for count in wrong[:3])
        rows.append((what, there.sha256[:16], *counts, kept, f"{seconds:.1f}"))
        print(*rows[-1], sep="  ", flush=True)
    shutil.rmtree(folder / "out")
    header = ("what", "SHA-256", "missing", "double", "temporary", "redone", "seconds")
    print(
        Table(
            f"{n} SYNTHETIC recordings, {len(first.inodes) if first else 0} partitions", header, tuple(rows)
        )
    )
    print("one digest, nothing missing, double or redone" if sound else "THE OUTPUTS DIFFER")
    return 0 if sound else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["--drive"]:
        drive(*sys.argv[2:])
    else:
        n_recordings = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
        seed = int(sys.argv[3]) if len(sys.argv) > 3 else random.SystemRandom().randrange(1 << 32)
        if len(sys.argv) > 2:
            sys.exit(main(n_recordings, Path(sys.argv[2]), seed))
        with tempfile.TemporaryDirectory() as place:
            sys.exit(main(n_recordings, Path(place), seed))

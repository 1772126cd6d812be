"""Loads files in processes of their own and tells what came of it, for the tests of bad files and their bench.

``python bad_files_work.py N`` takes a JSON list of jobs (path, folder, inside, options) and prints a JSON line for
each. All libraries are imported once; every N jobs run in a fork, which a crash, a hang or a bomb ends without ending
the others.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

LIBRARIES = (
    "h5py",
    "lz4.frame",
    "mcap.data_stream",
    "mcap.records",
    "pandas",  # which pyarrow brings in where it is installed
    "pyarrow.parquet",
    "rosbags.typesys",
    "ruamel.yaml",
    "sqlite3",
    "zstandard",
)
HANGS_AFTER_S = 60
MOST_MEGABYTES = 256
ADDRESS_SPACE = 3 << 30
"""What a job may map beyond what is mapped already: a request for 32 GiB fails even where it is never touched."""

CODE = (".py", ".pyc", ".so", ".pyd")
TELLING = (
    *(
        "os.chmod",
        "os.link",
        "os.mkdir",
        "os.remove",
        "os.rename",
        "os.rmdir",
        "os.symlink",
        "os.truncate",
        "os.utime",
    ),
    *(
        "os.exec",
        "os.fork",
        "os.posix_spawn",
        "os.system",
        "shutil.",
        "subprocess.",
        "socket.",
        "urllib.",
        "ftplib.",
    ),
    *("ctypes.dlopen", "pickle.", "sqlite3.enable_load_extension", "sqlite3.load_extension"),
)
"""Events of Python's audit that reading recordings has no business with."""


Job = dict[str, Any]
Answer = dict[str, Any]


class Watch:
    """Notes what a process opens and does, from Python; libraries in C are caught by pipes, which hang."""

    def __init__(self) -> None:
        self._on = False
        self.opened: list[str] = []
        self.done: list[str] = []
        sys.addaudithook(self._hook)

    def __enter__(self) -> None:
        self.opened, self.done, self._on = [], [], True

    def __exit__(self, *_: object) -> None:
        self._on = False

    def _hook(self, event: str, arguments: tuple[object, ...]) -> None:
        if not self._on:
            return
        if event == "open":
            path, _, flags = arguments
            if not isinstance(path, int) and not os.fsdecode(path).endswith(CODE):
                writing = int(flags or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC)
                (self.done if writing else self.opened).append(os.path.realpath(os.fsdecode(path)))
        elif event == "sqlite3.connect":
            address = urlsplit(os.fsdecode(arguments[0]))
            (self.opened if "mode=ro" in address.query else self.done).append(url2pathname(address.path))
        elif event.startswith(TELLING):
            relative = event in ("os.remove", "os.rmdir")
            self.done.append(f"{event}: {_whole(*arguments) if relative else arguments[0]!a}")


def _whole(path: object, folder: object = -1) -> object:
    """Return a path, with the open folder before it that it is relative to."""
    if not isinstance(folder, int) or folder < 0 or not isinstance(path, (str, bytes)):
        return path
    return Path(f"/proc/self/fd/{folder}").readlink() / os.fsdecode(path)


def attempt(path: str, options: dict[str, object]) -> Answer:
    """Load a path; return what came."""
    from granular_id.io import RecordingFileError, load

    came: Answer = {"path": path}
    start, cpu_start = time.perf_counter(), time.process_time()
    try:
        data = load(path, **options)
        rows = data.history[-1].rows
        came |= {"names": list(data.names), "skipped": [row["skipped"] for row in rows if "skipped" in row]}
        came["listed"] = [row["name"] for row in rows if "skipped" in row]
    except BaseException as error:
        came |= {"error": type(error).__name__, "message": str(error)}
        if isinstance(error, RecordingFileError):
            came |= {key: getattr(error, key) for key in ("line", "column", "place", "problem")}
            came["file"] = error.path
    came |= {"seconds": time.perf_counter() - start, "cpu_seconds": time.process_time() - cpu_start}
    return came


def peak_bytes() -> int:
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def work(jobs: list[Job]) -> list[Answer]:
    """Do some jobs one after the other, telling the peak of memory after each."""
    own = tempfile.mkdtemp()  # formats that have to unpack into a file do so here
    tempfile.tempdir = own
    watch = Watch()
    before = peak_bytes()
    answers = []
    for job in jobs:
        with warnings.catch_warnings(record=True) as warned, watch:
            warnings.simplefilter("always")
            options = dict(job["options"])
            alone = attempt(job["path"], options)
            beside = attempt(job["folder"], {**options, "on_error": "skip"})
            gc.collect()
        answers.append(
            {
                "alone": alone,
                "beside": beside,
                "megabytes": (peak_bytes() - before) / 1e6,
                "warnings": [str(warning.message) for warning in warned],
                "outside": [place for place in watch.opened if not inside(place, (job["inside"], own))],
                "done": [what for what in watch.done if own not in what]
                + [path.name for path in Path(own).iterdir()],
            }
        )
    Path(own).rmdir()
    return answers


def inside(place: str, folders: tuple[str, ...]) -> bool:
    return any(Path(place).is_relative_to(os.path.realpath(folder)) for folder in folders)


def in_a_fork(jobs: list[Job]) -> list[Answer]:
    """Do jobs in a child; where it hangs, dies or takes too much memory, one by one to tell which of them it was."""
    answers = answers_of_a_fork(jobs)
    if answers is not None and (len(jobs) == 1 or answers[-1]["megabytes"] < MOST_MEGABYTES):
        return answers
    if len(jobs) == 1:
        return [{"broken": "the process hung or died"}]
    return [answer for job in jobs for answer in in_a_fork([job])]


def answers_of_a_fork(jobs: list[Job]) -> list[Answer] | None:
    here, there = os.pipe()
    child = os.fork()
    if not child:
        os.close(here)
        limit_memory()
        data = json.dumps(work(jobs)).encode()
        with os.fdopen(there, "wb") as pipe:
            pipe.write(data)
        os._exit(0)
    os.close(there)
    parts = []
    ends = time.monotonic() + HANGS_AFTER_S
    with os.fdopen(here, "rb", buffering=0) as pipe:
        while select.select([pipe], [], [], max(0, ends - time.monotonic()))[0]:
            parts.append(pipe.read(1 << 16))
            if not parts[-1]:
                break
        else:
            os.kill(child, signal.SIGKILL)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return json.loads(b"".join(parts)) if status == 0 else None


def limit_memory() -> None:
    statm = Path("/proc/self/statm")
    mapped = int(statm.read_text().split()[0]) * resource.getpagesize() if statm.exists() else 4 << 30
    resource.setrlimit(resource.RLIMIT_AS, (mapped + ADDRESS_SPACE, resource.RLIM_INFINITY))


def answers_to(jobs: list[Job], at_once: int) -> list[Answer]:
    """Give jobs to two processes of their own and collect the answers, in order."""
    halves = jobs[: len(jobs) // 2], jobs[len(jobs) // 2 :]
    command = [sys.executable, os.path.abspath(__file__), str(at_once)]  # noqa: PTH100
    with contextlib.ExitStack() as stack:
        workers = []
        for half in halves:
            file = stack.enter_context(tempfile.TemporaryFile("w+"))
            json.dump(half, file)
            file.seek(0)
            workers.append(
                stack.enter_context(subprocess.Popen(command, stdin=file, stdout=subprocess.PIPE, text=True))
            )
        lines = [line for worker in workers for line in worker.stdout]
    if any(worker.returncode for worker in workers) or len(lines) != len(jobs):
        raise RuntimeError(f"{len(lines)} answers to {len(jobs)} jobs")
    return [json.loads(line) for line in lines]


def main() -> None:
    importlib.import_module("granular_id.io")
    for name in LIBRARIES:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    gc.freeze()  # what is there already is not looked at again in every fork
    jobs = json.load(sys.stdin)
    at_once = int(sys.argv[1])
    for i in range(0, len(jobs), at_once):
        for answer in in_a_fork(jobs[i : i + at_once]):
            print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()

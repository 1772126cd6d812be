"""Each recording exactly once: the same bytes whoever made them, whatever was killed, broken or full meanwhile.

All tests work on one archive, and compare all files that come of it. A few rounds in every run, many where
``GRANULAR_ID_CASES`` says so.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from archive_cases import (
    Dies,
    Sums,
    files_in,
    partitions_in,
    poison,
    samples_in,
    small_partitions,
    some_archive,
)
from effort import cases
from granular_id.archive import Archive, PartitionError
from granular_id.archive.partitions import UNFINISHED, run

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="kills by signal")

DRIVER = """
import os, pathlib, signal, sys, time
from archive_cases import Dies, Sums
from granular_id.archive import Archive, partitions

archive, out, dies_at, words, slow = sys.argv[1:]
partitions._MOST_RECORDINGS = 4
targets = set()

def dying(call):
    def renaming(source, target, **options):
        if dies_at and str(target).endswith(dies_at):
            targets.add(str(target))
        if len(targets) == 3:
            os.kill(os.getpid(), signal.SIGKILL)
        return call(source, target, **options)
    return renaming

for owner in (os, pathlib.Path):
    owner.replace, owner.rename = dying(owner.replace), dying(owner.rename)
if dies_at == "unlink":
    pathlib.Path.unlink = lambda path, **options: os.kill(os.getpid(), signal.SIGKILL)
before = Dies(words) if words else (lambda group: time.sleep(float(slow)))
partitions.run(Archive(archive), Sums(before=before), out, n_jobs=1, progress=False)
"""


def driver(archive, out, *, dies_at="", words="", slow_s=0.0) -> subprocess.Popen[bytes]:
    """Start a process of its own that works on the archive."""
    places = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", DRIVER, archive, out, dies_at, words, str(slow_s)]
    return subprocess.Popen(command, env=places)


@pytest.fixture(scope="module")
def archive(tmp_path_factory) -> Path:
    """24 recordings in row groups of 2."""
    return some_archive(tmp_path_factory.mktemp("a") / "archive")


@pytest.fixture(autouse=True)
def six_partitions(monkeypatch):
    """Partitions of 4; drafts of the dead are removed at once."""
    small_partitions(monkeypatch)
    monkeypatch.setattr("granular_id.archive.partitions._LONGEST_DRAFT_S", 0.0)


@pytest.fixture(scope="module")
def wanted(archive, tmp_path_factory) -> dict[str, bytes]:
    """What is in the folder when nothing disturbs."""
    out = tmp_path_factory.mktemp("undisturbed") / "out"
    assert driver(archive, out).wait(120) == 0
    return files_in(out)


@pytest.fixture
def out(archive, wanted, tmp_path):
    """A folder that in the end, all work done, has to hold what is wanted."""
    out = tmp_path / "out"
    yield out
    run(Archive(archive), Sums(), out, n_jobs=2, progress=False)
    assert files_in(out) == wanted


@pytest.mark.parametrize(
    ("deaths", "n_finished"),
    [({"dies_at": ".parquet"}, 2), ({"dies_at": "unlink"}, 6), ({"words": "."}, 2)],
    ids=["between write and rename", "after the last rename", "while it computes"],
)
def test_killed_driver_is_taken_up(archive, out, tmp_path, monkeypatch, deaths, n_finished):
    monkeypatch.chdir(tmp_path)
    assert driver(archive, out, **deaths).wait(120) == -signal.SIGKILL
    finished = {name: (out / name).stat().st_ino for name in partitions_in(out)}
    assert len(finished) == n_finished
    assert run(Archive(archive), Sums(), out, n_jobs=2, progress=False).n_resumed == n_finished
    assert {name: (out / name).stat().st_ino for name in finished} == finished


def test_drivers_killed_at_any_moment_are_taken_up(archive, wanted, out):
    draw = random.Random(0)
    for _ in range(cases(2)):
        other = driver(archive, out, slow_s=0.05)
        deadline = time.monotonic() + 60
        while other.poll() is None and not out.is_dir() and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(draw.uniform(0, 0.6))
        other.kill()
        other.wait()
        assert {name: (out / name).read_bytes() for name in partitions_in(out)}.items() <= wanted.items()
        if len(partitions_in(out)) == 6:
            (out / partitions_in(out)[draw.randrange(6)]).unlink()


def test_drivers_at_once_make_the_same_files(archive, wanted, out, tmp_path, monkeypatch):
    monkeypatch.setattr("granular_id.archive.partitions._LONGEST_DRAFT_S", 60.0)
    for place in (out, *(tmp_path / f"out {i}" for i in range(1, cases(1)))):
        other = driver(archive, place)
        while not place.is_dir():
            assert other.poll() is None
            time.sleep(0.01)
        run(Archive(archive), Sums(), place, n_jobs=1, progress=False)
        assert other.wait(120) == 0
        assert files_in(place) == wanted


def test_cluster_whose_workers_die_makes_the_same_files(archive, out, tmp_path):
    options = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "silence_logs": "CRITICAL"}
    with (
        # The first death of a worker ends the first attempt, so that few have to die.
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.Client(n_workers=2, set_as_default=False, **options) as client,
        pytest.raises(
            PartitionError, match="row group 8 to 9: the processes that worked on it died"
        ) as failed,
    ):
        run(Archive(archive), Sums(before=Dies(str(tmp_path))), out, scheduler=client, progress=False)
    assert len(failed.value.extraction.failures) == 1
    assert (tmp_path / "died at 5").exists()
    assert len(partitions_in(out)) == 5


def test_poisoned_partition_fails_alone_by_name(archive, out):
    good = poison(samples_in(archive), 3)
    with pytest.raises(PartitionError, match=r"1 partition failed.*\.parquet: [^:]*, row group 3: "):
        run(Archive(archive), Sums(), out, progress=False)
    samples_in(archive).write_bytes(good)
    assert (len(partitions_in(out)), (out / UNFINISHED).exists()) == (5, True)
    assert run(Archive(archive), Sums(), out, progress=False).n_resumed == 5


def test_full_disk_stops_all_in_one_line(archive, out):
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(OSError, match=r"^cannot write .*/out/[0-9a-f]{32}\.parquet: .*File too large.*$"):
            run(Archive(archive), Sums(), out, progress=False)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert set(files_in(out)) == {UNFINISHED}, "nothing half-written"

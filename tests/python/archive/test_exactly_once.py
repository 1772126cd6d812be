"""Each recording exactly once: the same files whoever made them, and whatever was killed meanwhile.

A few rounds in every run, many where ``GRANULAR_ID_CASES`` says so.
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

from archive_cases import Dies, Sums, files_in, partitions_in, small_partitions, some_archive
from effort import cases
from granular_id.archive import Archive, PartitionError
from granular_id.archive.partitions import run

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
pytest.importorskip("pyarrow")

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


def cluster():
    """Two worker processes; the first death of one ends the first attempt, so that few have to die."""
    return distributed.Client(
        n_workers=2,
        threads_per_worker=1,
        dashboard_address="127.0.0.1:0",
        silence_logs="CRITICAL",
        set_as_default=False,
    )


@pytest.fixture
def archive(tmp_path, monkeypatch) -> Path:
    """24 recordings in row groups of 2, six partitions of 4; drafts of the dead are removed at once."""
    small_partitions(monkeypatch)
    monkeypatch.setattr("granular_id.archive.partitions._LONGEST_DRAFT_S", 0.0)
    return some_archive(tmp_path / "archive")


@pytest.fixture
def wanted(archive, tmp_path) -> dict[str, bytes]:
    """What is in the folder when nothing disturbs: six partitions."""
    run(Archive(archive), Sums(), tmp_path / "undisturbed", n_jobs=1, progress=False)
    return files_in(tmp_path / "undisturbed")


@pytest.mark.parametrize(
    ("deaths", "n_finished"),
    [
        pytest.param({"dies_at": ".parquet"}, 2, id="between write and rename"),
        pytest.param({"dies_at": "unlink"}, 6, id="after the last rename"),
        pytest.param({"words": "."}, 2, id="while it computes"),
    ],
)
def test_killed_driver_is_taken_up(archive, wanted, tmp_path, monkeypatch, deaths, n_finished):
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "out"
    assert driver(archive, out, **deaths).wait(60) == -signal.SIGKILL
    finished = {name: (out / name).stat().st_ino for name in partitions_in(out)}
    assert len(finished) == n_finished
    again = run(Archive(archive), Sums(), out, n_jobs=2, progress=False)
    assert files_in(out) == wanted
    assert {name: (out / name).stat().st_ino for name in finished} == finished
    assert again.n_resumed == n_finished


def test_drivers_killed_at_any_moment_are_taken_up(archive, wanted, tmp_path):
    out = tmp_path / "out"
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
    run(Archive(archive), Sums(), out, n_jobs=2, progress=False)
    assert files_in(out) == wanted


def test_two_drivers_at_once_make_the_same_files(archive, wanted, tmp_path, monkeypatch):
    monkeypatch.setattr("granular_id.archive.partitions._LONGEST_DRAFT_S", 60.0)
    for i in range(cases(1)):
        out = tmp_path / f"out {i}"
        other = driver(archive, out)
        while not out.is_dir():
            assert other.poll() is None
        run(Archive(archive), Sums(), out, n_jobs=1, progress=False)
        assert other.wait(60) == 0
        assert files_in(out) == wanted


def test_cluster_whose_workers_die_makes_the_same_files(archive, wanted, tmp_path):
    out = tmp_path / "out"
    spec = Sums(before=Dies(str(tmp_path)))
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        cluster() as client,
        pytest.raises(
            PartitionError, match=r"row group 8 to 9: the processes that worked on it died"
        ) as failed,
    ):
        run(Archive(archive), spec, out, scheduler=client, progress=False)
    assert len(failed.value.extraction.failures) == 1
    assert (tmp_path / "died at 5").exists()
    assert len(partitions_in(out)) == 5
    run(Archive(archive), Sums(), out, n_jobs=1, progress=False)
    assert files_in(out) == wanted


def test_cluster_listens_on_this_machine_alone(archive, wanted, tmp_path):
    psutil = pytest.importorskip("psutil")
    with cluster() as client:
        run(Archive(archive), Sums(), tmp_path / "out", scheduler=client, progress=False)
        tree = [psutil.Process(), *psutil.Process().children(recursive=True)]
        places = {
            place.laddr.ip
            for one in tree
            for place in one.net_connections("tcp")
            if place.status == psutil.CONN_LISTEN
        }
    assert files_in(tmp_path / "out") == wanted
    assert places <= {"127.0.0.1", "::1"}

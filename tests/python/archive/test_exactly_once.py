"""Each recording exactly once: the same files whatever engine made them, and whatever was killed meanwhile."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from archive_cases import files_in, partitions_in, small_partitions, some_archive
from granular_id.archive import Archive, PartitionError
from granular_id.archive.extraction import run
from granular_id.archive.work import read_samples

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")
pa = pytest.importorskip("pyarrow")

pytestmark = pytest.mark.skipif(os.name != "posix", reason="kills by signal")

LONGEST_DRAFT_S = "granular_id.archive.extraction._LONGEST_DRAFT_S"

KILLS_ONCE, KILLS_ALWAYS = 5, 9
"""Row groups at which a deadly work dies: in the third partition of six, and in the fifth."""


@dataclass(frozen=True)
class Sums:
    """Sum of the samples of each recording; `deadly` is a folder where a worker leaves word before it kills itself."""

    deadly: str = ""

    def about(self):
        return {"sums": 1}

    def check(self, archive):
        pass

    def fields(self):
        return [pa.field("sum", pa.float64())]

    def columns(self, archive, group):
        if self.deadly:
            word = Path(self.deadly, f"died at {group.row_group}")
            if group.row_group == KILLS_ALWAYS or (group.row_group == KILLS_ONCE and not word.exists()):
                word.touch()
                os.kill(os.getpid(), signal.SIGKILL)
        samples = read_samples(archive, group)
        return [samples.reshape(group.stop - group.start, -1).sum(axis=1)]


DRIVER = """
import os, pathlib, signal, sys
from granular_id.archive import Archive, extraction
from test_exactly_once import Sums

archive, out, dies_at, work = sys.argv[1:]
extraction._MOST_RECORDINGS = 4
targets = set()

def dying(call):
    def renaming(source, target, **options):
        if dies_at and str(target).endswith(dies_at):
            targets.add(str(target))
        if len(targets) == (1 if dies_at == "_manifest.json" else 3):
            os.kill(os.getpid(), signal.SIGKILL)
        return call(source, target, **options)
    return renaming

for owner in (os, pathlib.Path):
    owner.replace, owner.rename = dying(owner.replace), dying(owner.rename)
extraction.run(Archive(archive), Sums(work), out, n_jobs=1, progress=False)
"""


def driver(archive, out, *, dies_at="", deadly="") -> subprocess.Popen[bytes]:
    """Start a process of its own that works on the archive."""
    places = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.Popen([sys.executable, "-c", DRIVER, archive, out, dies_at, deadly], env=places)


@pytest.fixture
def archive(tmp_path, monkeypatch) -> Path:
    """24 recordings in row groups of 2, six partitions of 4."""
    small_partitions(monkeypatch)
    return some_archive(tmp_path / "archive")


@pytest.fixture
def wanted(archive, tmp_path) -> dict[str, bytes]:
    """What is in the folder when nothing disturbs: six partitions and the manifest."""
    run(Archive(archive), Sums(), tmp_path / "undisturbed", n_jobs=1, progress=False)
    return files_in(tmp_path / "undisturbed")


def test_two_threads_make_the_same_files(archive, wanted, tmp_path):
    run(Archive(archive), Sums(), tmp_path / "out", n_jobs=2, progress=False)
    assert files_in(tmp_path / "out") == wanted


@pytest.mark.parametrize(
    ("deaths", "n_finished"),
    [
        pytest.param({"dies_at": ".parquet"}, 2, id="between write and rename"),
        pytest.param({"dies_at": "_manifest.json"}, 6, id="between rename and manifest"),
        pytest.param({"deadly": "."}, 2, id="while it computes"),
    ],
)
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no SIGKILL here")
def test_a_driver_that_was_killed_is_taken_up(archive, wanted, tmp_path, monkeypatch, deaths, n_finished):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(LONGEST_DRAFT_S, 0.0)
    out = tmp_path / "out"
    assert driver(archive, out, **deaths).wait(60) == -signal.SIGKILL
    finished = {name: (out / name).stat().st_ino for name in partitions_in(out)}
    assert len(finished) == n_finished
    again = run(Archive(archive), Sums(), out, n_jobs=2, progress=False)
    assert files_in(out) == wanted
    assert {name: (out / name).stat().st_ino for name in finished} == finished
    assert again.n_resumed == n_finished


def test_two_drivers_at_once_make_the_same_files(archive, wanted, tmp_path):
    out = tmp_path / "out"
    other = driver(archive, out)
    while not out.is_dir():
        assert other.poll() is None
    run(Archive(archive), Sums(), out, n_jobs=1, progress=False)
    assert other.wait(60) == 0
    assert files_in(out) == wanted


def test_a_cluster_whose_workers_die_makes_the_same_files(archive, wanted, tmp_path, monkeypatch):
    monkeypatch.setattr(LONGEST_DRAFT_S, 0.0)
    out = tmp_path / "out"
    # The first death ends the first attempt, so that few workers have to die.
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.Client(
            n_workers=2,
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",
            silence_logs="CRITICAL",
            set_as_default=False,
        ) as client,
        pytest.raises(PartitionError) as failed,
    ):
        run(Archive(archive), Sums(str(tmp_path)), out, scheduler=client, progress=False)
    assert [outcome.problem[:32] for outcome in failed.value.extraction.failures] == [
        "samples/part-00000.parquet, row "
    ]
    assert (tmp_path / f"died at {KILLS_ONCE}").exists()
    there = files_in(out)
    manifest = json.loads(there.pop("_manifest.json"))
    assert len(there) == 5
    assert there.items() <= wanted.items()
    assert len(manifest["failures"]) == 1
    run(Archive(archive), Sums(), out, n_jobs=1, progress=False)
    assert files_in(out) == wanted

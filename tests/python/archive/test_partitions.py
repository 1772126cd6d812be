"""Work on archives, partition by partition: what is written, what stays, what is refused, what fails alone."""

from __future__ import annotations

import os
import pickle
from dataclasses import replace
from pathlib import Path
from time import time

import pytest

from archive_cases import (
    Sums,
    files_in,
    index_in,
    partitions_in,
    poison,
    rewrite,
    small_partitions,
    some_archive,
    some_recordings,
    with_column,
)
from granular_id.archive import Archive, Extraction, PartitionError, append
from granular_id.archive.partitions import (
    UNFINISHED,
    Outputs,
    make_file,
    partitions_of,
    process_partition,
    run,
)
from granular_id.io import RecordingFileError, load
from granular_id.recording import Dataset

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")


@pytest.fixture
def archive(tmp_path, monkeypatch) -> Path:
    """24 recordings in row groups of 2, six partitions of 4."""
    small_partitions(monkeypatch)
    return some_archive(tmp_path / "archive")


@pytest.fixture
def out(tmp_path) -> Path:
    return tmp_path / "out"


def done(archive, out, spec=None, **options) -> Extraction:
    return run(Archive(archive), Sums() if spec is None else spec, out, **{"progress": False, **options})


class OfSums(Outputs):
    holds = "sums"


def sums_of(data):
    return [r.wrench.ravel().sum() for r in data]


def sums_in(out):
    return OfSums(out).joined("sum")["sum"].to_pylist()


# What is written.


def test_partition_is_a_pure_function(archive, tmp_path):
    before = sorted(tmp_path.rglob("*"))
    for partition in partitions_of(Archive(archive)):
        sent = pickle.dumps((partition, Sums()))
        assert len(sent) < 500
        table = process_partition(partition, Sums())
        assert process_partition(*pickle.loads(sent)).equals(table, check_metadata=True)
        assert table.num_rows == partition.n_recordings
    assert sorted(tmp_path.rglob("*")) == before


def test_run_writes_every_recording_once(archive, out, tmp_path):
    steps = []
    report = done(archive, out, n_jobs=2, progress=lambda *step: steps.append(step))
    assert (report.n_recordings, report.n_partitions, report.n_resumed) == (24, 6, 0)
    assert [step[:2] for step in steps] == [(4 * i, 24) for i in range(1, 7)]
    assert str(report).startswith(f"{out}: 24 recordings in 6 partitions; ")
    index, table = Archive(archive).index, OfSums(out).joined("name", "label", "digest")
    assert all(table[name].to_pylist() == index[name].to_pylist() for name in table.column_names)
    assert sums_in(out) == sums_of(some_recordings())
    assert sorted(pq.read_table(out)["sum"].to_pylist()) == sorted(sums_in(out)), "others read it, too"
    done(archive, tmp_path / "other", n_jobs=1)
    assert files_in(out) == files_in(tmp_path / "other")


def test_partitions_never_cross_a_file_and_are_bounded(tmp_path, monkeypatch):
    small_partitions(monkeypatch)
    every = some_recordings(22, [*[60] * 18, 150, 150, 60, 60]).recordings
    for part in (every[:6], every[6:18], every[18:]):
        append(tmp_path, Dataset(part))
    monkeypatch.setattr("granular_id.archive.partitions._MOST_SAMPLES", 200)
    sizes = [one.n_recordings for one in partitions_of(Archive(tmp_path))]
    assert sizes == [6, 12, 4], "row groups stay whole"
    grouped = partitions_of(Archive(some_archive(tmp_path / "a", Dataset(every), per_group=1)))
    assert [one.n_recordings for one in grouped] == [3] * 6 + [1, 1, 2]


def test_run_marks_what_comes_of_simulated_recordings(tmp_path, out):
    marked = [replace(r, meta={"synthetic": i == 3}) for i, r in enumerate(some_recordings(6))]
    report = done(some_archive(tmp_path / "a", Dataset(marked)), out)
    assert (report.synthetic, "SYNTHETIC" in str(report), OfSums(out).n_synthetic) == (True, True, 1)


def test_archive_counts_simulated_recordings_as_load_does(archive):
    metas = [None, '{"synthetic":true}', '{"synthetic": 1}', '{"a": {"synthetic": true}}']
    rewrite(index_in(archive), with_column("meta", pa.array(metas * 6, pa.string())))
    assert Archive(archive).n_synthetic == sum(one.is_synthetic for one in load(archive))


# Going on.


def test_run_computes_only_what_is_missing(archive, out):
    done(archive, out)
    before, seen = files_in(out), []
    for name in partitions_in(out)[:2]:
        (out / name).unlink()
    report = done(archive, out, Sums(before=seen.append))
    assert (report.n_resumed, len(seen), files_in(out)) == (4, 4, before), "two row groups each"
    assert (report.n_recordings, "4 of them there before" in str(report)) == (24, True)


def test_run_on_a_grown_archive_adds_and_changes_nothing(tmp_path, out, monkeypatch):
    small_partitions(monkeypatch)
    data = some_recordings(26)
    archive = some_archive(tmp_path / "archive", Dataset(data.recordings[:22]))
    done(archive, out)
    before = files_in(out)
    append(archive, Dataset(data.recordings[22:]))
    report = done(archive, out)
    assert (report.n_resumed, report.n_recordings, len(partitions_in(out))) == (6, 26, 7)
    assert before.items() <= files_in(out).items()
    assert sums_in(out) == sums_of(data)
    done(archive, tmp_path / "anew")
    assert files_in(tmp_path / "anew") == files_in(out)


def test_run_removes_drafts_only_of_dead_writers(archive, out):
    done(archive, out)
    draft, ages_s = f".{partitions_in(out)[0][:20]}-{'0' * 15}", {"1.parquet": 80_000, "2.parquet": 90_000}
    for name, age_s in {"notes.txt": 90_000, **{draft + end: age_s for end, age_s in ages_s.items()}}.items():
        (out / name).write_bytes(b"half")
        os.utime(out / name, (time() - age_s,) * 2)
    done(archive, out)
    assert sorted(files_in(out)) == sorted([*partitions_in(out), "notes.txt", f"{draft}1.parquet"])


# What is refused.


def test_run_into_other_work_is_refused(archive, out, tmp_path):
    done(archive, out)
    before, seen = files_in(out), []
    message = r"holds other work already: sums 'sums' there, 'others' wanted; name"
    with pytest.raises(ValueError, match=message):
        done(archive, out, Sums("others", before=seen.append))
    with pytest.raises(ValueError, match=r"holds recordings that .*other does not have"):
        done(some_archive(tmp_path / "other", some_recordings(seed=1)), out)
    (out / partitions_in(out)[0]).write_bytes(b"nonsense")
    with pytest.raises(RecordingFileError, match=r"reading it as a partition \(remove it, or name another"):
        done(archive, out)
    for place in (archive, archive / "out"):
        with pytest.raises(ValueError, match=r"out=.* is or lies in the archive"):
            done(archive, place)
    assert (len(files_in(out)), seen, (archive / "out").exists()) == (len(before), [], False)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_jobs": 0}, "n_jobs"),
        ({"progress": 3}, "progress must be"),
        ({"scheduler": "tcp://host:8786", "n_jobs": 2}, "n_jobs must be None with a scheduler"),
        ({"scheduler": "host"}, "scheduler='host' is no address such as tcp://host:8786"),
    ],
)
def test_run_checks_its_options_first(archive, out, options, message):
    with pytest.raises((ValueError, TypeError), match=message):
        done(archive, out, **options)
    assert not out.exists()


# What goes wrong.


def test_partitions_that_fail_are_named(archive, out):
    def fail(group):
        if group.row_group >= 4:
            raise ZeroDivisionError("no wrench\nat all")

    message = r"4 partitions failed, .*row group 4 to 5: no wrench\\nat all; .*; and 1 more"
    with pytest.raises(PartitionError, match=message) as caught:
        done(archive, out, Sums(before=fail))
    report = caught.value.extraction
    assert (report.n_partitions, report.n_recordings, len(report.failures)) == (2, 8, 4)
    assert "4 partitions FAILED" in str(report)


def test_ctrl_c_leaves_whole_partitions_that_are_unfinished(archive, out):
    def stop(n_made, total, what):
        if n_made == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        done(archive, out, progress=stop)
    assert sorted(files_in(out)) == sorted([*partitions_in(out), UNFINISHED])
    with pytest.raises(FileNotFoundError, match="not finished"):
        OfSums(out)
    assert done(archive, out).n_resumed >= 2


def test_outputs_of_something_else_are_refused(archive, out, tmp_path):
    done(archive, out)
    for folder, message in ((tmp_path / "no", "no such folder"), (archive, "the sums are not finished")):
        with pytest.raises(FileNotFoundError, match=message):
            OfSums(folder)
    with pytest.raises(ValueError, match="holds no sizes, but granular_id, sums"):
        type("OfSizes", (Outputs,), {"holds": "sizes"})(out)
    assert make_file(partitions_of(Archive(archive))[0], Sums("others"), str(out)) == ""
    with pytest.raises(ValueError, match=r"holds two kinds of sums: sums '\w+' there, '\w+' wanted \(in "):
        OfSums(out)


def test_damaged_outputs_are_refused_by_name(archive, out):
    done(archive, out)
    poison(out / partitions_in(out)[1], 0)
    with pytest.raises(RecordingFileError, match=rf"{partitions_in(out)[1]}: reading sums \(remove it"):
        OfSums(out).joined("name")

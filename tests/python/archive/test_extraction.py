"""Work on archives: each partition exactly once, whatever stops, dies, runs twice or cannot be read."""

from __future__ import annotations

import json
import os
import pickle
from dataclasses import dataclass, replace
from pathlib import Path
from time import time
from typing import Any

import pytest

from archive_cases import files_in, partitions_in, poison, small_partitions, some_archive, some_recordings
from granular_id.archive import Archive, Extraction, Features, PartitionError, append
from granular_id.archive.extraction import planned, run, tasks_of
from granular_id.archive.work import forget, process_partition, read_samples, remember
from granular_id.io import load
from granular_id.recording import Dataset

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")


@dataclass(frozen=True)
class Sums:
    """Sum of the samples of each recording; `before` is called with each row group."""

    about_it: str = "sums"
    before: Any = None

    def about(self):
        return {"sums": self.about_it}

    def check(self, archive):
        if archive.axes[0] != "fx":
            raise ValueError("wanted fx")

    def fields(self):
        return [pa.field("sum", pa.float64())]

    def columns(self, archive, group):
        if self.before is not None:
            self.before(group)
        samples = read_samples(archive, group)
        return [pa.array(samples.reshape(group.stop - group.start, -1).sum(axis=1))]


def quietly(archive, out, work=None, **options) -> Extraction:
    return run(Archive(archive), Sums() if work is None else work, out, progress=False, **options)


@pytest.fixture
def archive(tmp_path, monkeypatch) -> Path:
    """24 recordings in row groups of 2, partitions of 4."""
    small_partitions(monkeypatch)
    return some_archive(tmp_path / "archive")


@pytest.fixture
def out(tmp_path) -> Path:
    return tmp_path / "out"


# The plan.


@pytest.mark.parametrize(("lengths", "wanted"), [([60] * 8, [4, 4]), ([60] * 7, [4, 3]), ([60], [1])])
def test_partitions_join_row_groups_in_order(tmp_path, monkeypatch, lengths, wanted):
    small_partitions(monkeypatch)
    opened = Archive(some_archive(tmp_path / "a", some_recordings(n_samples=lengths, n=0), per_group=1))
    parts = list(planned(opened.row_groups))
    assert [sum(group.stop - group.start for group in part) for part in parts] == wanted
    assert [group for part in parts for group in part] == list(opened.row_groups)


def test_a_partition_never_splits_a_row_group(tmp_path, monkeypatch):
    small_partitions(monkeypatch, 3)
    opened = Archive(some_archive(tmp_path / "a", some_recordings(12), per_group=5))
    assert [[group.row_group for group in part] for part in planned(opened.row_groups)] == [[0], [1], [2]]


def test_partitions_of_long_recordings_hold_fewer(archive, monkeypatch):
    monkeypatch.setattr("granular_id.archive.extraction._MOST_SAMPLES", 150)
    assert {len(part) for part in planned(Archive(archive).row_groups)} == {1}


# What is written.


def test_every_recording_is_there_once_beside_what_the_index_says(archive, out):
    done = quietly(archive, out)
    assert (done.n_recordings, done.n_partitions, done.n_resumed) == (24, 6, 0)
    names = [part["name"] for part in json.loads((out / "_manifest.json").read_bytes())["partitions"]]
    table = pa.concat_tables([pq.read_table(out / name) for name in names])
    index = Archive(archive).index
    for name in ("name", "label", "session", "start_time", "digest"):
        assert table[name].to_pylist() == index[name].to_pylist()
    assert table["sum"].to_pylist() == [r.wrench.ravel().sum() for r in some_recordings()]


def test_row_groups_of_few_recordings_are_written_together(archive, out, tmp_path, monkeypatch):
    quietly(archive, out)
    together = [pq.read_metadata(path).num_row_groups for path in out.glob("*.parquet")]
    monkeypatch.setattr("granular_id.archive.work._LEAST_ROWS", 1)
    quietly(archive, tmp_path / "apart")
    apart = sorted((tmp_path / "apart").glob("*.parquet"))
    assert (together, [pq.read_metadata(path).num_row_groups for path in apart]) == ([1] * 6, [2] * 6)
    assert [pq.read_table(path) for path in apart] == [pq.read_table(out / path.name) for path in apart]


@pytest.mark.parametrize("n_jobs", [1, 2])
def test_the_same_bytes_from_any_number_of_threads(archive, out, tmp_path, n_jobs):
    first, second = quietly(archive, out), quietly(archive, tmp_path / "other", n_jobs=n_jobs)
    assert files_in(out) == files_in(tmp_path / "other")
    assert first.sha256 == second.sha256


def test_a_small_task_goes_to_a_worker_and_makes_the_same_file(archive, out):
    quietly(archive, out)
    before = files_in(out)
    for task in tasks_of(Archive(archive), Sums(), out):
        (out / task.name).unlink()
        forget(task.archive)
        sent = pickle.dumps(task)
        assert len(sent) < 2000
        assert process_partition(pickle.loads(sent)).sha256
    assert files_in(out) == before


def test_the_result_is_printed_in_a_line(archive, out):
    said = str(quietly(archive, out))
    assert said.startswith(f"{out}: 24 recordings in 6 partitions; ")
    assert "recordings/s; reading" in said
    assert "\n" not in said
    assert "6 of them there before" in str(quietly(archive, out))


def test_what_comes_of_simulated_recordings_is_marked(tmp_path, out):
    marked = [replace(r, meta={"synthetic": i == 3}) for i, r in enumerate(some_recordings(6))]
    done = quietly(some_archive(tmp_path / "a", Dataset(marked)), out)
    assert done.synthetic
    assert "SYNTHETIC" in str(done)
    assert json.loads((out / "_manifest.json").read_bytes())["synthetic"] is True


def test_progress_counts_recordings(archive, out):
    told = []
    run(Archive(archive), Sums(), out, progress=lambda *step: told.append(step))
    assert [step[:2] for step in told] == [(4 * i, 24) for i in range(1, 7)]
    assert "recordings/s" in told[-1][2]


# Going on.


def test_what_was_finished_is_not_computed_again(archive, out):
    whole = quietly(archive, out)
    before = files_in(out)
    for name in partitions_in(out)[:2]:
        (out / name).unlink()
    seen = []
    done = quietly(archive, out, Sums(before=seen.append))
    assert (done.n_resumed, len(seen), done.sha256) == (4, 4, whole.sha256)
    assert files_in(out) == before


def test_stopped_between_the_last_partition_and_the_manifest(archive, out, tmp_path, monkeypatch):
    whole = quietly(archive, tmp_path / "whole")
    with monkeypatch.context() as once:
        once.setattr("granular_id.archive.extraction.write_manifest", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            quietly(archive, out)
    assert len(partitions_in(out)) == 6
    done = quietly(archive, out)
    assert (done.n_resumed, done.sha256) == (6, whole.sha256)


def test_a_partition_that_was_cut_off_is_made_anew(archive, out):
    whole = quietly(archive, out)
    cut = out / partitions_in(out)[1]
    cut.write_bytes(cut.read_bytes()[:-40])
    done = quietly(archive, out)
    assert (done.n_resumed, done.sha256) == (5, whole.sha256)


@pytest.mark.parametrize("listed", [True, False], ids=["in the manifest", "without a manifest"])
def test_a_file_that_was_damaged_since_is_made_again(archive, out, listed):
    whole = quietly(archive, out)
    poison(out, 0, partitions_in(out)[1])
    if not listed:
        (out / "_manifest.json").unlink()
    done = quietly(archive, out)
    assert (done.n_resumed, done.sha256) == (5, whole.sha256)
    assert quietly(archive, out).n_resumed == 6


def test_a_manifest_of_something_else_is_left_alone(archive, out):
    out.mkdir()
    (out / "_manifest.json").write_text('{"my": "notes"}')
    with pytest.raises(ValueError, match=r"_manifest.json is no manifest of partitions: 'format' is missing"):
        quietly(archive, out)
    assert (out / "_manifest.json").read_text() == '{"my": "notes"}'


def test_others_read_the_folder_as_one_table(archive, out):
    quietly(archive, out)
    assert sorted(pq.read_table(out)["name"].to_pylist()) == sorted(r.name for r in some_recordings())


def test_an_archive_that_has_grown_has_only_its_end_computed(tmp_path, out, monkeypatch):
    small_partitions(monkeypatch)
    data = some_recordings(26)
    archive = some_archive(tmp_path / "archive", Dataset(data.recordings[:22]))
    quietly(archive, out)
    before = partitions_in(out)
    append(archive, Dataset(data.recordings[22:24]))  # joins the last partition, which held two
    append(archive, Dataset(data.recordings[24:]))
    done = quietly(archive, out)
    assert (done.n_resumed, done.n_recordings, len(partitions_in(out))) == (5, 26, 7)
    assert len({*before} - {*partitions_in(out)}) == 1
    assert done.sha256 == quietly(archive, tmp_path / "anew").sha256


def test_pushes_that_were_added_one_by_one_are_joined(tmp_path, out, monkeypatch):
    small_partitions(monkeypatch)
    for recording in some_recordings(6):
        append(tmp_path / "archive", Dataset([recording]))
    assert quietly(tmp_path / "archive", out).n_partitions == 2
    assert [pq.read_metadata(path).num_row_groups for path in out.glob("*.parquet")] == [1, 1]


@pytest.mark.parametrize(
    "recordings", [some_recordings(26), some_recordings(seed=1)], ids=["grown", "replaced"]
)
def test_workers_open_an_archive_again_that_is_another_one_by_now(archive, out, tmp_path, recordings):
    remember(Archive(archive), str(archive))
    out.mkdir()
    archive.rename(tmp_path / "gone")
    tasks = tasks_of(Archive(some_archive(archive, recordings)), Sums(), out)
    assert [process_partition(task).problem for task in tasks] == [""] * len(tasks)
    sums = [each for task in tasks for each in pq.read_table(out / task.name)["sum"].to_pylist()]
    assert sums == [r.wrench.ravel().sum() for r in recordings]
    forget(str(archive))


@pytest.mark.parametrize("age_s", [0, 3_600, 90_000])
def test_run_removes_drafts_only_of_dead_writers(archive, out, age_s):
    whole = quietly(archive, out)
    partition, when_s = partitions_in(out)[0], time() - age_s
    drafts = [f".{partition}.{'0' * 16}.tmp", f".{'0' * 16}.tmp", f"._manifest-{'0' * 16}.json"]
    for name in (*drafts, "notes.txt"):
        (out / name).write_bytes(b"half")
        os.utime(out / name, (when_s, when_s))
    assert quietly(archive, out).sha256 == whole.sha256
    left = [] if age_s > 86_400 else drafts
    assert sorted(files_in(out)) == sorted([*partitions_in(out), "_manifest.json", "notes.txt", *left])


def test_driver_that_fails_leaves_drafts_of_others(archive, out, tmp_path):
    calls, n_drafts = [], []

    def no_memory(_):
        raise MemoryError

    def fail_beside(group):
        calls.append(group.row_group)
        with pytest.raises(PartitionError):
            quietly(archive, out, Sums(before=no_memory), n_jobs=1)
        n_drafts.append(len(list(out.glob(".*.tmp"))))

    done = quietly(archive, out, Sums(before=fail_beside), n_jobs=1)
    assert done.sha256 == quietly(archive, tmp_path / "other").sha256
    assert (sorted(calls), set(n_drafts)) == (list(range(12)), {1})


def test_two_drivers_at_once_write_the_same_and_nothing_twice(archive, out, tmp_path):
    whole = quietly(archive, tmp_path / "whole")
    inner = []

    def another(_):
        if not inner:
            inner.append(None)
            inner.append(quietly(archive, out))

    outer = quietly(archive, out, Sums(before=another))
    assert {outer.sha256, inner[1].sha256} == {whole.sha256}
    assert files_in(out) == files_in(tmp_path / "whole")


def test_what_is_appended_between_two_row_groups_of_a_task_is_left_alone(tmp_path, out, monkeypatch):
    when = iter([1.0, 3.0, 2.0])
    monkeypatch.setattr("granular_id.io.parquet.writing.time.time", lambda: next(when))
    archive, data = tmp_path / "archive", some_recordings(6)
    append(archive, Dataset(data.recordings[:2]))
    append(archive, Dataset(data.recordings[2:4]))
    out.mkdir()
    (task,) = tasks_of(Archive(archive), Sums(), out)
    append(archive, Dataset(data.recordings[4:]))  # of a clock that lags
    assert process_partition(task).problem == ""
    assert pq.read_table(out / task.name)["name"].to_pylist() == [r.name for r in data.recordings[:4]]


def test_what_was_finished_stays_until_what_replaces_it_is_there(tmp_path, out, monkeypatch):
    small_partitions(monkeypatch)
    data = some_recordings(6)
    archive = some_archive(tmp_path / "archive", Dataset(data.recordings[:2]))
    quietly(archive, out)
    before = partitions_in(out)
    append(archive, Dataset(data.recordings[2:4]))
    (added,) = (archive / "samples").glob("?" * 32 + ".parquet")
    whole = poison(archive, 0, f"samples/{added.name}")
    with pytest.raises(PartitionError):
        quietly(archive, out)
    assert partitions_in(out) == before
    added.write_bytes(whole)
    quietly(archive, out)
    assert len(partitions_in(out)) == 1
    assert partitions_in(out) != before


def test_a_partition_that_another_driver_removed_is_made_again(archive, out):
    removed = []

    def remove(_):
        if not removed and partitions_in(out):
            removed.append(partitions_in(out)[0])
            (out / removed[0]).unlink()

    done = quietly(archive, out, Sums(before=remove))
    assert removed[0] in partitions_in(out)
    assert done.n_partitions == len(partitions_in(out)) == 6


def test_a_partition_that_vanishes_each_time_is_an_error(archive, out):
    def remove(_):
        for name in partitions_in(out):
            (out / name).unlink()

    with pytest.raises(OSError, match=r"[0-9a-f]{32}.parquet is gone each time that it was made"):
        quietly(archive, out, Sums(before=remove))


@pytest.mark.parametrize(
    "meta", ['{"synthetic":true}', '{"synthetic": 1}', '{"source": {"synthetic": true}}']
)
def test_simulated_recordings_are_told_as_when_loaded(archive, out, meta):
    index = archive / "recordings.parquet"
    table = pq.read_table(index)
    place = table.column_names.index("meta")
    pq.write_table(table.set_column(place, "meta", pa.array([None, meta] * 12, pa.string())), index)
    loaded = load(archive)
    assert quietly(archive, out).synthetic == loaded.is_synthetic
    assert Archive(archive).n_synthetic == sum(one.is_synthetic for one in loaded)


# What is refused.


def test_other_work_in_the_same_folder_is_refused_before_any_is_done(archive, out):
    quietly(archive, out)
    before, seen = files_in(out), []
    with pytest.raises(
        ValueError, match=r"holds other work already: sums 'sums' there, 'others' wanted; name another"
    ):
        quietly(archive, out, Sums("others", before=seen.append))
    assert (files_in(out), seen) == (before, [])


def test_other_recordings_in_the_same_folder_are_refused(archive, out, tmp_path):
    quietly(archive, out)
    other = some_archive(tmp_path / "other", some_recordings(seed=1))
    with pytest.raises(ValueError, match=r"holds recordings that .*other does not have"):
        quietly(other, out)


def test_work_that_an_archive_does_not_suit_makes_no_folder(tmp_path, out):
    data = some_recordings().select(axes=("fy", "fz"))
    with pytest.raises(ValueError, match="wanted fx"):
        quietly(some_archive(tmp_path / "a", data), out)
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"n_jobs": 0}, "n_jobs"),
        ({"scheduler": "tcp://host:8786", "n_jobs": 2}, "n_jobs must be None with a scheduler"),
    ],
)
def test_options_are_checked_first(archive, out, options, said):
    with pytest.raises((ValueError, TypeError), match=said):
        quietly(archive, out, **options)
    assert not out.exists()


# What goes wrong.


def test_a_row_group_that_cannot_be_read_fails_alone(archive, out, tmp_path):
    whole = quietly(archive, tmp_path / "whole")
    good = poison(archive, 3)
    with pytest.raises(
        PartitionError, match=r"1 of 6 partitions failed.*part-00000.parquet, row group 3"
    ) as caught:
        quietly(archive, out)
    done = caught.value.extraction
    assert (done.n_partitions, done.n_recordings, len(done.failures)) == (5, 20, 1)
    manifest = json.loads((out / "_manifest.json").read_bytes())
    assert [failure["name"] for failure in manifest["failures"]] == [done.failures[0].name]
    assert "row group 3" in manifest["failures"][0]["problem"]
    assert not list(out.glob(".*"))
    (archive / "samples" / "part-00000.parquet").write_bytes(good)
    repaired = quietly(archive, out)
    assert (repaired.n_resumed, repaired.sha256) == (5, whole.sha256)


def test_what_cannot_be_computed_is_named(archive, out):
    def fail(group):
        if group.row_group == 5:
            raise ZeroDivisionError("no wrench\nat all")

    with pytest.raises(PartitionError, match=r"samples/part-00000.parquet, row group 5: no wrench\\nat all"):
        quietly(archive, out, Sums(before=fail))


def test_a_full_disk_stops_all_and_leaves_nothing_half_written(archive, out):
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(OSError, match=r"cannot write .*/out/[0-9a-f]{32}\.parquet: File too large"):
            quietly(archive, out)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not out.exists()


def test_ctrl_c_leaves_whole_partitions_and_no_manifest(archive, out):
    def stop(done, total, what):
        if done == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(Archive(archive), Sums(), out, progress=stop)
    assert sorted(files_in(out)) == partitions_in(out)
    with pytest.raises(FileNotFoundError, match="not finished"):
        Features(out)
    assert quietly(archive, out).n_resumed >= 2

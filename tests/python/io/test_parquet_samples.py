"""The fast way through an archive: samples of a row group in a buffer, and what identifies the content."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from dataset_strategies import datasets
from effort import cases
from granular_id.archive import Archive
from granular_id.io import RecordingFileError
from granular_id.io.parquet.writing import save_parquet
from granular_id.recording import Dataset, Recording

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

RNG = np.random.default_rng(20)
PUSHES = [
    Recording(RNG.standard_normal((4 + i, 6)), rate_hz=500, label="rice", name=f"push {i}") for i in range(5)
]
INDEX, PART = "recordings.parquet", "samples/part-00000.parquet"


def saved(folder, recordings=PUSHES):
    return Archive(save_parquet(Dataset(recordings), folder, recordings_per_group=2))


def rewrite(path, table, **options):
    pq.write_table(table.replace_schema_metadata(pq.read_metadata(path).metadata), path, **options)


@settings(max_examples=cases(8))
@given(dataset=datasets(), per_group=st.integers(1, 4))
def test_samples_are_those_of_the_recordings_to_the_last_bit(tmp_path_factory, dataset, per_group):
    archive = Archive(save_parquet(dataset, tmp_path_factory.mktemp("a"), recordings_per_group=per_group))
    for group in archive.row_groups:
        wanted = np.concatenate([r.wrench for r in dataset.recordings[group.start : group.stop]])
        assert archive.samples(group).tobytes() == wanted.tobytes()


def test_a_buffer_that_is_large_enough_is_reused(tmp_path):
    archive = saved(tmp_path / "a")
    out = np.full((40, 6), np.nan)
    for group in archive.row_groups:
        samples = archive.samples(group, out)
        assert np.shares_memory(samples, out)
        assert samples.tobytes() == archive.samples(group).tobytes()


def test_a_buffer_that_is_too_short_is_left_alone(tmp_path):
    archive = saved(tmp_path / "a")
    out = np.zeros((3, 6))
    assert len(archive.samples(archive.row_groups[0], out)) == 9
    assert not out.any()


@pytest.mark.parametrize(
    "out", [np.zeros((99, 5)), np.zeros((99, 6), np.float32), np.zeros(99), np.zeros((6, 99)).T]
)
def test_a_buffer_of_another_kind_is_refused(tmp_path, out):
    archive = saved(tmp_path / "a")
    with pytest.raises(ValueError, match=r"out must be C-contiguous float64 of shape \(N, 6\), got float"):
        archive.samples(archive.row_groups[0], out)


def test_row_groups_larger_than_a_batch(tmp_path, monkeypatch):
    monkeypatch.setattr("granular_id.io.parquet.archive._BATCH_ROWS", 4)
    archive = saved(tmp_path / "a")
    assert (
        archive.samples(archive.row_groups[1]).tobytes()
        == np.vstack([r.wrench for r in PUSHES[2:4]]).tobytes()
    )
    assert archive.read(archive.row_groups[1]).recordings == tuple(PUSHES[2:4])


def test_samples_that_are_no_numbers_are_named(tmp_path):
    archive = saved(
        tmp_path / "a", [Recording(np.ones((5, 6)), rate_hz=5, name=f"push {i}") for i in range(4)]
    )
    path = archive.folder / PART
    fy = [1.0] * 17 + [float("nan"), 1, 1]
    rewrite(path, pq.ParquetFile(path).read().set_column(1, "fy", pa.array(fy)), row_group_size=10)
    archive.samples(archive.row_groups[0])
    with pytest.raises(RecordingFileError, match="sample 2 of recording 'push 3' is nan; wanted") as caught:
        archive.samples(archive.row_groups[1])
    assert (caught.value.place, caught.value.column) == ("row group 1", "fy")


def test_threads_share_an_archive(tmp_path):
    archive = saved(tmp_path / "a", PUSHES * 20)
    wanted = [archive.read(group) for group in archive.row_groups]
    wrong = []

    def read():
        out = np.empty((99, 6))
        for group, each in zip(archive.row_groups, wanted, strict=True):
            if archive.samples(group, out).tobytes() != np.vstack([r.wrench for r in each]).tobytes():
                wrong.append(group)

    threads = [threading.Thread(target=read) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def digests(folder, recordings=PUSHES):
    return [group.digest for group in saved(folder, recordings).row_groups]


def test_equal_archives_have_equal_digests(tmp_path):
    assert digests(tmp_path / "a") == digests(tmp_path / "b")
    assert Archive(tmp_path / "a").fingerprint == Archive(tmp_path / "b").fingerprint
    assert len(set(digests(tmp_path / "c"))) == 3


@pytest.mark.parametrize(
    "change",
    [
        {"wrench": PUSHES[2].wrench + 1e-12},
        {"label": "peas"},
        {"label": None},
        {"session": "mon"},
        {"name": "x"},
        {"start_time": 1.0},
        {"trigger_index": 1},
        {"rate_hz": 501.0},
        {"meta": {"a": 1}},
        {"flags": [1] * 6},
    ],
)
def test_a_change_of_one_recording_changes_the_digest_of_its_row_group_alone(tmp_path, change):
    old, new = (
        digests(tmp_path / "a"),
        digests(tmp_path / "b", [*PUSHES[:2], replace(PUSHES[2], **change), *PUSHES[3:]]),
    )
    assert [a == b for a, b in zip(old, new, strict=True)] == [True, False, True]
    assert Archive(tmp_path / "a").fingerprint != Archive(tmp_path / "b").fingerprint

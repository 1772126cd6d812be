"""``check``: what is damaged, missing, doubled or left over is named, and does not hide the rest."""

from dataclasses import replace

import numpy as np
import pytest

from granular_id.archive import Archive, Problem, append, check
from granular_id.io import RecordingFileError, save
from granular_id.io.parquet.writing import save_parquet
from granular_id.recording import Dataset, Recording

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

RNG = np.random.default_rng(9)
PUSHES = [
    Recording(RNG.standard_normal((5, 6)), rate_hz=500, label="rice", name=f"push {i}") for i in range(8)
]
PART = "samples/part-00000.parquet"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An archive of three files, with three row groups, one, and one."""
    monkeypatch.setattr("granular_id.io.parquet.writing.time.time", iter(range(9)).__next__)
    path = tmp_path / "archive"
    save_parquet(Dataset(PUSHES[:5]), path, recordings_per_group=2)
    append(path, Dataset(PUSHES[5:7]))
    append(path, Dataset(PUSHES[7:]))
    return path


def checked(folder, **options):
    return check(folder, progress=False, **options)


def rewrite(path, change, **options):
    labels = pq.read_metadata(path).metadata
    table = change(pq.ParquetFile(path).read())
    pq.write_table(table.replace_schema_metadata(labels), path, **options)


def flip(path, row_group):
    data = bytearray(path.read_bytes())
    column = pq.read_metadata(path).row_group(row_group).column(2)
    data[column.data_page_offset + column.total_compressed_size - 5] ^= 4
    path.write_bytes(data)


@pytest.mark.parametrize("n_jobs", [None, 2])
def test_a_sound_archive(folder, n_jobs):
    told = []
    report = check(folder, n_jobs=n_jobs, progress=lambda *step: told.append(step[:2]))
    assert report.ok
    assert (report.n_recordings, report.n_samples, report.n_files) == (8, 40, 3)
    assert (report.problems, report.leftovers) == ((), ())
    assert told == [(i, 5) for i in range(1, 6)]
    assert "8 recordings, 40 samples in 3 files" in str(report)
    assert str(report).endswith("recordings/s\nno problems")
    assert report == checked(Archive(folder))


def test_damaged_pages_do_not_hide_the_next_row_group(folder):
    flip(folder / PART, 0)
    flip(folder / PART, 2)
    report = checked(folder, n_jobs=2)
    assert not report.ok
    assert [(p.file, p.row_group) for p in report.problems] == [(PART, 0), (PART, 2)]
    assert all("CRC" in p.reason or "crc" in p.reason for p in report.problems)
    assert f"2 problems:\n  {PART}, row group 0: cannot be decoded" in str(report)


@pytest.mark.parametrize("share", [0, 0.5, 0.9])
def test_a_file_that_is_cut_off_is_named_once(folder, share):
    data = (folder / PART).read_bytes()
    (folder / PART).write_bytes(data[: int(len(data) * share)])
    (problem,) = checked(folder).problems
    assert (problem.file, problem.row_group) == (PART, None)


def test_a_file_that_is_missing_is_named_once(folder):
    (folder / PART).unlink()
    assert checked(folder).problems == (Problem(PART, None, "cannot be read: No such file or directory"),)


def test_samples_that_changed_have_another_digest(folder):
    rewrite(folder / PART, lambda t: t.set_column(0, "fx", pa.array(np.arange(25.0))), row_group_size=10)
    report = checked(folder)
    assert [p.row_group for p in report.problems] == [0, 1, 2]
    wanted = "2 recordings of 2 have another digest than recordings.parquet says, the first is 'push 0'"
    assert report.problems[0].reason == wanted


def test_samples_that_are_no_numbers_are_found(folder):
    fx = pa.array([1.0] * 12 + [float("nan")] + [1.0] * 12)
    rewrite(folder / PART, lambda t: t.set_column(0, "fx", fx), row_group_size=10)
    assert "sample 2) is nan" in checked(folder).problems[1].reason


def test_counts_that_differ_from_the_index_are_found(folder):
    rewrite(
        folder / "recordings.parquet",
        lambda t: t.set_column(t.column_names.index("n_samples"), "n_samples", [[5, 5, 4, 5, 5]]),
    )
    (problem,) = checked(folder).problems
    assert problem == Problem(PART, 1, "holds 10 samples; by recordings.parquet its recordings have 9")


def test_recordings_that_are_there_twice_are_found(folder, monkeypatch):
    monkeypatch.setattr("granular_id.io.parquet.writing._present", lambda *_: set())
    append(folder, Dataset([PUSHES[1], replace(PUSHES[2], name="other"), PUSHES[3]]))
    (problem,) = checked(folder).problems
    assert problem.row_group == 0
    reason = "holds 2 recordings that are in the archive already, the first is 'push 1' (recording 8 of all, also 1)"
    assert problem.reason == reason


def test_what_an_append_left_is_named_and_harms_nobody(folder):
    draft = ".0123456789abcdef0123-89abcdef01234567.parquet"
    for place in (f"samples/{'0' * 32}.parquet", f"samples/{draft}", f"recordings/{draft}"):
        (folder / place).write_bytes(b"x")
    report = checked(folder)
    assert report.ok
    assert report.leftovers == (f"samples/{draft}", f"samples/{'0' * 32}.parquet", f"recordings/{draft}")
    assert "3 files left by an append that was interrupted, or of one that is under way" in str(report)


def test_a_damaged_index_file_does_not_hide_the_others(folder):
    index = folder / Archive(folder).index_files[1]
    index.write_bytes(b"PAR1")
    report = checked(folder)
    assert (report.n_recordings, report.leftovers) == (6, ())
    assert [(p.file, p.row_group) for p in report.problems] == [(f"recordings/{index.name}", None)]


def test_an_archive_of_which_no_index_can_be_read(tmp_path):
    folder = save(Dataset(PUSHES), tmp_path / "a", "parquet")
    (folder / "recordings.parquet").write_bytes(b"")
    report = checked(folder)
    assert (report.n_recordings, [p.file for p in report.problems]) == (0, ["recordings.parquet"])


def test_many_problems_are_counted(folder):
    report = replace(checked(folder), problems=tuple(Problem(PART, i, "cut off") for i in range(25)))
    assert str(report).endswith(f"  {PART}, row group 19: cut off\n  and 5 more")


def test_what_is_no_archive_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file or folder"):
        checked(tmp_path / "a")
    with pytest.raises(RecordingFileError, match=r"recordings.parquet: cannot be read: No such file"):
        checked(tmp_path)


@pytest.mark.parametrize("options", [{"n_jobs": 0}, {"n_jobs": "all"}, {"progress": 3}])
def test_bad_arguments_are_named(folder, options):
    with pytest.raises((TypeError, ValueError), match=next(iter(options))):
        check(folder, **{"progress": False, **options})

"""``check``: what is damaged, missing, doubled or left over is named, and does not hide the rest."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from archive_cases import poison, rewrite, with_column
from granular_id.archive import Archive, append, check
from granular_id.io import RecordingFileError
from granular_id.io.parquet.writing import save_parquet
from granular_id.recording import Dataset, Recording

pa = pytest.importorskip("pyarrow")

RNG = np.random.default_rng(9)
PUSHES = [
    Recording(RNG.standard_normal((5, 6)), rate_hz=500, label="rice", name=f"push {i}") for i in range(8)
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An archive of three files, with three row groups, one, and one."""
    monkeypatch.setattr("granular_id.io.parquet.writing.time.time", iter(range(9)).__next__)
    path = tmp_path / "archive"
    save_parquet(Dataset(PUSHES[:5]), path, recordings_per_group=2)
    append(path, Dataset(PUSHES[5:7]))
    append(path, Dataset(PUSHES[7:]))
    return path


@pytest.fixture
def part(folder):
    """The file of samples with three row groups."""
    return folder / Archive(folder).row_groups[0].file


def checked(folder, **options):
    return check(folder, progress=False, **options)


def places(report):
    """File and row group of each problem."""
    return [(Path(problem.path).name, problem.place) for problem in report.problems]


def test_check_of_a_sound_archive_finds_nothing(folder):
    steps = []
    report = check(folder, n_jobs=2, progress=lambda *step: steps.append(step[:2]))
    assert (report.ok, report.n_recordings, report.problems, report.leftovers) == (True, 8, (), ())
    assert steps == [(i, 5) for i in range(1, 6)]
    assert str(report) == f"{folder}: 8 recordings, no problems"
    assert report == checked(Archive(folder))


def test_check_finds_damaged_pages_behind_each_other(folder, part):
    poison(part, 0)
    poison(part, 2)
    report = checked(folder, n_jobs=2)
    assert not report.ok
    assert places(report) == [(part.name, "row group 0"), (part.name, "row group 2")]
    assert all("crc" in p.problem.lower() for p in report.problems)
    assert f"3 of them unreadable, 2 problems\n  {part}, row group 0: cannot be decoded" in str(report)


@pytest.mark.parametrize("share", [None, 0, 0.5, 0.9])
def test_check_names_a_file_cut_off_or_missing_once(folder, part, share):
    data = part.read_bytes()
    part.unlink()
    if share is not None:
        part.write_bytes(data[: int(len(data) * share)])
    assert places(checked(folder)) == [(part.name, None)]


WRONG_SAMPLES = np.array([1.0] * 12 + [np.nan] + [1.0] * 12)


@pytest.mark.parametrize(
    ("of_index", "column", "values", "row_group", "message"),
    [
        (
            False,
            "fx",
            np.arange(25.0),
            0,
            "2 recordings of 2 have another digest than {index} says, .* 'push 0'",
        ),
        (False, "fx", WRONG_SAMPLES, 1, "sample 2 is nan; wanted finite numbers"),
        (True, "n_samples", [5, 5, 4, 5, 5], 1, "holds 10 samples; by {index} its recordings have 9"),
    ],
    ids=["digests", "nan", "counts"],
)
def test_check_finds_values_that_differ(folder, part, of_index, column, values, row_group, message):
    index = folder / f"recordings-{part.stem[5:]}.parquet"
    changed = with_column(column, pa.array(values))
    rewrite(index, changed) if of_index else rewrite(part, changed, row_group_size=10)
    problem = next(one for one in checked(folder).problems if one.place == f"row group {row_group}")
    with pytest.raises(RecordingFileError, match=message.format(index=index.name)):
        raise problem


def test_check_finds_recordings_that_are_there_twice(folder, monkeypatch):
    monkeypatch.setattr("granular_id.io.parquet.writing.Appender.update", lambda *_: None)
    append(folder, Dataset([PUSHES[1], replace(PUSHES[2], name="other"), PUSHES[3]]))
    (problem,) = checked(folder).problems
    assert problem.place == "row group 0"
    assert problem.problem.startswith("holds 2 recordings that are in the archive already")
    assert problem.problem.endswith("(recording 8 of all is also 1), the first is 'push 1'")


def test_check_names_what_a_killed_append_left(folder):
    draft = ".0123456789abcdef0123-89abcdef01234567.parquet"
    left = (draft, f"samples/{draft}", f"samples/part-{'0' * 32}.parquet")
    for place in left:
        (folder / place).write_bytes(b"x")
    report = checked(folder)
    assert (report.ok, report.leftovers) == (True, left)
    assert "3 files left by an append that was interrupted, or of one that is under way" in str(report)


def test_check_finds_a_damaged_index_and_the_others(folder):
    index = folder / f"recordings-{Archive(folder).keys[1]}.parquet"
    index.write_bytes(b"PAR1")
    report = checked(folder)
    assert (report.n_recordings, report.leftovers, places(report)) == (6, (), [(index.name, None)])
    for path in folder.glob("recordings-*"):
        path.write_bytes(b"")
    report = checked(folder)
    assert (report.n_recordings, len(report.problems)) == (0, 3)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"archive": "absent"}, FileNotFoundError, "no such file or folder"),
        ({"archive": "."}, RecordingFileError, r"is no archive: no recordings-\*.parquet lies in it"),
        ({"n_jobs": 0}, ValueError, "n_jobs"),
        ({"progress": 3}, TypeError, "progress"),
    ],
)
def test_check_of_what_cannot_be_is_refused(folder, monkeypatch, options, error, message):
    monkeypatch.chdir(folder.parent)
    with pytest.raises(error, match=message):
        check(**{"archive": folder, "progress": False, **options})

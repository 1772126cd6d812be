"""``load_parts``: what ``load`` gives, piece by piece."""

import numpy as np
import pytest

from granular_id.archive import Archive, append
from granular_id.io import RecordingFileError, load, load_parts, save
from granular_id.recording import Dataset, Recording, StepReport

RNG = np.random.default_rng(5)
PUSHES = [
    Recording(RNG.standard_normal((8 + i, 6)), rate_hz=10, label="ab"[i % 2], name=f"push {i}")
    for i in range(7)
]
HISTORY = [StepReport("made", {"by": "hand"})]


def written(tmp_path, format_, recordings=PUSHES):
    if format_ == "appended":
        pytest.importorskip("pyarrow")
        for start in range(0, len(recordings), 3):
            append(tmp_path / "data", Dataset(recordings[start : start + 3], HISTORY))
        return tmp_path / "data"
    if format_ == "parquet":
        pytest.importorskip("pyarrow")
    place = tmp_path / ("data.npz" if format_ == "npz" else "data")
    return save(Dataset(recordings, HISTORY), place, format_)


@pytest.mark.parametrize("format_", ["csv", "npz", "parquet", "appended"])
@pytest.mark.parametrize("n_recordings", [1, 3, 7, 100])
def test_pieces_are_the_recordings_and_history_of_load(tmp_path, format_, n_recordings):
    path = written(tmp_path, format_)
    parts, whole = list(load_parts(path, n_recordings=n_recordings)), load(path)
    assert [r for part in parts for r in part] == list(whole)
    assert [len(part) for part in parts[:-1]] == [n_recordings] * (len(parts) - 1)
    for part in parts:
        assert part.history[:-1] == whole.history[:-1] == tuple(HISTORY)
        assert part.history[-1].parameters == whole.history[-1].parameters
        assert part.history[-1].totals["recordings"] == len(part)


def test_an_archive_is_read_row_group_by_row_group(tmp_path, monkeypatch):
    path = written(tmp_path, "appended")
    read = []
    real = Archive.read
    monkeypatch.setattr(Archive, "read", lambda own, group: read.append(group.start) or real(own, group))
    parts = load_parts(path, n_recordings=2)
    next(parts)
    assert read == [0]
    next(parts)
    assert read == [0, 3]


def test_a_damaged_file_is_raised_where_it_stands(tmp_path):
    folder = written(tmp_path, "csv")
    last = sorted(folder.rglob("*6.csv"))[0]
    last.write_text("x\n")
    parts = load_parts(folder, n_recordings=2)
    assert len(next(parts)) == 2
    with pytest.raises(RecordingFileError) as caught:
        list(parts)
    assert caught.value.skippable


def test_skipped_files_are_listed_once_each(tmp_path):
    folder = written(tmp_path, "csv")
    for number in (1, 4, 7):
        next(folder.rglob(f"*{number}.csv")).write_text("x\n")
    parts = list(load_parts(folder, n_recordings=2, on_error="skip"))
    whole = load(folder, on_error="skip")
    assert [r for part in parts for r in part] == list(whole)
    skipped = [row for part in parts for row in part.history[-1].rows if "skipped" in row]
    assert skipped == [row for row in whole.history[-1].rows if "skipped" in row]


@pytest.mark.parametrize("n_recordings", [0, 1.5])
def test_a_number_of_recordings_that_cannot_be_is_refused(tmp_path, n_recordings):
    with pytest.raises((TypeError, ValueError), match="n_recordings must be"):
        load_parts(tmp_path, n_recordings=n_recordings)

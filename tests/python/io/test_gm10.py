"""Rows of GM10-ts and GM10-ts-Plus: recognised, read exactly, refused with line and column."""

import csv

import numpy as np
import pytest

from granular_id.evaluation import evaluate
from granular_id.io import RecordingFileError, load
from granular_id.io.gm10 import is_gm10

NAMES = "baysalt\nbroad bean\nsand\n"


def a_row(material=0, n=20, settings=(), seed=0):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.010, 0.022, n)).round(4).tolist()
    forces = np.abs(rng.normal(3, 1, n)).round(5).tolist()
    return [material, *settings, *times, *forces]


def write(path, *rows, end="\n"):
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator=end).writerows(rows)
    return path


def test_rows_of_gm10_ts(tmp_path):
    rows = [a_row(2, 20), a_row(0, 25, seed=1)]
    data = load(write(tmp_path / "HKUGM10_ts_train.csv", *rows))
    assert data.axes == ("force",)
    assert data.y.tolist() == ["2", "0"]
    for recording, row in zip(data, rows, strict=True):
        n = (len(row) - 1) // 2
        assert recording.wrench[:, 0].tolist() == row[1 + n :]
        times = np.array(row[1 : 1 + n])
        assert recording.time_s.tolist() == (times - times[0]).tolist()
        assert recording.rate_hz is None
        assert not recording.meta
    assert any("GM10-ts (id, times, forces)" in note for note in data.history[-1].notes)


def test_rows_of_gm10_ts_plus_carry_their_settings(tmp_path):
    row = [1, 0.7, 3, 6, *(np.arange(30) * 0.016).round(6).tolist(), *range(30)]
    (recording,) = load(write(tmp_path / "HKUGM10_ts_test1.csv", row, end="\r\n"))
    assert dict(recording.meta) == {"a": 0.7, "v": 3.0, "d": 6.0}
    assert (recording.n_samples, recording.rate_hz) == (30, 62.5)


def test_names_of_materials_beside_the_file(tmp_path):
    (tmp_path / "HKUGM10_ts.txt").write_text(NAMES)
    for split in ("train", "valid", "test1", "test2"):
        data = load(write(tmp_path / f"HKUGM10_ts_{split}.csv", a_row(1), a_row(2)))
        assert data.y.tolist() == ["broad bean", "sand"]
    with pytest.raises(RecordingFileError, match=r"line 1, column 1: the material's id is 3, .* has 3"):
        load(write(tmp_path / "HKUGM10_ts.csv", a_row(3)))


def test_a_list_of_names_that_is_none(tmp_path):
    path = write(tmp_path / "x_train.csv", a_row())
    for data in (b"\xff\xfe", b"a\n\nb\n"):
        (tmp_path / "x.txt").write_bytes(data)
        with pytest.raises(RecordingFileError, match=r"x\.txt: is no list of names"):
            load(path)
    (tmp_path / "x.txt").unlink()
    (tmp_path / "x.txt").symlink_to("/etc/hostname")
    with pytest.raises(RecordingFileError, match="link that leaves the folder"):
        load(path)


@pytest.mark.parametrize(
    ("row", "known"),
    [
        (a_row(3, 10), True),
        (a_row(3, 10, (1, 2, 3)), True),
        (a_row(3, 9), False),
        (a_row(0.5, 10), False),
        (a_row(-1, 10), False),
        ([0, *[1.0] * 20], False),
        ([f"c{i}" for i in range(30)], False),
        (["nan", *range(20)], False),
        ([], False),
    ],
)
def test_recognition(tmp_path, row, known):
    assert is_gm10(write(tmp_path / "a.csv", row)) is known


def changed(at, value):
    row = a_row(1)
    row[at] = value
    return row


@pytest.mark.parametrize(
    ("row", "column"),
    [
        (changed(5, "nan"), "6"),
        (changed(40, ""), "41"),
        (changed(7, ""), "8"),
        (changed(0, 1.5), "1"),
        (changed(0, -1), "1"),
        (changed(3, 0.0), "4"),
        (a_row(1)[:-1], None),
        (a_row(1, 4), None),
        ([], None),
        (["1" * 2_000_000], None),
    ],
)
def test_faults_are_named_by_line_and_column(tmp_path, row, column):
    with pytest.raises(RecordingFileError) as caught:
        load(write(tmp_path / "a.csv", a_row(), row, a_row()))
    assert (caught.value.line, caught.value.column) == (2, column)


def test_time_that_runs_back_is_repaired_where_asked_and_empty_lines_may_end_the_file(tmp_path):
    path = write(tmp_path / "a.csv", a_row(), changed(3, 0.0))
    path.write_bytes(path.read_bytes() + b"\r\n\n")
    data = load(path, on_time_error="repair")
    assert data.history[-1].rows[-1]["moved"]
    assert (np.diff(data[1].times()) > 0).all()


def test_one_axis_goes_through_the_spaces_and_the_evaluation(tmp_path):
    rows = [a_row(i % 3, 130, seed=i) for i in range(18)]
    data = load(write(tmp_path / "a.csv", *rows)).resample(62.5).align("shortest")
    drawn = {"train_per_class": 4, "test_per_class": 2, "n_partitions": 1}
    assert "raw+hfmh" in str(evaluate(data, ["raw+hfmh"], controls=False, **drawn))
